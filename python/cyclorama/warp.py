"""Pictures with depth, seen from where they were not taken.

Each pixel of an image with depth is a sample of a surface. A forward warp moves the samples to where another camera
sees them (McMillan and Bishop's warp; section 4.2 of the 1998 dissertation) and leaves a *hole* where none comes to
lie: behind what hid something from the image, outside of what it saw, and in cracks between samples that moved apart.
What is guessed for holes is never mixed up with what is known: `Warped.hole` says which is which, and `fill` is a step
of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from . import _core
from .arguments import as_numpy, check_threads, checked_choice, checked_sequence
from .backdrop import backdrop
from .camera import Camera, stack
from .depth_image import DepthImage
from .geometry_warp import geometry_matrix

__all__ = ["NO_SOURCE", "Warped", "backdrop", "fill", "forward", "geometry_matrix", "map"]

NO_SOURCE = np.uint8(0xFF)
"""The image in `Warped.source` of pixels that no sample covers."""

_Arrays = tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32], npt.NDArray[np.bool_] | None]
Order = Literal["occlusion", "zbuffer"]
Splat = int | Literal["projected", "disparity", "mesh"]

# Wider splats than this blur everything and take long.
_WIDEST_SPLAT = 63
_MOST_IMAGES = 255
_ORDERS = ("occlusion", "zbuffer")
_SHAPES = ("projected", "disparity", "mesh")
_TYPES = {
    name: np.dtype(kind)
    for name, kind in {"color": "u1", "depth": "f4", "hole": "?", "exact": "?", "source": "u1"}.items()
}


@dataclass(frozen=True, eq=False)
class Warped:
    """What a camera sees of warped images.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
        The background, or black, at holes.
    depth : (H, W) ndarray of float32
        Distance along the camera's axis of the sample that a pixel shows; infinity where it is infinitely far, and at
        holes.
    hole : (H, W) ndarray of bool
        Pixels that no sample covers, whatever their colour.
    exact : (H, W) ndarray of bool
        Pixels that a sample's own centre fell on; the others that are no holes are covered by the rest of a splat.
    source : (H, W) ndarray of uint8
        Which of the images a pixel is from, `NO_SOURCE` at holes.
    camera : Camera
        The camera that was asked.
    """

    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    hole: npt.NDArray[np.bool_]
    exact: npt.NDArray[np.bool_]
    source: npt.NDArray[np.uint8]
    camera: Camera

    @classmethod
    def empty(cls, camera: Camera) -> Warped:
        """Memory for warps to this camera: all hole, black.

        Parameters
        ----------
        camera : Camera
            Of W x H pixels.

        Examples
        --------
        >>> Warped.empty(Camera.look_at((0, 0, 1), (0, 0, 0), width=3, height=2)).hole.all()
        np.True_
        """
        _check_camera(camera)
        shape = (camera.height, camera.width)
        return cls(
            np.zeros((*shape, 3), np.uint8),
            np.full(shape, np.inf, np.float32),
            np.ones(shape, np.bool_),
            np.zeros(shape, np.bool_),
            np.full(shape, NO_SOURCE),
            camera,
        )

    def __repr__(self) -> str:
        height, width = self.hole.shape
        share = 100 * np.count_nonzero(self.hole) / self.hole.size
        return f"<Warped: {width} x {height}, {share:.1f} % hole>"


def forward(
    images: DepthImage | Sequence[DepthImage],
    camera: Camera,
    *,
    splat: Splat = 3,
    order: Order = "occlusion",
    background: Warped | npt.NDArray[np.uint8] | None = None,
    threads: int | None = None,
    out: Warped | None = None,
) -> Warped:
    """Warp images to another camera.

    Parameters
    ----------
    images : DepthImage or sequence of N DepthImage
        Of any sizes, each with its own pinhole camera; 255 at most. Several are drawn in turn, one over the other, so
        the farthest comes first: ``sorted(images, key=lambda i: -np.linalg.norm(i.camera.eye - camera.eye))``. None at
        all is a picture that is all hole.
    camera : Camera
        A pinhole camera, W x H pixels: anywhere, looking anywhere. Samples at or behind the plane of its eye are
        dropped, and those before its near plane.
    splat : int or {"projected", "disparity", "mesh"}
        What a sample covers. A number: a square of so many pixels a side, odd, 1 to 63, around the pixel that its
        centre falls on. The centre counts more: a pixel that centres fall on shows one of them. Any other shows the
        nearest of the samples shown in the square around it; of equally near ones one of the least distant row, of
        these of the least distant column, of these the upper or left one.
        "projected": a rectangle as large as the sample appears, from where it and its neighbours fall (section 4.2.2),
        around where it falls; neighbours on other surfaces are not asked.
        "disparity": a rectangle of new over old disparity pixels a side, times new over old focal length; opaque at the
        exact hit and fading to the edge (LDI culling, section 3.3): the colours of a surface's splats are averaged.
        Rectangles are at most 64 pixels a side. Here, too, a pixel that centres fall on shows one of them, except where
        something more than 5 % nearer covers it: else what is behind a surface showed through its cracks.
        "mesh": not a splat, but two triangles between every four neighbouring samples of one surface (section 4.2.2's
        bilinearly interpolated surfaces), cut where the four are not one surface: see `DepthImage.cut`. Colours are
        interpolated: amid 4 x 4 samples of one surface by Catmull and Rom's cubic, else bilinearly. Turned-over
        triangles are not drawn. At a cut each sample keeps its own pixel, and behind all others a surface goes on until
        just before the sample beyond; only those last pixels are not `exact`.
    order : {"occlusion", "zbuffer"}
        A mesh shows the nearest surface of all images, whatever is asked here. For splats: which of several samples
        that fall on one pixel is shown. "zbuffer": the nearest; of equally near ones that of the last image, the last
        in it row by row. "occlusion" compares no depths: each image is drawn over those before it, in up to four sheets
        around the epipole in which nearer samples come later (section 4.2.1 of the dissertation), and the last one
        drawn is shown. That is the nearer of two samples on one ray; of samples of one surface, or of neighbouring
        rows, that merely share a pixel it may be either.
    background : Warped or (H, W, 3) ndarray of uint8, optional
        The colours of holes, such as the previous picture, whose pixels so persist (section 4.2.3): holes all the same.
        Black by default.
    threads : int, optional
        All cores by default. The picture doesn't depend on it.
    out : Warped, optional
        Memory for the answer, of the camera's size; may be the `background` as well.

    Returns
    -------
    Warped
        The picture, and what of it is known.

    Raises
    ------
    ValueError
        If an argument is none of the above, a camera is orthographic, or `out` or `background` has another size.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> here = cyc.Camera.look_at((0, 0, 4), (0, 0, 0), width=64, height=48)
    >>> wall = cyc.DepthImage(np.full((48, 64, 3), 200, np.uint8), np.full((48, 64), 4.0), here)
    >>> aside = cyc.Camera.look_at((1, 0, 4), (1, 0, 0), width=64, height=48)
    >>> forward(wall, aside)
    <Warped: 64 x 48, 20.3 % hole>
    """
    pictures = checked_sequence("images", images, DepthImage)
    if len(pictures) > _MOST_IMAGES:
        raise ValueError(f"images has {len(pictures)} entries, a warp takes {_MOST_IMAGES} at most")
    _check_camera(camera)
    checked_choice("order", order, _ORDERS)
    check_threads(threads)
    name = _splat_name(splat)
    if out is None:
        out = _fresh(camera)
    else:
        _check_out(out, camera)
        out = Warped(out.color, out.depth, out.hole, out.exact, out.source, camera)
    behind = _colors_behind(background, out)
    cameras = stack([*(image.camera for image in pictures), camera])
    arrays: list[_Arrays] = [(image.color, image.disparity, image._mask) for image in pictures]
    results = out.color, out.depth, out.hole, out.exact, out.source
    kept = behind is out.color
    if name == "mesh":
        joins = [image.joins for image in pictures]
        _core.depth_mesh_warp(cameras, arrays, joins, results, None if kept else behind, kept, threads)
        return out
    _core.warp_forward(
        cameras,
        arrays,
        results,
        name,
        order,
        None if kept else behind,
        kept,
        threads,
    )
    return out


def map(source: Camera, target: Camera, depth: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Where the pixels of one camera are in another.

    Parameters
    ----------
    source, target : Camera
        Pinhole cameras; the source's has W x H pixels.
    depth : (H, W) array_like of float, or float
        Distance of each pixel's surface along the source's axis, infinity where infinitely far.

    Returns
    -------
    (H, W, 2) ndarray of float64
        Coordinates of each pixel's centre in the target, in those of its ``K``: its first pixel's centre is at
        (0.5, 0.5). NaN at and behind the plane of the target's eye and before its near plane.

    Raises
    ------
    ValueError
        If a depth is NaN or not positive, its shape isn't the source's, or a camera is orthographic.

    Notes
    -----
    The warping equation of section 4.2.1 of the 1998 dissertation, in float64. OpenCV puts the first pixel's centre
    at (0, 0): subtract 0.5 to compare, and for `cv2.remap`.

    Examples
    --------
    >>> here = Camera.look_at((0, 0, 4), (0, 0, 0), width=4, height=2)
    >>> map(here, here, 4.0)[1, 3]
    array([3.5, 1.5])
    """
    _check_camera(source, "source")
    _check_camera(target, "target")
    shape = (source.height, source.width)
    try:
        values = np.asarray(as_numpy(depth), dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"depth must be numbers, {shape} of them or one, got {type(depth).__name__}") from None
    if values.shape not in (shape, ()):
        raise ValueError(f"depth must be {shape} or one number, got shape {values.shape}")
    for index in np.argwhere(~(values > 0)):
        raise ValueError(f"depth{index.tolist() if len(index) else ''} is {values[tuple(index)]}: it must be positive")
    out = np.empty((*shape, 2))
    _core.warp_map(stack([source, target]), np.ascontiguousarray(np.broadcast_to(1.0 / values, shape)), out)
    return out


