"""Images with depth: from arrays, renders, RGB-D files and stereo pairs.

How far away a pixel's surface is can be said in four ways, and an array of numbers doesn't tell which one it is. So
each has a constructor of its own:

* *depth*, along the viewing axis: `DepthImage`;
* *disparity*, 1 / depth: `DepthImage.from_disparity`;
* *range*, along the pixel's ray: `DepthImage.from_range`;
* *z*, the contents of an OpenGL depth buffer: `DepthImage.from_zbuffer`.

A pixel of which nothing is known is *missing*: a mask says so, not a number. That is not the same as infinitely far: a
sky is seen, and moves when the eye turns.
"""

from __future__ import annotations

import os
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _core
from .archives import read_archive, write_archive
from .arguments import as_numpy
from .camera import Camera
from .render import View

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["DepthImage", "disparity_from_zbuffer"]

Bytes = npt.NDArray[np.uint8]
Singles = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Ids = npt.NDArray[np.uint32]

FORMAT = "cyclorama depth image 1"

# A depth and its disparity both have to be normal float32 numbers, with something to spare for a warp between them.
_NEAREST, _FARTHEST = 1e-30, 1e30

# The steepest surface that neighbouring samples are taken for (86 degrees). Measured in rooms and on scans, 5 % of the
# mean depth aside: 4 cuts what is one, and is 0.3 dB worse.
_SLOPE = 16.0


