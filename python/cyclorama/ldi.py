"""Layered depth images: several samples a pixel, of all surfaces that some region of eyes may see.

An image with depth has holes wherever a new eye looks behind what hid something from the old one. A layered image holds
what is behind, too: its pixels have lists of samples, nearest first. It has one camera, so it is warped like a single
image, and each surface is stored once, not once for each image that it was seen in (1998 dissertation, section 4.3).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from . import _core, ldi_storage
from .arguments import as_numpy, check_threads, checked_choice, checked_number, checked_pair, checked_sequence
from .camera import Camera, stack
from .depth_image import DepthImage
from .hits import hits
from .normals import encode, of_faces, of_image
from .placing import camera_through, construction_cameras, quadrilateral
from .warp import _ORDERS, Order, Warped, _check_camera, _check_out, _colors_behind, _fresh, _splat_size

if TYPE_CHECKING:
    from .scene import Scene

__all__ = [
    "Faults",
    "LayeredDepthImage",
    "LayeredWarped",
    "Octree",
    "Stats",
    "camera_through",
    "construction_cameras",
    "quadrilateral",
]

# What `_core.Layered.warp_as_paper` says of samples.
_OUTSIDE, _HIDDEN, _DRAWN = 1, 2, 3

Floats = npt.NDArray[np.float64]
Cull = Literal["exact", "paper"] | Literal[False]

# When two samples are one: tolerances of depth and colour, and whether those at corners count apart.
Conflict = tuple[float, int, bool]


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


@dataclass(frozen=True)
class Faults:
    """What ``cull="paper"`` gets wrong, as shares of all samples.

    Attributes
    ----------
    samples : int
    eliminated : float
        Left out because they were taken to be hidden.
    visible_culled : float
        Left out, or never reached, though the picture without culling shows them.
    invisible_kept : float
        Drawn though the picture without culling doesn't show them.
    """

    samples: int
    eliminated: float
    visible_culled: float
    invisible_kept: float


@dataclass(frozen=True, eq=False)
class Octree:
    """Nodes of an octree over samples, the root first.

    Attributes
    ----------
    low, high : (M, 3) ndarray of float32
        Bounds: column and row in pixels, disparity.
    level : (M,) ndarray of int64
        0 is the root.
    children : (M,) ndarray of int64
        The first of eight consecutive children, -1 for a leaf. The first four are the nearer half (greater disparity);
        of each half the second and fourth are the right ones, the third and fourth the lower ones.
    count : (M,) ndarray of int64
        Samples.
    """

    low: npt.NDArray[np.float32]
    high: npt.NDArray[np.float32]
    level: npt.NDArray[np.int64]
    children: npt.NDArray[np.int64]
    count: npt.NDArray[np.int64]


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
    normals : (N,) array_like of uint16, optional
        The world normal of each sample, as `cyclorama.normals.encode` packs it, for shading that depends on the view.

    Attributes
    ----------
    camera : Camera
    normals : (N,) ndarray of uint16, or None
    merged : tuple of int
        The construction images that `build` merged, by index.
    kept : tuple of int
        How many samples are from the central image and from each of those.
    errors : tuple of float
        What `build` found with `max_error`.

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

    normals: npt.NDArray[np.uint16] | None
    _sources: tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint32]]

    def __init__(
        self,
        camera: Camera,
        offsets: npt.ArrayLike,
        color: npt.ArrayLike,
        disparity: npt.ArrayLike,
        place: npt.ArrayLike | None = None,
        normals: npt.ArrayLike | None = None,
    ) -> None:
        _check_camera(camera)
        try:
            values = np.asarray(as_numpy(disparity), dtype=np.float32)
        except (TypeError, ValueError):
            raise ValueError(f"disparity must be (N,) numbers, got {type(disparity).__name__}") from None
        if values.ndim != 1:
            raise ValueError(f"disparity must be (N,), got {values.shape}")
        count = len(values)
        starts = _integers("offsets", offsets, (camera.width * camera.height + 1,), 0, 2**32 - 1)
        colors = np.asarray(as_numpy(color))
        if colors.size == 0:
            colors = np.empty((0, 3), np.uint8)
        if colors.shape != (count, 3) or colors.dtype.kind not in "iu":
            raise ValueError(f"color must be ({count}, 3) uint8, got {colors.shape} {colors.dtype}")
        colors = _integers("color", colors, (count, 3), 0, 255)
        places = np.zeros((count, 2), np.int8) if place is None else _integers("place", place, (count, 2), -8, 7)
        self._kernel = _core.Layered(
            stack(camera),
            starts.astype(np.uint32),
            np.ascontiguousarray(colors, dtype=np.uint8),
            np.ascontiguousarray(values),
            places.astype(np.int8),
        )
        self.camera = camera
        self.merged: tuple[int, ...] = ()
        self.kept: tuple[int, ...] = ()
        self.errors: tuple[float, ...] = ()
        self.normals = (
            None if normals is None else _own(_integers("normals", normals, (count,), 0, 2**16 - 1).astype(np.uint16))
        )

    def __getstate__(self) -> dict[str, Any]:
        """What copies and other processes make the same image of: arrays in the place of the kernel's memory."""
        arrays = self.offsets, self.color, self.disparity, self.place
        return {name: value for name, value in self.__dict__.items() if name != "_kernel"} | {"_arrays": arrays}

    def __setstate__(self, state: dict[str, Any]) -> None:
        arrays = state.pop("_arrays")
        self.__dict__.update(state)
        self._kernel = _core.Layered(stack(self.camera), *(np.ascontiguousarray(array) for array in arrays))

    @classmethod
    def _of(cls, kernel: _core.Layered, camera: Camera) -> LayeredDepthImage:
        image = cls.__new__(cls)
        image._kernel, image.camera = kernel, camera
        image.merged = image.kept = image.errors = ()
        image.normals = None
        return image

    @classmethod
    def build(
        cls,
        central: DepthImage,
        construction: Sequence[DepthImage] = (),
        *,
        tolerance: float = 2.0,
        color_tolerance: int = 64,
        corners: bool = True,
        max_error: float | None = None,
        held_out: Sequence[DepthImage] | None = None,
        normals: bool = False,
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
        corners : bool
            Keep a sample of a surface near each pixel's lower right corner, too, where an image has one: then there is
            enough for views that come nearer than the central image. At 1024 x 768 in a furnished house 0.5 dB better
            (31.4 dB instead of 30.9, all nine images 31.7), for half as many samples again (1.8 a pixel instead of
            1.2).
        max_error : float, optional
            Merge no more construction images than it takes to come below this error, in grey levels of 255: again and
            again the one that makes the worst error of the held-out images least. The error of an image is the root of
            the mean squared difference between it and the layered image warped to its camera (3 x 3 splats), over the
            pixels in which it is not missing; holes count as black. All images are merged if that is not reached.
        held_out : sequence of DepthImage, optional
            Images to judge by. By default the construction images, merged or not: others give an honest answer.
        normals : bool
            Also keep each sample's normal, found in the image that it is from (`cyclorama.normals`).
        threads : int, optional
            All cores by default. The answer doesn't depend on it.

        Returns
        -------
        LayeredDepthImage
            Its `.merged` says which construction images are in it; `.errors` are the worst errors with the central
            image alone and after each one, if `max_error` was given.

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
        if not isinstance(central, DepthImage):
            raise ValueError(f"central must be a DepthImage, got {type(central).__name__}")
        images = [central, *checked_sequence("construction", construction, DepthImage)]
        check_threads(threads)
        tolerance = checked_number("tolerance", tolerance)
        if not (isinstance(color_tolerance, (int, np.integer)) and 0 <= color_tolerance <= 255):
            raise ValueError(f"color_tolerance must be an integer from 0 to 255, got {color_tolerance!r}")
        layered = cls._fewest(images, (tolerance, int(color_tolerance), bool(corners)), max_error, held_out, threads)
        if normals:
            words = [encode(of_image(images[0]))] + [encode(of_image(construction[index])) for index in layered.merged]
            starts = np.cumsum([0, *(word.size for word in words[:-1])])
            which, pixel = layered._sources
            layered.normals = _own(np.concatenate([word.reshape(-1) for word in words])[starts[which] + pixel])
        del layered._sources
        return layered

    @classmethod
    def _fewest(
        cls,
        images: Sequence[DepthImage],
        conflict: Conflict,
        max_error: float | None,
        held_out: Sequence[DepthImage] | None,
        threads: int | None,
    ) -> LayeredDepthImage:
        """All images merged, or no more than `max_error` takes."""
        construction = images[1:]
        if max_error is None:
            if held_out is not None:
                raise ValueError("held_out is of use only with max_error")
            return cls._merge(images, range(len(construction)), conflict, threads)
        max_error = checked_number("max_error", max_error)
        judges = construction if held_out is None else checked_sequence("held_out", held_out, DepthImage)
        if not judges:
            name = "construction" if held_out is None else "held_out"
            raise ValueError(f"{name} is empty: max_error has no image to judge by")
        left = list(range(len(construction)))
        best = cls._merge(images, [], conflict, threads)
        errors = [_errors(best, judges, threads)]
        while errors[-1][0] > max_error and left:
            trials = [cls._merge(images, sorted([*best.merged, index]), conflict, threads) for index in left]
            found = [_errors(trial, judges, threads) for trial in trials]
            chosen = min(range(len(left)), key=lambda trial: found[trial])
            best = trials[chosen]
            errors.append(found[chosen])
            del left[chosen]
        best.errors = tuple(worst for worst, _ in errors)
        return best

    @classmethod
    def _merge(
        cls,
        images: Sequence[DepthImage],
        which: Sequence[int],
        conflict: Conflict,
        threads: int | None,
    ) -> LayeredDepthImage:
        """The first of the images with some of those after it."""
        used = [images[0], *(images[1 + index] for index in which)]
        kernel, which_image, pixel = _core.Layered.build(
            stack([image.camera for image in used]),
            [(image.color, image.disparity, image.missing) for image in used],
            *conflict,
            threads,
        )
        image = cls._of(kernel, images[0].camera)
        kept = np.bincount(which_image, minlength=len(used))
        image.merged, image.kept = tuple(which), tuple(kept.tolist())
        image._sources = which_image, pixel
        return image

    @classmethod
    def cast(
        cls,
        scene: Scene,
        camera: Camera,
        layers: int | None = None,
        *,
        faces: npt.ArrayLike | None = None,
        tolerance: float = 0.0,
        color: Callable[[npt.NDArray[np.uint32], Floats], npt.ArrayLike] | None = None,
        normals: bool = False,
        threads: int | None = None,
    ) -> LayeredDepthImage:
        """Sample all surfaces that the ray through each pixel meets (section 4.3.1, figure 4-4 (a)).

        Parameters
        ----------
        scene : Scene
            Its transparent faces are left out, but for those that `faces` names.
        camera : Camera
            A pinhole camera.
        layers : int, optional
            At most so many samples a pixel, the nearest ones. All by default.
        faces : (K,) array_like of int, optional
            Sample only these: those that eyes near the camera may see, for example.
        tolerance : float
            A hit that lies behind another by at most so many times the width that a pixel covers there is left out.
        color : callable, optional
            Takes the faces (N,) and the world positions (N, 3) of N hits, and gives their colours (N, 3) uint8. By
            default they are shaded as `Scene.render` shades them.
        normals : bool
            Also keep each hit's normal, that of its face, toward the eye (`cyclorama.normals`).
        threads : int, optional
            All cores by default.

        Raises
        ------
        ValueError
            If an argument is none of the above.

        Notes
        -----
        This sees every surface that a ray crosses, but those along the rays not at all, and it stores many that no
        eye near the camera will ever see, unless `faces` leaves those out: `build` is usually smaller and better.

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
        if not hasattr(scene, "_mesh"):
            raise ValueError(f"scene must be a Scene, got {type(scene).__name__}: see cyclorama.load")
        if color is not None and not callable(color):
            raise ValueError(f"color must be a function of faces and positions, got {type(color).__name__}")
        check_threads(threads)
        tolerance = checked_number("tolerance", tolerance)
        near = float(tolerance / min(camera.K[0, 0], camera.K[1, 1]))
        found = hits(scene, camera, faces, most=None if layers is None else int(layers), near=near, threads=threads)
        if color is not None:
            places = np.stack([found.pixels % camera.width, found.pixels // camera.width], axis=1) + 0.5
            colors = np.asarray(as_numpy(color(found.faces, camera.unproject(places, found.depths))))
        else:
            colors = np.empty((len(found.faces), 3), np.uint8)
            for own, view in found.layers():
                colors[own] = view.color.reshape(-1, 3)[found.pixels[own]]
        words = None
        if normals:
            _, rays = camera.rays()
            words = encode(of_faces(scene.vertices, scene.faces[found.faces], -rays.reshape(-1, 3)[found.pixels]))
        disparity = (1.0 / found.depths.astype(np.float64)).astype(np.float32)
        return cls(camera, found.offsets, colors, disparity, normals=words)

    @property
    def samples(self) -> int:
        """How many there are."""
        return len(self._kernel)

    @property
    def nbytes(self) -> int:
        """Bytes of the samples and offsets, 8 a sample and 4 a pixel; normals, 2 a sample, count apart."""
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
        splat: int | Literal["disparity", "projected"] = 3,
        *,
        order: Order | None = None,
        cull: Cull = False,
        thresholds: tuple[int, int] = (64, 4),
        where: npt.NDArray[np.bool_] | None = None,
        background: Warped | npt.NDArray[np.uint8] | None = None,
        threads: int | None = None,
        out: Warped | None = None,
    ) -> LayeredWarped:
        """What another camera sees of it.

        Parameters
        ----------
        camera : Camera
            A pinhole camera, W x H pixels: anywhere, looking anywhere.
        splat : int or "projected"
            A number as for `cyclorama.warp.forward`. Besides, where it is more than 1, a pixel whose neighbours left
            and right of it, or above and below, are both nearer by more than 3 % is a crack through which something
            behind shines; it is filled from around like one that nothing fell on. Samples just outside of the picture
            don't reach into it here: up to half a splat along its border may stay a hole that `forward` fills.
            "projected": a rectangle somewhat larger than the piece of surface appears that a sample stands for, which
            takes several times as long. Seen from much nearer than it was taken, an image then has no wide cracks.
        order : {"occlusion", "zbuffer"}, optional
            Samples are drawn in occlusion-compatible order either way, bands of the picture in parallel. "zbuffer" also
            compares depths, which decides where two samples share a pixel though their lines through the epipole
            differ. By default "occlusion", except for "projected", which needs a depth buffer.
        cull : {False, "exact", "paper"}
            "exact" leaves out samples that are hidden: no pixel of the picture changes, whichever the order.
            "paper" goes front to back through an octree with an occlusion buffer, as the LDI culling paper has it
            (sections 3.2 and 3.3): splats are opaque at the pixel that a centre falls on and fade to their edges, and
            what the octree's order gets wrong is wrong in the picture. `cull_faults` counts that. It is there to be
            compared with, on one thread. Its `splat` may be "disparity": as large as the ratio of the new disparity to
            the old one.
        thresholds : (int, int)
            For "paper": an octree node of fewer samples than the first, or fewer pixels a side than the second, is not
            divided.
        where : (H, W) ndarray of bool, optional
            For "projected": the pixels that are wanted. Others may be holes, and what falls on them only is left out.
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
        check_threads(threads)
        checked_choice("cull", cull, (False, "exact", "paper"))
        projected = isinstance(splat, str) and splat == "projected"
        if order is None:
            order = "zbuffer" if projected else "occlusion"
        checked_choice("order", order, _ORDERS)
        if projected and (cull or order != "zbuffer"):
            raise ValueError(f"splat='projected' needs cull=False and order='zbuffer', got {cull!r} and {order!r}")
        if where is not None and not projected:
            raise ValueError(f"where= is for splat='projected', got splat={splat!r}")
        size = 1 if projected else _size(splat, cull == "paper")
        if out is None:
            out = _fresh(camera)
        else:
            _check_out(out, camera)
        behind = _colors_behind(background, out)
        keep, arrays = behind is out.color, (out.color, out.depth, out.hole, out.exact, out.source)
        behind = None if keep else behind
        if projected:
            self._kernel.warp_patches(stack(camera), arrays, where, behind, keep, threads)
            stats = Stats(self.samples, self.samples, 0, 0)
        elif cull == "paper":
            count, side = checked_pair("thresholds", thresholds)
            fates = self._kernel.warp_as_paper(stack(camera), arrays, size, count, side, behind, keep, threads)
            stats = Stats(self.samples, *(int((fates == fate).sum()) for fate in (_DRAWN, _HIDDEN, _OUTSIDE)))
        else:
            counts = self._kernel.warp(stack(camera), arrays, size, order, cull == "exact", behind, keep, threads)
            stats = Stats(self.samples, *counts)
        return LayeredWarped(out.color, out.depth, out.hole, out.exact, out.source, camera, stats)

    def cull_faults(
        self, camera: Camera, splat: int | Literal["disparity"] = 3, *, thresholds: tuple[int, int] = (64, 4)
    ) -> Faults:
        """What ``cull="paper"`` gets wrong, sample by sample.

        The measure that the LDI culling paper planned (section 4).

        A sample is visible if the warp without culling shows it at its own pixel.

        Parameters
        ----------
        camera, splat, thresholds
            As for `warp`; where `splat` is "disparity", visible is what a warp with 3 x 3 splats shows.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=64, height=48)
        >>> wall = DepthImage(np.full((48, 64, 3), 200, np.uint8), np.full((48, 64), 4.0), camera)
        >>> LayeredDepthImage.build(wall).cull_faults(camera)
        Faults(samples=3072, eliminated=0.0, visible_culled=0.0, invisible_kept=0.0)
        """
        _check_camera(camera)
        size = _size(splat, True)
        out, (count, side) = _fresh(camera), checked_pair("thresholds", thresholds)
        arrays = (out.color, out.depth, out.hole, out.exact, out.source)
        fates = self._kernel.warp_as_paper(stack(camera), arrays, size, count, side)
        visible = self._kernel.shown(stack(camera), size or 3, "occlusion") > 0
        drawn = fates == _DRAWN
        masks = (fates == _HIDDEN, visible & ~drawn, ~visible & drawn)
        return Faults(self.samples, *(float(mask.sum() / max(1, self.samples)) for mask in masks))

    def octree(self, thresholds: tuple[int, int] = (64, 4)) -> Octree:
        """The octree over the samples: column, row and disparity are its space (LDI culling paper, section 3.1).

        Parameters
        ----------
        thresholds : (int, int)
            As for `warp`.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=16, height=16)
        >>> wall = DepthImage(np.full((16, 16, 3), 200, np.uint8), np.full((16, 16), 4.0), camera)
        >>> tree = LayeredDepthImage.build(wall).octree((100, 1))
        >>> len(tree.level), tree.count[:9]
        (9, array([256,  64,  64,  64,  64,   0,   0,   0,   0]))
        """
        boxes, links = self._kernel.octree(*checked_pair("thresholds", thresholds))
        return Octree(boxes[:, :3], boxes[:, 3:], links[:, 0], links[:, 1], links[:, 2])

    def compact(self, cameras: Sequence[Camera], *, loss: float = 0.0, threads: int | None = None) -> LayeredDepthImage:
        """The fewest samples for some views.

        Parameters
        ----------
        cameras : sequence of Camera
            Views that matter: many eyes of the region that the image is for.
        loss : float
            The share of what these views show, in pixels that a sample's centre fell on, that may be lost. With 0 none
            of their pixels changes, whatever the splats, drawn in occlusion-compatible order.
        threads : int, optional
            All cores by default.

        Returns
        -------
        LayeredDepthImage
            Samples that no view shows are left out, and those that the fewest pixels show, as long as they are no more
            than `loss` allows: no smaller set keeps as many pixels as they are.

        Raises
        ------
        ValueError
            If `loss` isn't from 0 to 1, or there are no cameras.

        Examples
        --------
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
        >>> image = LayeredDepthImage(camera, [0, 2, 3], np.zeros((3, 3), np.uint8), [0.5, 0.25, 1.0])
        >>> image.compact([camera])
        <LayeredDepthImage: 2 x 1, 2 samples, 1.00 a pixel>
        """
        views = checked_sequence("cameras", cameras, Camera)
        if not views:
            raise ValueError("cameras is empty: no sample would be needed")
        for index, view in enumerate(views):
            _check_camera(view, f"cameras[{index}]")
        loss = checked_number("loss", loss, 1)
        check_threads(threads)
        shown = self._kernel.shown(stack(views), 1, "occlusion", threads).astype(np.int64)
        order = np.argsort(shown, kind="stable")
        gone = np.cumsum(shown[order]) <= loss * shown.sum()
        keep = np.ones(self.samples, np.bool_)
        keep[order[gone]] = False
        small = self._of(self._kernel.filter(keep), self.camera)
        small.normals = None if self.normals is None else _own(self.normals[keep])
        return small

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an ``.npz`` that plain NumPy opens, or a deep scanline ``.exr`` (``pip install cyclorama[exr]``).

        Both come back bit for bit; `cyclorama.ldi_storage` says what is in them.

        Parameters
        ----------
        path : path
            Ends in ``.npz`` or ``.exr``. Written under another name first, and renamed when it is whole.

        Raises
        ------
        ValueError
            If it ends otherwise.
        OSError
            If it can't be written.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
        >>> image = LayeredDepthImage(camera, [0, 2, 3], np.zeros((3, 3), np.uint8), [0.5, 0.25, 1.0])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     image.save(Path(folder) / "view.npz")
        ...     LayeredDepthImage.load(Path(folder) / "view.npz")
        <LayeredDepthImage: 2 x 1, 3 samples, 1.50 a pixel>
        """
        ldi_storage.save(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LayeredDepthImage:
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
        return ldi_storage.load(path)

    def __repr__(self) -> str:
        pixels = self.camera.width * self.camera.height
        return (
            f"<LayeredDepthImage: {self.camera.width} x {self.camera.height}, {self.samples:,} samples, "
            f"{self.samples / pixels:.2f} a pixel>"
        )


def _errors(image: LayeredDepthImage, judges: Sequence[DepthImage], threads: int | None) -> tuple[float, float]:
    """The worst and the mean error against pictures taken elsewhere, in grey levels."""
    errors = [0.0]
    for judge in judges:
        there = ~judge.missing
        if there.any():
            color = np.where(judge.missing[..., None], 0, judge.color[..., :3]).astype(np.float32)
            difference = (image.warp(judge.camera, threads=threads).color - color)[there]
            errors.append(float(np.sqrt(np.mean(np.square(difference)))))
    return max(errors), float(np.mean(errors))


def _size(splat: int | str, as_paper: bool) -> int:
    """A splat's side, 0 if it follows the disparity."""
    if isinstance(splat, str) and splat == "mesh":
        raise ValueError(
            "splat='mesh' asks each sample for its neighbours, which those of a layered image don't have: give a "
            "number of pixels or 'projected', or warp its layers, `[image.layer(k), ..., image.layer(0)]`, by "
            "`warp.forward`"
        )
    if not isinstance(splat, str):
        return _splat_size(splat)
    if splat != "disparity":
        raise ValueError(f"splat must be an odd number of pixels, 'projected' or 'disparity', got {splat!r}")
    if not as_paper:
        raise ValueError("splat='disparity' of a layered image is for cull='paper' only: give a number of pixels")
    return 0


def _integers(name: str, values: npt.ArrayLike, shape: tuple[int, ...], least: int, most: int) -> npt.NDArray[Any]:
    array = np.asarray(as_numpy(values))
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