def fill(
    warped: Warped, *, method: Literal["background", "nearest"] = "background", out: Warped | None = None
) -> Warped:
    """Guess what holes show.

    Parameters
    ----------
    warped : Warped
        A picture with holes, W x H pixels.
    method : {"background", "nearest"}
        Where each pixel of a hole takes colour and depth from. "background": of the first known pixels to the left, to
        the right, above and below it the farthest from the eye, since what opens up beside something near belongs to
        what is behind it; of those within 5 % of one depth the least distant. "nearest": the fewest steps to one of
        eight neighbours away, whatever its depth.
    out : Warped, optional
        Memory for the answer, of the same size; may be `warped` itself.

    Returns
    -------
    Warped
        With other colours and depths at holes; `hole`, `exact` and `source` still say what they are. A picture that is
        all hole stays as it is.

    Raises
    ------
    ValueError
        If `method` is none of these, or `out` has another size.

    Examples
    --------
    >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=3, height=1)
    >>> color = np.uint8([[[9, 9, 9], [0, 0, 0], [5, 5, 5]]])
    >>> image = DepthImage(color, [[4.0, np.inf, 2.0]], camera)
    >>> filled = fill(forward(image, camera, splat=1))
    >>> filled.color[0, :, 0], filled.hole[0]
    (array([9, 9, 5], dtype=uint8), array([False,  True, False]))
    """
    if not isinstance(warped, Warped):
        raise ValueError(f"warped must be a Warped, got {type(warped).__name__}")
    checked_choice("method", method, ("background", "nearest"))
    if out is None:
        out = _fresh(warped.camera)
    else:
        _check_out(out, warped.camera)
        out = Warped(out.color, out.depth, out.hole, out.exact, out.source, warped.camera)
    for name in _TYPES:
        if getattr(out, name) is not getattr(warped, name):
            np.copyto(getattr(out, name), getattr(warped, name))
    _core.warp_fill(out.color, out.depth, out.hole, method)
    return out


