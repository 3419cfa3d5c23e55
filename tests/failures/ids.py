"""Where id-buffers fail: faces between samples, and faces that share a place."""

import numpy as np

import cyclorama as cyc
from reference.truth import Truth

from . import Shown, failure


@failure(
    "A bare id-buffer loses small faces",
    method="Id-buffers",
    source="measured here: 9 to 96 % of the visible faces of real models",
    remedy='`fill="rays"`, the default, proves faces without a pixel visible at points on them.',
)
def faces_without_a_pixel():
    """A face that lies between pixel centres owns none. Of a plant with many small leaves most are lost."""
    scene = cyc.scenes.tree(faces=3000)
    bare, filled = {}, {}
    for width in (32, 64, 128, 256):
        camera = cyc.Camera.look_at(scene.center + [0, 0, 3 * scene.radius], scene.center, width=width, height=width)
        view = Truth(scene.vertices, scene.faces).view(camera)
        for curve, fill in ((bare, None), (filled, "rays")):
            answer = scene.visible([camera], fill=fill, progress=False).unpack()[0]
            curve[width] = float((view.visible & ~answer).sum() / view.visible.sum())
    assert bare[32] > 0.6 and bare[32] > bare[64] > bare[128] > bare[256]
    assert all(filled[width] < bare[width] / 8 for width in bare) and filled[256] < 0.01
    return Shown(
        "pixels across",
        "share of the visible faces missed",
        {"pixel centres only": bare, 'fill="rays"': filled},
        f"At 32 pixels {bare[32]:.0%} of the faces that rays find own no pixel, at 256 {bare[256]:.0%}; "
        f"with rays {filled[32]:.1%} and {filled[256]:.1%} are missed.",
    )


@failure(
    "Faces in the same place",
    method="Id-buffers",
    source="meshes with duplicated faces",
    remedy="Ties go to the lower id, from everywhere: the answer is stable, and the other face counts as hidden.",
)
def coincident_faces():
    """Of two sheets in one place one is seen. Nearness is kept to 26 bits: nearer than
    4 / 2^26 at a distance of 4 they still tie."""
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    camera = cyc.Camera.look_at((0, 0, 4), (0, 0, 0), width=32, height=32)
    curve = {}
    for gap in (0.0, 1e-9, 2e-7, 1e-6):
        vertices = np.concatenate([square, square + [0, 0, gap]])
        scene = cyc.Scene(vertices, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
        ids = scene.render(camera).ids
        curve[f"{gap:g}"] = float((ids[ids != cyc.BACKGROUND] < 2).mean())
    assert curve["0"] == curve["1e-09"] == 1 and curve["2e-07"] == curve["1e-06"] == 0
    return Shown(
        "distance between the sheets, of 4 to the eye",
        "share of pixels that name the farther sheet",
        {"farther sheet has the lower id": curve},
        "The farther sheet is named where they are 1e-9 apart, at a distance of 4, and no longer at 2e-7.",
    )
