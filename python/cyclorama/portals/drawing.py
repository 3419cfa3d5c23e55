"""Frames of a building in which portals are pictures (figures 6-4 and 6-7 of the 1998 dissertation).

The cell of the eye is drawn as geometry, and each portal that is seen from it as an image. A portal that is nearer than
its transition distance is geometry: the cell behind it is drawn, too, and the portals of that are images in turn.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from .. import _core
from ..backdrop import cut
from ..camera import Camera
from ..compose import Canvas
from ..depth_image import DepthImage
from ..geometry_warp import Plane, bent_camera
from ..ldi import LayeredDepthImage
from ..render import View
from ..scene import Scene
from ..warp import Splat, Warped, forward
from .images import Deadline, Flat, PortalImages
from .viewpoints import Side

__all__ = ["FRAMES", "PortalDrawn", "PortalFrame", "PortalStats", "PortalView", "PortalWalk", "draw", "frame"]

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Ids = npt.NDArray[np.uint32]
Mask = npt.NDArray[np.bool_]

#: Frames of a transition between geometry and image (5.3.1).
FRAMES = 5

#: What `PortalDrawn.portal` says of pixels that show no portal's image.
NO_PORTAL = np.int32(-1)


@dataclass(frozen=True, eq=False)
class PortalView:
    """A portal that is shown as an image, or on its way there.

    Attributes
    ----------
    portal : int
    place : int or None
        The cell that it is seen from, None outdoors.
    opening : (N, 3) ndarray of float64
        The part of it that is in view.
    corners : (4, 3) ndarray of float64
        Of the image: top-left, top-right, bottom-right, bottom-left as seen from its viewpoint.
    images : list of int
        Those that show it, by index; the nearest first.
    viewpoint : (3,) ndarray of float64
        Of the first.
    share : float
        0 geometry, 1 image; between the geometry bends.
    faces : (K,) ndarray of uint32
        What is drawn of the cells behind it while it bends.
    """

    portal: int
    place: int | None
    opening: Floats
    corners: Floats
    images: list[int]
    viewpoint: Floats
    share: float = 1.0
    faces: Ids = field(default_factory=lambda: np.empty(0, np.uint32))


@dataclass(frozen=True, eq=False)
class PortalFrame:
    """What is drawn for an eye.

    Attributes
    ----------
    cells : list of int or None
        Those drawn as geometry, the eye's own first; None is outdoors.
    faces : (K,) ndarray of uint32
        Of these cells, in the frustum; ascending.
    views : list of PortalView
        The portals that are images; one that is seen in several ways, through others, is there as often.
    open : list of int
        The portals that are geometry, by index.
    """

    cells: list[int | None]
    faces: Ids
    views: list[PortalView]
    open: list[int]

    @property
    def drawn(self) -> int:
        """How many faces are drawn, with those of transitions."""
        return len(self.faces) + sum(len(view.faces) for view in self.views)


@dataclass(frozen=True)
class PortalStats:
    """What a frame took.

    Attributes
    ----------
    faces : int
        Drawn as geometry.
    images : int
        Shown.
    painted : int
        Images painted for this frame.
    culled, rendered, shown : float
        Milliseconds: what is to be drawn, with painting where that is spread over frames; the geometry; the images,
        with painting where it isn't.
    """

    faces: int
    images: int
    painted: int
    culled: float
    rendered: float
    shown: float

    @property
    def total(self) -> float:
        """Milliseconds of the whole frame."""
        return self.culled + self.rendered + self.shown


@dataclass(frozen=True, eq=False)
class PortalDrawn:
    """A composed frame.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
    depth : (H, W) ndarray of float32
        Along the camera's axis; of a static image the portal's. Infinity where nothing is seen.
    hole : (H, W) ndarray of bool
        Pixels of portals to which nothing was warped; their colour is that of the image laid flat on the portal.
    ids : (H, W) ndarray of uint32
        The face of pixels that show geometry, `BACKGROUND` elsewhere.
    portal : (H, W) ndarray of int32
        The portal whose image a pixel shows, -1 for geometry.
    camera : Camera
    frame : PortalFrame
    stats : PortalStats
    """

    color: Bytes
    depth: npt.NDArray[np.float32]
    hole: Mask
    ids: Ids
    portal: npt.NDArray[np.int32]
    camera: Camera
    frame: PortalFrame
    stats: PortalStats

    def __repr__(self) -> str:
        height, width = self.hole.shape
        return (
            f"<PortalDrawn: {width} x {height}, {self.stats.faces:,} faces, {self.stats.images} images on "
            f"{100 * (self.portal >= 0).mean():.1f} % of it, {100 * self.hole.mean():.2f} % hole>"
        )


#: How much of an image a side of a portal is, 0 to 1, by its number and its distance from the eye.
Shares = Callable[[int, float], float]


def frame(
    images: PortalImages,
    camera: Camera,
    *,
    shares: Shares | None = None,
    deadline: Deadline | None = None,
    threads: int | None = None,
) -> PortalFrame:
    """What is drawn for a camera; see `Building.frame`.

    Parameters
    ----------
    images : PortalImages
    camera : Camera
        A pinhole camera.
    shares : callable, optional
        How much of an image a side is; by default all where it is farther than its transition distance, else nothing.
    deadline : Deadline, optional
        When to stop painting; a portal without any image is geometry.
    threads : int, optional
    """
    building, shares = images.building, shares or _by_distance(images)
    eye = camera.eye
    decided: dict[int, PortalView] = {}

    def is_image(number: int) -> bool:
        side = images.sides[number]
        if not side.before(eye) > 1e-6 * side.size:
            return False
        view = _view(images, number, eye, shares(number, side.distance(eye)), deadline, threads)
        if view is not None:
            decided[number] = view
        return view is not None

    faces, entered, shown, opened = building.kernel.walk(*building.start(camera), is_image)
    outdoors = len(building.cells)
    cells = [None if place == outdoors else place for place in dict.fromkeys(entered)]
    return PortalFrame(cells, faces, [replace(decided[number], opening=part) for number, part in shown], opened)


def _by_distance(images: PortalImages) -> Shares:
    return lambda number, distance: float(distance > images.transition_distances[number])


def _view(
    images: PortalImages, number: int, eye: Floats, share: float, deadline: Deadline | None, threads: int | None
) -> PortalView | None:
    """A portal as an image, wholly in view; None if it is geometry."""
    if share <= 0.0:
        return None
    shown = images.ready(number, eye, deadline, threads)
    if not shown:
        return None
    side, viewpoint = images.sides[number], images.viewpoint(shown[0])
    place = None if side.place == len(images.building.cells) else side.place
    faces = np.empty(0, np.uint32)
    if share < 1.0:
        faces = images.building.kernel.behind((eye + share * (viewpoint - eye)).tolist(), number)
    return PortalView(side.portal, place, side.polygon, side.corners, shown, viewpoint, share, faces)


def draw(
    images: PortalImages,
    camera: Camera,
    *,
    shares: Shares | None = None,
    splat: Splat | None = None,
    max_ms: float | None = None,
    threads: int | None = None,
) -> PortalDrawn:
    """The composed picture of a camera; see `Building.draw`."""
    scene = images.building.scene
    before = images.painted
    clock = [time.perf_counter()]
    deadline = None if max_ms is None else Deadline(max_ms)
    found = frame(images, camera, shares=shares, deadline=deadline, threads=threads)
    clock.append(time.perf_counter())
    view = scene.render(camera, found.faces, threads=threads)
    color, shape = images.color(view).copy(), view.depth.shape
    clock.append(time.perf_counter())
    hole, portal = np.zeros(shape, np.bool_), np.full(shape, NO_PORTAL)
    canvas = Canvas(color, view.depth, view.ids, portal, hole)
    for shown in found.views:
        side = images.sides[images.number(shown.portal, _place(images, shown))]
        window = _Window.of(shown.opening, side, camera)
        if window is None:
            continue
        bent = shown.share < 1.0
        new = _bent(images, side, shown, window, threads) if bent else _image(images, shown, window, splat, threads)
        # What is nearer than the portal hides it; all that is beyond it is the image's.
        label = int(NO_PORTAL) if bent else shown.portal
        canvas.lay(new.depth, label, color=new.color, ids=new.ids, hole=new.hole, before=window.depth, at=window.at)
    clock.append(time.perf_counter())
    times = (1e3 * np.diff(clock)).tolist()
    stats = PortalStats(found.drawn, sum(len(v.images) for v in found.views), images.painted - before, *times)
    return PortalDrawn(color, view.depth, hole, view.ids, portal, camera, found, stats)


def _place(images: PortalImages, view: PortalView) -> int:
    return len(images.building.cells) if view.place is None else view.place


@dataclass(frozen=True, eq=False)
class _Window:
    """The pixels through which a portal is seen.

    Attributes
    ----------
    at : (int, int)
        Row and column of the rectangle around them.
    inside : (h, w) ndarray of bool
        Which of the rectangle's they are.
    depth : (h, w) ndarray of float32
        Of the portal's plane; infinity where the portal isn't met.
    camera : Camera
        Sees the rectangle alone.
    """

    at: tuple[int, int]
    inside: Mask
    depth: npt.NDArray[np.float32]
    camera: Camera

    @classmethod
    def of(cls, opening: Floats, side: Side, camera: Camera) -> _Window | None:
        """The pixels whose centres lie in the part of a portal that is in view; None if there is no pixel."""
        pixels, deep = camera.project(opening)
        size = (camera.width, camera.height)
        if (deep > 1e-9 * side.size).all():
            low = np.clip(np.floor(pixels.min(axis=0)), 0, size).astype(int)
            high = np.clip(np.ceil(pixels.max(axis=0)), 0, size).astype(int)
        else:
            low, high = np.zeros(2, int), np.array(size)
        if (low >= high).any():
            return None
        K = camera.K.copy()
        K[:2, 2] -= low
        part = camera.replace(K=K, width=int(high[0] - low[0]), height=int(high[1] - low[1]))
        _, rays = part.rays()
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = side.before(camera.eye) / (rays @ side.normal)
        inside = depth > 0
        edges = opening - camera.eye
        sides = np.cross(edges, np.roll(edges, -1, 0))
        sides *= np.sign(sides @ edges.mean(axis=0))[:, None]
        for normal in sides:
            inside &= rays @ normal >= 0
        return cls((int(low[1]), int(low[0])), inside, np.where(inside, depth, np.inf).astype(np.float32), part)


@dataclass(frozen=True, eq=False)
class _Content:
    """What a window shows: pictures have no faces, geometry has no holes."""

    color: Bytes
    depth: npt.NDArray[np.float32]
    hole: Mask | None = None
    ids: Ids | None = None


def _image(
    images: PortalImages, shown: PortalView, window: _Window, splat: Splat | None, threads: int | None
) -> _Content:
    """A portal's image as the eye sees it."""
    pictures = [images.store.get(index) for index in shown.images]
    camera = window.camera
    flat = np.zeros((camera.height, camera.width, 3), np.uint8)
    _, rays = camera.rays()
    places = camera.eye + rays[window.inside] * window.depth[window.inside][:, None]
    at = np.ascontiguousarray(pictures[0].camera.project(places)[0])
    flat[window.inside] = _core.sample(np.ascontiguousarray(_front(pictures[0])), at)[:, :3]
    if images.kind == "static":
        return _Content(flat, window.depth)
    warped: Warped
    if isinstance(pictures[0], LayeredDepthImage):
        warped = pictures[0].warp(camera, splat or "projected", background=flat, threads=threads)  # type: ignore[arg-type]
    else:
        # The nearest comes last: it is drawn over the others.
        warped = forward(pictures[::-1], camera, splat=splat or "mesh", background=flat, threads=threads)
    return _Content(warped.color, warped.depth, warped.hole)


