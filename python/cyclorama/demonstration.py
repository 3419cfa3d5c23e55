"""The demo: a mesh is baked, rebuilt from what one eye may see, judged, and drawn; needs matplotlib."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .bakes.baking import bake
from .bakes.evaluation import evaluate
from .bakes.visibility import Visibility
from .camera import Camera
from .files import whole_file
from .framing import Framing
from .progress import Progress
from .render import BACKGROUND
from .scene import Scene
from .tradeoff import file_bytes, tradeoff

__all__ = ["picture", "run"]

#: Where the demo looks from, and from where it then looks at what was left out: from behind and to the side.
TOWARD_EYE = (0.45, 0.4, 0.8)
TOWARD_SIDE = (-0.80, 0.40, -0.45)

#: A surface without a colour of its own, one that is left out, and the paper, as shares of red, green and blue.
SURFACE, LEFT_OUT, PAPER = np.array([0.42, 0.56, 0.74]), np.array([0.84, 0.88, 0.94]), np.ones(3)

#: How much of what is behind a face that is left out its picture hides.
CLOUDINESS = 0.72

Image = npt.NDArray[np.float64]


def run(
    scene: Scene, name: str, out: Path, *, views: int = 66, seed: int = 0, progress: Progress = None
) -> dict[str, Any]:
    """Bakes, rebuilds, judges and draws a scene; writes `demo.png` and `tradeoff.png` into a folder.

    Parameters
    ----------
    scene : Scene
    name : str
        What the pictures call it.
    out : Path
        A folder that is there.
    views : int
        Samples of the bake.
    seed : int
        Of the views that judge it.
    progress : bool, callable or None
        As everywhere.

    Returns
    -------
    dict
        Figures by name, in the order to print them.
    """
    start = time.perf_counter()
    vis = bake(scene, views, progress=progress)
    baked = time.perf_counter()
    report = evaluate(vis, scene, views=50, seed=seed, progress=progress)
    chart = tradeoff(
        scene,
        [6, 18, 66],
        [None, 1000, 200],
        resolution=(255, 240),
        join=["samples", "cells"],
        eval_views=50,
        seed=seed,
        progress=progress,
    )
    picture(scene, vis, name, out / "demo.png")
    chart.plot(out / "tradeoff.png")
    low, high = report.interval
    return {
        "faces": f"{len(scene):,}",
        "samples": f"{len(vis):,}",
        "bake": f"{baked - start:.1f} s",
        "culled": f"{vis.culling_rate():.1%} of the faces on average over all directions; "
        f"over {len(report.missed)} random views {report.backfacing.mean():.1%} face away, "
        f"{report.occluded.mean():.1%} are hidden",
        "missed": f"{report.mean_missed:.2g} of the pixels on average over these views "
        f"(95 % interval {low:.1g} to {min(high, report.bound):.1g})",
        "file": f"{file_bytes(vis):,} bytes",
        "pictures": f"{out / 'demo.png'}, {out / 'tradeoff.png'}",
        "all of it": f"{time.perf_counter() - start:.0f} s",
    }


def picture(scene: Scene, vis: Visibility, name: str, path: Path) -> None:
    """Draws the whole model, its reconstruction from the eye, and the same reconstruction from the side."""
    from matplotlib.figure import Figure

    framing = Framing.of(scene, (1020, 960), 32.0)
    eye, side = framing.cameras(np.array([TOWARD_EYE, TOWARD_SIDE]))
    faces = vis.visible_faces(eye.eye)
    whole, kept = _shaded(scene, eye, None), _shaded(scene, eye, faces)
    beside = _shaded(scene, side, faces, ghost=True)
    differ = int(np.count_nonzero(_halved(np.abs(whole - kept)).max(axis=-1) > 0))
    captions = (
        f"{name}: all {len(scene):,} faces",
        f"what the eye may see: {len(faces):,} faces, "
        + ("no pixel differs" if differ == 0 else f"{differ:,} pixels differ"),
        f"the same from the side: {1 - len(faces) / len(scene):.0%} left out (pale)",
    )
    figure = Figure(figsize=(15.6, 5.6), layout="constrained", facecolor="white")
    for panel, image, caption in zip(figure.subplots(1, 3), (whole, kept, beside), captions, strict=True):
        panel.imshow(_halved(image), interpolation="lanczos")
        panel.set_title(caption, fontsize=13, color="#222222", y=-0.08)
        panel.set_axis_off()
    with whole_file(path) as file:
        figure.savefig(file, dpi=100, format="png")


def _shaded(scene: Scene, camera: Camera, faces: npt.NDArray[np.uint32] | None, *, ghost: bool = False) -> Image:
    """(H, W, 3) in [0, 1]; `ghost` also shows the faces that are left out, as pale glass before the others."""
    image = _lit(scene, camera, scene.render(camera, faces).ids, _surface(scene))
    if ghost:
        ids = scene.render(camera).ids
        kept = np.zeros(len(scene), dtype=bool)
        kept[faces] = True
        glass = ids != BACKGROUND
        glass[glass] = ~kept[ids[glass]]
        before = _lit(scene, camera, np.where(glass, ids, BACKGROUND), np.broadcast_to(LEFT_OUT, (len(scene), 3)))
        image[glass] += CLOUDINESS * (before[glass] - image[glass])
    return image


def _lit(scene: Scene, camera: Camera, ids: npt.NDArray[np.uint32], colors: Image) -> Image:
    """Light from above the viewer's left shoulder, on both sides of each face."""
    image = np.broadcast_to(PAPER, (*ids.shape, 3)).copy()
    hit = ids != BACKGROUND
    seen, which = np.unique(ids[hit], return_inverse=True)
    corners = (scene.vertices - scene.center)[scene.faces[seen]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    normals = normals @ camera.world_to_camera[:3, :3].T
    normals[normals[:, 2] > 0] *= -1
    light = np.array([-0.45, -0.65, -0.75])
    diffuse = np.clip(normals @ (light / np.linalg.norm(light)), 0, 1)
    shade = 0.32 + 0.62 * diffuse + 0.06 * np.abs(normals[:, 2])
    image[hit] = np.clip(colors[seen] * 1.25 * shade[:, None], 0, 1)[which]
    return image


def _surface(scene: Scene) -> Image:
    if scene.colors is None:
        return np.broadcast_to(SURFACE, (len(scene), 3))
    colors = scene.colors / 255.0
    return np.asarray(colors[scene.faces].mean(axis=1) if len(colors) == len(scene.vertices) else colors)


def _halved(image: Image) -> Image:
    """Every pixel the mean of 2 x 2."""
    height, width = image.shape[:2]
    return np.asarray(image.reshape(height // 2, 2, width // 2, 2, -1).mean(axis=(1, 3)))
