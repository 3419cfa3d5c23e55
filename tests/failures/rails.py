"""Where walks on a rail fail: slabs, culling as the paper does it, views between references."""

import tempfile
from functools import partial

import numpy as np

import cyclorama as cyc
from cyclorama.panorama import BuiltIn, Projection, kept_tiles

from . import Shown, failure
from .scenes import fence

MAGENTA = (255, 0, 255)


def halfway(slabs, length, pictures, name):
    """Share of holes of a view in the middle between two references."""
    scene = fence()
    paint = partial(cyc.quality.paint, grain=1.0)
    with tempfile.TemporaryDirectory() as folder:
        track = [(0.0, 0, 0), (length, 0, 0)]
        store = cyc.panorama.bake(
            BuiltIn(scene, texture=paint),
            track,
            slabs,
            (512, 128),
            out=folder,
            places=[0.0, 1.0],
            method=None,
            allow_outside=True,
            progress=False,
        )
        eye = np.array([length / 2, 0, 0])
        camera = cyc.Camera.look_at(eye, eye + [0, 0, -1], fov_y=50, width=160, height=120)
        seen = cyc.panorama.view(store, 0.5, camera)
    picture = seen.color.copy()
    picture[seen.hole] = MAGENTA
    pictures[name] = picture
    return float(seen.hole.mean())


@failure(
    "References too far apart",
    method="Between references",
    source="found here",
    remedy="`max_error=` places references where errors want them; the default spacing is a twentieth of the median "
    "range.",
)
def far_references():
    """Between two viewpoints posts hide parts of the wall from both. The farther apart, the more nobody saw."""
    pictures, holes = {}, {}
    for length in (0.8, 0.4, 0.2, 0.05):
        holes[length] = halfway(1, length, pictures, f"{length:g} apart")
    assert holes[0.8] > 0.01 and holes[0.05] < 0.25 * holes[0.8], holes
    return Shown(
        "distance between references, posts at 1, 0.5 apart",
        "share of pixels that are holes",
        {"holes": holes},
        f"0.8 apart {holes[0.8]:.1%} of the view is hole, 0.05 apart {holes[0.05]:.2%} (with one slab, below).",
        pictures,
    )


@failure(
    "One slab has nothing behind what is near",
    method="Panoramas: slabs",
    source="found here: what slabs are for",
    remedy="Slabs are cut in the valleys of the histogram of ranges; each keeps what it shows behind nearer ones.",
)
def one_slab():
    """A panorama of one slab has one surface a pixel. Cut between the posts and the wall, the second slab has the wall
    behind the posts, too."""
    pictures, curve = {}, {}
    for slabs, cuts in ((1, 1), (2, [2.5]), (3, [2.5, 8.0])):
        curve[slabs] = halfway(cuts, 0.8, pictures, f"slabs: {slabs}")
    assert curve[1] > 0.01 and curve[2] < 0.2 * curve[1], curve
    return Shown(
        "slabs",
        "share of pixels that are holes",
        {"holes": curve},
        f"With one slab {curve[1]:.1%} of the view is hole, with two {curve[2]:.2%}.",
        pictures,
    )


def hidden_tiles(panorama, wall, near, far, eyes):
    """By brute force: tiles of 8 columns at `far` of which all eyes see nothing for the wall at `near`."""
    ways = panorama.directions()[36]
    ways = ways / np.linalg.norm(ways[:, [0, 2]], axis=1, keepdims=True)
    angles = np.arctan2(ways[:, 2], ways[:, 0])
    order = np.argsort(angles)
    hidden = np.ones(len(ways), bool)
    for eye in eyes:
        way = (far * ways - eye)[:, [0, 2]]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        start = eye[[0, 2]]
        along = -way @ start + np.sqrt((way @ start) ** 2 - start @ start + near**2)
        at = start + along[:, None] * way
        place = np.searchsorted(angles[order], np.arctan2(at[:, 1], at[:, 0]))
        hidden &= wall[order[place % len(order)]]
    return hidden.reshape(-1, 8).all(axis=1)


@failure(
    "Occluders are not at their slab's far end",
    method="Panoramas: culling by the paper",
    source="2003: extended projections; found here not to be conservative",
    remedy='`method="exact"`, the default, shrinks each occluder by its own shift, and extends what lies behind.',
)
def culling_by_the_paper():
    """The paper puts occluders at their slab's far end. What is nearer shifts more when the eye moves aside: by
    b (1 / h - 1 / h2) radians; so tiles are dropped that an eye sees beside the occluder."""
    panorama = Projection(size=(1024, 64))
    slabs, aside, far = [(0.0, 1000.0), (1000.0, np.inf)], 50.0, 5000.0
    eyes = np.array([[aside, 0, 0], [-aside, 0, 0]])
    curves = {"the paper's way": {}, "exact": {}}
    for near in (100, 200, 400, 900):
        wall = np.zeros((64, 1024), np.float32)
        wall[:, 312:712] = 1 / near
        behind = np.full_like(wall, 1 / far)
        hidden = hidden_tiles(panorama, wall[36] > 0, near, far, eyes)
        for curve, method in zip(curves.values(), ("paper", "exact"), strict=True):
            keep = kept_tiles(panorama, [wall, behind], slabs, eyes, tile=8, method=method)[1]
            curve[near] = float((~keep[4] & ~hidden).sum())
    paper, exact = curves.values()
    assert paper[100] > paper[200] > paper[900], curves
    assert paper[100] >= 4 and paper[900] == 0, curves
    assert max(exact.values()) == 0, curves
    return Shown(
        "distance of the occluder, slab's end at 1000",
        "tiles a row dropped that are seen",
        curves,
        f"With the occluder at 100 {paper[100]:.0f} tiles of a row are dropped that some eye sees; none by "
        "the exact way.",
    )
