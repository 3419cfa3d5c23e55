"""Sweeps of each method with `lab`: rows of what a setting takes, and how far from the truth it is.

The truth is always the whole scene, drawn for the same camera with a texture that is the same from everywhere
(`quality.textured`): no method has a say in it. Bakes are swept by `tradeoff`. Each function gives rows for
`lab.table`, `lab.pareto`, `lab.best`, `lab.draw` and `lab.save`.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import lab, quality, warp
from .arguments import checked_number, checked_sequence
from .camera import Camera
from .depth_image import DepthImage
from .ldi import LayeredDepthImage
from .panorama import BuiltIn, Track
from .panorama import bake as bake_walk
from .panorama import view as view_walk
from .placement import cells, lattice, optimise, place_images, star_radius
from .placement.optimising import Subset
from .portals import Building, PortalImages
from .portals.drawing import draw as draw_portals
from .progress import Progress
from .scene import Scene

__all__ = ["budgets", "construction", "optimisers", "panoramas", "portal_images", "star_shapes", "warps"]

Grain = float | None
Floats = npt.NDArray[np.float64]


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
        `splat`, `order`, `rms` (root mean square of what is shown, of 255; None if nothing is), `holes` and `cracks`
        (shares of pixels), `time` in seconds for all targets, `times`.

    Raises
    ------
    ValueError
        If there is no target, or one is no camera.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> here, there = (cyc.Camera.look_at((x, 0, 3), (0, 0, 0), width=64, height=48) for x in (0, 0.2))
    >>> rows = warps(cyc.scenes.sphere(faces=320), here, [there], splats=[1, "mesh"], orders=["zbuffer"], rounds=1)
    >>> [row["splat"] for row in rows]
    [1, 'mesh']
    """
    targets = _some("targets", targets)
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
    splats: Sequence[Any] = (3,),
    rounds: int = 5,
    grain: Grain = None,
    progress: Progress = None,
) -> list[lab.Row]:
    """A layered image of the first camera, with the first so many of the others merged into it, by splat.

    Returns
    -------
    list of dict
        `merged`, `splat`, `rms` and `holes` as in `warps`, `bytes`, `samples`, `time` of warping to all targets,
        `times`.

    Raises
    ------
    ValueError
        If there is no camera or no target, or one is no camera.
    """
    cameras, targets = _some("cameras", cameras), _some("targets", targets)
    images = [quality.textured(scene, camera, grain=grain) for camera in cameras]
    truths = [quality.textured(scene, target, grain=grain) for target in targets]
    layered = {count: LayeredDepthImage.build(images[0], images[1 : 1 + count]) for count in merged}

    def measure(merged: int, splat: Any) -> lab.Row:
        image = layered[merged]
        figures = _figures([image.warp(target, splat) for target in targets], truths)
        return figures | {"bytes": image.nbytes, "samples": image.samples}

    def timed(merged: int, splat: Any) -> Callable[[], object]:
        return lambda: [layered[merged].warp(target, splat) for target in targets]

    return lab.sweep(
        {"merged": merged, "splat": splats}, measure, timed=timed, rounds=rounds, progress=progress, desc="construction"
    )


def budgets(
    scene: Scene,
    shares: Sequence[float],
    *,
    methods: Sequence[str] = ("cover",),
    targets: Sequence[float] = (0.8,),
    vary: Mapping[str, Sequence[Any]] | None = None,
    frames: int = 50,
    seed: int = 0,
    progress: Progress = None,
    **options: Any,
) -> list[lab.Row]:
    """What a budget costs in images, by each optimiser and its settings.

    Parameters
    ----------
    scene : Scene
    shares : sequence of float
        Budgets as shares of the scene's faces.
    methods : sequence of str
        As for `place_images`.
    targets : sequence of float
        `optimize_to` (P_opt) as shares of the budget.
    vary : mapping of str to sequence, optional
        Values of any other options of `place_images`: ``{"lookahead": [0, 1, 2]}``, `star_shape`, `leaf_depth`.
    frames : int
        Random frames that each plan is checked on.
    **options
        Passed on to `place_images` as they are.

    Returns
    -------
    list of dict
        `share`, `method`, `target` and what `vary` names; `budget`, `images`, `viewpoints`, `seconds` to place them
        (one run), `not_proved` (frames that the paper's star-shapes leave so, in parts of the proof), `drawn` (the most
        of any checked frame), `wrong` (checked frames that draw too much or lose something), `distance` (median, from
        an eye to its image's viewpoint); or `error`, where the budget can't be promised.
    """

    def measure(share: float, method: Any, target: float, **chosen: Any) -> lab.Row:
        budget = int(checked_number("share", share) * len(scene))
        place = partial(place_images, scene, budget, int(target * budget), method=method, progress=False)
        plan, seconds = lab.elapsed(partial(place, **options, **chosen))
        found = plan.check(frames, seed=seed, progress=False)
        return {
            "budget": budget,
            "images": len(plan.images),
            "viewpoints": len(plan.viewpoints),
            "seconds": seconds,
            "not_proved": plan.gaps,
            "wrong": found.violations,
            "drawn": int(found.most),
            "distance": float(found.median_distance),
        }

    grid = {"share": shares, "method": methods, "target": targets, **(vary or {})}
    return lab.sweep(grid, measure, progress=progress, desc="budgets")


