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

from .. import _core
from ..camera import Camera
from ..scene import Scene
from .painting import Frame, Placement, behind
from .verify import cell_boxes

__all__ = ["Foreground", "Nearer"]


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
        The plan's, without coarser levels of detail: of several levels the finest is drawn.
    """

    def __init__(self, plan: Placement, scene: Scene) -> None:
        self._plan = plan
        order, starts = plan.cells()
        ends = np.append(starts, len(order)).astype(np.int64)
        low, high = cell_boxes(order, starts, plan.whole)
        self._scene = scene
        # Cells of the scene itself: each is of one level of detail.
        self._own = np.flatnonzero(order[starts] < len(scene))
        self._boxes = np.ascontiguousarray(low), np.ascontiguousarray(high), ends, np.ascontiguousarray(order)
        self._cell = np.empty(len(order), np.int64)
        self._cell[order] = np.repeat(np.arange(len(starts)), np.diff(ends))
        self._behind: dict[int, npt.NDArray[np.int64]] = {}

    def cells(self, image: int) -> npt.NDArray[np.int64]:
        """The cells that an image stands for."""
        if image not in self._behind:
            self._behind[image] = np.unique(self._cell[behind(self._plan, self._scene, image)])
        return self._behind[image]

    def rest(self, frame: Frame, camera: Camera) -> Nearer:
        """What the rest of a frame's budget is spent on: the nearest of all that its images stand for.

        Parameters
        ----------
        frame : Frame
            Of the plan, with one image at least.
        camera : Camera
        """
        drawn = len(frame.faces) + sum(len(level) for level in frame.levels)
        cells = np.unique(np.concatenate([self.cells(image.index) for image in frame.images]))
        return self.of(cells, camera, self._plan.budget - drawn)

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
        w, h = camera.width, camera.height
        rays = camera.unproject([(0, 0), (w, 0), (w, h), (0, h)], np.ones(4)) - camera.eye
        sides = np.cross(rays, np.roll(rays, -1, axis=0))
        gaze = np.vstack([camera.eye, camera.world_to_camera[2, :3], sides])
        return Nearer(*_core.nearest_cells(self._boxes, cells, gaze, max(int(room), 0)))

    def in_frustum(self, camera: Camera) -> int:
        """Faces of the scene in all cells that a camera may see: what culling alone would draw."""
        return len(self.of(self._own, camera, len(self._cell)).faces)
