"""Frames composed of geometry and a backdrop (1998 dissertation, sections 1.4.1 and 4.4.3).

Depth decides, pixel by pixel: what an image holds is what is not drawn as geometry, and both know how deep they are. A
culled cell may lie nearer than geometry beside it, and then it is right that it hides it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..compose import Canvas, entered
from ..depth_image import DepthImage
from ..geometry_warp import ImagePlane, bent_camera
from ..ldi import LayeredDepthImage
from ..placing import camera_through
from ..render import View
from ..scene import Scene
from ..warp import Warped, forward
from .foreground import Foreground, Nearer
from .painting import Coloring, Frame, Placement, behind, frame_camera, picture

__all__ = ["DISPLAYS", "Display", "DrawStats", "Drawn", "Pictures", "Splat", "draw"]

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: What a sample covers, for the displays that have splats.
Splat = int | Literal["projected"]

#: The ways to display an image (section 1.4.1).
Display = Literal["ldi", "warp", "mesh", "quad", "geometry"]
DISPLAYS: tuple[Display, ...] = ("ldi", "warp", "mesh", "quad", "geometry")

# A frame is filled from so many layered images, while more than this share of what it asks of them is unknown: an eye
# may look past the image of its group where few of those that the group is known by do.
_MOST_LAYERED, _FEW_HOLES = 5, 0.002

#: What `Drawn.layer` says of pixels that show geometry, or nothing.
GEOMETRY = -1


@dataclass(frozen=True)
class DrawStats:
    """What a frame took.

    Attributes
    ----------
    images : tuple of int
        Which images are behind the geometry; the plan's choice first.
    faces : int
        Drawn as geometry.
    nearer : int
        Those of them that are in the image, too: the rest of the budget (`foreground`).
    culled : int
        In the image.
    samples : int
        Samples, or pixels, of the image.
    placed, rendered, warped, composed : float
        Milliseconds: the plan's answer, the geometry, the backdrop (with loading it, where it was not in memory), both
        together.
    """

    images: tuple[int, ...]
    faces: int
    nearer: int
    culled: int
    samples: int
    placed: float
    rendered: float
    warped: float
    composed: float

    @property
    def image(self) -> int | None:
        """The first of the images."""
        return self.images[0] if self.images else None

    @property
    def total(self) -> float:
        """Milliseconds of the whole frame."""
        return self.placed + self.rendered + self.warped + self.composed


@dataclass(frozen=True, eq=False)
class Drawn:
    """A composed frame.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
    depth : (H, W) ndarray of float32
        Along the camera's axis; infinity where nothing is seen.
    hole : (H, W) ndarray of bool
        Pixels of which it is not known what they show: no sample of the backdrop came to lie there, and the ray goes
        through the space that the backdrop stands for before it meets geometry.
    layer : (H, W) ndarray of int32
        The image that a pixel shows, by index; -1 where it shows geometry, or nothing.
    ids : (H, W) ndarray of uint32
        The face of pixels that show geometry, `BACKGROUND` elsewhere.
    nearer : (K,) ndarray of uint32
        Faces that are in the image, too, but drawn as geometry.
    camera : Camera
    stats : DrawStats
    """

    color: Bytes
    depth: npt.NDArray[np.float32]
    hole: Mask
    layer: npt.NDArray[np.int32]
    ids: npt.NDArray[np.uint32]
    nearer: npt.NDArray[np.uint32]
    camera: Camera
    stats: DrawStats

    @classmethod
    def empty(cls, camera: Camera) -> Drawn:
        """Memory for frames of a camera's size.

        Parameters
        ----------
        camera : Camera

        Examples
        --------
        >>> Drawn.empty(Camera.look_at((0, 0, 1), (0, 0, 0), width=3, height=2)).depth.shape
        (2, 3)
        """
        canvas = Canvas.empty(camera.height, camera.width, GEOMETRY)
        assert canvas.hole is not None
        stats = DrawStats((), 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0)
        none = np.empty(0, np.uint32)
        return cls(canvas.color, canvas.depth, canvas.hole, canvas.layer, canvas.ids, none, camera, stats)

    def checked(self, camera: Camera) -> Drawn:
        """The same, if it has a camera's size.

        Raises
        ------
        ValueError
            If not.
        """
        height, width = self.depth.shape
        if (height, width) != (camera.height, camera.width):
            raise ValueError(f"out is a picture of {width} x {height}, the frame has {camera.width} x {camera.height}")
        return self

    @property
    def backdrop(self) -> Mask:
        """(H, W) bool: pixels that show an image."""
        return np.asarray(self.layer != GEOMETRY)

    def __repr__(self) -> str:
        height, width = self.hole.shape
        return (
            f"<Drawn: {width} x {height}, {self.stats.faces:,} faces, {100 * self.backdrop.mean():.1f} % backdrop, "
            f"{100 * self.hole.mean():.2f} % hole>"
        )


class Pictures:
    """What displays need of a placement: its layered image, or one picture taken at its viewpoint.

    Parameters
    ----------
    plan : Plan
    scene : Scene
    size : (int, int)
        Of an image in pixels.
    color : callable
        Gives a view's colours.
    layered : callable
        Gives the layered images of an index for an eye and a gaze, the best first.
    foreground : Foreground, optional
        Draw of what an image stands for the nearest as geometry, as far as the budget goes.
    """

    def __init__(
        self,
        plan: Placement,
        scene: Scene,
        size: tuple[int, int],
        color: Coloring,
        layered: Callable[[int, npt.ArrayLike, npt.ArrayLike], Iterator[LayeredDepthImage]],
        foreground: Foreground | None = None,
    ) -> None:
        self.plan, self.scene, self.size, self.color = plan, scene, size, color
        self.layered, self.foreground = layered, foreground
        self._central: tuple[int, DepthImage] | None = None
        self._bounds: dict[int, Floats] = {}
        self._culled: dict[int, int] = {}

    def central(self, index: int) -> DepthImage:
        """What the viewpoint sees through the quadrilateral, rendered on the fly; the last one is kept (4.4.1)."""
        if self._central is None or self._central[0] != index:
            viewpoint = self.plan.viewpoints[self.plan.images.viewpoint[index]]
            camera = camera_through(viewpoint, self.plan.images.corners[index], self.size)
            self._central = index, picture(self.scene, camera, behind(self.plan, self.scene, index), self.color)
        return self._central[1]

    def culled(self, index: int) -> int:
        """How many faces an image stands for."""
        if index not in self._culled:
            self._culled[index] = len(behind(self.plan, self.scene, index))
        return self._culled[index]

    def space(self, index: int) -> Floats:
        """(P, 4) half-spaces ``n . x + d >= 0`` whose common part holds all that an image stands for."""
        if index not in self._bounds:
            viewpoint = self.plan.viewpoints[self.plan.images.viewpoint[index]]
            plane = ImagePlane.of(self.plan.images.corners[index], viewpoint)
            sides = np.column_stack([plane.sides(), -plane.sides() @ viewpoint])
            front = np.append(plane.normal, -plane.normal @ plane.corners[0])
            faces = behind(self.plan, self.scene, index)
            held = self.scene.vertices[self.scene.faces[faces]].reshape(-1, 3).astype(np.float64)
            low, high = (held.min(axis=0), held.max(axis=0)) if len(held) else (viewpoint, viewpoint)
            box = np.vstack([np.column_stack([np.eye(3), -low]), np.column_stack([-np.eye(3), high])])
            self._bounds[index] = np.vstack([sides, front, box])
        return self._bounds[index]


def draw(
    pictures: Pictures,
    eye: npt.ArrayLike,
    gaze: npt.ArrayLike,
    size: tuple[int, int] = (510, 480),
    *,
    display: Display = "ldi",
    splat: Splat | None = None,
    warp_size: tuple[int, int] | None = None,
    threads: int | None = None,
    out: Drawn | None = None,
) -> Drawn:
    """Draws a frame; see `Backdrops.draw`."""
    if display not in DISPLAYS:
        raise ValueError(f"display must be one of {DISPLAYS}, got {display!r}")
    plan = pictures.plan
    clock = [time.perf_counter()]
    camera = frame_camera(plan, eye, gaze, size)
    out = Drawn.empty(camera) if out is None else out.checked(camera)
    # A flat image hides all that is beyond its plane: nothing can be drawn there, nor another image.
    flat = display in ("quad", "geometry")
    frame = plan.frame(eye, gaze, images=1 if flat else None)
    images = tuple(image.index for image in frame.images)
    faces, near = _every_level(pictures, frame), Nearer(np.empty(0, np.uint32), 0.0)
    if images and pictures.foreground is not None and not flat:
        near = pictures.foreground.rest(frame, camera)
        faces = np.concatenate([faces, near.faces])
    clock.append(time.perf_counter())
    canvas = Canvas(out.color, out.depth, out.ids, out.layer, out.hole)
    _geometry(pictures, canvas, faces, camera, images[0] if images and display == "geometry" else None, threads)
    clock.append(time.perf_counter())
    samples = culled = 0
    warped, unknown = 0.0, []
    # Where each image's space is before the geometry; images are laid over that in turn.
    seen = [entered(pictures.space(index), camera, out.depth, near.depth) for index in images]
    for index, within in zip(images, seen, strict=True):
        culled += pictures.culled(index)
        if not within.any():
            continue
        start = time.perf_counter()
        small = camera if warp_size is None else camera.with_size(*warp_size)
        # What is not seen need not be warped.
        wanted = within if warp_size is None else within[_centers(within.shape, (small.height, small.width))]
        to = small.replace(near=near.depth)
        shown, count = _backdrop(pictures, index, to, display, splat, wanted, threads)
        samples += count
        if warp_size is not None:
            shown = _scaled(shown, camera)
        warped += time.perf_counter() - start
        # What is in the image and drawn as well is as deep in both, but for rounding to the image's pixels.
        twice = np.zeros(len(plan.whole), np.bool_)
        twice[near.faces] = True
        unknown.append((index, shown.hole & within))
        # What a flat image shows is elsewhere.
        canvas.lay(shown.depth, index, color=shown.color, within=None if flat else within, twice=twice)
    for index, hole in unknown:
        # Another image may be nearer than what is unknown.
        still = hole & entered(pictures.space(index), camera, out.depth, near.depth) if len(images) > 1 else hole
        out.hole[still] = True
    clock.append(time.perf_counter())
    placed, rendered, rest = (1e3 * np.diff(clock)).tolist()
    warped *= 1e3
    stats = DrawStats(images, len(faces), len(near.faces), culled, samples, placed, rendered, warped, rest - warped)
    return replace(out, nearer=near.faces, camera=camera, stats=stats)


def _every_level(pictures: Pictures, frame: Frame) -> npt.NDArray[np.uint32]:
    """What a frame draws of the scene and of its coarser levels of detail, as faces of both together."""
    ends = np.cumsum([len(pictures.scene), *(len(level) for level, _ in pictures.plan.lod)])
    coarser = [level + np.uint32(end) for level, end in zip(frame.levels, ends, strict=False)]
    return np.concatenate([frame.faces, *coarser]) if coarser else frame.faces


def _geometry(
    pictures: Pictures,
    canvas: Canvas,
    faces: npt.NDArray[np.uint32],
    camera: Camera,
    bend: int | None,
    threads: int | None,
) -> None:
    """Draws faces on a canvas; those beyond the plane of an image, if one is given, bent to it (section 5.1.1)."""
    scene = pictures.plan.whole if pictures.plan.lod else pictures.scene
    bent = faces[:0]
    if bend is not None:
        viewpoint = pictures.plan.viewpoints[pictures.plan.images.viewpoint[bend]]
        plane = ImagePlane.of(pictures.plan.images.corners[bend], viewpoint)
        # A face through the plane stays where it is: it touches both sides.
        beyond = plane.behind(scene.vertices)[scene.faces[faces]].min(axis=1) >= 0
        faces, bent = faces[~beyond], faces[beyond]
    view = View(canvas.ids, canvas.depth, camera, scene)
    scene.render(camera, faces, out=view, threads=threads)
    if len(bent):
        towards, scale = bent_camera(plane, camera)
        far = scene.render(towards, bent, threads=threads)
        canvas.lay(far.depth, GEOMETRY, ids=far.ids, scale=scale)
    canvas.color[...] = pictures.color(view)
    canvas.layer.fill(GEOMETRY)
    if canvas.hole is not None:
        canvas.hole.fill(False)


def _backdrop(
    pictures: Pictures,
    index: int,
    camera: Camera,
    display: Display,
    splat: Splat | None,
    wanted: Mask,
    threads: int | None,
) -> tuple[Warped, int]:
    """What a camera sees of an image, and how many samples that is."""
    if display == "ldi":
        return _layered(pictures, index, camera, splat or "projected", wanted, threads)
    central = pictures.central(index)
    if display == "warp":
        return forward(central, camera, splat=splat or 3, threads=threads), central.missing.size
    if display == "mesh":
        return forward(central, camera, splat="mesh", threads=threads), central.missing.size
    plane = ImagePlane.of(pictures.plan.images.corners[index], central.camera.eye)
    return _flat(central, plane, camera, display == "quad"), central.missing.size


def _layered(
    pictures: Pictures, index: int, camera: Camera, splat: Splat, wanted: Mask, threads: int | None
) -> tuple[Warped, int]:
    """What a camera sees of layered images: of others only what those before don't know."""
    # An eye and a gaze choose the group.
    shown, samples, unknown = None, 0, wanted
    for layered in islice(pictures.layered(index, camera.eye, camera.world_to_camera[2, :3]), _MOST_LAYERED):
        where = unknown if splat == "projected" else None
        more = layered.warp(camera, splat=splat, where=where, threads=threads)
        samples += layered.samples
        if shown is None:
            shown = more
        else:
            for into, known in zip(_arrays(shown), _arrays(more), strict=True):
                into[unknown] = known[unknown]
        unknown = shown.hole & wanted
        if unknown.sum() <= _FEW_HOLES * wanted.sum():
            break
    assert shown is not None
    return shown, samples


