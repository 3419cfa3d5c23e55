"""What is left of a view behind a row of portals: a convex cone from the eye."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..camera import Camera

__all__ = ["Cone"]

Floats = npt.NDArray[np.float64]

# Radians between two corners from which on they are two.
_SLIVER = 1e-10


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

    def clip(self, polygon: Floats) -> Floats:
        """The part of a convex polygon inside, (N, 3); N is 0 if nothing is."""
        for normal, offset in zip(self.normals, self.offsets, strict=True):
            inside = polygon @ normal - offset
            if (inside >= 0).all():
                continue
            if (inside < 0).all():
                return np.empty((0, 3))
            corners = []
            for a, b, p, q in zip(polygon, np.roll(polygon, -1, 0), inside, np.roll(inside, -1), strict=True):
                if p >= 0:
                    corners.append(a)
                if (p >= 0) != (q >= 0):
                    corners.append(a + (b - a) * (p / (p - q)))
            polygon = np.array(corners)
        return polygon

    def through(self, polygon: Floats) -> Cone | None:
        """What is seen of what lies behind a portal's polygon, already clipped; None if that is nothing."""
        rays = polygon - self.eye
        normal = np.cross(polygon - polygon.mean(0), np.roll(polygon, -1, 0) - polygon.mean(0)).sum(0)
        length = np.linalg.norm(normal)
        if len(polygon) < 3 or length == 0.0:
            return None
        normal /= length
        ahead = float(rays.mean(0) @ normal)
        if ahead < 0.0:
            normal, ahead = -normal, -ahead
        sides = np.cross(rays, np.roll(rays, -1, 0))
        lengths, reach = np.linalg.norm(sides, axis=1), np.linalg.norm(rays, axis=1)
        # Corners that rounding tells apart have a plane of any direction between them: it bounds nothing.
        edges = lengths > _SLIVER * reach * np.roll(reach, -1)
        sides = sides[edges] / lengths[edges, None]
        if len(sides) < 3:
            return None
        if (sides @ rays.mean(0)).sum() < 0.0:
            sides = -sides
        normals = np.vstack([sides, normal])
        return Cone(self.eye, normals, np.append(sides @ self.eye, normal @ polygon[0]))

    def contains(self, points: Floats) -> bool:
        """Whether all of some points (N, 3) are inside, or as near as rounding."""
        return bool((points @ self.normals.T - self.offsets >= -self._slack(points)).all())

    def misses(self, points: Floats) -> npt.NDArray[np.bool_]:
        """(K,) of (K, N, 3) sets of points: those that lie wholly outside of one plane."""
        reach = (points @ self.normals.T - self.offsets).max(axis=1)
        return np.asarray((reach < -self._slack(points)).any(axis=1))

    def _slack(self, points: Floats) -> float:
        """What rounding may have moved a plane by: what touches is kept."""
        extent = float(np.abs(points).max(initial=0.0)) + float(np.abs(self.eye).max())
        return 64 * np.finfo(np.float64).eps * extent
