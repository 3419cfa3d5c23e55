"""What a plan does, as figures: images of a viewpoint (3-17), what frames draw (3-19), a path (3-20)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import charts

if TYPE_CHECKING:
    from .plan import Plan

__all__ = [
    "STEEPEST",
    "Path",
    "chart_images_of_viewpoints",
    "chart_path",
    "chart_targets",
    "follow",
    "images_of_viewpoints",
    "walk",
]

Floats = npt.NDArray[np.float64]

#: How far the gazes of a walk are pitched where a plan is for all of them, in degrees.
STEEPEST = 30.0

# Waves along each axis of a walk; their amplitudes add up to this share of half the box.
_WAVES, _REACH = 3, 0.8


def walk(
    bounds: npt.ArrayLike, frames: int = 200, *, seed: int = 0, up: npt.ArrayLike = (0, 1, 0), steepest: float = 0.0
) -> tuple[Floats, Floats]:
    """A closed path inside a box, along which an eye looks where it goes.

    Parameters
    ----------
    bounds : (2, 3) array_like of float
        Lowest and highest coordinates of the box.
    frames : int
        Steps of the path, even in its parameter.
    seed : int
        Of the amplitudes and phases of the three waves along each axis, whose periods are the whole path, half and a
        third of it.
    up : (3,) array_like of float
    steepest : float
        Gazes are pitched by at most so many degrees.

    Returns
    -------
    eyes, forwards : (N, 3) ndarray of float64
        The eyes keep to the inner 0.8 of the box; the gazes have unit length.

    Examples
    --------
    >>> eyes, forwards = walk([[0, 0, 0], [1, 1, 1]], 50)
    >>> bool((abs(eyes - 0.5) <= 0.4).all()), float(abs(forwards[:, 1]).max())
    (True, 0.0)
    """
    low, high = np.asarray(bounds, dtype=np.float64)
    upright = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    rng = np.random.default_rng(seed)
    amplitudes = _REACH * (high - low)[:, None] / 2 * rng.dirichlet(np.ones(_WAVES), 3)
    phases = rng.uniform(0, 2 * np.pi, (3, _WAVES))
    k = np.arange(1, _WAVES + 1)
    angles = 2 * np.pi * np.arange(frames)[:, None, None] / frames * k + phases
    eyes = (low + high) / 2 + (amplitudes * np.sin(angles)).sum(axis=2)
    gazes = (amplitudes * k * np.cos(angles)).sum(axis=2)
    climb = gazes @ upright
    level = gazes - climb[:, None] * upright
    # A step straight up has no heading: it looks along the first level axis.
    flat = np.linalg.norm(level, axis=1)
    level[flat == 0] = np.cross(upright, np.roll(upright, 1))
    steep = np.tan(np.radians(steepest)) * np.linalg.norm(level, axis=1)
    gazes = level + np.clip(climb, -steep, steep)[:, None] * upright
    return eyes, gazes / np.linalg.norm(gazes, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Path:
    """What frames along a path draw.

    Attributes
    ----------
    alone : (N,) ndarray of int64
        Faces in the cells that the frustum may see.
    drawn : (N,) ndarray of int64
        Those that are left with an image.
    image : (N,) ndarray of int64
        The image, -1 for none.
    distance : (N,) ndarray of float64
        From the eye to the image's viewpoint; NaN without one.
    """

    alone: npt.NDArray[np.int64]
    drawn: npt.NDArray[np.int64]
    image: npt.NDArray[np.int64]
    distance: Floats


def follow(plan: Plan, eyes: npt.ArrayLike, forwards: npt.ArrayLike) -> Path:
    """Asks a plan for the frames of a path.

    Parameters
    ----------
    plan : Plan
    eyes, forwards : (N, 3) array_like of float
        As for `Plan.frame`.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
    >>> path = follow(plan, *walk(plan.domain, 50, up=plan.up))
    >>> bool(path.drawn.max() <= 13_000), bool((path.drawn <= path.alone).all())
    (True, True)
    """
    # With a budget of everything no frame needs an image.
    whole = replace(plan, budget=len(plan.scene))
    rows = []
    for eye, forward in zip(np.asarray(eyes, dtype=np.float64), np.asarray(forwards, dtype=np.float64), strict=True):
        frame = plan.frame(eye, forward)
        away = np.nan if frame.image is None else float(np.linalg.norm(frame.image.viewpoint - eye))
        index = -1 if frame.image is None else frame.image.index
        rows.append((len(whole.frame(eye, forward).faces), len(frame.faces), index, away))
    alone, drawn, image, distance = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    return Path(alone.astype(np.int64), drawn.astype(np.int64), image.astype(np.int64), distance)


def chart_path(
    plan: Plan,
    eyes: npt.ArrayLike | None = None,
    forwards: npt.ArrayLike | None = None,
    *,
    seed: int = 0,
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """Figure 3-20: primitives a frame along a path, with frustum culling alone and with images.

    Parameters
    ----------
    plan : Plan
    eyes, forwards : (N, 3) array_like of float, optional
        By default a `walk` of 200 frames in the plan's domain.
    seed : int
        Of that walk.
    path : path-like, optional
        A picture to write.

    Returns
    -------
    matplotlib.figure.Figure
    """
    if eyes is None or forwards is None:
        eyes, forwards = walk(
            plan.domain, seed=seed, up=plan.up, steepest=0.0 if plan.directions == "yaw" else STEEPEST
        )
    found = follow(plan, eyes, forwards)
    frames = np.arange(len(found.drawn))
    return charts.lines(
        {"frustum culling alone": (frames, found.alone), "with images": (frames, found.drawn)},
        x="frame",
        y="primitives",
        title=f"A path through {len(plan.scene):,} primitives (figure 3-20)",
        limits={f"budget, {plan.budget:,}": plan.budget, f"placed for {plan.optimize_to:,}": plan.optimize_to},
        path=path,
    )


def images_of_viewpoints(plan: Plan) -> npt.NDArray[np.int64]:
    """(N,) how many images each viewpoint has."""
    return np.bincount(plan.images.viewpoint, minlength=len(plan.viewpoints))


def chart_images_of_viewpoints(plan: Plan, *, path: str | os.PathLike[str] | None = None) -> Any:
    """Figure 3-17: how many viewpoints have 1, 2, 3, ... images.

    Parameters
    ----------
    plan : Plan
    path : path-like, optional
        A picture to write.

    Returns
    -------
    matplotlib.figure.Figure
    """
    counts = np.bincount(images_of_viewpoints(plan))
    first = 0 if counts[0] else 1
    return charts.lines(
        {"viewpoints": (np.arange(first, len(counts)), counts[first:])},
        x="images of a viewpoint",
        y="viewpoints",
        title=f"{len(plan.images):,} images of {len(plan.viewpoints):,} viewpoints (figure 3-17)",
        bars=True,
        path=path,
    )


def chart_targets(plan: Plan, *, frames: int = 500, seed: int = 0, path: str | os.PathLike[str] | None = None) -> Any:
    """Figure 3-19: what frames with an image draw, beside what images were placed for.

    Parameters
    ----------
    plan : Plan
    frames : int
        Random frames: eyes even in the domain, gazes even in all directions, level in a yaw plan.
    seed : int
    path : path-like, optional
        A picture to write.

    Returns
    -------
    matplotlib.figure.Figure
        A point for each frame that needs an image, by the image's number.
    """
    found = follow(plan, *zip(*_random(plan, frames, seed), strict=True))
    with_image = found.image >= 0
    return charts.lines(
        {"frames": (found.image[with_image], found.drawn[with_image])},
        x="image",
        y="primitives",
        title="What is drawn before images (figure 3-19)",
        limits={f"budget, {plan.budget:,}": plan.budget, f"placed for {plan.optimize_to:,}": plan.optimize_to},
        points=("frames",),
        path=path,
    )


def _random(plan: Plan, frames: int, seed: int) -> Iterator[tuple[Floats, Floats]]:
    rng = np.random.default_rng(seed)
    low, high = plan.domain
    upright = plan.up / np.linalg.norm(plan.up)
    for _ in range(frames):
        gaze = rng.normal(size=3)
        if plan.directions == "yaw":
            gaze -= gaze @ upright * upright
        yield rng.uniform(low, high), gaze / np.linalg.norm(gaze)
