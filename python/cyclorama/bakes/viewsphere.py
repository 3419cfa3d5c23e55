"""The sphere on which a bake's viewpoints lie, and which of its faces an eye anywhere looks through."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .. import sphere

__all__ = ["ViewSphere"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ViewSphere:
    """Directions of viewpoints around a scene, and the triangles between them.

    Parameters
    ----------
    points : (N, 3) ndarray of float64
        Unit vectors from the centre to the viewpoints.
    faces : (M, 3) ndarray of uint32
        The triangles; together they surround the centre.
    center : (3,) ndarray of float64
        Centre of the scene, in the user's units.
    radius : float
        Distance of the viewpoints from the centre, in the user's units.
    """

    points: Floats
    faces: npt.NDArray[np.uint32]
    center: Floats
    radius: float

    @cached_property
    def viewpoints(self) -> Floats:
        """(N, 3) positions of the viewpoints, in the user's units."""
        return np.asarray(self.center + self.radius * self.points)

    @cached_property
    def solid_angles(self) -> Floats:
        """(M,) share of all directions that each face covers; they add up to 1."""
        a, b, c = (self.points[self.faces[:, k]] for k in range(3))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        cosines = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
        angles = 2 * np.arctan2(np.abs(volume), 1 + cosines[0] + cosines[1] + cosines[2])
        return np.asarray(angles / angles.sum())

    def toward(self, eye: npt.ArrayLike) -> tuple[Floats, float]:
        """Unit direction and distance of an eye from the centre; no direction (zeros) for the centre itself.

        Raises
        ------
        ValueError
            If `eye` is not three finite numbers.
        """
        position = np.asarray(eye, dtype=np.float64)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise ValueError(f"eye must be three finite numbers, got {np.asarray(eye).tolist()}")
        offset = position - self.center
        distance = math.hypot(*offset)
        return (offset / distance if distance else np.zeros(3)), distance

    def locate(self, directions: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """(K,) face that each of (K, 3) directions passes through."""
        return self._locator.locate(np.atleast_2d(np.asarray(directions, dtype=np.float64))).astype(np.int64)

    def crossed(self, direction: npt.ArrayLike, angle: float) -> npt.NDArray[np.int64]:
        """(K,) faces with a point at most `angle` degrees from a direction, ascending."""
        return sphere.faces_in_cap(self.points, self.faces, direction, angle).astype(np.int64)

    @cached_property
    def _locator(self) -> sphere.Locator:
        return sphere.Locator(self.points, self.faces)
