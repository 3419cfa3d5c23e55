"""Layered images for the placements of a plan (1998 dissertation, sections 4.3.2 and 4.4.2).

The image of a placement holds what the placement culls, and nothing else: whatever a frame draws as geometry is in
front of it, behind it or beside it by its depth. Rays that meet none of it are samples too, infinitely far away: so a
pixel without a sample is one of which nothing is known, and not the sky.

The dissertation takes its construction images around the viewpoint, within the star-shape. An eye that gets an image
may be far from its viewpoint, close to the image's plane. So they are taken here where the image is really used: the
plan is asked for frames all over its domain, and the eyes that get an image are grouped.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..depth_image import DepthImage
from ..ldi import LayeredDepthImage
from ..placing import camera_through, construction_cameras
from ..render import View
from ..scene import Scene

__all__ = ["Lit", "Uses", "frame_camera", "paint_image", "picture", "uses", "views_of_use"]

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

#: Gives the colours (H, W, 3) of a view: the same ones for a place from wherever it is seen, or borders show.
Coloring = Callable[[View], Bytes]

#: Where construction images are taken: where an image is used, or as the dissertation has it.
Where = Literal["use", "paper"]

# Steepest ray of a construction image to its axis: beyond it pixels are more than three times as dense as in the
# middle.
_STEEPEST = 2.0

# Where a layered image's own camera stands: at the viewpoint (0) what is just behind the plane is taken from far away,
# amid the eyes (1) its view is wide and its pixels are large. Measured in a cathedral and in a tangle of pipes at 0,
# 0.5 and 1: 25.0, 25.5, 24.2 dB and 18.6, 18.9, 18.5 dB.
_HALFWAY = 0.5

# Share of the samples that may lie beyond each border of a layered image: a few at the very edge would make its pixels
# large for all.
_OUTSIDE = 0.0005

# Rounds in which eyes find the middle nearest to them: later ones move the middles by less than a tenth of their
# distance (measured on a thousand eyes and 16 middles).
_ROUNDS = 10


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
    def frame(self, eye: npt.ArrayLike, forward: npt.ArrayLike) -> Frame: ...
    def culled(self, index: int) -> npt.NDArray[np.uint32]: ...


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
        last = len(self._colors) - 1
        return np.asarray(self._colors[np.minimum(view.ids, last)])


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

    def of(self, index: int) -> tuple[Floats, Floats]:
        """The eyes and gazes of one image."""
        first, end = np.searchsorted(self.image, [index, index + 1])
        return self.eyes[first:end], self.gazes[first:end]


def uses(plan: Placement, count: int, *, seed: int = 0) -> Uses:
    """Which images a plan gives to random eyes of its domain that look in random directions.

    Parameters
    ----------
    plan : Plan
    count : int
        Frames asked for; those that need no image are left out.
    seed : int
        Of the frames.

    Examples
    --------
    See `cyclorama.placement`.
    """
    rng = np.random.default_rng(seed)
    low, high = np.asarray(plan.domain, np.float64)
    eyes = rng.uniform(low, high, (count, 3))
    gazes = _gazes(plan, rng, count)
    found = np.full(count, -1, np.int64)
    for frame in range(count):
        image = plan.frame(eyes[frame], gazes[frame]).image
        if image is not None:
            found[frame] = image.index
    order = np.argsort(found, kind="stable")
    order = order[found[order] >= 0]
    return Uses(eyes[order], gazes[order], found[order])


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
    with np.errstate(divide="ignore"):
        disparity = 1.0 / view.depth
    missing = np.zeros(view.ids.shape, np.bool_)
    return DepthImage.from_disparity(color(view), disparity, camera, missing=missing, ids=view.ids)


def views_of_use(
    plan: Placement, index: int, eyes: Floats, gazes: Floats, count: int, size: tuple[int, int]
) -> list[Camera]:
    """Construction cameras amid the eyes that use an image.

    Parameters
    ----------
    plan : Plan
    index : int
        Of the image.
    eyes, gazes : (K, 3) ndarray of float64
        Some of its uses, one at least.
    count : int
        Cameras wanted; fewer eyes have one each.
    size : (int, int)
        Of a frame: the cameras have its pixels.

    Returns
    -------
    list of Camera
        At the middles of groups of eyes, the one nearest to the viewpoint first. They look along the image's gaze, and
        see what any of the frames sees of the space behind the quadrilateral.
    """
    viewpoint = plan.viewpoints[plan.images.viewpoint[index]]
    corners = plan.images.corners[index]
    central = camera_through(viewpoint, corners, (2, 2))
    turn = central.world_to_camera[:3, :3]
    rays = []
    for gaze in gazes:
        camera = frame_camera(plan, viewpoint, gaze, size)
        w, h = size
        rays.append(camera.unproject([(0, 0), (w, 0), (w, h), (0, h)], np.ones(4)) - viewpoint)
    slopes = _slopes(np.concatenate(rays) @ turn.T)
    behind = _slopes((corners - viewpoint) @ turn.T)
    middles = _middles(eyes, count)
    middles = middles[np.argsort(np.linalg.norm(middles - viewpoint, axis=1))]
    tan_x = math.tan(math.radians(plan.fov_x) / 2)
    focal = np.array([size[0], size[1] * plan.aspect]) / (2 * tan_x)
    cameras = []
    for middle in middles:
        # What is behind the quadrilateral lies between its corners and the directions in which the viewpoint sees them.
        at = np.concatenate([behind, _slopes((corners - middle) @ turn.T)])
        low = np.maximum(slopes.min(axis=0), at.min(axis=0))
        high = np.minimum(slopes.max(axis=0), at.max(axis=0))
        pixels = np.maximum(np.ceil((high - low) * focal), 1).astype(int)
        K = np.diag([*focal, 1.0])
        K[:2, 2] = -low * focal
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, -turn @ middle
        cameras.append(Camera(K, pose, *pixels.tolist()))
    return cameras


def _slopes(rays: Floats) -> Floats:
    """x / z and y / z, no steeper than cameras are made."""
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.where(rays[:, 2:] > 0, rays[:, :2] / rays[:, 2:], np.sign(rays[:, :2]) * np.inf)
    return np.clip(slopes, -_STEEPEST, _STEEPEST)


def _middles(points: Floats, count: int) -> Floats:
    """Means of groups of points: Lloyd's rounds, from points that are far from each other."""
    if len(points) <= count:
        return points.copy()
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmin())]
    nearest = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[chosen[-1]], axis=1))
    middles = points[chosen]
    for _ in range(_ROUNDS):
        group = np.linalg.norm(points[:, None] - middles, axis=2).argmin(axis=1)
        for place in range(count):
            if (group == place).any():
                middles[place] = points[group == place].mean(axis=0)
    return middles