def _front(image: Flat | DepthImage | LayeredDepthImage) -> Bytes:
    """(H, W, 4) the picture that an image shows to its own camera."""
    color = image.color
    if isinstance(image, LayeredDepthImage):
        shape = (image.camera.height, image.camera.width, 3)
        first, there = image.offsets[:-1], image.offsets[:-1] < image.offsets[1:]
        color = np.full((len(first), 3), 255, np.uint8)
        color[there] = image.color[first[there]]
        color = color.reshape(shape)
    return np.dstack([color, np.full(color.shape[:2], 255, np.uint8)])


def _bent(images: PortalImages, side: Side, shown: PortalView, window: _Window, threads: int | None) -> _Content:
    """What is behind a portal in a transition, bent as if the image had been made from an eye on the way (5.1.3)."""
    scene, camera = images.building.scene, window.camera
    out = Canvas.empty(camera.height, camera.width)
    eye = camera.eye + shown.share * (shown.viewpoint - camera.eye)
    plane = Plane(eye, side.normal, side.before(eye))
    bent, scale = bent_camera(plane, camera)
    slack = 1e-9 * side.size
    beyond = plane.behind(scene.vertices)[scene.faces[shown.faces]]
    whole = (beyond >= -slack).all(axis=1)
    crossing = shown.faces[~whole & (beyond > slack).any(axis=1)]
    parts: list[tuple[Scene, Ids | None, Ids]] = [(scene, shown.faces[whole], np.arange(len(scene), dtype=np.uint32))]
    if len(crossing):
        piece = Scene(scene.vertices, scene.faces[crossing])
        kept = cut(piece, crossing, side.normal, plane.offset, slack)
        if kept is not None:
            parts.append((kept.scene, None, kept.faces))
    for drawn, faces, names in parts:
        view = drawn.render(bent, faces, threads=threads)
        out.lay(view.depth, 0, ids=view.ids, scale=scale, names=names)
    return _Content(images.color(View(out.ids, out.depth, camera, scene)), out.depth, ids=out.ids)


