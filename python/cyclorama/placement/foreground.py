"""The rest of a frame's budget, spent on what an image stands for but shows worst: what is nearest to the eye.

An image is chosen because what is left then fits the budget, and often much less is left. A picture of something far
away hardly changes as the eye moves, one of something near does. So of the cells behind an image those that come
nearest to the eye are drawn as geometry again, as many as the budget has room for, and the image shows only what is
farther than all that is not drawn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..scene import Scene
from .painting import Placement
from .verify import cell_boxes

__all__ = ["Foreground", "Nearer"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Nearer:
    """What of an image a frame draws as geometry.

    Attributes
    ----------
    faces : (K,) ndarray of uint32
    depth : float
        Along the camera's axis: whatever of the image is nearer is among the faces, or not seen.
    """

    faces: npt.NDArray[np.uint32]
    depth: float


class Foreground:
    """Which cells behind a plan's images come nearest to an eye.

    Parameters
    ----------
    plan : Plan
    scene : Scene
    """

    def __init__(self, plan: Placement, scene: Scene) -> None:
        self._plan = plan
        self._order, self._starts = plan.cells()
        self._ends = np.append(self._starts[1:], len(self._order))
        self._low, self._high = cell_boxes(self._order, self._starts, scene)
        self._cell = np.empty(len(self._order), np.int64)
        self._cell[self._order] = np.repeat(np.arange(len(self._starts)), self._ends - self._starts)
        self._behind: dict[int, npt.NDArray[np.int64]] = {}

    def cells(self, image: int) -> npt.NDArray[np.int64]:
        """The cells that an image stands for."""
        if image not in self._behind:
            self._behind[image] = np.unique(self._cell[self._plan.culled(image)])
        return self._behind[image]

    def of(self, cells: npt.NDArray[np.int64], camera: Camera, room: int) -> Nearer:
        """The cells that come nearest to a camera's eye and have no more faces than there is room for.

        Parameters
        ----------
        cells : (C,) ndarray of int64
            Those that the images of the frame stand for.
        camera : Camera
        room : int
            Faces.
        """
        seen, nearest = self._seen(cells, camera)
        order = np.argsort(nearest, kind="stable")
        seen, nearest = seen[order], nearest[order]
        first, end = self._starts[seen], self._ends[seen]
        total = np.cumsum(end - first)
        count = int(np.searchsorted(total, max(room, 0), side="right"))
        depth = float(nearest[count]) if count < len(seen) else np.inf
        # A cell that begins where the first that is left out does is of no use, but it does no harm.
        chosen = [self._order[a:b] for a, b in zip(first[:count].tolist(), end[:count].tolist(), strict=True)]
        return Nearer(np.concatenate(chosen) if chosen else np.empty(0, np.uint32), depth)

    def in_frustum(self, camera: Camera) -> int:
        """Faces of all cells that a camera may see: what culling alone would draw."""
        seen, _ = self._seen(np.arange(len(self._starts)), camera)
        return int((self._ends - self._starts)[seen].sum())

    def _seen(self, cells: npt.NDArray[np.int64], camera: Camera) -> tuple[npt.NDArray[np.int64], Floats]:
        """Those of some cells that are not wholly outside of one side of a frustum, and their least depths."""
        low, high = self._low[cells], self._high[cells]
        middle, half = (low + high) / 2 - camera.eye, (high - low) / 2
        w, h = camera.width, camera.height
        rays = camera.unproject([(0, 0), (w, 0), (w, h), (0, h)], np.ones(4)) - camera.eye
        sides = np.cross(rays, np.roll(rays, -1, axis=0))
        ahead = camera.world_to_camera[2, :3]
        along, reach = middle @ ahead, half @ np.abs(ahead)
        inside = (middle @ sides.T + half @ np.abs(sides).T >= 0).all(axis=1) & (along + reach > 0)
        return cells[inside], np.maximum((along - reach)[inside], 0.0)
