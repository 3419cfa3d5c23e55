"""Placement as the 1998 dissertation does it: an adaptive grid of viewpoints and their images (sections 3.2 to 3.4)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from ..progress import Progress, reporter
from ..scene import Scene
from . import _checks
from .cells import Cells, cells
from .optimising import WEIGHTS, Search, search_arguments, weight_arguments

__all__ = ["GridFrame", "GridImages", "GridPlan", "place_on_grid"]

Floats = npt.NDArray[np.float64]

#: What can be wrong with a frame: no viewpoint in the reverse frustum, no image of it for the gaze, the eye at or past
#: the image's plane, more primitives than the budget.
Fault = Literal["no viewpoint", "no image", "past the image", "over budget"]


class GridImages(NamedTuple):
    """The images of a plan, viewpoint by viewpoint."""

    #: (I,) index of the viewpoint of each.
    viewpoint: npt.NDArray[np.int64]
    #: (I, 4, 3) top-left, top-right, bottom-right, bottom-left as seen from it.
    corners: Floats
    #: (I, 3) the gaze it was made for, at a right angle to its plane.
    forward: Floats
    #: (I, 2) gazes served: from this yaw to that one, in degrees; the second may exceed 360.
    yaw: Floats
    #: (I,) primitives in the view that it was made for, and those that it leaves there.
    total: npt.NDArray[np.uint64]
    remaining: npt.NDArray[np.uint64]
    #: (I,) the cost-benefit value, and how much more any subset of the view could have (infinite if not known).
    value: Floats
    gap: Floats


class GridFrame(NamedTuple):
    """What one eye draws."""

    #: (K,) the faces, ascending: those of all cells in view that no image replaces.
    faces: npt.NDArray[np.uint32]
    #: Index of the image in `GridPlan.images`, if there is one.
    image: int | None
    #: Index of the closest viewpoint in the reverse frustum; `None` if the eye needs none or there is none.
    viewpoint: int | None
    fault: Fault | None


@dataclass(frozen=True)
class GridPlan:
    """A grid of viewpoints with images, for a budget. Made by `place_on_grid`."""

    budget: int
    #: (2, 3) where eyes are.
    domain: Floats
    #: (N, 3), and the level of each: even and odd ones in turn, from 0.
    viewpoints: Floats
    levels: npt.NDArray[np.uint32]
    #: (N,) radii of the star-shapes, in scene units; 0 where no view exceeds the budget or no eye needs the viewpoint.
    radii: Floats
    images: GridImages
    cells: Cells = field(repr=False)
    up: tuple[float, float, float]
    #: Tangents of half the field of view of frames, and of images.
    tangents: tuple[float, float]
    image_tangents: tuple[float, float]

    def _axes(self, forward: npt.ArrayLike) -> tuple[Floats, Floats, Floats]:
        ahead = np.asarray(forward, dtype=np.float64)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, self.up)
        right /= np.linalg.norm(right)
        return ahead, right, np.cross(right, ahead)

    def _normals(self, axes: tuple[Floats, Floats, Floats], tangents: tuple[float, float]) -> Floats:
        ahead, right, up = axes
        across, upward = tangents
        return np.array([right + ahead * across, ahead * across - right, up + ahead * upward, ahead * upward - up])

    def _reach(self, normals: Floats, eye: Floats, farthest: bool) -> Floats:
        """How far each box reaches past planes through an eye, with its farthest or its nearest corner: (C, P)."""
        low, high = self.cells.low - eye, self.cells.high - eye
        one, other = np.maximum(normals, 0).T, np.minimum(normals, 0).T
        return high @ one + low @ other if farthest else low @ one + high @ other

    def yaw(self, forward: npt.ArrayLike) -> float:
        """The yaw of a gaze in degrees, in [0, 360)."""
        k = int(np.flatnonzero(self.up)[0])
        gaze = np.asarray(forward, dtype=np.float64)
        angle = np.degrees(np.arctan2(gaze[(k + 2) % 3] * np.sign(self.up[k]), gaze[(k + 1) % 3]))
        return float(angle % 360.0)

    def frame(self, eye: npt.ArrayLike, forward: npt.ArrayLike) -> GridFrame:
        """What an eye draws: the dissertation's rule, which takes the closest viewpoint and no other.

        Parameters
        ----------
        eye : (3,) array_like of float
            In `domain`.
        forward : (3,) array_like of float
            A level gaze: at a right angle to `up`, up to rounding.

        Returns
        -------
        GridFrame
            With its `fault`, if the plan has no answer here: then `faces` are those without an image.

        Raises
        ------
        ValueError
            If the eye is outside the domain or the gaze isn't level.
        """
        at = np.array(_checks.vector("eye", eye))
        gaze = _checks.vector("forward", forward)
        if (at < self.domain[0]).any() or (at > self.domain[1]).any():
            raise ValueError(f"eye {at.tolist()} is outside the domain {self.domain.tolist()}")
        if abs(np.dot(gaze, self.up)) > 1e-9 * np.linalg.norm(gaze) * np.linalg.norm(self.up) or not any(gaze):
            raise ValueError(f"forward {gaze} must be level: this is a plan for yaw, with up {self.up}")
        axes = self._axes(gaze)
        seen = np.all(self._reach(self._normals(axes, self.tangents), at, True) >= 0, axis=1)

        def drawn(cells: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.uint32], bool]:
            return self.cells.faces(np.flatnonzero(cells)), int(self.cells.counts[cells].sum()) > self.budget

        faces, over = drawn(seen)
        if not over:
            return GridFrame(faces, None, None, None)
        behind = ((at - self.viewpoints) @ self._normals(axes, self.image_tangents).T >= 0).all(axis=1)
        if not behind.any():
            return GridFrame(faces, None, None, "no viewpoint")
        distances = np.where(behind, np.linalg.norm(at - self.viewpoints, axis=1), np.inf)
        viewpoint = int(np.argmin(distances))
        yaw = self.yaw(gaze)
        of = np.flatnonzero(self.images.viewpoint == viewpoint)
        begin, end = self.images.yaw[of].T
        fits = of[(yaw - begin) % 360.0 <= end - begin]
        if not len(fits):
            return GridFrame(faces, None, viewpoint, "no image")
        image = int(fits[0])
        corners = self.images.corners[image]
        ahead = self.images.forward[image]
        if ahead @ (corners[0] - at) <= 0:
            return GridFrame(faces, image, viewpoint, "past the image")
        rays = corners - self.viewpoints[viewpoint]
        sides = np.cross(np.roll(rays, -1, axis=0), rays)
        sides *= np.sign(sides @ rays.mean(axis=0))[:, None]
        inside = (self._reach(sides, self.viewpoints[viewpoint], False) >= 0).all(axis=1)
        beyond = self._reach(ahead[None], corners[0], False)[:, 0] >= 0
        faces, over = drawn(np.logical_and(seen, ~(inside & beyond)))
        return GridFrame(faces, image, viewpoint, "over budget" if over else None)

    def aimed_frames(self, count: int, seed: int = 0, steps: int = 80) -> tuple[Floats, Floats]:
        """Frames whose closest viewpoint is far from the eye for its star-shape, found by climbing from random ones.

        Parameters
        ----------
        count : int
            How many climbs.
        seed : int
        steps : int
            Of each climb: random steps of eye and yaw, ever shorter, taken where the distance over the star-shape's
            radius grows.

        Returns
        -------
        eyes, gazes : (N, 3) ndarray of float64
        """
        rng = np.random.default_rng(seed)
        low, high = self.domain
        eyes, yaws = rng.uniform(low, high, (count, 3)), rng.uniform(0, 2 * np.pi, count)
        best = self._far(eyes, yaws)
        for step in 0.3 * 0.93 ** np.arange(steps):
            tried = np.clip(eyes + rng.normal(0, step, (count, 3)) * (high - low), low, high)
            turned = yaws + rng.normal(0, step, count)
            far = self._far(tried, turned)
            better = far > best
            eyes[better], yaws[better], best[better] = tried[better], turned[better], far[better]
        return eyes, self._gazes(yaws)

    def _gazes(self, yaws: Floats) -> Floats:
        """(N, 3) level gazes; the yaws of `yaw`, in radians."""
        k = int(np.flatnonzero(self.up)[0])
        gazes = np.zeros((len(yaws), 3))
        gazes[:, (k + 1) % 3] = np.cos(yaws)
        gazes[:, (k + 2) % 3] = np.sin(yaws) * np.sign(self.up[k])
        return gazes

    def away(self, eyes: npt.ArrayLike, gazes: npt.ArrayLike) -> Floats:
        """How far eyes are from the closest viewpoints in their reverse frusta, over the radii of those star-shapes.

        Parameters
        ----------
        eyes, gazes : (N, 3) array_like of float

        Returns
        -------
        (N,) ndarray of float64
            0 where the viewpoint has no images, infinite where there is none.
        """
        along = np.asarray(gazes, dtype=np.float64)
        return self._far(np.asarray(eyes, dtype=np.float64), np.radians([self.yaw(gaze) for gaze in along]))

    def _far(self, eyes: Floats, yaws: Floats) -> Floats:
        """(N,) distances to the closest viewpoints in the reverse frusta over the radii of their star-shapes; 0 for
        those without one, infinite where there is no viewpoint."""
        ahead = self._gazes(yaws)
        up = np.array(self.up) / np.linalg.norm(self.up)
        right = np.cross(ahead, up)
        across, upward = self.image_tangents
        away = eyes[:, None] - self.viewpoints
        x, y, z = (np.einsum("nvi,ni->nv", away, axis) for axis in (right, np.broadcast_to(up, ahead.shape), ahead))
        behind = (np.abs(x) <= across * z) & (np.abs(y) <= upward * z)
        distances = np.where(behind, np.linalg.norm(away, axis=2), np.inf)
        closest = distances.argmin(axis=1)
        nearest = distances[np.arange(len(eyes)), closest]
        radii = self.radii[closest]
        return np.where(radii > 0, nearest / np.where(radii > 0, radii, 1), np.where(np.isinf(nearest), np.inf, 0.0))

    def check(self, frames: int = 1000, seed: int = 0, *, aimed: bool = False) -> dict[str, int]:
        """Random frames and their faults, by kind: half of the eyes near the domain's surface, looking inward.

        Parameters
        ----------
        frames, seed : int
        aimed : bool
            The frames of `aimed_frames` in place of random ones, which hardly ever find what the dissertation's
            star-shapes leave out.

        Returns
        -------
        dict
            "frames", "with image", "most drawn" (of frames without a fault), "outside the star-shape" (frames over the
            budget that are farther from their viewpoint than its radius), and the count of each fault.
        """
        faults: Counter[str] = Counter()
        images = most = far = 0
        eyes, gazes = self.aimed_frames(frames, seed) if aimed else self._random_frames(frames, seed)
        for eye, gaze in zip(eyes, gazes, strict=True):
            found = self.frame(eye, gaze)
            if found.fault is not None:
                faults[found.fault] += 1
            else:
                most = max(most, len(found.faces))
            images += found.image is not None
            if found.viewpoint is not None:
                away = float(np.linalg.norm(eye - self.viewpoints[found.viewpoint]))
                far += away > self.radii[found.viewpoint] * (1 + 1e-9)
        kinds = ("no viewpoint", "no image", "past the image", "over budget")
        return {
            "frames": frames,
            "with image": images,
            "most drawn": most,
            "outside the star-shape": far,
        } | {kind: faults[kind] for kind in kinds}

    def _random_frames(self, frames: int, seed: int) -> tuple[Floats, Floats]:
        rng = np.random.default_rng(seed)
        low, high = self.domain
        eyes, gazes = [], []
        for k in range(frames):
            share = rng.random(3)
            gaze = self._gazes(rng.uniform(0, 2 * np.pi, 1))[0]
            if k % 2:
                # Near a face, an edge or a corner; turned around if it looks outward.
                near = rng.random(3) < 0.6
                share = np.where(near, np.round(share) + (0.5 - np.round(share)) * 0.02 * rng.random(3), share)
                gaze *= 1 if gaze @ ((low + high) / 2 - (low + share * (high - low))) >= 0 else -1
            eyes.append(low + share * (high - low))
            gazes.append(gaze)
        return np.array(eyes).reshape(-1, 3), np.array(gazes).reshape(-1, 3)


def place_on_grid(
    scene: Scene,
    budget: int,
    *,
    optimize_to: int | None = None,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    image_fov: float | None = None,
    grid: Sequence[int] = (3, 3, 3),
    leaf_depth: int = 5,
    weights: Sequence[float] = WEIGHTS,
    up: npt.ArrayLike = (0, 1, 0),
    star_shape: Literal["certified", "paper"] = "certified",
    subdivide: Literal["count", "solve"] = "solve",
    search: Search = "paper",
    lookahead: int = 1,
    keep: Literal["last", "best"] = "last",
    steps: int = 5000,
    seed: int = 0,
    gap: float = 0.01,
    most: int = 200,
    max_viewpoints: int = 20_000,
    threads: int | None = None,
    progress: Progress = None,
) -> GridPlan:
    """Images on an adaptive grid of viewpoints, so that no frame draws more than a budget of primitives.

    Parameters
    ----------
    scene : Scene
    budget : int
        P: primitives of a frame at most.
    optimize_to : int, optional
        P_opt: primitives that an image leaves in its own view at most; by default 80 % of the budget.
    fov_x : float
        Horizontal field of view in degrees.
    aspect : float
        Width over height.
    image_fov : float, optional
        Horizontal field of view of the images' views, at least `fov_x`: wider ones make star-shapes smaller and views
        more expensive (section 3.4.1).
    grid : (int, int, int)
        Viewpoints along each axis of the scene at first, at least 3, all with one spacing; the margin comes on top.
    leaf_depth : int
        See `cells`.
    weights, search, lookahead, keep, steps, seed, gap, most
        See `optimise`.
    up : (3,) array_like of float
        Gazes are level; this is the axis that they turn about: along x, y or z.
    star_shape : {"certified", "paper"}
        Radii that are proved for the viewpoints around each one, the scene's bounds and each range of yaws, with as
        wide a margin as they need; or spheres of 2 spacings at even and 3 at odd levels and a margin of two rings: then
        some eyes are past their image, which `GridPlan.check` counts.
    subdivide : {"solve", "count"}
        Subdivide around a viewpoint where no image lies outside its star-shape (figure 3-4), or before that where a
        view has more than the budget within it (section 3.6.1).
    max_viewpoints : int
        A plan with more is an error.
    threads : int, optional
        All cores by default. The plan doesn't depend on it.
    progress : bool or callable, optional
        See `cyclorama.progress.reporter`; one unit is a viewpoint. Their number is not known beforehand.

    Returns
    -------
    GridPlan

    Raises
    ------
    ValueError
        If an argument is out of range, or the budget is less than what lies before any image somewhere: the message
        says where, how much is needed there, and what budget would do.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> plan = place_on_grid(cyc.scenes.pipes(20_000), 10_000, leaf_depth=3, lookahead=0, star_shape="paper")
    >>> checked = plan.check(frames=20)
    >>> checked["most drawn"] <= 10_000, checked["over budget"]
    (True, 0)
    """
    faces = len(scene)
    if not 0 < budget:
        raise ValueError(f"budget must be positive, got {budget}")
    if budget >= faces:
        raise ValueError(f"budget {budget} is no less than the scene's {faces} primitives: no image is needed")
    target = max(1, int(budget * 0.8)) if optimize_to is None else optimize_to
    if not 0 < target <= budget:
        raise ValueError(f"optimize_to must be above 0 and at most the budget of {budget}, got {optimize_to}")
    tangents = _checks.tangents(fov_x, aspect)
    if image_fov is not None and not fov_x <= image_fov < 180:
        raise ValueError(f"image_fov must be at least fov_x, {fov_x}, and below 180 degrees, got {image_fov}")
    # Wider across and upward by the same factor.
    wide = tangents if image_fov is None else _checks.tangents(image_fov, aspect)
    resolution = [int(n) for n in grid]
    if len(resolution) != 3 or min(resolution) < 3 or max(resolution) > 64:
        raise ValueError(f"grid must be three numbers from 3 to 64, got {grid!r}")
    if min(scene.bounds[1] - scene.bounds[0]) <= 0:
        raise ValueError(f"the scene is flat: bounds {scene.bounds.tolist()} have no volume for eyes to be in")
    if max_viewpoints < 1:
        raise ValueError(f"max_viewpoints must be at least 1, got {max_viewpoints}")
    axis = _checks.axis("up", up)
    found = cells(scene, leaf_depth)
    low, high = found.low.min(axis=0), found.high.max(axis=0)
    with reporter(progress, max_viewpoints, "placing") as report:
        placed: dict[str, Any] = _core.placement_paper(
            (found.low, found.high, found.counts),
            (_checks.vector("low", low), _checks.vector("high", high)),
            axis,
            wide,
            int(budget),
            target,
            resolution,
            weight_arguments(weights),
            search_arguments(search, lookahead, keep, steps, seed, gap, most),
            star_shape,
            subdivide,
            max_viewpoints,
            threads,
            report,
        )
    begin = np.degrees(placed["yaw"])
    images = GridImages(
        placed["viewpoint"],
        placed["corners"],
        placed["forward"],
        np.stack([begin, begin + np.degrees(placed["width"])], axis=1),
        placed["total"],
        placed["remaining"],
        placed["value"],
        placed["gap"],
    )
    return GridPlan(
        int(budget),
        np.array([low, high]),
        placed["viewpoints"],
        placed["levels"],
        placed["radii"],
        images,
        found,
        axis,
        tangents,
        wide,
    )
