"""Layered depth images: several samples a pixel, of all surfaces that some region of eyes may see.

An image with depth has holes wherever a new eye looks behind what hid something from the old one. A layered image holds
what is behind, too: its pixels have lists of samples, nearest first. It has one camera, so it is warped like a single
image, and each surface is stored once, not once for each image that it was seen in (1998 dissertation, section 4.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from . import _core
from .camera import Camera, stack
from .depth_image import DepthImage
from .placing import camera_through, construction_cameras, quadrilateral
from .render import BACKGROUND
from .warp import Order, Warped, _check_camera, _colors_behind, _fresh, _splat_size

if TYPE_CHECKING:
    from .scene import Scene

__all__ = [
    "LayeredDepthImage",
    "LayeredWarped",
    "Stats",
    "camera_through",
    "construction_cameras",
    "quadrilateral",
]

Floats = npt.NDArray[np.float64]
Cull = Literal["exact"] | Literal[False]


@dataclass(frozen=True)
class Stats:
    """What became of the samples of a layered image in a warp.

    Attributes
    ----------
    samples : int
        All there are.
    drawn, hidden, outside : int
        Those that were drawn; those left out because they are hidden; those left out because they lie beside the
        image. Samples are drawn or left out some at a time: of those drawn some are hidden, too, or outside.
    """

    samples: int
    drawn: int
    hidden: int
    outside: int

    @property
    def eliminated(self) -> float:
        """The share of samples that were left out because they are hidden."""
        return self.hidden / self.samples if self.samples else 0.0


@dataclass(frozen=True, eq=False, repr=False)
class LayeredWarped(Warped):
    """What a camera sees of a layered image: a `Warped` with `.stats`; its `.source` is 0 where a sample is shown."""

    stats: Stats

    def __repr__(self) -> str:
        height, width = self.hole.shape
        return (
            f"<LayeredWarped: {width} x {height}, {100 * self.hole.mean():.1f} % hole, "
            f"{self.stats.drawn:,} of {self.stats.samples:,} samples drawn>"
        )


class LayeredDepthImage:
    """Samples of surfaces by pixel of one camera, nearest first; it never changes once made.

    Most are made by `build`, or by `cast` from a scene.

    Parameters
    ----------
    camera : Camera
        A pinhole camera of W x H pixels.
    offsets : (H * W + 1,) array_like of int
        Pixel ``p = y W + x`` has the samples ``offsets[p]`` to ``offsets[p + 1] - 1``.
    color : (N, 3) array_like of uint8
        Of each sample.
    disparity : (N,) array_like of float32
        1 / depth of each sample; 0 is infinitely far. It doesn't grow within a pixel.
    place : (N, 2) array_like of int, optional
        Where in its pixel a sample lies: how many sixteenths of a pixel right of and below its centre, -8 to 7. At the
        centre by default.

    Raises
    ------
    ValueError
        If the offsets don't ascend from 0 to N, a disparity is negative, not finite or greater than the one before it
        in its pixel, a place is out of range, or a shape doesn't fit. The message names the array, the index and the
        value.

    Notes
    -----
    A sample takes 8 bytes, colour, place and disparity, and a pixel 4, its offset. Warping adds 10 bytes a sample, made
    at the first warp.

    Examples
    --------
    >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
    >>> LayeredDepthImage(camera, [0, 2, 2], [(255, 0, 0), (0, 255, 0)], [0.5, 0.25])
    <LayeredDepthImage: 2 x 1, 2 samples, 1.00 a pixel>
    """

    def __init__(
        self,
        camera: Camera,
        offsets: npt.ArrayLike,
        color: npt.ArrayLike,
        disparity: npt.ArrayLike,
        place: npt.ArrayLike | None = None,
    ) -> None:
        _check_camera(camera)
        values = np.ascontiguousarray(disparity, dtype=np.float32)
        if values.ndim != 1:
            raise ValueError(f"disparity must be (N,), got {values.shape}")
        count = len(values)
        starts = _integers("offsets", offsets, (camera.width * camera.height + 1,), 0, 2**32 - 1)
        colors = np.asarray(color)
        if colors.size == 0:
            colors = np.empty((0, 3), np.uint8)
        if colors.shape != (count, 3) or colors.dtype.kind not in "iu" or (colors.size and colors.max() > 255):
            raise ValueError(f"color must be ({count}, 3) uint8, got {colors.shape} {colors.dtype}")
        places = np.zeros((count, 2), np.int8) if place is None else _integers("place", place, (count, 2), -8, 7)
        self._kernel = _core.Layered(
            stack(camera),
            starts.astype(np.uint32),
            np.ascontiguousarray(colors, dtype=np.uint8),
            values,
            places.astype(np.int8),
        )
        self.camera = camera

    @classmethod
    def _of(cls, kernel: _core.Layered, camera: Camera) -> LayeredDepthImage:
        image = cls.__new__(cls)
        image._kernel, image.camera = kernel, camera
        return image

    @classmethod
    def build(
        cls,
        central: DepthImage,
        construction: Sequence[DepthImage] = (),
        *,
        tolerance: float = 2.0,
        color_tolerance: int = 64,
        threads: int | None = None,
    ) -> LayeredDepthImage:
        """Merge images into one layered image (section 4.3.1 of the dissertation).

        Every sample of every image is warped to the central camera. One that lies at nearly the same depth as another
        of its pixel is left out, unless their colours differ; the image that comes first has precedence.

        Parameters
        ----------
        central : DepthImage
            Its camera becomes the layered image's. All its samples are kept.
        construction : sequence of DepthImage
            Images of any sizes from nearby, nearest first, 255 at most; `construction_cameras` says where to take them.
            None: one sample a pixel.
        tolerance : float
            Samples conflict where their depths differ by at most so many times the width that a pixel covers there.
        color_tolerance : int
            Conflicting samples are both kept where a channel of their colours differs by more.
        threads : int, optional
            All cores by default. The answer doesn't depend on it.

        Returns
        -------
        LayeredDepthImage

        Raises
        ------
        ValueError
            If an argument is none of the above.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=4, height=3)
        >>> wall = DepthImage(np.full((3, 4, 3), 200, np.uint8), np.full((3, 4), 4.0), camera)
        >>> LayeredDepthImage.build(wall, [wall])
        <LayeredDepthImage: 4 x 3, 12 samples, 1.00 a pixel>
        """
        images = [central, *construction]
        for index, image in enumerate(images):
            if not isinstance(image, DepthImage):
                name = f"construction[{index - 1}]" if index else "central"
                raise ValueError(f"{name} must be a DepthImage, got {type(image).__name__}")
        if not (np.isfinite(tolerance) and tolerance >= 0):
            raise ValueError(f"tolerance must be finite and at least 0, got {tolerance}")
        if not (isinstance(color_tolerance, (int, np.integer)) and 0 <= color_tolerance <= 255):
            raise ValueError(f"color_tolerance must be an integer from 0 to 255, got {color_tolerance!r}")
        kernel, _ = _core.Layered.build(
            stack([image.camera for image in images]),
            [(image.color, image.disparity, image.missing) for image in images],
            float(tolerance),
            int(color_tolerance),
            threads,
        )
        return cls._of(kernel, central.camera)

    @classmethod
    def cast(
        cls,
        scene: Scene,
        camera: Camera,
        layers: int | None = None,
        *,
        tolerance: float = 0.0,
        color: Callable[[npt.NDArray[np.uint32], Floats], npt.ArrayLike] | None = None,
        threads: int | None = None,
    ) -> LayeredDepthImage:
        """Sample all surfaces that the ray through each pixel meets (section 4.3.1, figure 4-4 (a)).

        Parameters
        ----------
        scene : Scene
            Its transparent faces are left out.
        camera : Camera
            A pinhole camera.
        layers : int, optional
            At most so many samples a pixel, the nearest ones. All by default.
        tolerance : float
            A hit that lies behind another by at most so many times the width that a pixel covers there is left out.
        color : callable, optional
            Takes the faces (N,) and the world positions (N, 3) of N hits, and gives their colours (N, 3) uint8. By
            default they are shaded as `Scene.render` shades them.
        threads : int, optional
            All cores by default.

        Raises
        ------
        ValueError
            If an argument is none of the above.

        Notes
        -----
        This sees every surface that a ray crosses, but those along the rays not at all, and it stores many that no
        eye near the camera will ever see: `build` is usually smaller and better.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> sheets = cyc.scenes.layers(20, layers=5)
        >>> camera = cyc.Camera.look_at((0, 0, 9), (0, 0, 0), width=16, height=12)
        >>> LayeredDepthImage.cast(sheets, camera, 2).counts.max()
        np.int64(2)
        """
        _check_camera(camera)
        if layers is not None and not (isinstance(layers, (int, np.integer)) and layers >= 1):
            raise ValueError(f"layers must be an integer of at least 1, got {layers!r}")
        if not (np.isfinite(tolerance) and tolerance >= 0):
            raise ValueError(f"tolerance must be finite and at least 0, got {tolerance}")
        near = float(tolerance / min(camera.K[0, 0], camera.K[1, 1]))
        most = 2**32 - 1 if layers is None else int(layers)
        offsets, faces, depths = scene._mesh.hits(stack(camera), most, near, threads)
        shape = (camera.height, camera.width)
        counts = offsets[1:].astype(np.int64) - offsets[:-1]
        pixel = np.repeat(np.arange(len(counts)), counts)
        if color is not None:
            places = np.stack([pixel % shape[1], pixel // shape[1]], axis=1) + 0.5
            colors = np.asarray(color(faces, camera.unproject(places, depths)))
        else:
            colors = np.empty((len(faces), 3), np.uint8)
            picture, ids = np.empty((*shape, 3), np.uint8), np.empty(shape, np.uint32)
            layer = np.arange(len(faces)) - offsets[:-1].astype(np.int64)[pixel]
            for index in range(int(counts.max(initial=0))):
                own = layer == index
                ids[...] = BACKGROUND
                ids.reshape(-1)[pixel[own]] = faces[own]
                scene._mesh.shade(stack(camera), ids, picture, scene.colors)
                colors[own] = picture.reshape(-1, 3)[pixel[own]]
        return cls(camera, offsets, colors, (1.0 / depths.astype(np.float64)).astype(np.float32))

    @property
    def samples(self) -> int:
        """How many there are."""
        return len(self._kernel)

    @property
    def nbytes(self) -> int:
        """Bytes of the samples and offsets: 8 a sample and 4 a pixel."""
        return 8 * self.samples + 4 * (self.camera.width * self.camera.height + 1)

    @cached_property
    def offsets(self) -> npt.NDArray[np.uint32]:
        """(H * W + 1,) where each pixel's samples begin, and the end."""
        return _own(self._kernel.offsets())

    @cached_property
    def disparity(self) -> npt.NDArray[np.float32]:
        """(N,) 1 / depth of each sample."""
        return _own(self._kernel.disparities())

    @cached_property
    def color(self) -> npt.NDArray[np.uint8]:
        """(N, 3) red, green and blue of each sample."""
        return _own(self._kernel.colors())

    @cached_property
    def place(self) -> npt.NDArray[np.int8]:
        """(N, 2) sixteenths of a pixel that each sample lies right of and below its pixel's centre."""
        return _own(self._kernel.places())

    @property
    def counts(self) -> npt.NDArray[np.int64]:
        """(H, W) samples of each pixel."""
        offsets = self.offsets.astype(np.int64)
        return (offsets[1:] - offsets[:-1]).reshape(self.camera.height, self.camera.width)

    def layer(self, index: int) -> DepthImage:
        """The `index`-th sample of each pixel, the nearest being 0; missing where there are fewer.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
        >>> LayeredDepthImage(camera, [0, 2, 3], np.zeros((3, 3), np.uint8), [0.5, 0.25, 1.0]).layer(1).depth
        array([[ 4., inf]], dtype=float32)
        """
        if index < 0:
            raise ValueError(f"index must be at least 0, got {index}")
        there = self.counts > index
        samples = self.offsets[:-1].reshape(there.shape)[there].astype(np.int64) + index
        color, disparity = np.zeros((*there.shape, 3), np.uint8), np.zeros(there.shape, np.float32)
        color[there], disparity[there] = self.color[samples], self.disparity[samples]
        return DepthImage.from_disparity(color, disparity, self.camera, missing=~there)

    def warp(
        self,
        camera: Camera,
        splat: int = 3,
        *,
        order: Order = "zbuffer",
        cull: Cull = False,
        background: Warped | npt.NDArray[np.uint8] | None = None,
        threads: int | None = None,
        out: Warped | None = None,
    ) -> LayeredWarped:
        """What another camera sees of it.

        Parameters
        ----------
        camera : Camera
            A pinhole camera, W x H pixels: anywhere, looking anywhere.
        splat : int
            As for `cyclorama.warp.forward`. Besides, where it is more than 1, a pixel whose neighbours left and right
            of it, or above and below, are both nearer by more than 3 % is a crack through which something behind
            shines; it is filled from around like one that nothing fell on.
        order : {"zbuffer", "occlusion"}
            Samples are drawn in occlusion-compatible order either way. "zbuffer" also compares depths, which decides
            where two samples share a pixel though their lines through the epipole differ.
        cull : {False, "exact"}
            "exact" leaves out samples that are hidden: no pixel of the picture changes. It needs ``order="zbuffer"``.
        background, threads, out
            As for `cyclorama.warp.forward`.

        Returns
        -------
        LayeredWarped
            The picture, what of it is known, and how many samples were left out.

        Raises
        ------
        ValueError
            If an argument is none of the above.

        Notes
        -----
        An empty layered image is a picture that is all hole.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=64, height=48)
        >>> wall = DepthImage(np.full((48, 64, 3), 200, np.uint8), np.full((48, 64), 4.0), camera)
        >>> LayeredDepthImage.build(wall).warp(Camera.look_at((1, 0, 4), (1, 0, 0), width=64, height=48))
        <LayeredWarped: 64 x 48, 20.3 % hole, 3,072 of 3,072 samples drawn>
        """
        _check_camera(camera)
        size = _splat_size(splat)
        if cull not in (False, "exact"):
            raise ValueError(f"cull must be False or 'exact', got {cull!r}")
        if out is None:
            out = _fresh(camera)
        elif not isinstance(out, Warped):
            raise ValueError(f"out must be a Warped, got {type(out).__name__}")
        elif out.hole.shape != (camera.height, camera.width):
            raise ValueError(f"out has shape {out.hole.shape}, the camera {(camera.height, camera.width)}")
        behind = _colors_behind(background, out)
        fates = self._kernel.warp(
            stack(camera),
            (out.color, out.depth, out.hole, out.exact, out.source),
            size,
            order,
            cull == "exact",
            None if behind is out.color else behind,
            behind is out.color,
            threads,
        )
        stats = Stats(self.samples, *fates)
        return LayeredWarped(out.color, out.depth, out.hole, out.exact, out.source, camera, stats)

    def __repr__(self) -> str:
        pixels = self.camera.width * self.camera.height
        return (
            f"<LayeredDepthImage: {self.camera.width} x {self.camera.height}, {self.samples:,} samples, "
            f"{self.samples / pixels:.2f} a pixel>"
        )


def _integers(name: str, values: npt.ArrayLike, shape: tuple[int, ...], least: int, most: int) -> npt.NDArray[Any]:
    array = np.asarray(values)
    if array.size == 0 and 0 in shape:
        return np.zeros(shape, np.int64)
    if array.shape != shape or array.dtype.kind not in "iu":
        raise ValueError(f"{name} must be {shape} integers, got {array.shape} {array.dtype}")
    for index in np.argwhere((array < least) | (array > most)):
        raise ValueError(f"{name}{index.tolist()} is {array[tuple(index)]}: it must be from {least} to {most}")
    return array


def _own(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    array.flags.writeable = False
    return array