class PortalWalk:
    """A walk through a building in which portals turn to images and back (sections 5.1.3 and 6.3).

    A static image is as its viewpoint sees it, geometry as the eye does: over some frames what is behind the portal
    bends from one to the other. Out of view, and once the eye has passed a portal, it changes at once; so do warped and
    layered images, which are seen as from the eye anyway.

    Parameters
    ----------
    images : PortalImages
    frames : int
        Of a transition, at least 1.

    Attributes
    ----------
    changing : dict of int to float
        The sides of portals in a transition, by number, and how much of an image they are.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> home = cyc.scenes.house(rooms=3, seed=1)
    >>> building = cyc.portals.Building(home, home.cells, home.portals)
    >>> walk = PortalWalk(PortalImages(building, size=(32, 32)), frames=5)
    >>> eye = (home.cells[0]["min"] + home.cells[0]["max"]) / 2
    >>> walk.draw(cyc.Camera.look_at(eye, home.portals[0]["polygon"].mean(0), width=64, height=48)).hole.any()
    np.False_
    """

    def __init__(self, images: PortalImages, *, frames: int = FRAMES) -> None:
        if not (isinstance(frames, (int, np.integer)) and frames >= 1):
            raise ValueError(f"frames must be an integer of at least 1, got {frames!r}")
        self.images, self.frames = images, int(frames)
        self._steps: dict[int, int] = {}

    @property
    def changing(self) -> dict[int, float]:
        return {n: step / self.frames for n, step in self._steps.items() if 0 < step < self.frames}

    def draw(
        self, camera: Camera, *, splat: Splat | None = None, max_ms: float | None = None, threads: int | None = None
    ) -> PortalDrawn:
        """Takes the next step of all transitions, and draws.

        Parameters
        ----------
        camera, splat, max_ms, threads
            As for `Building.draw`.
        """
        before, self._steps = self._steps, {}

        def share(number: int, distance: float) -> float:
            wanted = self.frames if distance > self.images.transition_distances[number] else 0
            # A portal that is seen in several ways takes one step.
            if number not in self._steps:
                old = before.get(number, wanted)
                if self.images.kind != "static":
                    old = wanted
                self._steps[number] = old + int(np.sign(wanted - old))
            return self._steps[number] / self.frames

        return draw(self.images, camera, shares=share, splat=splat, max_ms=max_ms, threads=threads)