@dataclass(frozen=True, init=False, eq=False, repr=False)
class DepthImage:
    """A picture of which the depth of each pixel is known, and the camera that took it; it never changes once made.

    Parameters
    ----------
    color : (H, W, 3) or (H, W, 4) array_like of uint8
        Red, green, blue; a fourth channel is kept, and not interpreted: every sample is opaque.
    depth : (H, W) array_like of float
        Distance of each pixel's surface along the viewing axis, in the user's units, from 1e-30 to 1e30. Infinity is
        a missing pixel where `missing` isn't given (as `Scene.render` writes it), else infinitely far.
    camera : Camera
        A pinhole camera of W x H pixels.
    missing : (H, W) array_like of bool, optional
        Pixels of which nothing is known. What `depth` holds there is not looked at.
    ids : (H, W) array_like of uint32, optional
        The face that each pixel shows, as `Scene.render` writes it.

    Attributes
    ----------
    color : (H, W, 3) or (H, W, 4) ndarray of uint8
    disparity : (H, W) ndarray of float32
        1 / depth; 0 where infinitely far and where missing.
    depth : (H, W) ndarray of float32
        Infinity where infinitely far and where missing.
    missing : (H, W) ndarray of bool
    ids : (H, W) ndarray of uint32, or None
    camera : Camera

    Raises
    ------
    ValueError
        If a depth is NaN, zero, negative or beyond what float32 holds; if a shape or type is none of the above or
        doesn't fit the camera. The message names the array, the index and the value.

    Notes
    -----
    What was given is rounded to float32 once, and the other of depth and disparity is rounded once more from that: so
    the depth of a render comes back bit for bit, and so does the disparity of a stereo pair.

    Examples
    --------
    >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
    >>> image = DepthImage(np.zeros((1, 2, 3), np.uint8), [[4.0, np.inf]], camera)
    >>> image.disparity, image.missing
    (array([[0.25, 0.  ]], dtype=float32), array([[False,  True]]))
    """

    color: Bytes
    disparity: Singles
    depth: Singles
    missing: Mask
    ids: Ids | None
    camera: Camera
    _given: str

    def __init__(
        self,
        color: npt.ArrayLike,
        depth: npt.ArrayLike,
        camera: Camera,
        *,
        missing: npt.ArrayLike | None = None,
        ids: npt.ArrayLike | None = None,
    ) -> None:
        shape = _shape_of(camera)
        values = _values("depth", depth, shape)
        mask = np.isposinf(values) if missing is None else _mask(missing, shape)
        _refuse("depth", values, ~mask & ~(values > 0), "must be positive, or missing")
        _refuse("depth", values, ~mask & np.isfinite(values) & _extreme(values), _LIMITS)
        self._set(color, np.where(mask, np.inf, values), "depth", mask, ids, camera)

    def _set(
        self, color: npt.ArrayLike, values: Floats, given: str, missing: Mask, ids: npt.ArrayLike | None, camera: Camera
    ) -> None:
        """Depth or disparity (0 where missing), checked, becomes both."""
        shape = values.shape
        primary = values.astype(np.float32)
        with np.errstate(divide="ignore"):
            # The quotient of two float32 numbers in float64 is rounded to the nearest float32 without a second thought.
            other = (1.0 / primary.astype(np.float64)).astype(np.float32)
        depth, disparity = (primary, other) if given == "depth" else (other, primary)
        keep = object.__setattr__
        keep(self, "color", _own(_color(color, shape)))
        keep(self, "disparity", _own(disparity))
        keep(self, "depth", _own(depth))
        keep(self, "missing", _own(missing))
        keep(self, "ids", None if ids is None else _own(_ids(ids, shape)))
        keep(self, "camera", camera)
        keep(self, "_given", given)

    @classmethod
    def from_disparity(
        cls,
        color: npt.ArrayLike,
        disparity: npt.ArrayLike,
        camera: Camera,
        *,
        missing: npt.ArrayLike | None = None,
        ids: npt.ArrayLike | None = None,
    ) -> DepthImage:
        """From 1 / depth; 0 is infinitely far.

        Parameters
        ----------
        color, camera, ids
            As for `DepthImage`.
        disparity : (H, W) array_like of float
            1 / depth: 0, or from 1e-30 to 1e30. Not in pixels: see `from_stereo`.
        missing : (H, W) array_like of bool, optional
            Pixels of which nothing is known; none by default. What `disparity` holds there is not looked at.

        Raises
        ------
        ValueError
            If a disparity is NaN, negative or beyond what float32 holds, and as for `DepthImage`.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
        >>> image = DepthImage.from_disparity(np.zeros((1, 2, 3), np.uint8), [[0.25, 0.0]], camera)
        >>> image.depth, image.missing
        (array([[ 4., inf]], dtype=float32), array([[False, False]]))
        """
        shape = _shape_of(camera)
        values = _values("disparity", disparity, shape)
        mask = np.zeros(shape, np.bool_) if missing is None else _mask(missing, shape)
        _refuse("disparity", values, ~mask & ~(np.isfinite(values) & (values >= 0)), "must be finite and at least 0")
        _refuse("disparity", values, ~mask & (values > 0) & _extreme(values), _LIMITS)
        image = cls.__new__(cls)
        image._set(color, np.where(mask, 0.0, values), "disparity", mask, ids, camera)
        return image

    @classmethod
    def from_range(
        cls,
        color: npt.ArrayLike,
        range: npt.ArrayLike,
        camera: Camera,
        *,
        missing: npt.ArrayLike | None = None,
        ids: npt.ArrayLike | None = None,
    ) -> DepthImage:
        """From distances along each pixel's ray, as ray casters and laser scanners measure them.

        Parameters
        ----------
        color, camera, missing, ids
            As for `DepthImage`.
        range : (H, W) array_like of float
            Distance from the eye to the surface through the pixel's centre; infinity as for a depth.

        Raises
        ------
        ValueError
            As for `DepthImage`.

        Examples
        --------
        >>> camera = Camera([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], np.eye(4), 2, 1)
        >>> DepthImage.from_range(np.zeros((1, 2, 3), np.uint8), [[2.0, 2.0]], camera).depth
        array([[2.       , 1.4142135]], dtype=float32)
        """
        shape = _shape_of(camera)
        values = _values("range", range, shape)
        mask = np.isposinf(values) if missing is None else _mask(missing, shape)
        _refuse("range", values, ~mask & ~(values > 0), "must be positive, or missing")
        _, directions = camera.rays()
        return cls(color, values / np.linalg.norm(directions, axis=-1), camera, missing=mask, ids=ids)

    @classmethod
    def from_zbuffer(
        cls,
        color: npt.ArrayLike,
        z: npt.ArrayLike,
        camera: Camera,
        near: float,
        far: float,
        *,
        missing: npt.ArrayLike | None = None,
        ids: npt.ArrayLike | None = None,
    ) -> DepthImage:
        """From what OpenGL's depth buffer holds; 1, the value it is cleared to, is missing.

        Parameters
        ----------
        color, camera, ids
            As for `DepthImage`.
        z : (H, W) array_like of float
            Depth buffer, from 0 (near plane) to 1 (far plane, or nothing drawn).
        near, far : float
            Depths of the clipping planes that it was drawn with, ``0 < near < far``.
        missing : (H, W) array_like of bool, optional
            Further pixels of which nothing is known.

        Raises
        ------
        ValueError
            As for `disparity_from_zbuffer` and `from_disparity`.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
        >>> DepthImage.from_zbuffer(np.zeros((1, 2, 3), np.uint8), [[0.75, 1.0]], camera, 1, np.inf).depth
        array([[ 4., inf]], dtype=float32)
        """
        shape = _shape_of(camera)
        values = _values("z", z, shape)
        mask = values == 1
        if missing is not None:
            mask |= _mask(missing, shape)
        disparity = disparity_from_zbuffer(np.where(mask, 1.0, values), near, far)
        return cls.from_disparity(color, disparity, camera, missing=mask, ids=ids)

    @classmethod
    def from_view(cls, view: View, *, color: npt.ArrayLike | None = None) -> DepthImage:
        """From what `Scene.render` drew; `Scene.depth_image` does both.

        Parameters
        ----------
        view : View
            Its ids and its camera are kept; pixels that see nothing are missing.
        color : (H, W, 3) or (H, W, 4) array_like of uint8, optional
            Another picture of the same view than the plain shaded one.

        Raises
        ------
        ValueError
            If `color` has another size, or the camera is orthographic.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> scene = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> view = scene.render(Camera.look_at((0.3, 0.3, 2), (0.3, 0.3, 0), width=3, height=3))
        >>> DepthImage.from_view(view)
        <DepthImage: 3 x 3, 88.9 % missing, depth 2 to 2, ids>
        """
        return cls(view.color if color is None else color, view.depth, view.camera, ids=view.ids)

    @classmethod
    def read_rgbd(
        cls,
        color_path: str | os.PathLike[str],
        depth_path: str | os.PathLike[str],
        camera: Camera,
        *,
        scale: float = 1000.0,
    ) -> DepthImage:
        """From the two files of an RGB-D frame, read by Pillow (``pip install cyclorama[viz]``).

        Parameters
        ----------
        color_path : path
            A picture of 8 bits a channel.
        depth_path : path
            A picture of one channel, usually of 16 bits; 0 is missing.
        camera : Camera
            Of the depth picture, to which the colours must be registered. Most calibrations put the first pixel's
            centre at 0: `Camera.from_opencv` takes them with ``pixel_center=0``.
        scale : float
            Steps of the depth picture to a unit of length: 1000 for millimetres in a scene in metres.

        Raises
        ------
        FileNotFoundError
            If a file isn't there.
        ValueError
            If the depth picture has several channels, the sizes don't fit the camera, or `scale` isn't positive.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> from PIL import Image
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     color, depth = Path(folder) / "color.png", Path(folder) / "depth.png"
        ...     Image.fromarray(np.zeros((1, 2, 3), np.uint8)).save(color)
        ...     Image.fromarray(np.array([[2500, 0]], np.uint16)).save(depth)
        ...     DepthImage.read_rgbd(color, depth, camera).depth
        array([[2.5, inf]], dtype=float32)
        """
        from PIL import Image

        if not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"scale must be positive and finite, got {scale}")
        with Image.open(color_path) as picture:
            color = np.asarray(picture.convert("RGBA" if "A" in picture.getbands() else "RGB"))
        with Image.open(depth_path) as picture:
            steps = np.asarray(picture)
        if steps.ndim != 2:
            raise ValueError(f"{os.fspath(depth_path)} must have one channel, got {steps.shape}")
        return cls(color, steps / scale, camera, missing=steps == 0)

    @classmethod
    def from_stereo(
        cls,
        color: npt.ArrayLike,
        disparity_px: npt.ArrayLike,
        camera: Camera,
        baseline: float,
        *,
        offset: float = 0.0,
        missing: npt.ArrayLike | None = None,
    ) -> DepthImage:
        """From the left picture of a rectified stereo pair and its disparities in pixels.

        Parameters
        ----------
        color : (H, W, 3) or (H, W, 4) array_like of uint8
            The left picture.
        disparity_px : (H, W) array_like of float
            By how many pixels each pixel ``(x, y)`` moves to the left: it is at ``(x - disparity_px, y)`` in the right
            picture. A value that is not finite is missing where `missing` isn't given.
        camera : Camera
            Of the left picture.
        baseline : float
            Distance between the eyes, in the user's units.
        offset : float
            ``cx`` of the right picture less that of the left, in pixels: what a disparity is short of that of cameras
            with the same principal point (``doffs`` in the Middlebury calibrations).
        missing : (H, W) array_like of bool, optional
            Pixels of which nothing is known.

        Raises
        ------
        ValueError
            If ``disparity_px + offset`` is negative somewhere, `baseline` isn't positive, and as for `DepthImage`.

        Examples
        --------
        >>> camera = Camera([[100, 0, 1], [0, 100, 0.5], [0, 0, 1]], np.eye(4), 2, 1)
        >>> DepthImage.from_stereo(np.zeros((1, 2, 3), np.uint8), [[5.0, np.inf]], camera, 0.2).depth
        array([[ 4., inf]], dtype=float32)
        """
        if not (np.isfinite(baseline) and baseline > 0):
            raise ValueError(f"baseline must be positive and finite, got {baseline}")
        if not np.isfinite(offset):
            raise ValueError(f"offset must be finite, got {offset}")
        shape = _shape_of(camera)
        values = _values("disparity_px", disparity_px, shape)
        mask = ~np.isfinite(values) if missing is None else _mask(missing, shape)
        _refuse("disparity_px", values, ~mask & ~np.isfinite(values), "must be finite, or missing")
        _refuse("disparity_px", values, ~mask & ~(values + offset >= 0), f"with offset {offset} it is negative")
        disparity = np.where(mask, 0.0, values + offset) / (baseline * camera.K[0, 0])
        return cls.from_disparity(color, disparity, camera, missing=mask)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> DepthImage:
        """Reads what `save` wrote.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        ValueError
            If it is cut off, damaged or something else.

        Examples
        --------
        See `save`.
        """
        with read_archive(path, FORMAT, "depth image") as (header, file):
            camera = Camera(file["K"], file["world_to_camera"], *header["size"], near=header["near"])
            given, ids = header["given"], file["ids"] if "ids" in file else None
            if given not in ("depth", "disparity"):
                raise ValueError(f"it holds {given!r}, neither depth nor disparity")
            make = cls if given == "depth" else cls.from_disparity
            return make(file["color"], file["values"], camera, missing=file["missing"], ids=ids)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an ``.npz`` that plain NumPy opens.

        Its members are ``color``, ``values`` (depth or disparity, as it was given; the header says which), ``missing``,
        ``ids``, ``K``, ``world_to_camera`` and a JSON ``header``.

        Parameters
        ----------
        path : path
            Written under another name first, and renamed when it is whole.

        Raises
        ------
        OSError
            If it can't be written.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
        >>> image = DepthImage(np.zeros((1, 2, 3), np.uint8), [[4.0, np.inf]], camera)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     image.save(Path(folder) / "image.npz")
        ...     DepthImage.load(Path(folder) / "image.npz")
        <DepthImage: 2 x 1, 50.0 % missing, depth 4 to 4>
        """
        camera = self.camera
        size = camera.width, camera.height
        header = {"given": self._given, "size": size, "near": camera.near}
        members: dict[str, npt.NDArray[Any]] = {
            "color": self.color,
            "values": self.depth if self._given == "depth" else self.disparity,
            "missing": self.missing,
            "K": camera.K,
            "world_to_camera": camera.world_to_camera,
        }
        if self.ids is not None:
            members["ids"] = self.ids
        write_archive(path, FORMAT, header, members)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        height, width = self.depth.shape
        return height, width

    @cached_property
    def _mask(self) -> Mask | None:
        """What is missing, if anything is: a warp then need not look."""
        return self.missing if self.missing.any() else None

    @cached_property
    def joins(self) -> Bytes:
        """(H, W) uint8: which samples are one surface with the ones beside them, as `cut` decides without arguments.

        1 where a sample and the one to its right are, plus 2 where it and the one below are, plus 4 where there is a
        sample, plus 8 where all of the 4 x 4 samples are from the one above and to its left on. It is found once, when
        a mesh (``splat="mesh"`` of `cyclorama.warp.forward`) is first asked for.
        """
        return self._joins(self.ids, None, _SLOPE)

    def cut(self, *, ids: bool = True, scene: Scene | None = None, slope: float = _SLOPE) -> DepthImage:
        """The same image, whose mesh is cut by another rule.

        Two samples side by side are one surface where one of these says so:

        * they show the same face;
        * they show faces that share an edge;
        * the surface between them would not be too steep;
        * the disparity between them changes as it does in two steps beside it, give or take half of that: disparity is
          linear on a plane, so a plane of four samples is never cut, however steep.

        Parameters
        ----------
        ids : bool
            Whether to ask for the image's ids, where it has some.
        scene : Scene, optional
            What was drawn: asks also whether its faces share edges.
        slope : float
            The steepest surface: so much depth for a step to the side that is as long as 1 where depth is 1. It has no
            unit and doesn't depend on the resolution; the surface is seen at an angle of ``arctan(1 / slope)``. 0
            leaves the decision to the other rules.

        Returns
        -------
        DepthImage
            It shares the arrays of this one.

        Raises
        ------
        ValueError
            If `slope` is negative or not finite, a scene is given and there are no ids or `ids` is false, or an id is
            none of its faces.

        Examples
        --------
        >>> camera = Camera([[100, 0, 2], [0, 100, 0.5], [0, 0, 1]], np.eye(4), 4, 1)
        >>> image = DepthImage(np.zeros((1, 4, 3), np.uint8), [[1.0, 1.0, 2.0, 2.0]], camera)
        >>> image.joins, image.cut(slope=1e3).joins
        (array([[5, 4, 5, 4]], dtype=uint8), array([[5, 5, 5, 4]], dtype=uint8))
        """
        if not (np.isfinite(slope) and slope >= 0):
            raise ValueError(f"slope must be finite and at least 0, got {slope}")
        asked = self.ids if ids else None
        if scene is not None and asked is None:
            raise ValueError("the scene's faces can't be asked without ids")
        image = copy(self)
        image.__dict__["joins"] = self._joins(asked, scene, slope)
        return image

    def _joins(self, ids: Ids | None, scene: Scene | None, slope: float) -> Bytes:
        step = float(1 / self.camera.K[0, 0]), float(1 / self.camera.K[1, 1])
        mesh = None if scene is None else scene._mesh
        return _core.depth_mesh_joins(self.disparity, self.missing, step, slope, ids, mesh)

    def points(self) -> Floats:
        """World positions of what the pixels show.

        Returns
        -------
        (H, W, 3) ndarray of float64
            NaN where nothing is known, or infinitely far.

        Examples
        --------
        >>> camera = Camera([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]], np.eye(4), 2, 1)
        >>> DepthImage(np.zeros((1, 2, 3), np.uint8), [[2.0, 4.0]], camera).points()
        array([[[0., 0., 2.], [4., 0., 4.]]])
        """
        height, width = self.shape
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        return self.camera.unproject(np.stack([x, y], axis=-1), self.depth)

    def __repr__(self) -> str:
        height, width = self.shape
        known = self.depth[~self.missing]
        depths = f", depth {known.min():.6g} to {known.max():.6g}" if known.size else ""
        return (
            f"<DepthImage: {width} x {height}, {100 * self.missing.mean():.1f} % missing{depths}"
            f"{'' if self.ids is None else ', ids'}>"
        )


def disparity_from_zbuffer(z: npt.ArrayLike, near: float, far: float) -> Floats:
    """1 / depth from the values of an OpenGL depth buffer.

    Parameters
    ----------
    z : array_like of float
        From 0 (near plane) to 1 (far plane, or nothing drawn: the value that the buffer is cleared to).
    near, far : float
        Depths of the clipping planes, ``0 < near < far``; `far` may be infinite.

    Returns
    -------
    ndarray of float64
        1 / depth, NaN where `z` is 1: nothing was drawn there, or nothing that can be told from it.

    Raises
    ------
    ValueError
        If the planes are not in this order or a value is outside [0, 1]; the message names its index.

    Notes
    -----
    The 1998 dissertation's formula (section 4.2.1) is ``1 - z (far - near) / far``, which is near / depth; it is
    divided by `near` here, so that pictures of different near planes can be compared.

    Examples
    --------
    >>> disparity_from_zbuffer([0.0, 0.75, 1.0], near=1, far=np.inf)
    array([1.  , 0.25,  nan])
    """
    near, far = float(near), float(far)
    if not (0 < near < far and np.isfinite(near)):
        raise ValueError(f"clip planes must satisfy 0 < near < far, got near={near}, far={far}")
    values = _numbers("z", z)
    _refuse("z", values, ~((values >= 0) & (values <= 1)), "must be from 0 to 1")
    return np.where(values == 1, np.nan, (1 - values * (1 - near / far)) / near)


_LIMITS = f"depth and disparity must be from {_NEAREST:g} to {_FARTHEST:g}"


def _extreme(values: Floats) -> Mask:
    return np.asarray((values < _NEAREST) | (values > _FARTHEST))


def _shape_of(camera: Camera) -> tuple[int, int]:
    if not isinstance(camera, Camera):
        raise ValueError(f"camera must be a Camera, got {type(camera).__name__}")
    if camera.orthographic:
        raise ValueError("camera is orthographic: a depth image needs a pinhole camera")
    return camera.height, camera.width


def _numbers(name: str, values: npt.ArrayLike) -> Floats:
    array = np.asarray(as_numpy(values))
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be real numbers, got dtype {array.dtype}")
    return array.astype(np.float64)


def _values(name: str, values: npt.ArrayLike, shape: tuple[int, int]) -> Floats:
    array = _numbers(name, values)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, as the camera has, got {array.shape}")
    return array


def _refuse(name: str, values: Floats, wrong: Mask, why: str) -> None:
    """Says where the first wrong value is, if there is one."""
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise ValueError(f"{name}{list(index)} is {values[index]}: {why}")


def _mask(missing: npt.ArrayLike, shape: tuple[int, int]) -> Mask:
    array = np.asarray(as_numpy(missing))
    if array.shape != shape or array.dtype != np.bool_:
        raise ValueError(f"missing must be {shape} bool, as the camera has, got {array.shape} {array.dtype}")
    return array


def _ids(ids: npt.ArrayLike, shape: tuple[int, int]) -> Ids:
    array = np.asarray(as_numpy(ids))
    if array.shape != shape or array.dtype != np.uint32:
        raise ValueError(f"ids must be {shape} uint32, as the camera has, got {array.shape} {array.dtype}")
    return array


def _color(color: npt.ArrayLike, shape: tuple[int, ...]) -> Bytes:
    array = np.asarray(as_numpy(color))
    if array.ndim != 3 or array.shape[:2] != shape or array.shape[2] not in (3, 4) or array.dtype != np.uint8:
        height, width = shape
        raise ValueError(f"color must be ({height}, {width}, 3 or 4) uint8, got {array.shape} {array.dtype}")
    return array


def _own(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A copy that never changes, whatever happens to the caller's array."""
    copy = np.array(array, order="C")
    copy.flags.writeable = False
    return copy