#: How a search is set, one after the other: the paper's by look-ahead, then two that are not in it.
SEARCHES: tuple[Mapping[str, Any], ...] = (
    *({"search": "paper", "lookahead": q} for q in (0, 1, 2, 3)),
    {"search": "annealing", "steps": 5000},
    {"search": "windows"},
)


def optimisers(
    scene: Scene,
    shares: Sequence[float],
    *,
    searches: Sequence[Mapping[str, Any]] = SEARCHES,
    views: int = 20,
    leaf_depth: int = 5,
    rounds: int = 3,
    seed: int = 0,
    progress: Progress = None,
    **options: Any,
) -> list[lab.Row]:
    """What each search finds for one image to replace, and how long it looks.

    Parameters
    ----------
    scene : Scene
    shares : sequence of float
        What an image may leave to draw (P_opt), as shares of the scene's faces.
    searches : sequence of mappings
        Options of `placement.optimise`, a search each.
    views : int
        Viewpoints, drawn at random with level gazes, of which those count that need an image.
    leaf_depth : int
        Of the cells.
    rounds : int
        In which the searches take turns to be timed.
    seed : int
        Of the views.
    **options
        Of all searches.

    Returns
    -------
    list of dict
        `share`, the search's options; `views` that need an image, `solved` of them, the mean `value` of these images,
        `short`, by how much that is less than any image's can be (mean, at most: the bound of the "windows" search; a
        view without an image is worth nothing), `near`, the share of images that leave at least 98 % of what they may;
        `time` for all views, `times`.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> rows = optimisers(cyc.scenes.pipes(5_000), [0.3], views=3, leaf_depth=3, rounds=1, progress=False)
    >>> [row.get("lookahead") for row in rows]
    [0, 1, 2, 3, None, None]
    """
    tree = cells(scene, leaf_depth)
    low, high = scene.bounds
    rng = np.random.default_rng(seed)
    looks = []
    for _ in range(views):
        yaw = rng.uniform(0, 2 * np.pi)
        forward = np.array([np.cos(yaw), 0.0, np.sin(yaw)])
        looks.append((rng.uniform(low, high) - 0.3 * (high - low) * forward, forward))

    def find(share: float, **chosen: Any) -> list[Subset | None]:
        boxes = tree.low, tree.high, tree.counts
        target = int(share * len(scene))
        return [optimise(*boxes, *look, target=target, **{**options, **chosen}) for look in looks]

    # The one search that knows a bound says which views need an image, and how good one can be.
    best = {share: find(share, search="windows") for share in shares}

    def measure(share: float, **chosen: Any) -> lab.Row:
        target = int(share * len(scene))
        pairs = [
            (f, b.bound) for f, b in zip(find(share, **chosen), best[share], strict=True) if b and b.total > target
        ]
        solved = [f for f, _ in pairs if f is not None]
        short = [bound - (f.value if f is not None else 0.0) for f, bound in pairs]
        return {
            "views": len(pairs),
            "solved": len(solved),
            "value": float(np.mean([f.value for f in solved])) if solved else None,
            "short": float(np.mean(short)) if short else None,
            "near": float(np.mean([f.remaining >= 0.98 * target for f in solved])) if solved else None,
        }

    def timed(share: float, **chosen: Any) -> Callable[[], object]:
        return partial(find, share, **chosen)

    grid = [{"share": share, **search} for share, search in itertools.product(shares, searches)]
    return lab.sweep(grid, measure, timed=timed, rounds=rounds, progress=progress, desc="optimisers")


