"""Frames of a plan drawn at random and looked at one by one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .. import _core
from ..progress import Progress, reporter
from .verify import cell_boxes, details

if TYPE_CHECKING:
    from .plan import Plan

__all__ = ["Check", "audit", "check", "look", "random_frames"]

Floats = npt.NDArray[np.float64]

# Roundings of lengths, as shares of the domain's longest edge and the largest coordinate.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Check:
    """What `Plan.check` found.

    Attributes
    ----------
    frames, with_image : int
        All that were drawn, and those of them that need an image.
    violations : int
        Frames that draw more than the budget, or would without an image that isn't there.
    lost : int
        Frames in which a face of the frustum is neither drawn nor behind the quadrilateral.
    past : int
        Frames whose eye is not strictly on the viewpoint's side of the plane.
    outside : int
        Frames whose viewpoint is not in the reverse frustum.
    over_target : int
        Frames that draw more than was optimized to.
    most : int
        Faces of the largest frame.
    median_distance, greatest_distance : float
        From the eye to the viewpoint, in longest edges of the domain.
    """

    frames: int
    with_image: int
    violations: int
    lost: int
    past: int
    outside: int
    over_target: int
    most: int
    median_distance: float
    greatest_distance: float

    @property
    def is_sound(self) -> bool:
        """Whether nothing was wrong with any frame."""
        return self.violations == self.lost == self.past == self.outside == 0


def random_frames(plan: Plan, count: int, seed: int) -> tuple[Floats, Floats]:
    """Eyes and gazes, (N, 3) each: half anywhere, half near faces, edges and corners of the domain, looking inwards."""
    rng = np.random.default_rng(seed)
    low, high = plan.domain
    eyes = rng.uniform(low, high, (count, 3))
    yaw = rng.uniform(0, 2 * np.pi, count)
    pitch = np.arcsin(rng.uniform(-1, 1, count)) if plan.directions == "sphere" else np.zeros(count)
    ahead, beside, up = plan.axes
    for i in range(count // 2):
        axes = rng.permutation(3)[: rng.integers(1, 4)]
        ends = rng.integers(0, 2, len(axes))
        eyes[i, axes] = np.where(ends == 1, high[axes], low[axes]) + (1 - 2 * ends) * (
            rng.exponential(0.01, len(axes)) * (high - low)[axes]
        )
        eyes[i] = np.clip(eyes[i], low, high)
        inward = (low + high) / 2 - eyes[i] + rng.normal(0, 0.2, 3) * (high - low)
        yaw[i] = np.arctan2(inward @ beside, inward @ ahead)
    gazes = np.cos(pitch)[:, None] * (np.cos(yaw)[:, None] * ahead + np.sin(yaw)[:, None] * beside)
    return eyes, gazes + np.sin(pitch)[:, None] * up


def check(plan: Plan, frames: int, seed: int, threads: int | None, progress: Progress) -> Check:
    """See `Plan.check`."""
    eyes, gazes = random_frames(plan, frames, seed)
    return look(plan, eyes, gazes, threads=threads, progress=progress)


def look(
    plan: Plan, eyes: npt.ArrayLike, gazes: npt.ArrayLike, *, threads: int | None = None, progress: Progress = None
) -> Check:
    """Draws frames of a plan and looks at each.

    Parameters
    ----------
    plan : Plan
    eyes, gazes : (N, 3) array_like of float
        In the plan's domain, and as its directions allow; gazes have unit length.
    threads : int, optional
        All cores by default.
    progress : bool or callable, optional
        One unit is a frame.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> plan = cyc.place_images(cyc.scenes.pipes(20_000), budget=13_000, progress=False)
    >>> look(plan, [[0, 0, -0.9]], [[0, 0, 1]], progress=False).is_sound
    True
    """
    at = np.ascontiguousarray(eyes, dtype=np.float64)
    along = np.ascontiguousarray(gazes, dtype=np.float64)
    angles = np.array([plan.angles(gaze) for gaze in along]).reshape(-1, 2)
    edge = float((plan.domain[1] - plan.domain[0]).max())
    slack = _ROUNDING * (edge + float(np.abs(plan.domain).max()))
    opinion, starts = audit(plan, slack)
    with reporter(progress, len(at), "checking frames") as report:
        counts, image, flags, distances = plan._kernel.check(opinion, starts, at, along, angles, threads, report)
    lost, past, outside = flags.sum(axis=0)
    far = distances[image >= 0] / edge
    return Check(
        frames=len(at),
        with_image=len(far),
        violations=int(((counts > plan.budget) | (image == -2)).sum()),
        lost=int(lost),
        past=int(past),
        outside=int(outside),
        over_target=int((counts > plan.optimize_to).sum()),
        most=int(counts.max(initial=0)),
        median_distance=float(np.median(far)) if len(far) else 0.0,
        greatest_distance=float(far.max(initial=0.0)),
    )


def audit(plan: Plan, slack: float) -> tuple[_core.Audit, npt.NDArray[np.int64]]:
    """What the second opinion knows of a plan, with the starts of the cells."""
    header, arrays = plan._certificate()
    order, starts = arrays["order"], arrays["starts"]
    low, high = cell_boxes(order, starts, plan.whole)
    sizes = np.diff(np.append(starts, len(order))).astype(np.uint32)
    spans, regions, seen = details(header, arrays)
    opinion = _core.Audit(
        low,
        high,
        sizes,
        arrays["viewpoints"],
        arrays["corners"].reshape(-1, 3),
        plan.axes.tolist(),
        plan.tangents,
        plan.budget,
        slack,
        spans,
        regions.tolist(),
        seen,
    )
    return opinion, starts