def paint_image(
    plan: Placement,
    scene: Scene,
    index: int,
    found: Uses,
    *,
    size: tuple[int, int] = (512, 384),
    construction: int = 16,
    where: Where = "use",
    color: Coloring | None = None,
    threads: int | None = None,
) -> LayeredDepthImage:
    """The layered image of one placement.

    Parameters
    ----------
    plan : Plan
    scene : Scene
    index : int
        Of the image.
    found : Uses
        Frames that get images; an image that none gets has the dissertation's construction images.
    size : (int, int)
        Of the layered image in pixels: the view through the quadrilateral.
    construction : int
        Construction images.
    where : {"use", "paper"}
        Where they are taken: amid the eyes that use the image, or at the eight places of section 4.3.2.
    color : callable, optional
        Gives a view's colours; `Lit` by default.
    threads : int, optional
        All cores by default.
    """
    color = color or Lit(scene, plan.up)
    viewpoint = plan.viewpoints[plan.images.viewpoint[index]]
    corners = plan.images.corners[index]
    faces = plan.culled(index)
    eyes, gazes = found.of(index)
    if where == "use" and len(eyes):
        # An eye may stand at the viewpoint itself, though few do.
        views = views_of_use(plan, index, eyes, gazes, construction, size)
        cameras = [camera_through(viewpoint, corners, size), *views]
        images = [picture(scene, camera, faces, color, threads=threads) for camera in cameras]
        central = _between(images, viewpoint, eyes, corners, size)
    else:
        distance = float(np.linalg.norm(corners.mean(axis=0) - viewpoint))
        reach = float(np.linalg.norm(eyes - viewpoint, axis=1).max()) if len(eyes) else distance
        central, *cameras = construction_cameras(viewpoint, corners, min(reach, distance), size)
        images = [picture(scene, camera, faces, color, threads=threads) for camera in cameras]
    return LayeredDepthImage.build(picture(scene, central, faces, color, threads=threads), images, threads=threads)


def _between(
    images: list[DepthImage], viewpoint: Floats, eyes: Floats, corners: Floats, size: tuple[int, int]
) -> Camera:
    """A camera halfway from the viewpoint to the eyes that use it, which holds what the construction images saw."""
    turn = images[0].camera.world_to_camera[:3, :3]
    middle = (1 - _HALFWAY) * viewpoint + _HALFWAY * eyes.mean(axis=0)
    found = [(image.points()[image.disparity > 0] - middle) @ turn.T for image in images]
    points = np.concatenate([(corners - middle) @ turn.T, *found])
    points = points[points[:, 2] > 0]
    slopes = points[:, :2] / points[:, 2:]
    low, high = np.quantile(slopes[4:] if len(slopes) > 4 else slopes, [_OUTSIDE, 1 - _OUTSIDE], axis=0)
    focal = np.array(size) / np.maximum(high - low, 1e-6)
    K = np.diag([*focal, 1.0])
    K[:2, 2] = -low * focal
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ middle
    return Camera(K, pose, *size)
