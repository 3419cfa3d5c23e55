"""What is left of a view behind a row of portals: a convex cone from the eye."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..camera import Camera

__all__ = ["Cone"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cone:
    """The points on the inner side of planes.

    Attributes
    ----------
    eye : (3,) ndarray of float64
        Its tip.
    normals : (P, 3) ndarray of float64
        Inward unit normals.
    offsets : (P,) ndarray of float64
        ``normals @ x >= offsets`` inside. All planes but the last portal's pass through the eye.
    """

    eye: Floats
    normals: Floats
    offsets: Floats

    @classmethod
    def of(cls, camera: Camera) -> Cone:
        """All that a pinhole camera may see."""
        rows = camera.K @ camera.world_to_camera[:3]
        x, y, depth = rows
        planes = np.stack([x, camera.width * depth - x, y, camera.height * depth - y, depth - [0, 0, 0, camera.near]])
        planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        return cls(camera.eye, planes[:, :3], -planes[:, 3])

    def misses(self, points: Floats) -> npt.NDArray[np.bool_]:
        """(K,) of (K, N, 3) sets of points: those that lie wholly outside of one plane."""
        reach = (points @ self.normals.T - self.offsets).max(axis=1)
        return np.asarray((reach < -self._slack(points)).any(axis=1))

    def _slack(self, points: Floats) -> float:
        """What rounding may have moved a plane by: what touches is kept."""
        extent = float(np.abs(points).max(initial=0.0)) + float(np.abs(self.eye).max())
        return 64 * np.finfo(np.float64).eps * extent
