"""Cameras: pinhole and orthographic, in OpenCV axes, with OpenGL at the door.

A camera's axes are OpenCV's: ``+x`` right, ``+y`` down, ``+z`` forward. Pixel ``(x, y)`` has its centre at
``(x + 0.5, y + 0.5)`` in the coordinates of ``K``, as in OpenGL and in Open3D's pinhole rays. Depth is ``z`` along the
viewing axis, in the user's units. A pinhole camera maps ``(x, y, z)`` of its space to the pixel
``K @ (x / z, y / z, 1)``, an orthographic one to ``K @ (x, y, 1)``.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable
from typing import Any, NamedTuple, SupportsIndex

import numpy as np
import numpy.typing as npt

from .arguments import as_numpy

__all__ = ["Camera", "CameraArrays", "stack"]

Floats = npt.NDArray[np.float64]

# The kernels keep pixel indices well inside 32 bits; the same bound as theirs.
_MAX_SIDE = 1 << 15
# Entries of R R^T - I: what is left of a rotation stored as float32, ten times over.
_ROTATION_TOLERANCE = 1e-6
# Beyond this |cos| between `up` and the view, `up` says too little of how to hold the camera.
_UP_LIMIT = 0.999
# The near plane of `to_opengl` where neither the caller nor the camera has one; pyrender's default.
_OPENGL_NEAR = 0.05
# OpenCV axes (y down, z forward) to OpenGL axes (y up, z backward), and back.
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


class CameraArrays(NamedTuple):
    """Cameras as the kernels take them: one row per camera, C-contiguous."""

    K: Floats
    world_to_camera: Floats
    size: npt.NDArray[np.uint32]
    near: Floats
    orthographic: npt.NDArray[np.bool_]


class Camera:
    """A pinhole or orthographic camera; it never changes once made.

    Most cameras come from `look_at`, `orthographic_look_at`, `from_opengl` or `from_opencv`.

    Parameters
    ----------
    K : (3, 3) array_like of float
        Intrinsics ``[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]`` in pixels, pixel centres at ``+0.5``; for an
        orthographic camera ``fx`` and ``fy`` are pixels per unit of length.
    world_to_camera : (4, 4) array_like of float
        Rotation and translation from the world to the camera's axes (``+x`` right, ``+y`` down, ``+z`` forward).
    width, height : int
        Size of the image in pixels.
    near : float
        Points with a smaller depth are not seen. 0 clips at the plane of the eye itself.
    orthographic : bool
        Parallel rays instead of rays through one eye.

    Raises
    ------
    ValueError
        If the size is not 1 to 32768 pixels a side, a value is not finite, `near` is negative, `K` is not of the form
        above with positive focal lengths, or `world_to_camera` is not a rotation and a translation.

    Examples
    --------
    >>> camera = Camera([[100, 0, 32], [0, 100, 24], [0, 0, 1]], np.eye(4), 64, 48)
    >>> camera.project([[0, 0, 2], [0.5, 0, 2]])[0]
    array([[32., 24.], [57., 24.]])
    """

    __slots__ = ("K", "height", "near", "orthographic", "width", "world_to_camera")

    K: Floats
    world_to_camera: Floats
    width: int
    height: int
    near: float
    orthographic: bool

    def __init__(
        self,
        K: npt.ArrayLike,
        world_to_camera: npt.ArrayLike,
        width: SupportsIndex,
        height: SupportsIndex,
        *,
        near: float = 0.0,
        orthographic: bool = False,
    ) -> None:
        keep = object.__setattr__
        keep(self, "K", _intrinsics(K))
        keep(self, "world_to_camera", _pose(world_to_camera))
        keep(self, "width", _side("width", width))
        keep(self, "height", _side("height", height))
        keep(self, "near", _number("near", near))
        keep(self, "orthographic", bool(orthographic))
        if self.near < 0:
            raise ValueError(f"near must be at least 0, got {self.near}")

    @classmethod
    def look_at(
        cls,
        eye: npt.ArrayLike,
        target: npt.ArrayLike,
        up: npt.ArrayLike = (0.0, 1.0, 0.0),
        fov_y: float = 45.0,
        width: SupportsIndex = 510,
        height: SupportsIndex = 480,
        near: float = 0.0,
    ) -> Camera:
        """A pinhole camera at `eye` with `target` in the middle of its image.

        Parameters
        ----------
        eye, target : (3,) array_like of float
            World positions, in the user's units.
        up : (3,) array_like of float
            World direction that is up in the image. Where it is within 2.6 degrees of the viewing axis
            (``|up . view| > 0.999``) the coordinate axis after its largest component takes its place: z for y.
        fov_y : float
            Vertical field of view in degrees, between 0 and 180.
        width, height : int
            Size of the image in pixels.
        near : float
            Points with a smaller depth are not seen.

        Raises
        ------
        ValueError
            If `eye` and `target` are the same point, `up` is zero, `fov_y` is outside (0, 180), or a value is bad for
            `Camera` itself.

        Examples
        --------
        >>> Camera.look_at((0, 0, 5), (0, 0, 0)).forward
        array([ 0.,  0., -1.])
        """
        pose = _look_at(eye, target, up)
        fov_y = _number("fov_y", fov_y)
        if not 0.0 < fov_y < 180.0:
            raise ValueError(f"fov_y must be between 0 and 180 degrees, got {fov_y}")
        width, height = _side("width", width), _side("height", height)
        focal = height / 2 / math.tan(math.radians(fov_y) / 2)
        return cls(_centred(focal, width, height), pose, width, height, near=near)

    @classmethod
    def orthographic_look_at(
        cls,
        eye: npt.ArrayLike,
        target: npt.ArrayLike,
        up: npt.ArrayLike = (0.0, 1.0, 0.0),
        extent: float = 1.0,
        width: SupportsIndex = 510,
        height: SupportsIndex = 480,
        near: float = 0.0,
    ) -> Camera:
        """A camera of parallel rays, from the plane through `eye` toward `target`.

        Parameters
        ----------
        eye, target : (3,) array_like of float
            The middle of the image's plane, where depth is 0, and a point that the middle ray meets.
        up : (3,) array_like of float
            As for `look_at`.
        extent : float
            Height of the image in the world's units.
        width, height : int
            Size of the image in pixels; pixels are square.
        near : float
            Points with a smaller depth are not seen.

        Raises
        ------
        ValueError
            If `eye` and `target` are the same point, `up` is zero, or `extent` is not positive.

        Examples
        --------
        >>> camera = Camera.orthographic_look_at((0, 0, 5), (0, 0, 0), extent=2, width=100, height=100)
        >>> camera.project([[1, 0, 0], [1, 0, -20]])
        (array([[100.,  50.], [100.,  50.]]), array([ 5., 25.]))
        """
        pose = _look_at(eye, target, up)
        extent = _number("extent", extent)
        if not extent > 0.0:
            raise ValueError(f"extent must be positive, got {extent}")
        width, height = _side("width", width), _side("height", height)
        return cls(_centred(height / extent, width, height), pose, width, height, near=near, orthographic=True)

    @classmethod
    def from_opencv(
        cls,
        K: npt.ArrayLike,
        world_to_camera: npt.ArrayLike,
        width: SupportsIndex,
        height: SupportsIndex,
        *,
        pixel_center: float,
        near: float = 0.0,
    ) -> Camera:
        """A pinhole camera from a calibration that says where its pixel centres are.

        Parameters
        ----------
        K : (3, 3) array_like of float
            Intrinsics in pixels.
        world_to_camera : (4, 4) or (3, 4) array_like of float
            Extrinsics, OpenCV axes.
        width, height : int
            Size of the image in pixels.
        pixel_center : 0 or 0.5
            Where the centre of the first pixel is in the coordinates of `K`. 0 (OpenCV and most data sets) adds 0.5 to
            ``cx`` and ``cy``.
        near : float
            Points with a smaller depth are not seen.

        Raises
        ------
        ValueError
            If `pixel_center` is neither 0 nor 0.5, or a value is bad for `Camera` itself.

        Examples
        --------
        >>> camera = Camera.from_opencv([[100, 0, 31.5], [0, 100, 23.5], [0, 0, 1]], np.eye(4), 64, 48, pixel_center=0)
        >>> camera.K[:2, 2]
        array([32., 24.])
        """
        if pixel_center not in (0, 0.5):
            raise ValueError(f"pixel_center must be 0 or 0.5, got {pixel_center}")
        intrinsics = _intrinsics(K).copy()
        intrinsics[:2, 2] += 0.5 - pixel_center
        pose = _array("world_to_camera", world_to_camera)
        if pose.shape == (3, 4):
            pose = np.vstack([pose, [0.0, 0.0, 0.0, 1.0]])
        return cls(intrinsics, pose, width, height, near=near)

    @classmethod
    def from_opengl(
        cls,
        view: npt.ArrayLike,
        projection: npt.ArrayLike,
        width: SupportsIndex,
        height: SupportsIndex,
        *,
        near: float | None = None,
    ) -> Camera:
        """The camera that sees what OpenGL draws with these matrices into a viewport of this size.

        Parameters
        ----------
        view : (4, 4) array_like of float
            World to eye space (``+y`` up, ``-z`` forward), acting on columns; the inverse of a camera's pose.
        projection : (4, 4) array_like of float
            Eye space to clip space, perspective or orthographic, acting on columns.
        width, height : int
            Size of the viewport in pixels.
        near : float, optional
            Points with a smaller depth are not seen. By default the near plane of `projection`.

        Raises
        ------
        ValueError
            If `view` is not rigid, `projection` is neither a perspective nor an orthographic one, or its near plane is
            not in front of the eye (a reversed depth range, say) and `near` is not given.

        Examples
        --------
        >>> camera = Camera.look_at((3, 4, 5), (0, 0, 0))
        >>> same = Camera.from_opengl(*camera.to_opengl(near=0.1, far=10), camera.width, camera.height)
        >>> np.allclose(same.K, camera.K), round(same.near, 9)
        (True, 0.1)
        """
        clip = _array("projection", projection, (4, 4))
        width, height = _side("width", width), _side("height", height)
        orthographic = _is_orthographic(clip)
        (a, b), (c, d) = clip[:2, :2]
        x0, y0 = clip[:2, 3] if orthographic else -clip[:2, 2]
        K = [
            [width / 2 * a, -width / 2 * b, width / 2 * (1 + x0)],
            [-height / 2 * c, height / 2 * d, height / 2 * (1 - y0)],
            [0.0, 0.0, 1.0],
        ]
        if near is None:
            near = _opengl_near(clip, orthographic)
        pose = _FLIP @ _pose(view, name="view")
        return cls(K, pose, width, height, near=near, orthographic=orthographic)

    def to_opengl(self, near: float | None = None, far: float = math.inf) -> tuple[Floats, Floats]:
        """View and projection matrices with which OpenGL draws this camera's image.

        Parameters
        ----------
        near : float, optional
            Depth of the near plane, positive (any number below `far` for an orthographic camera). By default the
            camera's own, or 0.05 where that is 0, which OpenGL can't have.
        far : float
            Depth of the far plane; infinite for a pinhole camera where nothing is said. An orthographic camera needs
            one.

        Returns
        -------
        view, projection : (4, 4) ndarray of float64
            World to eye space, eye space to clip space, acting on columns.

        Raises
        ------
        ValueError
            If ``0 < near < far`` does not hold (``near < far < inf`` for an orthographic camera).

        Examples
        --------
        >>> view, projection = Camera.look_at((0, 0, 5), (0, 0, 0), fov_y=90, width=64, height=64).to_opengl(1, 10)
        >>> projection[:2, :2].round(12)
        array([[1., 0.], [0., 1.]])
        """
        if near is None:
            near = self.near or (0.0 if self.orthographic else _OPENGL_NEAR)
        near = _number("near", near)
        (fx, skew, cx), (_, fy, cy), _ = self.K
        w, h = self.width, self.height
        clip = np.zeros((4, 4))
        clip[0, :2] = 2 * fx / w, -2 * skew / w
        clip[1, 1] = 2 * fy / h
        offset = 2 * cx / w - 1, 1 - 2 * cy / h
        if self.orthographic:
            if not near < far < math.inf:
                raise ValueError(f"an orthographic camera needs finite clip planes, near < far, got {near} and {far}")
            clip[:2, 3] = offset
            clip[2, 2:] = -2 / (far - near), -(far + near) / (far - near)
            clip[3, 3] = 1.0
        else:
            if not 0.0 < near < far:
                raise ValueError(f"clip planes must satisfy 0 < near < far, got near={near}, far={far}")
            ratio = near / far
            clip[0, 2], clip[1, 2] = -offset[0], -offset[1]
            clip[2, 2:] = -(1 + ratio) / (1 - ratio), -2 * near / (1 - ratio)
            clip[3, 2] = -1.0
        return _FLIP @ self.world_to_camera + 0.0, clip + 0.0

    @property
    def eye(self) -> Floats:
        """(3,) world position that all rays pass through; an orthographic camera has none and raises `ValueError`."""
        if self.orthographic:
            raise ValueError("an orthographic camera has no eye: its rays are parallel (see `forward`)")
        return self.camera_to_world[:3, 3].copy()

    @property
    def camera_to_world(self) -> Floats:
        """(4, 4) from the camera's axes to the world."""
        inverse = np.eye(4)
        inverse[:3, :3] = np.linalg.inv(self.world_to_camera[:3, :3])
        inverse[:3, 3] = -inverse[:3, :3] @ self.world_to_camera[:3, 3]
        return inverse

    @property
    def forward(self) -> Floats:
        """(3,) unit world direction of the viewing axis."""
        axis = self.camera_to_world[:3, 2]
        return np.asarray(axis / np.linalg.norm(axis) + 0.0)

    @property
    def fov_x(self) -> float:
        """Horizontal field of view in degrees, through the principal point; 0 for an orthographic camera."""
        return self._fov(0, self.width)

    @property
    def fov_y(self) -> float:
        """Vertical field of view in degrees, through the principal point; 0 for an orthographic camera."""
        return self._fov(1, self.height)

    def _fov(self, axis: int, side: int) -> float:
        if self.orthographic:
            return 0.0
        focal, centre = float(self.K[axis, axis]), float(self.K[axis, 2])
        return math.degrees(math.atan(centre / focal) + math.atan((side - centre) / focal))

    def rays(self) -> tuple[Floats, Floats]:
        """The ray through the centre of each pixel.

        Returns
        -------
        origins : (H, W, 3) ndarray of float64
            World positions of depth 0: the eye, or points of the image plane of an orthographic camera.
        directions : (H, W, 3) ndarray of float64
            World directions whose length along the viewing axis is 1, so that ``origins + depth * directions`` is the
            point at that depth. They are not unit vectors, except in the middle.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 5), (0, 0, 0), width=3, height=3)
        >>> origins, directions = camera.rays()
        >>> origins[1, 1] + 4 * directions[1, 1]
        array([0., 0., 1.])
        """
        to_world = self.camera_to_world
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        plane = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(self.K).T
        if self.orthographic:
            plane[..., 2] = 0.0
            origins = plane @ to_world[:3, :3].T + to_world[:3, 3]
            directions = np.empty_like(origins)
            directions[...] = to_world[:3, 2]
            return origins, directions
        directions = plane @ to_world[:3, :3].T
        origins = np.empty_like(directions)
        origins[...] = to_world[:3, 3]
        return origins, directions

    def project(self, points: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Where world points fall in the image, and how deep they lie.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World positions; any number of leading axes, a single point too.

        Returns
        -------
        pixels : (N, 2) ndarray of float64
            ``(x, y)`` in the coordinates of `K`: the first pixel's centre is (0.5, 0.5). NaN where a pinhole camera has
            the point at or behind its eye's plane.
        depth : (N,) ndarray of float64
            Distance along the viewing axis.

        Raises
        ------
        ValueError
            If the last axis is not 3.

        Examples
        --------
        >>> Camera.look_at((0, 0, 5), (0, 0, 0), width=64, height=48).project((0, 0, 1))
        (array([32., 24.]), array(4.))
        """
        world = np.asarray(points, dtype=np.float64)
        if world.ndim == 0 or world.shape[-1] != 3:
            raise ValueError(f"points must have shape (N, 3), got {world.shape}")
        local = world @ self.world_to_camera[:3, :3].T + self.world_to_camera[:3, 3]
        depth = local[..., 2].copy()
        plane = local
        if not self.orthographic:
            with np.errstate(divide="ignore", invalid="ignore"):
                plane = np.where(depth[..., None] > 0, local / depth[..., None], np.nan)
        return plane[..., :2] @ self.K[:2, :2].T + self.K[:2, 2], depth

    def unproject(self, pixels: npt.ArrayLike, depth: npt.ArrayLike) -> Floats:
        """World points at these pixels and depths; the inverse of `project`.

        Parameters
        ----------
        pixels : (N, 2) array_like of float
            ``(x, y)`` in the coordinates of `K`.
        depth : (N,) array_like of float
            Distance along the viewing axis.

        Returns
        -------
        (N, 3) ndarray of float64
            World positions; NaN where `depth` is not finite (the background of a depth image).

        Raises
        ------
        ValueError
            If the shapes do not fit.

        Examples
        --------
        >>> Camera.look_at((0, 0, 5), (0, 0, 0), width=64, height=48).unproject((32, 24), 4)
        array([0., 0., 1.])
        """
        image = np.asarray(pixels, dtype=np.float64)
        if image.ndim == 0 or image.shape[-1] != 2:
            raise ValueError(f"pixels must have shape (N, 2), got {image.shape}")
        z = np.asarray(depth, dtype=np.float64)
        if z.shape != image.shape[:-1]:
            raise ValueError(
                f"depth must have shape {image.shape[:-1]} for pixels of shape {image.shape}, got {z.shape}"
            )
        z = np.where(np.isfinite(z), z, np.nan)
        plane = (image - self.K[:2, 2]) @ np.linalg.inv(self.K[:2, :2]).T
        local = np.empty((*z.shape, 3))
        local[..., :2] = plane if self.orthographic else plane * z[..., None]
        local[..., 2] = z
        local[np.isnan(z)] = np.nan
        to_world = self.camera_to_world
        return np.asarray(local @ to_world[:3, :3].T + to_world[:3, 3])

    def with_size(self, width: SupportsIndex, height: SupportsIndex) -> Camera:
        """The same view in an image of another size; pixels are stretched where the proportions differ.

        Examples
        --------
        >>> Camera.look_at((0, 0, 5), (0, 0, 0)).with_size(1020, 960).fov_y
        45.0
        """
        width, height = _side("width", width), _side("height", height)
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return self.replace(K=scale @ self.K, width=width, height=height)

    def scaled(self, factor: float) -> Camera:
        """The same view with `factor` times as many pixels along each side, rounded to whole pixels.

        Examples
        --------
        >>> Camera.look_at((0, 0, 5), (0, 0, 0)).scaled(0.5)
        <Camera: 255 x 240, fov_y 45, eye (0, 0, 5), forward (0, 0, -1)>
        """
        factor = _number("factor", factor)
        if not factor > 0.0:
            raise ValueError(f"factor must be positive, got {factor}")
        return self.with_size(max(1, round(self.width * factor)), max(1, round(self.height * factor)))

    def replace(self, **changes: Any) -> Camera:
        """A camera with some of its attributes changed, checked again.

        Examples
        --------
        >>> Camera.look_at((0, 0, 5), (0, 0, 0)).replace(near=0.5).near
        0.5
        """
        values = {name: getattr(self, name) for name in self.__slots__}
        unknown = sorted(set(changes) - set(values))
        if unknown:
            raise ValueError(f"a camera has no {unknown[0]!r}: it has {', '.join(sorted(values))}")
        return Camera(**(values | changes))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a camera never changes: use replace({name}=...)")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a camera never changes: cannot delete {name}")

    def _state(self) -> tuple[object, ...]:
        # `+ 0.0` makes -0.0 and 0.0, which are equal, the same bytes.
        arrays = (self.K + 0.0).tobytes(), (self.world_to_camera + 0.0).tobytes()
        return (*arrays, self.width, self.height, self.near, self.orthographic)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        return self._state() == other._state()

    def __hash__(self) -> int:
        return hash(self._state())

    def __reduce__(self) -> tuple[object, ...]:
        return _restore, (self.K, self.world_to_camera, self.width, self.height, self.near, self.orthographic)

    def __repr__(self) -> str:
        if self.orthographic:
            lens = f"orthographic, extent {self.height / self.K[1, 1]:.6g}"
            place = f"through {_text(self.camera_to_world[:3, 3])}"
        else:
            lens, place = f"fov_y {self.fov_y:.6g}", f"eye {_text(self.eye)}"
        near = f", near {self.near:.6g}" if self.near else ""
        return f"<Camera: {self.width} x {self.height}, {lens}, {place}, forward {_text(self.forward)}{near}>"


def stack(cameras: Camera | Iterable[Camera]) -> CameraArrays:
    """Cameras as arrays, a row per camera, as the kernels take them.

    Parameters
    ----------
    cameras : Camera or iterable of Camera
        N cameras; one alone counts as a list of one.

    Returns
    -------
    CameraArrays
        ``K`` (N, 3, 3) float64, ``world_to_camera`` (N, 4, 4) float64, ``size`` (N, 2) uint32 (width, height), ``near``
        (N,) float64, ``orthographic`` (N,) bool; all C-contiguous, and a plain tuple in this order.

    Raises
    ------
    ValueError
        If an item is not a `Camera`; the message names its index.

    Examples
    --------
    >>> stack([Camera.look_at((0, 0, 5), (0, 0, 0))] * 2).size
    array([[510, 480], [510, 480]], dtype=uint32)
    """
    items = [cameras] if isinstance(cameras, Camera) else list(cameras)
    for index, camera in enumerate(items):
        if not isinstance(camera, Camera):
            raise ValueError(f"cameras[{index}] must be a Camera, got {type(camera).__name__}")
    count = len(items)
    return CameraArrays(
        K=np.array([camera.K for camera in items], dtype=np.float64).reshape(count, 3, 3),
        world_to_camera=np.array([camera.world_to_camera for camera in items], dtype=np.float64).reshape(count, 4, 4),
        size=np.array([(camera.width, camera.height) for camera in items], dtype=np.uint32).reshape(count, 2),
        near=np.array([camera.near for camera in items], dtype=np.float64),
        orthographic=np.array([camera.orthographic for camera in items], dtype=np.bool_),
    )


def _restore(K: Floats, world_to_camera: Floats, width: int, height: int, near: float, orthographic: bool) -> Camera:
    return Camera(K, world_to_camera, width, height, near=near, orthographic=orthographic)


def _text(vector: Floats) -> str:
    return "(" + ", ".join(f"{value + 0.0:.6g}" for value in vector.round(9)) + ")"


def _number(name: str, value: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a number, got {value!r}") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def _side(name: str, value: SupportsIndex) -> int:
    try:
        side = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be a whole number of pixels, got {value!r}") from None
    if not 1 <= side <= _MAX_SIDE:
        raise ValueError(f"{name} must be 1 to {_MAX_SIDE} pixels, got {side}")
    return side


def _array(name: str, value: npt.ArrayLike, shape: tuple[int, ...] | None = None) -> Floats:
    try:
        array = np.array(as_numpy(value), dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be an array of numbers, got {value!r}") from None
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        index = tuple(int(i) for i in bad[0])
        raise ValueError(f"{name}{list(index)} is {array[index]}: values must be finite")
    return array


def _intrinsics(K: npt.ArrayLike) -> Floats:
    array = _array("K", K, (3, 3))
    if array[2].tolist() != [0.0, 0.0, 1.0] or array[1, 0] != 0.0:
        raise ValueError(f"K must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], got {array.tolist()}")
    if not (array[0, 0] > 0.0 and array[1, 1] > 0.0):
        raise ValueError(f"K must have positive focal lengths, got fx={array[0, 0]}, fy={array[1, 1]}")
    array.flags.writeable = False
    return array


def _pose(world_to_camera: npt.ArrayLike, name: str = "world_to_camera") -> Floats:
    array = _array(name, world_to_camera, (4, 4))
    if array[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ValueError(f"{name} must have the last row (0, 0, 0, 1), got {array[3].tolist()}")
    rotation = array[:3, :3]
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > _ROTATION_TOLERANCE:
        raise ValueError(f"{name} must hold a rotation: R R^T differs from the identity by {error:.3g}")
    if np.linalg.det(rotation) < 0.0:
        raise ValueError(f"{name} must hold a rotation, but it mirrors: its determinant is -1")
    array.flags.writeable = False
    return array


def _centred(focal: float, width: int, height: int) -> Floats:
    return np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])


def _look_at(eye: npt.ArrayLike, target: npt.ArrayLike, up: npt.ArrayLike) -> Floats:
    """World to camera, from where to where."""
    position, goal, upward = _array("eye", eye, (3,)), _array("target", target, (3,)), _array("up", up, (3,))
    axis = goal - position
    distance = math.hypot(*axis)
    if distance == 0.0:
        raise ValueError(f"eye and target are the same point, {position.tolist()}: there is no direction to look in")
    if not math.isfinite(distance):
        raise ValueError(f"eye {position.tolist()} and target {goal.tolist()} are too far apart for float64")
    forward = axis / distance
    length = math.hypot(*upward)
    if length == 0.0 or not math.isfinite(length):
        raise ValueError(f"up must be a direction, got {upward.tolist()}")
    upward /= length
    if abs(float(upward @ forward)) > _UP_LIMIT:
        upward = np.eye(3)[(int(np.abs(upward).argmax()) + 1) % 3]
    right = np.cross(forward, upward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = right, np.cross(forward, right), forward
    pose[:3, 3] = -pose[:3, :3] @ position
    return pose + 0.0


def _is_orthographic(projection: Floats) -> bool:
    last = projection[3].tolist()
    perspective, orthographic = last == [0.0, 0.0, -1.0, 0.0], last == [0.0, 0.0, 0.0, 1.0]
    if not (perspective or orthographic):
        raise ValueError(f"projection must have the last row (0, 0, -1, 0) or (0, 0, 0, 1), got {last}")
    stray = projection[:2, 2] if orthographic else projection[:2, 3]
    if stray.any():
        raise ValueError(
            f"projection shifts the picture with depth: column {2 if orthographic else 3} is {stray.tolist()}"
        )
    if projection[1, 0] != 0.0:
        raise ValueError(f"projection[1, 0] must be 0, got {projection[1, 0]}")
    return bool(orthographic)


def _opengl_near(projection: Floats, orthographic: bool) -> float:
    """Depth at which normalised device z is -1."""
    a, b = (float(value) for value in projection[2, 2:])
    if orthographic:
        near, far = ((1 + b) / a, (b - 1) / a) if a else (math.nan, math.nan)
    else:
        near, far = (b / (a - 1) if a != 1 else math.nan), (b / (a + 1) if a != -1 else math.inf)
    if not (0.0 <= near < far if orthographic else 0.0 < near < far):
        raise ValueError(
            f"projection has its near plane at depth {near:.6g} and its far plane at {far:.6g}: give near="
        )
    return near
