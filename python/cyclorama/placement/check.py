"""Frames of a plan drawn at random and looked at one by one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..progress import Progress, reporter
from .verify import cell_boxes

if TYPE_CHECKING:
    from .plan import Plan

__all__ = ["Check", "check", "random_frames"]

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
        Frames that draw more than the budget.
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


def check(plan: Plan, frames: int, seed: int, progress: Progress) -> Check:
    """See `Plan.check`."""
    eyes, gazes = random_frames(plan, frames, seed)
    order, starts = plan.cells()
    low, high = cell_boxes(order, starts, plan.scene)
    centers, halves = (low + high) / 2, (high - low) / 2
    sizes = np.diff(np.append(starts, len(order)))
    cell = np.empty(len(order), np.int64)
    cell[order] = np.repeat(np.arange(len(starts)), sizes)
    edge = float((plan.domain[1] - plan.domain[0]).max())
    slack = _ROUNDING * (edge + float(np.abs(plan.domain).max()))
    out = np.empty(min(plan.budget, len(plan.scene)), np.uint32)
    violations = lost = past = outside = over = most = 0
    distances = []
    tangents = plan.tangents
    with reporter(progress, frames, "checking frames") as report:
        for done, (eye, gaze) in enumerate(zip(eyes, gazes, strict=True)):
            frame = plan.frame(eye, gaze, out)
            count = len(frame.faces)
            most = max(most, count)
            violations += count > plan.budget
            over += count > plan.optimize_to
            sides = _sides(gaze, plan.axes[2], tangents)
            missed = ((centers - eye) @ sides.T + halves @ np.abs(sides).T < slack).any(axis=1)
            drawn = np.bincount(cell[frame.faces], minlength=len(starts)) == sizes
            gone = ~(missed | drawn)
            if frame.image is not None:
                image = frame.image
                to_eye = eye - image.viewpoint
                distances.append(float(np.linalg.norm(to_eye)) / edge)
                outside += bool((sides @ to_eye < -slack).any())
                depth = image.forward @ (image.corners[0] - image.viewpoint)
                past += bool(image.forward @ to_eye >= depth)
                rays = image.corners - image.viewpoint
                walls = np.cross(rays, np.roll(rays, -1, axis=0))
                walls *= np.sign(walls @ image.forward)[:, None]
                least = (centers - image.viewpoint) @ image.forward - halves @ np.abs(image.forward)
                held = (centers - image.viewpoint) @ walls.T - halves @ np.abs(walls).T
                gone &= ~((least >= depth - slack) & (held >= -slack * np.linalg.norm(walls, axis=1)).all(axis=1))
            lost += bool(gone.any())
            report(done + 1)
    return Check(
        frames=frames,
        with_image=len(distances),
        violations=violations,
        lost=lost,
        past=past,
        outside=outside,
        over_target=over,
        most=most,
        median_distance=float(np.median(distances)) if distances else 0.0,
        greatest_distance=max(distances, default=0.0),
    )


def _sides(forward: Floats, up: Floats, tangents: tuple[float, float]) -> Floats:
    """(4, 3) inward unit normals of a frustum's side planes."""
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    above = np.cross(right, forward)
    tan_x, tan_y = tangents
    sides = np.stack(
        [right + forward * tan_x, forward * tan_x - right, above + forward * tan_y, forward * tan_y - above]
    )
    return np.asarray(sides / np.linalg.norm(sides, axis=1)[:, None])
