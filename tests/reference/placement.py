"""A plan of a few images, face by face: no cells, no budget, no proof."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

import cyclorama as cyc


@dataclass
class Images:
    viewpoint: np.ndarray
    corners: np.ndarray
    forward: np.ndarray

    def __len__(self) -> int:
        return len(self.viewpoint)


class FewImages:
    """Images that look along -z from viewpoints, each with the faces wholly in its pyramid and beyond its plane."""

    def __init__(self, scene: cyc.Scene, viewpoints, distance: float, fov_x=60.0, aspect=4 / 3, wide=66.0) -> None:
        self.scene, self.viewpoints = scene, np.array(viewpoints, np.float64)
        self.fov_x, self.aspect, self.directions = fov_x, aspect, "yaw"
        self.up = np.array([0.0, 1.0, 0.0])
        self.domain = scene.bounds
        w = np.tan(np.radians(wide / 2)) * distance
        h = w / aspect
        quad = np.array([[-w, h, -distance], [w, h, -distance], [w, -h, -distance], [-w, -h, -distance]])
        corners = self.viewpoints[:, None] + quad
        forward = np.tile([0.0, 0.0, -1.0], (len(viewpoints), 1))
        self.images = Images(np.arange(len(viewpoints)), corners, forward)
        points = scene.vertices[scene.faces].astype(np.float64)
        self._culled = []
        for viewpoint in self.viewpoints:
            x, y, z = np.moveaxis(points - viewpoint, -1, 0) / distance
            inside = (np.abs(x) <= -z * w / distance) & (np.abs(y) <= -z * w / distance / aspect) & (z <= -1)
            self._culled.append(np.flatnonzero(inside.all(axis=1)).astype(np.uint32))
        self._every = np.arange(len(scene), dtype=np.uint32)
        self._rest = [np.setdiff1d(self._every, culled, assume_unique=True) for culled in self._culled]

    #: No coarser levels of detail, and one image a frame.
    lod = ()
    images_per_frame = 1

    @property
    def whole(self) -> cyc.Scene:
        return self.scene

    #: Nothing more than what is left: the rest of the budget is zero or less.
    budget = 0

    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Each face is a cell."""
        return np.arange(len(self.scene), dtype=np.uint32), np.arange(len(self.scene))

    def culled(self, index: int) -> np.ndarray:
        return self._culled[index]

    def frame(self, eye, forward, *, images=None) -> SimpleNamespace:
        eye, gaze = np.asarray(eye, np.float64), np.asarray(forward, np.float64) / np.linalg.norm(forward)
        right = np.cross(gaze, self.up) / np.linalg.norm(np.cross(gaze, self.up))
        tan = np.tan(np.radians(self.fov_x / 2))
        best = None
        for index, viewpoint in enumerate(self.viewpoints):
            step = eye - viewpoint
            ahead = step @ gaze
            seen = abs(step @ right) <= tan * ahead and abs(step @ np.cross(right, gaze)) <= tan / self.aspect * ahead
            # Its own gaze, nearly: else it would have to be another image.
            fits = -gaze[2] > 0.995 and eye[2] > self.images.corners[index, 0, 2]
            if seen and fits and (best is None or np.linalg.norm(step) < best[0]):
                best = np.linalg.norm(step), index
        if best is None:
            return SimpleNamespace(faces=self._every, image=None, levels=(), images=())
        image = SimpleNamespace(index=best[1])
        return SimpleNamespace(faces=self._rest[best[1]], image=image, levels=(), images=(image,))