def _check_camera(camera: Camera, name: str = "camera") -> None:
    if not isinstance(camera, Camera):
        raise ValueError(f"{name} must be a Camera, got {type(camera).__name__}")
    if camera.orthographic:
        raise ValueError(f"{name} is orthographic: a warp needs an eye at both ends")


def _splat_name(splat: Splat) -> str:
    if isinstance(splat, str):
        if splat in _SHAPES:
            return splat
        raise ValueError(f"splat must be an odd number of pixels or one of {_SHAPES}, got {splat!r}")
    return str(_splat_size(splat))


def _splat_size(splat: int) -> int:
    if isinstance(splat, (int, np.integer)) and 1 <= splat <= _WIDEST_SPLAT and splat % 2:
        return int(splat)
    raise ValueError(f"splat must be an odd number of pixels from 1 to {_WIDEST_SPLAT}, got {splat!r}")


def _check_out(out: Warped, camera: Camera) -> None:
    if not isinstance(out, Warped):
        raise ValueError(f"out must be a Warped, got {type(out).__name__}")
    shape = (camera.height, camera.width)
    for name, dtype in _TYPES.items():
        array = getattr(out, name)
        expected = (*shape, 3) if name == "color" else shape
        if array.shape != expected or array.dtype != dtype:
            raise ValueError(f"out.{name} must be {expected} {dtype}, got {array.shape} {array.dtype}")
        if not array.flags.c_contiguous or not array.flags.writeable:
            raise ValueError(f"out.{name} must be writeable and row-major")


def _fresh(camera: Camera) -> Warped:
    """Memory that is written to the last pixel."""
    shape = (camera.height, camera.width)
    return Warped(
        np.empty((*shape, 3), np.uint8),
        np.empty(shape, np.float32),
        np.empty(shape, np.bool_),
        np.empty(shape, np.bool_),
        np.empty(shape, np.uint8),
        camera,
    )


def _colors_behind(background: Warped | npt.NDArray[np.uint8] | None, out: Warped) -> npt.NDArray[np.uint8] | None:
    """The background's colours: `out.color` itself if they are already there."""
    if background is None:
        return None
    colors = background.color if isinstance(background, Warped) else np.asarray(as_numpy(background))
    if colors.shape != out.color.shape or colors.dtype != np.uint8:
        raise ValueError(f"background must be {out.color.shape} uint8, got {colors.shape} {colors.dtype}")
    if colors is out.color:
        return colors
    return colors.copy() if np.may_share_memory(colors, out.color) else np.ascontiguousarray(colors)
