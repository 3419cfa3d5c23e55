"""Cameras around a scene that hold all of it in their image (2002, section 3.2.1).

The scene's bounding sphere touches the nearer pair of image borders. At the sampling radius that takes the asked field
of view; nearer or farther the field of view follows, so that the scene fills the image from everywhere; infinitely far
the camera is orthographic.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .camera import Camera, CameraArrays
from .scene import Scene

__all__ = ["Framing"]

Floats = npt.NDArray[np.float64]

#: As in `Camera.look_at`: nearer to the viewing axis than this, `up` says too little.
_UP_LIMIT = 0.999


@dataclass(frozen=True)
class Framing:
    """Where cameras stand around a scene, and how they see it.

    Parameters
    ----------
    center : (3,) ndarray of float64
        What all cameras look at.
    radius : float
        Radius of the scene's bounding sphere around `center`.
    resolution : (int, int)
        Width and height of the images in pixels.
    fov_y : float
        Vertical field of view in degrees at the sampling radius.
    """

    center: Floats
    radius: float
    resolution: tuple[int, int] = (510, 480)
    fov_y: float = 45.0

    def __post_init__(self) -> None:
        try:
            width, height = (operator.index(side) for side in self.resolution)
        except (TypeError, ValueError):
            raise ValueError(f"resolution must be (width, height) in pixels, got {self.resolution!r}") from None
        if min(width, height) < 1:
            raise ValueError(f"resolution must be at least 1 x 1 pixels, got {width} x {height}")
        if isinstance(self.fov_y, str) or self.fov_y is None or not 0 < self.fov_y < 180:
            raise ValueError(f"fov_y must be between 0 and 180 degrees, got {self.fov_y}")
        object.__setattr__(self, "resolution", (width, height))

    @classmethod
    def of(cls, scene: Scene, resolution: tuple[int, int] = (510, 480), fov_y: float = 45.0) -> Framing:
        """The framing of a scene, around the centre of its bounds."""
        return cls(scene.center, scene.radius, resolution, fov_y)

    @property
    def sampling_radius(self) -> float:
        """Distance from the centre at which the asked field of view just holds the bounding sphere."""
        return self.radius / math.sin(self._half(self.fov_y))

    def with_resolution(self, resolution: tuple[int, int]) -> Framing:
        """The same cameras with other images of the same proportions."""
        return Framing(self.center, self.radius, resolution, self.fov_y)

    def cameras(self, directions: npt.ArrayLike, distance: float = 1.0) -> list[Camera]:
        """A camera in each direction.

        Parameters
        ----------
        directions : (N, 3) array_like of float
            From the centre to the eyes; their lengths do not matter.
        distance : float
            Of the eyes from the centre, in sampling radii; infinite for orthographic cameras.

        Returns
        -------
        list of Camera

        Raises
        ------
        ValueError
            If a direction is zero or not finite, or `distance` is not outside the bounding sphere.

        Examples
        --------
        >>> Framing(np.zeros(3), 1.0).cameras([[0, 0, 1]])
        [<Camera: 510 x 480, fov_y 45, eye (0, 0, 2.61313), forward (0, 0, -1)>]
        """
        arrays = self.arrays(directions, distance)
        width, height = self.resolution
        return [
            Camera(K, pose, width, height, orthographic=bool(parallel))
            for K, pose, parallel in zip(arrays.K, arrays.world_to_camera, arrays.orthographic, strict=True)
        ]

    def arrays(self, directions: npt.ArrayLike, distance: float = 1.0) -> CameraArrays:
        """The same cameras as arrays, for the kernels: for thousands, without an object for each."""
        unit = unit_directions(directions)
        count = len(unit)
        width, height = self.resolution
        up = np.broadcast_to([0.0, 1.0, 0.0], unit.shape).copy()
        up[np.abs(unit[:, 1]) > _UP_LIMIT] = [0.0, 0.0, 1.0]
        right = np.cross(-unit, up)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        poses = np.tile(np.eye(4), (count, 1, 1))
        poses[:, 0, :3], poses[:, 1, :3], poses[:, 2, :3] = right, np.cross(-unit, right), -unit
        focal, reach = self._lens(distance)
        eyes = self.center + reach * unit
        poses[:, :3, 3] = -np.einsum("nij,nj->ni", poses[:, :3, :3], eyes)
        K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
        return CameraArrays(
            K=np.tile(K, (count, 1, 1)),
            world_to_camera=poses,
            size=np.tile(np.array([width, height], dtype=np.uint32), (count, 1)),
            near=np.zeros(count),
            orthographic=np.full(count, math.isinf(distance)),
        )

    def check_distance(self, distance: float) -> float:
        """A distance in sampling radii, once it is known to be outside the bounding sphere.

        Raises
        ------
        ValueError
            If it is not.
        """
        if not distance * self.sampling_radius > self.radius:
            nearest = self.radius / self.sampling_radius
            raise ValueError(
                f"distance must be above {nearest:.6g} sampling radii, outside the bounding sphere, got {distance}"
            )
        return float(distance)

    def _lens(self, distance: float) -> tuple[float, float]:
        """Focal length in pixels (per unit of length if orthographic), and distance of the eyes in units of length."""
        side = min(self.resolution)
        if math.isinf(distance):
            return side / (2 * self.radius), 2 * self.radius
        if distance == 1:
            return self.resolution[1] / 2 / math.tan(math.radians(self.fov_y) / 2), self.sampling_radius
        reach = self.check_distance(distance) * self.sampling_radius
        return side / 2 / math.tan(math.asin(self.radius / reach)), reach

    def _half(self, fov_y: float) -> float:
        """Half of the smaller field of view, in radians."""
        width, height = self.resolution
        return math.atan(math.tan(math.radians(fov_y) / 2) * min(1.0, width / height))


def unit_directions(directions: npt.ArrayLike) -> Floats:
    """Directions scaled to unit length, checked.

    Raises
    ------
    ValueError
        If a row is zero or not finite; the message names its index.

    Examples
    --------
    >>> unit_directions([[0, 0, 2]])
    array([[0., 0., 1.]])
    """
    try:
        array = np.asarray(directions, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"directions must be numbers of shape (N, 3), got {directions!r}") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"directions must have shape (N, 3), got {array.shape}")
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scaled = array / np.abs(array).max(axis=1, keepdims=True, initial=0)
        unit = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    bad = np.flatnonzero(~np.isfinite(unit).all(axis=1))
    if len(bad):
        raise ValueError(f"directions[{bad[0]}] is {array[bad[0]].tolist()}: a direction must be finite and not zero")
    return np.asarray(unit)