def star_shapes(
    fovs: Sequence[float],
    *,
    levels: Sequence[Literal["even", "odd"]] = ("even", "odd"),
    yaws: Sequence[tuple[float, float]] = ((0.0, 360.0),),
    tolerances: Sequence[float] = (0.02,),
    aspect: float = 4 / 3,
    eyes: int = 4000,
    seed: int = 0,
    progress: Progress = None,
) -> list[lab.Row]:
    """How far eyes are that a viewpoint of a grid serves, proved, beside the dissertation's spheres and sampled eyes.

    Parameters
    ----------
    fovs : sequence of float
        Horizontal fields of view in degrees.
    levels, yaws, tolerances
        As for `placement.star_radius`.
    aspect : float
        Width over height.
    eyes : int
        Sampled before a viewpoint, with level gazes.
    seed : int
        Of the sample.

    Returns
    -------
    list of dict
        `fov`, `level`, `yaws`, `tolerance`; `radius`, which no eye exceeds, and `low`, which one reaches, in spacings
        of the grid; `paper`, the radius that the dissertation takes; of the sampled eyes that have the viewpoint as the
        closest in their reverse frustum the share `outside` of that, and the `farthest`; `seconds` of the proof.

    Examples
    --------
    >>> rows = star_shapes([60.0, 90.0], levels=["even"], eyes=500, progress=False)
    >>> [row["paper"] < row["radius"] for row in rows]
    [True, False]
    """

    def measure(fov: float, level: Literal["even", "odd"], yaws: tuple[float, float], tolerance: float) -> lab.Row:
        prove = partial(star_radius, level, fov_x=fov, aspect=aspect, yaws=yaws, tolerance=tolerance)
        found, seconds = lab.elapsed(prove)
        rng = np.random.default_rng(seed)
        turn = np.radians(rng.uniform(*yaws, eyes))
        gazes = np.column_stack([np.sin(turn), np.zeros(eyes), np.cos(turn)])
        across = np.tan(np.radians(fov / 2))
        x, y = across * rng.uniform(-1, 1, (2, eyes))
        ahead = gazes + np.column_stack([-x * np.cos(turn), y / aspect, x * np.sin(turn)])
        far = 1.1 * found.high * rng.random((eyes, 1)) ** (1 / 3)
        sampled = ahead * far / np.linalg.norm(ahead, axis=1, keepdims=True)
        served = _served(sampled, gazes, lattice(level, 2.2 * found.high), across, aspect)
        away = np.linalg.norm(sampled[served], axis=1)
        paper = PAPER_RADII[level]
        return {
            "radius": found.high,
            "low": found.low,
            "paper": paper,
            "outside": float((away > paper).mean()) if len(away) else None,
            "farthest": float(away.max(initial=0)),
            "seconds": seconds,
        }

    grid = {"fov": fovs, "level": levels, "yaws": yaws, "tolerance": tolerances}
    return lab.sweep(grid, measure, progress=progress, desc="star-shapes")


#: Radii of the dissertation's spheres, in spacings (1998, section 3.4.1).
PAPER_RADII = {"even": 2.0, "odd": 3.0}


def _served(eyes: Floats, gazes: Floats, others: Floats, across: float, aspect: float) -> npt.NDArray[np.bool_]:
    """Which eyes have the viewpoint at zero as the closest in their reverse frustum: asks every viewpoint."""
    served = np.zeros(len(eyes), np.bool_)
    for index, (eye, forward) in enumerate(zip(eyes, gazes, strict=True)):
        right = np.cross(forward, (0.0, 1.0, 0.0))
        offsets = eye - np.vstack([np.zeros(3), others])
        x, y, z = offsets @ right, offsets[:, 1], offsets @ forward
        behind = (np.abs(x) <= z * across) & (np.abs(y) <= z * across / aspect)
        away = np.linalg.norm(offsets, axis=1)
        served[index] = behind[0] and away[behind].min() >= away[0]
    return served


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

    Raises
    ------
    ValueError
        If there is no camera, or one is none.
    """
    cameras = _some("cameras", cameras)
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


def _some(name: str, cameras: Sequence[Camera]) -> list[Camera]:
    """At least one camera."""
    found = checked_sequence(name, cameras, Camera)
    if not found:
        raise ValueError(f"{name} is empty: at least one is needed")
    return found


def _figures(out: Sequence[Any], truths: Sequence[DepthImage]) -> lab.Row:
    off = [(w.color.astype(float) - t.color)[~w.hole & ~t.missing].ravel() for w, t in zip(out, truths, strict=True)]
    holes = [(w.hole & ~t.missing).sum() / max(1, (~t.missing).sum()) for w, t in zip(out, truths, strict=True)]
    pixels = np.concatenate(off)
    return {"rms": float(np.sqrt(np.mean(pixels**2))) if len(pixels) else None, "holes": float(np.mean(holes))}
