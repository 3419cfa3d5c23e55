"""Layered images for the placements of a plan (1998 dissertation, sections 4.3.2 and 4.4.2).

The image of a placement holds what the placement culls, and nothing else: whatever a frame draws as geometry is in
front of it, behind it or beside it by its depth. Rays that meet none of it are samples too, infinitely far away: so a
pixel without a sample is one of which nothing is known, and not the sky.

The dissertation takes its construction images around the viewpoint, within the star-shape. An eye that gets an image
may be far from its viewpoint, close to the image's plane. So they are taken here where the image is really used: the
plan is asked for frames all over its domain, those that get an image are grouped, and each group's layered image is
built from its own frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
import numpy.typing as npt

from .. import _core
from ..camera import Camera
from ..depth_image import DepthImage
from ..hits import hits
from ..ldi import LayeredDepthImage
from ..placing import construction_cameras
from ..render import BACKGROUND, View
from ..scene import Scene

if TYPE_CHECKING:
    from .foreground import Foreground, Nearer
    from .groups import Group

__all__ = [
    "Lit",
    "Painted",
    "Uses",
    "behind",
    "frame_camera",
    "more_uses",
    "paint_as_paper",
    "paint_group",
    "picture",
    "uses",
]

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Gives the colours (H, W, 3) of a view: the same ones for a place from wherever it is seen, or borders show.
Coloring = Callable[[View], Bytes]

#: Where construction images are taken: where an image is used, or as the dissertation has it.
Where = Literal["use", "paper"]

# Steepest ray of a construction image to its axis: beyond it pixels are more than three times as dense as in the
# middle.
_STEEPEST = 2.0

# How much wider than a frame construction images are on each side: a share of its side.
_MARGIN = 0.1

# Share of the samples that may lie beyond each border of a layered image: a few at the very edge would make its pixels
# large for all.
_OUTSIDE = 0.0005

# How far beside known frames others are looked for: a share of the region's edges, and of a radian.
_BESIDE = 0.02

#: Frames of a group that are drawn: some join the layered image, the others judge it.
FRAMES = 20

#: Frames of a group that are asked which faces they see of the image.
WITNESSES = 64

# The most layers that are peeled: with the most construction images no more than one layered image is built from.
_LAYERS = 254 - FRAMES

# Surfaces that a ray meets no farther from each other than so many times the width that a pixel covers there are one
# layer. `LayeredDepthImage.build` would leave out the same, but a pile of a thousand sheets would take gigabytes first.
_APART = 2.0


class Images(Protocol):
    """The images of a plan, side by side."""

    @property
    def viewpoint(self) -> npt.NDArray[np.int64]: ...
    @property
    def corners(self) -> Floats: ...
    @property
    def forward(self) -> Floats: ...
    def __len__(self) -> int: ...


class Image(Protocol):
    """An image of a frame."""

    @property
    def index(self) -> int: ...


class Frame(Protocol):
    """What a plan draws for an eye and a gaze."""

    @property
    def faces(self) -> npt.NDArray[np.uint32]: ...
    @property
    def image(self) -> Image | None: ...
    @property
    def images(self) -> Sequence[Image]: ...
    @property
    def levels(self) -> tuple[npt.NDArray[np.uint32], ...]: ...


class Placement(Protocol):
    """What painting and drawing ask of a plan."""

    @property
    def viewpoints(self) -> Floats: ...
    @property
    def fov_x(self) -> float: ...
    @property
    def aspect(self) -> float: ...
    @property
    def up(self) -> Floats: ...
    @property
    def domain(self) -> Floats: ...
    @property
    def directions(self) -> str: ...
    @property
    def images(self) -> Images: ...
    @property
    def budget(self) -> int: ...
    @property
    def images_per_frame(self) -> int: ...
    @property
    def lod(self) -> tuple[tuple[Scene, float], ...]: ...
    @property
    def whole(self) -> Scene: ...
    def cells(self) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64]]: ...
    def frame(self, eye: npt.ArrayLike, forward: npt.ArrayLike, *, images: int | None = None) -> Frame: ...
    def culled(self, index: int) -> npt.NDArray[np.uint32]: ...


def behind(plan: Placement, scene: Scene, index: int) -> npt.NDArray[np.uint32]:
    """The faces of a scene that an image of a plan stands for: of several levels of detail it shows the finest.

    Parameters
    ----------
    plan : Plan
    scene : Scene
        The plan's, without coarser levels.
    index : int
        Of the image.

    Returns
    -------
    (K,) ndarray of uint32
    """
    faces = plan.culled(index)
    return faces[faces < len(scene)] if plan.lod else faces


class Lit:
    """Colours that are the same from everywhere: the scene's, as a high sun and the sky light them, faces alike on both
    sides.

    `Scene.render` shades as if the lamp were at the eye, and would give a picture that was taken elsewhere away.

    Parameters
    ----------
    scene : Scene
    up : (3,) array_like of float
        Where the sky is.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(600)
    >>> Lit(scene)(scene.render(Camera.look_at((0, 0, 3), (0, 0, 0), width=32, height=24))).shape
    (24, 32, 3)
    """

    def __init__(self, scene: Scene, up: npt.ArrayLike = (0.0, 1.0, 0.0)) -> None:
        corners = scene.vertices[scene.faces].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        normals /= np.where(lengths > 0, lengths, 1.0)
        sky = np.asarray(up, np.float64) / np.linalg.norm(up)
        # Not along an axis, so that the walls of a room differ.
        sun = sky + 0.5 * np.roll(sky, 1) + 0.3 * np.roll(sky, 2)
        light = 0.45 + 0.55 * np.abs(normals @ (sun / np.linalg.norm(sun)))
        if scene.colors is None:
            colors = np.full((len(scene), 3), 200.0)
        elif len(scene.colors) == len(scene.vertices):
            colors = scene.colors[scene.faces].mean(axis=1)
        else:
            colors = scene.colors.astype(np.float64)
        # The last row is what ids of the background index.
        self._colors = np.vstack([np.rint(colors * light[:, None]), [(255, 255, 255)]]).astype(np.uint8)

    def __call__(self, view: View) -> Bytes:
        picture = np.empty((*view.ids.shape, 3), np.uint8)
        _core.face_colors(view.ids, self._colors, picture)
        return picture


@dataclass(frozen=True)
class Uses:
    """Frames for which a plan gives an image.

    Attributes
    ----------
    eyes, gazes : (K, 3) ndarray of float64
    image : (K,) ndarray of int64
        By index, ascending.
    """

    eyes: Floats
    gazes: Floats
    image: npt.NDArray[np.int64]

    def of(self, index: int) -> slice:
        """The frames of one image."""
        first, end = np.searchsorted(self.image, [index, index + 1])
        return slice(int(first), int(end))


def uses(plan: Placement, count: int, *, region: npt.ArrayLike | None = None, seed: int = 0) -> Uses:
    """Which images a plan gives to random eyes that look in random directions.

    Parameters
    ----------
    plan : Plan
    count : int
        Frames asked for; those that need no image are left out.
    region : (2, 3) array_like of float, optional
        Where the eyes are: lowest and highest coordinates, by default the plan's domain.
    seed : int
        Of the frames.

    Examples
    --------
    See `cyclorama.placement`.
    """
    rng = np.random.default_rng(seed)
    low, high = np.asarray(plan.domain if region is None else region, np.float64)
    eyes = rng.uniform(low, high, (count, 3))
    gazes = _gazes(plan, rng, count)
    found: list[tuple[int, int]] = []
    for index in range(count):
        frame = plan.frame(eyes[index], gazes[index])
        found.extend((image.index, index) for image in frame.images)
    image, index_of = np.array(found, np.int64).reshape(-1, 2).T
    order = np.argsort(image, kind="stable")
    at = index_of[order]
    return Uses(eyes[at], gazes[at], image[order])


def more_uses(plan: Placement, image: int, eyes: Floats, gazes: Floats, region: Floats, wanted: int) -> Uses:
    """More frames for which a plan gives an image, near some that are known.

    Parameters
    ----------
    plan : Plan
    image : int
    eyes, gazes : (K, 3) ndarray of float64
        The known ones, one at least.
    region : (2, 3) ndarray of float64
        Where eyes are.
    wanted : int
        Frames; fewer if twice as many tries don't find them.
    """
    rng = np.random.default_rng(image)
    up = np.asarray(plan.up, np.float64) / np.linalg.norm(plan.up)
    pairs = rng.integers(0, len(eyes), (2 * wanted, 2))
    # Between two known ones or a little beyond, which stays level if both are, and a little beside.
    share = rng.uniform(-0.25, 1.25, (2 * wanted, 1))
    at = eyes[pairs[:, 0]] * (1 - share) + eyes[pairs[:, 1]] * share
    at += rng.normal(0.0, _BESIDE, at.shape) * (region[1] - region[0])
    at = np.clip(at, *region)
    ahead = gazes[pairs[:, 0]] * (1 - share) + gazes[pairs[:, 1]] * share + rng.normal(0.0, _BESIDE, at.shape)
    if plan.directions == "yaw":
        ahead -= np.outer(ahead @ up, up)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    kept: list[int] = []
    for index in range(2 * wanted):
        frame = plan.frame(at[index], ahead[index])
        if any(one.index == image for one in frame.images):
            kept.append(index)
            if len(kept) == wanted:
                break
    return Uses(at[kept], ahead[kept], np.full(len(kept), image))


def _gazes(plan: Placement, rng: np.random.Generator, count: int) -> Floats:
    """Random gazes that the plan serves."""
    if plan.directions == "sphere":
        gazes = rng.standard_normal((count, 3))
    else:
        up = np.asarray(plan.up, np.float64) / np.linalg.norm(plan.up)
        ahead = np.roll(up, 1) - up * (up @ np.roll(up, 1))
        ahead /= np.linalg.norm(ahead)
        yaw = rng.uniform(0, 2 * np.pi, (count, 1))
        gazes = np.cos(yaw) * ahead + np.sin(yaw) * np.cross(up, ahead)
    return np.asarray(gazes / np.linalg.norm(gazes, axis=1, keepdims=True))


def frame_camera(plan: Placement, eye: npt.ArrayLike, forward: npt.ArrayLike, size: tuple[int, int]) -> Camera:
    """The camera of a frame: the plan's field of view, whatever the shape of the pixels.

    Parameters
    ----------
    plan : Plan
    eye, forward : (3,) array_like of float
    size : (int, int)
        Width and height in pixels.
    """
    at = np.asarray(eye, np.float64)
    camera = Camera.look_at(at, at + np.asarray(forward, np.float64), plan.up, 60.0, *size)
    tan_x = math.tan(math.radians(plan.fov_x) / 2)
    half = np.array(size) / 2
    K = np.diag([half[0] / tan_x, half[1] / (tan_x / plan.aspect), 1.0])
    K[:2, 2] = half
    return camera.replace(K=K)


def picture(
    scene: Scene, camera: Camera, faces: npt.NDArray[np.uint32] | None, color: Coloring, *, threads: int | None = None
) -> DepthImage:
    """Some faces with depth; where there are none, samples that are infinitely far away.

    Parameters
    ----------
    scene : Scene
    camera : Camera
        A pinhole camera.
    faces : (K,) ndarray of uint32 or None
        All, for None.
    color : callable
        Gives a view's colours.
    threads : int, optional
        All cores by default.
    """
    view = scene.render(camera, faces, threads=threads)
    return _pictured(view, color, np.zeros(view.ids.shape, np.bool_))


def _pictured(view: View, color: Coloring, missing: npt.NDArray[np.bool_]) -> DepthImage:
    with np.errstate(divide="ignore"):
        disparity = 1.0 / view.depth
    return DepthImage.from_disparity(color(view), disparity, view.camera, missing=missing, ids=view.ids)


@dataclass(frozen=True, eq=False)
class Painted:
    """A layered image, and how well it shows what frames see of it that it was not built from.

    Attributes
    ----------
    image : LayeredDepthImage
    error : float
        The root of the mean squared difference to the truth, in grey levels of 255, over the pixels that show what the
        image stands for; holes count as black.
    holes : float
        The share of those pixels of which nothing is known, of the worst frame.
    judges : int
        Frames that it was judged by; if all were needed to build it, it was judged by those.
    """

    image: LayeredDepthImage
    error: float
    holes: float
    judges: int


def paint_group(
    plan: Placement,
    scene: Scene,
    group: Group,
    foreground: Foreground | None,
    *,
    size: tuple[int, int] = (512, 384),
    construction: int = 16,
    max_holes: float = 0.005,
    color: Coloring | None = None,
    threads: int | None = None,
) -> Painted:
    """The layered image of a group of frames.

    Some frames of the group are drawn. One after another those join the layered image of which the others still leave
    the most unknown, until none leaves more than `max_holes`: the rest has judged it. In a tangle no number of pictures
    is enough, as each eye sees other parts of what is far behind. If `construction` frames have joined and there are
    still more holes, or all have joined and none is left to judge, the faces that any frame of the group asks it for
    are peeled, layer by layer, from amid its eyes (`cyclorama.hits`): then all that the ray of a pixel meets of them is
    known, though most of it was seen from nowhere.

    Parameters
    ----------
    plan : Plan
    scene : Scene
    group : Group
        One frame at least.
    foreground : Foreground, optional
        Of the plan: what the frames draw of the image as geometry is not asked of it. None: they draw nothing of it.
    size : (int, int)
        Of a frame in pixels. The layered image has its pixels, and as many as all of the group see.
    construction : int
        The most frames that may join.
    max_holes : float
        Share of a frame's pixels that show what the image stands for.
    color : callable, optional
        Gives a view's colours; `Lit` by default.
    threads : int, optional
        All cores by default.
    """
    color = color or Lit(scene, plan.up)
    chosen = group.some(WITNESSES)
    cameras = [frame_camera(plan, group.eyes[i], group.gazes[i], size) for i in chosen]

    @cache
    def nearer(i: int) -> Nearer | None:
        if foreground is None:
            return None
        return foreground.rest(plan.frame(group.eyes[chosen[i]], group.gazes[chosen[i]]), cameras[i])

    faces = behind(plan, scene, group.image)
    # What they draw as geometry is painted, too: another frame of the group may have less room for it.
    frames = [picture(scene, _wider(camera), faces, color, threads=threads) for camera in cameras[:FRAMES]]
    judges = [_Judge(frame, cameras[i], nearer(i)) for i, frame in enumerate(frames)]
    central = picture(scene, _amid(frames, group, cameras[0], plan.up), faces, color, threads=threads)
    merged, left = [0], list(range(1, len(frames)))
    image = LayeredDepthImage.build(central, [frames[0]], threads=threads)
    for i in left:
        judges[i].look(image, threads)
    while left:
        # What joins can only fill holes: one that was known to have few has no more now.
        worst = max(left, key=lambda i: judges[i].holes)
        if judges[worst].holes <= max_holes:
            break
        if judges[worst].joined < len(merged):
            judges[worst].look(image, threads, len(merged))
            continue
        if len(merged) >= construction:
            break
        merged.append(worst)
        left.remove(worst)
        image = LayeredDepthImage.build(central, [frames[i] for i in merged], threads=threads)
    if not left or max(judges[i].holes for i in left) > max_holes:
        asked = np.zeros(len(scene), np.bool_)
        for i, camera in enumerate(cameras):
            known = i < len(frames)
            ids = np.asarray(frames[i].ids if known else scene.render(_wider(camera), faces, threads=threads).ids)
            asked[ids[_asked(ids, nearer(i))]] = True
        near = _APART / float(np.diag(central.camera.K)[:2].min())
        peeled = hits(scene, central.camera, np.flatnonzero(asked), most=_LAYERS, near=near, threads=threads)
        layers = [_pictured(view, color, view.ids == BACKGROUND) for _, view in peeled.layers()]
        image = LayeredDepthImage.build(central, [*(frames[i] for i in merged), *layers], threads=threads)
    for i in left or merged:
        judges[i].look(image, threads, len(merged))
    jury = [judges[i] for i in left or merged]
    pixels = sum(judge.pixels for judge in jury)
    error = math.sqrt(sum(judge.squares for judge in jury) / (3 * pixels)) if pixels else 0.0
    return Painted(image, error, max(judge.holes for judge in jury), len(left))


def _asked(ids: npt.NDArray[np.uint32], nearer: Nearer | None) -> Mask:
    """The pixels of a frame in which an image is asked for what it stands for."""
    asked: Mask = ids != BACKGROUND
    if nearer is not None:
        asked &= ~np.isin(ids, nearer.faces)
    return asked


class _Judge:
    """A frame that a layered image is compared with."""

    def __init__(self, frame: DepthImage, camera: Camera, nearer: Nearer | None) -> None:
        left, top = (frame.camera.width - camera.width) // 2, (frame.camera.height - camera.height) // 2
        own = np.s_[top : top + camera.height, left : left + camera.width]
        self.color, ids = frame.color[own], np.asarray(frame.ids)[own]
        self.where = _asked(ids, nearer)
        self.pixels = int(self.where.sum())
        self.camera: Camera | None = camera
        if nearer is not None:
            # Where everything is drawn as geometry nothing is asked of the image.
            self.camera = camera.replace(near=nearer.depth) if np.isfinite(nearer.depth) else None
        self.holes = self.squares = 0.0
        # How many frames were in the layered image when it was looked at.
        self.joined = 0

    def look(self, image: LayeredDepthImage, threads: int | None, joined: int = 1) -> None:
        self.joined = joined
        if not self.pixels or self.camera is None:
            return
        warped = image.warp(self.camera, splat="projected", threads=threads)
        self.holes = int((warped.hole & self.where).sum()) / self.pixels
        difference = warped.color[self.where].astype(np.float64) - self.color[self.where]
        self.squares = float(np.square(difference).sum())


def _wider(camera: Camera) -> Camera:
    """A camera that sees a little more on all sides: eyes that were not asked look beside those that were."""
    more = [math.ceil(_MARGIN * side) for side in (camera.width, camera.height)]
    K = camera.K.copy()
    K[:2, 2] += more
    return Camera(K, camera.world_to_camera, camera.width + 2 * more[0], camera.height + 2 * more[1])


def paint_as_paper(
    plan: Placement,
    scene: Scene,
    group: Group,
    *,
    size: tuple[int, int] = (512, 384),
    color: Coloring | None = None,
    threads: int | None = None,
) -> LayeredDepthImage:
    """The layered image of a placement from the nine cameras of section 4.3.2, `size` pixels through the quadrilateral.

    Its star-shape has the radius of the eyes of the group, or reaches to the quadrilateral.
    """
    color = color or Lit(scene, plan.up)
    viewpoint = plan.viewpoints[plan.images.viewpoint[group.image]]
    corners = plan.images.corners[group.image]
    distance = float(np.linalg.norm(corners.mean(axis=0) - viewpoint))
    reach = float(np.linalg.norm(group.eyes - viewpoint, axis=1).max()) if len(group.eyes) else distance
    cameras = construction_cameras(viewpoint, corners, min(reach, distance), size)
    faces = behind(plan, scene, group.image)
    central, *others = [picture(scene, camera, faces, color, threads=threads) for camera in cameras]
    return LayeredDepthImage.build(central, others, threads=threads)


def _amid(frames: list[DepthImage], group: Group, pixels: Camera, up: Floats) -> Camera:
    """A camera amid the eyes of a group that looks where they do, sees what they see, and has a camera's pixels."""
    middle = group.eyes.mean(axis=0)
    gaze = group.gazes.mean(axis=0)
    turn = Camera.look_at(middle, middle + gaze, up).world_to_camera[:3, :3]
    found = [(frame.points()[frame.disparity > 0] - middle) @ turn.T for frame in frames]
    points = np.concatenate(found)
    points = points[points[:, 2] > 0]
    slopes = np.clip(points[:, :2] / points[:, 2:], -_STEEPEST, _STEEPEST)
    if not len(slopes):
        slopes = np.zeros((1, 2))
    low, high = np.quantile(slopes, [_OUTSIDE, 1 - _OUTSIDE], axis=0)
    focal = np.diag(pixels.K)[:2]
    width, height = np.maximum(np.ceil((high - low) * focal), 1).astype(int).tolist()
    K = np.diag([*focal, 1.0])
    K[:2, 2] = -low * focal
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ middle
    return Camera(K, pose, width, height)