def _arrays(warped: Warped) -> tuple[npt.NDArray[Any], ...]:
    return warped.color, warped.depth, warped.hole, warped.exact, warped.source


def _flat(image: DepthImage, plane: ImagePlane, camera: Camera, opaque: bool) -> Warped:
    """An image on its quadrilateral: as deep as that, or as the bent points that it shows."""
    out = Warped.empty(camera)
    bent, scale = bent_camera(plane, camera)
    # Two cameras at one eye: pixels are mapped by their rays alone.
    to_image = (
        image.camera.K @ image.camera.world_to_camera[:3, :3] @ np.linalg.inv(bent.K @ bent.world_to_camera[:3, :3])
    )
    y, x = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    u, v, w = np.tensordot(to_image, np.stack([x, y, np.ones_like(x)]), 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = u / w, v / w
        there = (w > 0) & (u >= 0) & (u < image.camera.width) & (v >= 0) & (v < image.camera.height)
    u, v = u[there], v[there]
    row, column = v.astype(np.int64), u.astype(np.int64)
    out.color[there] = _between(image.color, u, v)
    if opaque:
        normal = camera.world_to_camera[:3, :3] @ plane.normal
        offset = plane.corners[0] @ plane.normal - plane.normal @ camera.eye
        rays = np.linalg.inv(camera.K) @ np.stack([x[there], y[there], np.ones(len(u))])
        deep = offset / (normal @ rays)
        # The picture of nothing is transparent.
        out.depth[there] = np.where(image.disparity[row, column] > 0, deep, np.inf)
    else:
        with np.errstate(divide="ignore"):
            along = 1.0 / image.disparity[row, column].astype(np.float64)
        rays = np.linalg.inv(image.camera.K) @ np.stack([u, v, np.ones(len(u))])
        turn = bent.world_to_camera[:3, :3] @ image.camera.world_to_camera[:3, :3].T
        out.depth[there] = scale * along * (turn[2] @ rays)
    out.hole[there] = False
    out.exact[there] = True
    out.source[there] = 0
    return out


def _between(color: Bytes, u: Floats, v: Floats) -> Bytes:
    """Bilinear samples of a picture at pixel coordinates."""
    height, width = color.shape[:2]
    x, y = np.clip(u - 0.5, 0, width - 1), np.clip(v - 0.5, 0, height - 1)
    left, top = x.astype(np.int64), y.astype(np.int64)
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    s, t = (x - left)[:, None], (y - top)[:, None]
    upper = color[top, left] * (1 - s) + color[top, right] * s
    lower = color[bottom, left] * (1 - s) + color[bottom, right] * s
    return np.asarray(np.rint(upper * (1 - t) + lower * t).astype(np.uint8))


def _scaled(warped: Warped, camera: Camera) -> Warped:
    """A picture at another size: each pixel that of the small one which holds its centre, and its depth."""
    at = _centers(warped.hole.shape, (camera.height, camera.width))
    color, depth, hole, exact, source = (array[at] for array in _arrays(warped))
    return Warped(color, depth, hole, exact, source, camera)


def _centers(shape: tuple[int, ...], to: tuple[int, int]) -> tuple[npt.NDArray[np.int64], ...]:
    """Where the centres of another size's pixels are in a picture."""
    rows, columns = (((np.arange(n) + 0.5) * side / n).astype(np.int64) for n, side in zip(to, shape, strict=True))
    return np.ix_(rows, columns)
