"""Sweeps of each method with `lab`: rows of what a setting takes, and how far from the truth it is.

The truth is always the whole scene, drawn for the same camera with a texture that is the same from everywhere
(`quality.textured`): no method has a say in it. Bakes are swept by `tradeoff`. Each function gives rows for
`lab.table`, `lab.pareto`, `lab.best`, `lab.draw` and `lab.save`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from . import lab, quality, warp
from .camera import Camera
from .depth_image import DepthImage
from .ldi import LayeredDepthImage
from .panorama import BuiltIn, Track
from .panorama import bake as bake_walk
from .panorama import view as view_walk
from .placement import place_images
from .portals import Building, PortalImages
from .portals.drawing import draw as draw_portals
from .progress import Progress
from .scene import Scene

__all__ = ["budgets", "construction", "panoramas", "portal_images", "warps"]

Grain = float | None


def warps(
    scene: Scene,
    camera: Camera,
    targets: Sequence[Camera],
    *,
    splats: Sequence[Any] = (1, 3, "disparity", "mesh"),
    orders: Sequence[str] = ("occlusion", "zbuffer"),
    rounds: int = 5,
    grain: Grain = None,
    progress: Progress = None,
) -> list[lab.Row]:
    """One picture with depth seen from elsewhere, with each splat in each order.

    Parameters
    ----------
    scene : Scene
    camera : Camera
        Of the picture.
    targets : sequence of Camera
        Views that it is warped to; figures are means over them.
    splats, orders : sequence
        As for `warp.forward`.
    rounds : int
        In which the settings take turns to be timed.
    grain : float, optional
        Of the texture, in scene units.

    Returns
    -------
    list of dict
        `splat`, `order`, `rms` (root mean square of what is shown, of 255), `holes` and `cracks` (shares of pixels),
        `time` in seconds for all targets, `times`.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> here, there = (cyc.Camera.look_at((x, 0, 3), (0, 0, 0), width=64, height=48) for x in (0, 0.2))
    >>> rows = warps(cyc.scenes.sphere(faces=320), here, [there], splats=[1, "mesh"], orders=["zbuffer"], rounds=1)
    >>> [row["splat"] for row in rows]
    [1, 'mesh']
    """
    image = quality.textured(scene, camera, grain=grain)
    truths = [quality.textured(scene, target, grain=grain) for target in targets]
    known = [quality.seen(scene, truth, camera) for truth in truths]

    def measure(splat: Any, order: Any) -> lab.Row:
        out = [warp.forward(image, target, splat=splat, order=order) for target in targets]
        cracks = [quality.compare(w, t, k).cracks for w, t, k in zip(out, truths, known, strict=True)]
        return _figures(out, truths) | {"cracks": float(np.mean(cracks))}

    def timed(splat: Any, order: Any) -> Callable[[], object]:
        return lambda: [warp.forward(image, target, splat=splat, order=order) for target in targets]

    grid = {"splat": splats, "order": orders}
    return lab.sweep(grid, measure, timed=timed, rounds=rounds, progress=progress, desc="warps")


def construction(
    scene: Scene,
    cameras: Sequence[Camera],
    targets: Sequence[Camera],
    *,
    merged: Sequence[int] = (0, 2, 4, 8),
    rounds: int = 5,
    grain: Grain = None,
    progress: Progress = None,
) -> list[lab.Row]:
    """A layered image of the first camera, with the first so many of the others merged into it.

    Returns
    -------
    list of dict
        `merged`, `rms` and `holes` as in `warps`, `bytes`, `samples`, `time` of warping to all targets, `times`.
    """
    images = [quality.textured(scene, camera, grain=grain) for camera in cameras]
    truths = [quality.textured(scene, target, grain=grain) for target in targets]
    layered = {count: LayeredDepthImage.build(images[0], images[1 : 1 + count]) for count in merged}

    def measure(merged: int) -> lab.Row:
        image = layered[merged]
        figures = _figures([image.warp(target) for target in targets], truths)
        return figures | {"bytes": image.nbytes, "samples": image.samples}

    def timed(merged: int) -> Callable[[], object]:
        return lambda: [layered[merged].warp(target) for target in targets]

    return lab.sweep({"merged": merged}, measure, timed=timed, rounds=rounds, progress=progress, desc="construction")


def budgets(
    scene: Scene,
    shares: Sequence[float],
    *,
    methods: Sequence[str] = ("cover",),
    frames: int = 50,
    seed: int = 0,
    progress: Progress = None,
    **options: Any,
) -> list[lab.Row]:
    """What a budget costs in images, by each optimiser.

    Parameters
    ----------
    scene : Scene
    shares : sequence of float
        Budgets as shares of the scene's faces.
    methods : sequence of str
        As for `place_images`.
    frames : int
        Random frames that each plan is checked on.
    **options
        Passed on to `place_images`.

    Returns
    -------
    list of dict
        `share`, `method`, `budget`, `images`, `viewpoints`, `drawn` (the most of any checked frame),
        `distance` (median, from an eye to its image's viewpoint); or `error`, where the budget can't be promised.
    """

    def measure(share: float, method: Any) -> lab.Row:
        budget = int(share * len(scene))
        plan = place_images(scene, budget, method=method, progress=False, **options)
        found = plan.check(frames, seed=seed, progress=False)
        return {
            "budget": budget,
            "images": len(plan.images),
            "viewpoints": len(plan.viewpoints),
            "drawn": int(found.most),
            "distance": float(found.median_distance),
        }

    return lab.sweep({"share": shares, "method": methods}, measure, progress=progress, desc="budgets")


def panoramas(
    scene: Scene,
    track: npt.ArrayLike | Track,
    *,
    slabs: Sequence[int] = (1, 2, 3),
    spacing: Sequence[float] = (0.4, 0.2, 0.1),
    alpha: Sequence[float] = (1.0,),
    ahead: Iterable[npt.ArrayLike] = ((1, 0, 0), (0, 0, 1)),
    size: tuple[int, int] = (512, 128),
    grain: Grain = None,
    progress: Progress = None,
    **options: Any,
) -> list[lab.Row]:
    """Walks with so many slabs, references so far apart, tiles dropped at `alpha`: seen half-way between references.

    Returns
    -------
    list of dict
        `slabs`, `spacing`, `alpha`, `references`, `bytes` of the folder, `rms` and `holes` as in `warps`.
    """
    paint = partial(quality.paint, grain=scene.radius / 20 if grain is None else grain)
    gazes = [np.asarray(gaze, float) for gaze in ahead]

    def measure(slabs: int, spacing: float, alpha: float) -> lab.Row:
        with tempfile.TemporaryDirectory() as folder:
            renderer = BuiltIn(scene, texture=paint)
            walk = bake_walk(
                renderer, track, slabs, size, alpha=alpha, spacing=spacing, out=folder, progress=False, **options
            )
            middle = (walk.references[0].t + walk.references[1].t) / 2
            eye = walk.track.at(float(middle))
            cameras = [Camera.look_at(eye, eye + gaze, fov_y=50, width=128, height=96) for gaze in gazes]
            seen = [view_walk(walk, float(middle), camera) for camera in cameras]
            points = [DepthImage.from_view(scene.render(camera)).points() for camera in cameras]
            known = [np.isfinite(at).all(axis=-1) for at in points]
            off = [(s.color.astype(float) - paint(p))[k & ~s.hole] for s, p, k in zip(seen, points, known, strict=True)]
            holes = [float((s.hole & k).mean()) for s, k in zip(seen, known, strict=True)]
            return {
                "references": len(walk),
                "bytes": walk.bytes,
                "rms": float(np.sqrt(np.mean(np.concatenate(off) ** 2))),
                "holes": float(np.mean(holes)),
            }

    grid = {"slabs": slabs, "spacing": spacing, "alpha": alpha}
    return lab.sweep(grid, measure, progress=progress, desc="walks")


def portal_images(
    building: Building,
    cameras: Sequence[Camera],
    *,
    kinds: Sequence[Any] = ("static", "warped", "layered"),
    steps: Sequence[float] = (30, 10),
    size: tuple[int, int] = (96, 96),
    progress: Progress = None,
) -> list[lab.Row]:
    """Pictures in doors of each kind, taken every so many degrees.

    Returns
    -------
    list of dict
        `kind`, `step`, `images`, `faces` drawn a frame (mean), `portals` (faces without pictures, through portals),
        `rms` (root mean square of pixels that show pictures, of 255).
    """
    through = [len(building.visible(camera)) for camera in cameras]

    def measure(kind: Any, step: float) -> lab.Row:
        images = PortalImages(building, kind, step=step, size=size)
        off, faces = [], []
        for camera in cameras:
            drawn = draw_portals(images, camera)
            shown = drawn.portal >= 0
            truth = images.color(building.scene.render(camera))
            off.append((drawn.color[shown].astype(float) - truth[shown]).ravel())
            faces.append(len(drawn.frame.faces))
        pixels = np.concatenate(off)
        return {
            "images": len(images),
            "faces": float(np.mean(faces)),
            "portals": float(np.mean(through)),
            "rms": float(np.sqrt(np.mean(pixels**2))) if len(pixels) else 0.0,
        }

    return lab.sweep({"kind": kinds, "step": steps}, measure, progress=progress, desc="portal images")


def _figures(out: Sequence[Any], truths: Sequence[DepthImage]) -> lab.Row:
    off = [(w.color.astype(float) - t.color)[~w.hole & ~t.missing].ravel() for w, t in zip(out, truths, strict=True)]
    holes = [(w.hole & ~t.missing).sum() / max(1, (~t.missing).sum()) for w, t in zip(out, truths, strict=True)]
    return {"rms": float(np.sqrt(np.mean(np.concatenate(off) ** 2))), "holes": float(np.mean(holes))}
