"""Several images in one frame (section 8.2 of the 1998 dissertation).

One image is enough for the budget to hold. Others whose viewpoints lie behind the eye as well may stand for more of
what is left: of those that serve the eye the one that takes away the most faces is taken, then the next.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from .plan import Plan

__all__ = ["Several"]

Floats = npt.NDArray[np.float64]


class Several:
    """Which images of a plan can be shown together.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        images = plan.images
        self._viewpoints = plan.viewpoints[images.viewpoint]
        self._offsets = np.einsum("ij,ij->i", images.forward, images.corners[:, 0])
        # Those of the shell stand for the whole scene: one is all there is.
        self._own = len(images) - plan.shell
        self._culled: dict[int, npt.NDArray[np.bool_]] = {}

    def add(
        self, faces: npt.NDArray[np.uint32], count: int, first: int, eye: Floats, yaw: float, pitch: float, more: int
    ) -> tuple[int, list[int]]:
        """Takes what further images stand for out of a frame's faces.

        Parameters
        ----------
        faces : (B,) ndarray of uint32
            Of the frame, in place; their order stays.
        count : int
            How many they are.
        first : int
            The frame's image.
        eye : (3,) ndarray of float64
        yaw, pitch : float
            Radians, as `Plan.angles` has them.
        more : int
            The most images to add.

        Returns
        -------
        count : int
        images : list of int
            By index, the one that took the most first.
        """
        chosen: list[int] = []
        able = [int(i) for i in self.serving(eye, yaw, pitch) if i != first]
        while able and len(chosen) < more:
            taken = [int(self._behind(i)[faces[:count]].sum()) for i in able]
            best = int(np.argmax(taken))
            if taken[best] == 0:
                break
            index = able.pop(best)
            left = faces[:count][~self._behind(index)[faces[:count]]]
            count = len(left)
            faces[:count] = left
            chosen.append(index)
        return count, chosen

    def serving(self, eye: Floats, yaw: float, pitch: float) -> npt.NDArray[np.int64]:
        """The images whose viewpoints lie in the reverse frustum of an eye that is before their planes."""
        ahead, beside, upright = self._plan.axes
        level = np.cos(yaw) * ahead + np.sin(yaw) * beside
        gaze = np.cos(pitch) * level + np.sin(pitch) * upright
        above = np.cos(pitch) * upright - np.sin(pitch) * level
        right = np.cross(gaze, above)
        back = eye - self._viewpoints
        depth = back @ gaze
        tan_x, tan_y = self._plan.tangents
        inside = (np.abs(back @ right) <= tan_x * depth) & (np.abs(back @ above) <= tan_y * depth)
        before = self._plan.images.forward @ eye < self._offsets
        return np.flatnonzero((inside & before)[: self._own])

    def _behind(self, index: int) -> npt.NDArray[np.bool_]:
        if index not in self._culled:
            mask = np.zeros(len(self._plan.whole), np.bool_)
            mask[self._plan.culled(index)] = True
            self._culled[index] = mask
        return self._culled[index]
