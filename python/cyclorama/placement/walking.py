"""What a walk with backdrops looks like, beside the same walk with all geometry (1998 dissertation, section 1.4.1).

The dissertation asks three things of a display: that pictures don't jump as the eye moves (temporal continuity), that
geometry and image meet without a step (geometric continuity), and that nobody sees an image take the place of another
(smooth transitions). It compares its displays by words; here they are numbers, in grey levels of 255 and each as what
the true pictures don't do:

*popping* is the root mean square of how much the error of the pixels that show the image changes from one frame to the
next; the *jump* is the same for frames at which the image changes; the *step* is the mean over neighbouring pixels, one
of geometry and one of the backdrop, of how much their difference differs from the true one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..lab import Row
from ..progress import Progress, reporter
from ..render import BACKGROUND
from .backdrops import Backdrops
from .drawing import DISPLAYS, Display, Drawn, Splat
from .painting import behind, frame_camera

__all__ = ["path", "walk"]

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# A frame shows enough of an image to say which share is unknown if this share of its pixels does.
_ENOUGH = 0.01

# Not the backdrop, and deeper than this share beyond the truth: the backdrop is missing.
_DEEPER = 0.01

# How often a path swings along each axis, at most.
_SWINGS = 2.0


def path(low: npt.ArrayLike, high: npt.ArrayLike, frames: int, *, seed: int = 0) -> tuple[Floats, Floats]:
    """A smooth random walk in a box whose gaze turns around once, level along y.

    Parameters
    ----------
    low, high : (3,) array_like of float
        Corners of the box.
    frames : int
        Eyes wanted.
    seed : int
        Of the walk.

    Returns
    -------
    eyes, gazes : (frames, 3) ndarray of float64

    Examples
    --------
    >>> eyes, gazes = path((-1, -1, -1), (1, 1, 1), 200)
    >>> bool(np.linalg.norm(np.diff(eyes, axis=0), axis=1).max() < 0.1), bool(np.abs(eyes).max() <= 1)
    (True, True)
    """
    rng = np.random.default_rng(seed)
    corner, size = np.asarray(low, np.float64), np.subtract(high, low)
    t = np.arange(frames)[:, None] / frames
    rate, phase = rng.uniform(0.5, _SWINGS, 3), rng.uniform(0, 2 * np.pi, 3)
    eyes = corner + size * (0.5 + 0.45 * np.sin(2 * np.pi * rate * t + phase))
    yaw = 2 * np.pi * (t[:, 0] + rng.uniform())
    return eyes, np.stack([np.sin(yaw), np.zeros(frames), np.cos(yaw)], axis=1)


@dataclass
class _Sums:
    """What is added up along a walk for one display."""

    pixels: int = 0
    squares: float = 0.0
    all_squares: float = 0.0
    holes: int = 0
    worst: float = 0.0
    lost: int = 0
    pops: list[float] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    steps: float = 0.0
    pairs: int = 0
    faces: list[int] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    warped: list[float] = field(default_factory=list)
    last: npt.NDArray[np.int16] | None = None


def walk(
    backdrops: Backdrops,
    eyes: npt.ArrayLike,
    gazes: npt.ArrayLike,
    *,
    displays: Sequence[Display] = DISPLAYS,
    size: tuple[int, int] = (510, 480),
    splat: Splat | None = None,
    warp_size: tuple[int, int] | None = None,
    progress: Progress = None,
) -> list[Row]:
    """Draws the frames of a walk in several ways, and compares them with the true pictures.

    Parameters
    ----------
    backdrops : Backdrops
    eyes, gazes : (N, 3) array_like of float
        See `path`.
    displays : sequence of str
        As for `Backdrops.draw`.
    size : (int, int)
        Of the pictures in pixels.
    splat : int or str, optional
    warp_size : (int, int), optional
        As for `Backdrops.draw`.
    progress : bool or callable, optional
        One unit is a frame.

    Returns
    -------
    list of dict
        A row for each display: `frames` that have an image, of `of`; `behind`, the share of their pixels that truly
        show what the image stands for, and `pixels`, the share of those that show what is not drawn as geometry either
        (`foreground`). Over the latter `psnr`, `holes` (known to be unknown), `worst_holes` (of the worst frame with a
        hundredth of its pixels from the image) and `lost` (something deeper is shown); over the former `behind_psnr`,
        `popping` and `jump`; `step` in grey levels, too. `faces` drawn by frames with an image and `in_frustum`, what
        culling alone would draw, in the mean; `ms` of a frame with an image and `all_ms` of drawing all geometry
        instead (medians), and `warp_ms` for the backdrop alone.
    """
    at, ahead = np.asarray(eyes, np.float64), np.asarray(gazes, np.float64)
    plan, scene = backdrops.plan, backdrops.scene
    sums = {display: _Sums() for display in displays}
    pixels, with_image, all_ms, in_frustum = 0, 0, [], []
    last_image, last_mask = -1, np.zeros(size[::-1], np.bool_)
    with reporter(progress, len(at), "walking") as report:
        for number, (eye, gaze) in enumerate(zip(at, ahead, strict=True)):
            camera = frame_camera(plan, eye, gaze, size)
            start = time.perf_counter()
            view = scene.render(camera)
            truth = backdrops.color(view)
            elapsed = 1e3 * (time.perf_counter() - start)
            mask, image = None, -1
            for display in displays:
                drawn = backdrops.draw(eye, gaze, size, display=display, splat=splat, warp_size=warp_size)
                if mask is None:
                    image = -1 if drawn.stats.image is None else drawn.stats.image
                    mask = _culled(backdrops, drawn, view.ids)
                    if image >= 0:
                        all_ms.append(elapsed)
                        in_frustum.append(backdrops.foreground.in_frustum(camera))
                        with_image += 1
                        pixels += int(mask.sum())
                either = mask | last_mask if number else np.zeros_like(mask)
                own = mask & ~np.isin(view.ids, drawn.nearer)
                _add(sums[display], drawn, view.depth, truth, (mask, own, either), image != last_image)
            if mask is not None:
                last_image, last_mask = image, mask
            report(number + 1)
    common: Row = {
        "frames": with_image,
        "of": len(at),
        "behind": pixels / max(1, with_image * size[0] * size[1]),
        "in_frustum": float(np.mean(in_frustum or [0])),
        "all_ms": _median(all_ms),
    }
    return [{"display": display, **common, **_row(found, pixels)} for display, found in sums.items()]


def _culled(backdrops: Backdrops, drawn: Drawn, ids: npt.NDArray[np.uint32]) -> Mask:
    """The pixels that truly show what the image stands for."""
    if drawn.stats.image is None:
        return np.zeros(ids.shape, np.bool_)
    inside = np.zeros(len(backdrops.scene) + 1, np.bool_)
    for index in drawn.stats.images:
        inside[behind(backdrops.plan, backdrops.scene, index)] = True
    return np.asarray(inside[np.where(ids == BACKGROUND, len(backdrops.scene), ids)])


def _add(
    found: _Sums,
    drawn: Drawn,
    depth: npt.NDArray[np.float32],
    truth: npt.NDArray[np.uint8],
    masks: tuple[Mask, Mask, Mask],
    changed: bool,
) -> None:
    behind, own, either = masks
    error = drawn.color.astype(np.int16) - truth
    squares = np.square(error.astype(np.float64)).sum(axis=2)
    count, holes = int(own.sum()), int((drawn.hole & own).sum())
    found.pixels += count
    found.squares += float(squares[own].sum())
    found.all_squares += float(squares[behind].sum())
    found.holes += holes
    if count >= _ENOUGH * own.size:
        found.worst = max(found.worst, holes / count)
    # Faces at one place may be on both sides: then geometry shows what the backdrop would.
    found.lost += int((~drawn.backdrop & own & ~(drawn.depth <= depth * (1 + _DEEPER))).sum())
    if found.last is not None and either.any():
        change = (error - found.last)[either].astype(np.float64)
        (found.jumps if changed else found.pops).append(math.sqrt(float(np.square(change).mean())))
    found.last = error
    for axis in (0, 1):
        border = np.diff(drawn.backdrop.astype(np.int8), axis=axis) != 0
        found.steps += float(np.abs(np.diff(error, axis=axis)[border]).sum()) / 3
        found.pairs += int(border.sum())
    if drawn.stats.image is not None:
        found.faces.append(drawn.stats.faces)
        found.ms.append(drawn.stats.total)
        found.warped.append(drawn.stats.warped)


def _row(found: _Sums, behind: int) -> Row:
    return {
        "pixels": found.pixels / max(1, behind),
        "psnr": _psnr(found.squares, found.pixels),
        "behind_psnr": _psnr(found.all_squares, behind),
        "holes": found.holes / max(1, found.pixels),
        "worst_holes": found.worst,
        "lost": found.lost / max(1, found.pixels),
        "popping": float(np.mean(found.pops)) if found.pops else math.nan,
        "jump": float(np.mean(found.jumps)) if found.jumps else math.nan,
        "step": found.steps / max(1, found.pairs),
        "faces": float(np.mean(found.faces or [0])),
        "ms": _median(found.ms),
        "warp_ms": _median(found.warped),
    }


def _psnr(squares: float, pixels: int) -> float:
    if not pixels:
        return math.nan
    return 10 * math.log10(255**2 * 3 * pixels / squares) if squares else math.inf


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else math.nan
