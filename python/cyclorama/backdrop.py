"""A flat picture instead of all that lies beyond a distance, and geometry that bends to it (sections 5.1 and 5.3).

The quadrilateral of the picture parts the scene in three (5.1.1): *near* geometry, before its plane, is drawn as it is;
*image* geometry, behind the quadrilateral as seen from the picture's eye, is not drawn at all; *surrounding* geometry,
behind the plane beside the quadrilateral, is drawn bent, so that it meets the picture's border wherever the eye is.
Faces that cross the plane are cut there, so that the parts join on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from . import _core
from .camera import Camera
from .compose import Canvas
from .geometry_warp import ImagePlane, Plane, bent_camera
from .placing import quadrilateral
from .render import BACKGROUND
from .scene import Scene

__all__ = ["Backdrop", "BackdropWalk", "Backdrops", "Composed", "backdrop", "check_together"]

Floats = npt.NDArray[np.float64]
Ids = npt.NDArray[np.uint32]
Mask = npt.NDArray[np.bool_]

#: Frames of a transition between geometry and image (5.3.1).
FRAMES = 5

#: What a pixel of `Composed.layer` shows.
NOTHING, NEAR, SURROUNDING, IMAGE = range(4)

# Corners within this share of the image's distance from its plane lie on it: cutting there would leave slivers only.
_ON_PLANE = 1e-9


@dataclass(eq=False)
class Composed:
    """Geometry and a backdrop in one picture.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
        White where nothing is.
    depth : (H, W) ndarray of float32
        Along the camera's axis, of what is shown where it is shown: bent where the geometry is, and of the image's
        plane. Infinity where nothing is.
    ids : (H, W) ndarray of uint32
        The scene's face at each pixel, `BACKGROUND` where there is none or the image is.
    layer : (H, W) ndarray of int32
        0 nothing, 1 near geometry, 2 surrounding geometry, 3 image.
    faces : int
        How many faces were drawn; those of the scene that are cut count once for each part.
    camera : Camera
        The camera that was asked.
    """

    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    ids: npt.NDArray[np.uint32]
    layer: npt.NDArray[np.int32]
    faces: int
    camera: Camera

    def __repr__(self) -> str:
        height, width = self.ids.shape
        share = np.count_nonzero(self.layer == IMAGE) / self.layer.size
        return f"<Composed: {width} x {height}, {self.faces:,} faces drawn, {share:.1%} is picture>"

    @classmethod
    def empty(cls, camera: Camera) -> Composed:
        """Nothing, as a camera sees it."""
        canvas = Canvas.empty(camera.height, camera.width, NOTHING)
        return cls(canvas.color, canvas.depth, canvas.ids, canvas.layer, 0, camera)

    @classmethod
    def plain(cls, scene: Scene, camera: Camera) -> Composed:
        """A scene as it is."""
        view = scene.render(camera)
        layer = np.where(view.ids == BACKGROUND, NOTHING, NEAR).astype(np.int32)
        return cls(view.color, view.depth, view.ids, layer, len(scene), camera)

    @property
    def canvas(self) -> Canvas:
        """The picture, to lay something over it."""
        return Canvas(self.color, self.depth, self.ids, self.layer)


class Part:
    """A part of a scene that bends to one plane, and the image on it.

    Parameters
    ----------
    scene : Scene
        What the plane parts.
    faces : (F,) ndarray of uint32
        What the scene's faces are part of; so they are called in all answers.
    plane : Plane
        The plane and the eye.
    camera : Camera, optional
        The pinhole camera, at that eye, that the picture is taken with, if the plane is that of an image.
    """

    def __init__(self, scene: Scene, faces: Ids, plane: Plane, camera: Camera | None = None) -> None:
        self.plane = plane
        self.camera = camera
        slack = _ON_PLANE * plane.height
        self.near = cut(scene, faces, -plane.normal, -plane.offset, slack)
        self.beyond = cut(scene, faces, plane.normal, plane.offset, slack)

    @cached_property
    def _parted(self) -> tuple[Ids, Ids]:
        """Faces beyond the plane that reach behind the quadrilateral, and those that reach beside it."""
        if self.beyond is None:
            return np.empty(0, np.uint32), np.empty(0, np.uint32)
        assert isinstance(self.plane, ImagePlane)
        inside = (self.beyond.scene.vertices - self.plane.eye) @ self.plane.sides().T
        # How far each corner of each face is inside each side of the pyramid.
        within = inside[self.beyond.scene.faces]
        wholly, missed = np.all(within >= 0, axis=(1, 2)), np.any(np.all(within <= 0, axis=1), axis=1)
        return np.flatnonzero(~missed).astype(np.uint32), np.flatnonzero(~wholly).astype(np.uint32)

    @property
    def hidden(self) -> Ids:
        """Faces of `beyond` that reach behind the quadrilateral."""
        return self._parted[0]

    @property
    def beside(self) -> Ids:
        """Faces of `beyond` that reach beside it."""
        return self._parted[1]

    @cached_property
    def picture(self) -> npt.NDArray[np.uint8]:
        """(H, W, 4) uint8: what the camera sees beyond the plane; opacity 0 where that is nothing."""
        assert self.camera is not None
        if self.beyond is None:
            return np.zeros((self.camera.height, self.camera.width, 4), np.uint8)
        view = self.beyond.scene.render(self.camera, self.hidden)
        opacity = np.where(view.ids == BACKGROUND, 0, 255).astype(np.uint8)
        return np.dstack([view.color, opacity])

    def draw(self, out: Composed, from_eye: Floats, image: bool) -> int:
        """Adds what `out.camera` sees of it, bent as if the picture had been made from `from_eye`, or with the image.

        How many faces were drawn.
        """
        count = 0 if self.near is None else self.add(out, self.near, out.camera, 1.0, None, NEAR, None)
        return count + self.draw_beyond(out, from_eye, image)

    def draw_beyond(self, out: Composed, from_eye: Floats, image: bool) -> int:
        """As `draw`, without what is before the plane."""
        covered = self._draw_image(out) if image else None
        faces = self.beside if image else None
        if self.beyond is None or (faces is not None and not len(faces)):
            return 0
        bent, scale = bent_camera(self.plane.seen_from(from_eye), out.camera)
        return self.add(out, self.beyond, bent, scale, faces, SURROUNDING, covered)

    @staticmethod
    def add(
        out: Composed, cut: Cut, camera: Camera, scale: float, faces: Ids | None, layer: int, but: Mask | None
    ) -> int:
        """Draws a part's faces, all by default, elsewhere than in the pixels `but`; how many."""
        view = cut.scene.render(camera, faces)
        within = None if but is None else ~but
        canvas, names = out.canvas, np.ascontiguousarray(cut.faces, np.uint32)
        canvas.lay(view.depth, layer, color=view.color, ids=view.ids, within=within, scale=scale, names=names)
        return len(cut.faces if faces is None else faces)

    def _draw_image(self, out: Composed) -> Mask:
        """The pixels that look at the quadrilateral."""
        # Places on the plane are homogeneous combinations of two of its directions and a corner; so each side of the
        # quadrilateral, and 1 / depth, is a plane over the image.
        assert isinstance(self.plane, ImagePlane) and self.camera is not None
        corners = self.plane.corners
        basis = np.column_stack([corners[1] - corners[0], corners[3] - corners[0], corners[0]])
        from_pixel = np.linalg.inv(_homogeneous(out.camera, basis))
        local = (corners - corners[0]) @ np.linalg.pinv(basis[:, :2]).T
        flat = np.column_stack([local, np.ones(4)])
        sides = np.cross(flat, np.roll(flat, -1, 0))
        sides *= np.sign(sides @ flat.mean(0))[:, None]
        x, y = np.arange(out.camera.width) + 0.5, np.arange(out.camera.height)[:, None] + 0.5
        forms = np.vstack([sides, [0.0, 0.0, 1.0]]) @ from_pixel
        inside = np.ones(out.depth.shape, bool)
        for form in forms[:-1]:
            inside &= form[0] * x + (form[1] * y + form[2]) >= 0
        nearness = forms[-1, 0] * x + (forms[-1, 1] * y + forms[-1, 2])
        inside &= nearness > 0
        rows, columns = np.nonzero(inside)
        to_picture = _homogeneous(self.camera, basis) @ from_pixel
        u, v, w = to_picture @ np.stack([x[columns], y[rows, 0], np.ones(len(rows))])
        found = _core.sample(np.ascontiguousarray(self.picture), np.column_stack([u / w, v / w]))
        color, depth = np.empty_like(out.color), np.full(out.depth.shape, np.inf, np.float32)
        color[inside] = found[:, :3]
        depth[inside] = np.where(found[:, 3] > 0, 1.0 / nearness[inside], np.inf)
        out.canvas.lay(depth, IMAGE, color=color)
        return inside


class Backdrop:
    """A picture of all that a quadrilateral hides from an eye, and the scene parted by it.

    Parameters
    ----------
    scene : Scene
        F faces.
    corners : (4, 3) array_like of float
        Top-left, top-right, bottom-right, bottom-left as seen from the eye of `camera`.
    camera : Camera
        The pinhole camera that the picture is taken with; its image must hold the quadrilateral.

    Attributes
    ----------
    plane : ImagePlane
        The quadrilateral and the eye.
    part : Part
        The scene on both sides of it.
    near, image, surrounding : (K,) ndarray of uint32
        Faces of the scene that have a part in each; one that is cut, or crosses the border, is in several.
    saved : int
        How many faces fewer than the scene has are drawn with the image. None are, or less than none, where the image
        hides no more than the cuts add: then `draw` shows the scene as it is.

    Raises
    ------
    ValueError
        If the corners are no convex quadrilateral in that order, or not all inside the camera's image.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(2_000)
    >>> camera = cyc.Camera.look_at(scene.center + (0, 0, 3), scene.center, width=64, height=48)
    >>> drop = backdrop(scene, camera, 3.0)
    >>> drop.draw(camera).faces < len(scene)
    True
    """

    def __init__(self, scene: Scene, corners: npt.ArrayLike, camera: Camera) -> None:
        self.plane = ImagePlane.of(corners, camera.eye)
        pixels, _ = camera.project(self.plane.corners)
        size = (camera.width, camera.height)
        slack = 1e-6 * max(size)
        inside = np.all((pixels >= -slack) & (pixels <= np.add(size, slack)), axis=1)
        for index in np.flatnonzero(~inside):
            raise ValueError(
                f"corners[{index}] is at pixel {pixels[index].round(2).tolist()}, outside of the camera's image of "
                f"{camera.width} x {camera.height}"
            )
        self.scene = scene
        self.camera = camera
        self.part = Part(scene, np.arange(len(scene), dtype=np.uint32), self.plane, camera)

    @property
    def near(self) -> Ids:
        return _faces(self.part.near)

    @property
    def image(self) -> Ids:
        return _faces(self.part.beyond, self.part.hidden)

    @property
    def surrounding(self) -> Ids:
        return _faces(self.part.beyond, self.part.beside)

    @property
    def saved(self) -> int:
        near = 0 if self.part.near is None else len(self.part.near.faces)
        return len(self.scene) - near - len(self.part.beside)

    def draw(self, camera: Camera, *, share: float = 1.0) -> Composed:
        """The scene with the backdrop, as another camera sees it.

        Parameters
        ----------
        camera : Camera
            A pinhole camera whose eye is in front of the image's plane.
        share : float
            Of the way from geometry (0) to image (1): between, all that lies beyond the plane is drawn as geometry,
            bent as if the picture had been made from an eye so far on the way from the camera's to its own (5.1.3).

        Returns
        -------
        Composed

        Raises
        ------
        ValueError
            If the eye is not in front of the plane, the camera is orthographic, or `share` is outside [0, 1].

        Notes
        -----
        At the picture's own viewpoint nothing moves, whatever `share` is.
        """
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"share must lie in [0, 1], got {share}")
        self.plane.distance(camera.eye)
        if self.saved <= 0:
            return Composed.plain(self.scene, camera)
        out = Composed.empty(camera)
        out.faces = self.part.draw(out, camera.eye + share * (self.plane.eye - camera.eye), share == 1.0)
        return out

    def in_view(self, camera: Camera) -> bool:
        """Whether some of the quadrilateral may be in a camera's image: not wholly outside of one of its sides."""
        local = self.plane.corners @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
        x, y, w = (local @ camera.K.T).T
        sides = (x, camera.width * w - x, y, camera.height * w - y, w)
        return not any((side <= 0).all() for side in sides)


def backdrop(scene: Scene, camera: Camera, distance: float) -> Backdrop:
    """All that a camera sees beyond a distance, as a flat picture (section 5.3.1).

    Parameters
    ----------
    scene : Scene
        The scene.
    camera : Camera
        A pinhole camera; the picture covers its image.
    distance : float
        Of the picture's plane from the eye, along the camera's axis, in the scene's units.

    Returns
    -------
    Backdrop

    Raises
    ------
    ValueError
        If `distance` is not positive and finite, or the camera is orthographic.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(2_000)
    >>> camera = cyc.Camera.look_at(scene.center + (0, 0, 3), scene.center, width=64, height=48)
    >>> drop = backdrop(scene, camera, 3.0)
    >>> round(drop.plane.height, 6)
    3.0
    """
    return Backdrop(scene, quadrilateral(camera, distance), camera)


def check_together(backdrops: Sequence[Backdrop]) -> None:
    """Refuses backdrops of one scene that can't be shown together (section 5.2.2).

    Parameters
    ----------
    backdrops : sequence of Backdrop
        Of any viewpoints; for several of one viewpoint see `cyclorama.strip.Strip`.

    Raises
    ------
    ValueError
        If two quadrilaterals cut each other; or two of different viewpoints both bend a face, or one bends what the
        other shows: a face can't meet two images.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(2_000)
    >>> camera = cyc.Camera.look_at(scene.center + (0, 0, 3), scene.center, width=64, height=48)
    >>> check_together([backdrop(scene, camera, 3.0)])
    """
    for j, second in enumerate(backdrops):
        for i, first in enumerate(backdrops[:j]):
            if _cut_each_other(first.plane.corners, second.plane.corners):
                raise ValueError(f"the quadrilaterals of backdrops[{i}] and backdrops[{j}] cut each other")
            if _of_one_viewpoint(first, second):
                continue
            shown = [np.union1d(drop.image, drop.surrounding) for drop in (first, second)]
            shared = np.union1d(
                np.intersect1d(first.surrounding, shown[1]), np.intersect1d(second.surrounding, shown[0])
            )
            if len(shared):
                raise ValueError(
                    f"backdrops[{i}] and backdrops[{j}] have different viewpoints and both bend {len(shared)} faces, "
                    f"face {shared[0]} among them: show one of them, or take both from one viewpoint"
                )


class Backdrops:
    """Several backdrops of a scene, of different viewpoints, shown together (section 5.2.2).

    Parameters
    ----------
    backdrops : sequence of Backdrop
        At least one; for several of one viewpoint, side by side, see `cyclorama.strip.Strip`.

    Attributes
    ----------
    saved : int
        As of a `Backdrop`: where it isn't positive, `draw` shows the scene as it is.

    Raises
    ------
    ValueError
        As for `check_together`; and if there is none, they are not of one scene, or two of one viewpoint stand for the
        same faces.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(2_000)
    >>> camera = cyc.Camera.look_at(scene.center + (0, 0, 3), scene.center, width=64, height=48)
    >>> Backdrops([backdrop(scene, camera, 3.0)]).draw(camera).faces < len(scene)
    True
    """

    def __init__(self, backdrops: Sequence[Backdrop]) -> None:
        self.backdrops = list(backdrops)
        if not self.backdrops:
            raise ValueError("backdrops is empty: there is nothing to show")
        scene = self.backdrops[0].scene
        for index, drop in enumerate(self.backdrops):
            if drop.scene is not scene:
                raise ValueError(f"backdrops[{index}] is of another scene than backdrops[0]")
        check_together(self.backdrops)
        shown = [np.union1d(drop.image, drop.surrounding) for drop in self.backdrops]
        for j, second in enumerate(self.backdrops):
            for i, first in enumerate(self.backdrops[:j]):
                shared = np.intersect1d(shown[i], shown[j])
                if _of_one_viewpoint(first, second) and len(shared):
                    raise ValueError(
                        f"backdrops[{i}] and backdrops[{j}] have one viewpoint and both stand for face {shared[0]}: "
                        "make a Strip of them"
                    )
        near: Cut | None = Cut(scene, np.arange(len(scene), dtype=np.uint32))
        for drop in self.backdrops:
            if near is not None:
                plane = drop.plane
                near = cut(near.scene, near.faces, -plane.normal, -plane.offset, _ON_PLANE * plane.height)
        self._near = near

    @property
    def saved(self) -> int:
        near = 0 if self._near is None else len(self._near.faces)
        return len(self.backdrops[0].scene) - near - sum(len(drop.part.beside) for drop in self.backdrops)

    def draw(self, camera: Camera) -> Composed:
        """The scene with all of them, as a camera sees it.

        Parameters
        ----------
        camera : Camera
            A pinhole camera whose eye is in front of all their planes.

        Returns
        -------
        Composed

        Raises
        ------
        ValueError
            If the eye is not in front of a plane, or the camera is orthographic.
        """
        for drop in self.backdrops:
            drop.plane.distance(camera.eye)
        if self.saved <= 0:
            return Composed.plain(self.backdrops[0].scene, camera)
        out = Composed.empty(camera)
        if self._near is not None:
            out.faces += Part.add(out, self._near, camera, 1.0, None, NEAR, None)
        for drop in self.backdrops:
            out.faces += drop.part.draw_beyond(out, drop.plane.eye, True)
        return out


def _of_one_viewpoint(first: Backdrop, second: Backdrop) -> bool:
    return np.allclose(first.plane.eye, second.plane.eye, rtol=0, atol=_ON_PLANE * first.plane.height)


def _cut_each_other(first: Floats, second: Floats) -> bool:
    """Whether two convex quadrilaterals in different planes have points in common."""
    spans = []
    normals = [np.cross(quad[2] - quad[0], quad[3] - quad[1]) for quad in (first, second)]
    line = np.cross(normals[0], normals[1])
    if not np.linalg.norm(line) > 1e-9 * np.linalg.norm(normals[0]) * np.linalg.norm(normals[1]):
        return False
    for quad, other, normal in ((first, second, normals[1]), (second, first, normals[0])):
        depth = (quad - other[0]) @ normal
        beyond = np.roll(depth, -1)
        crosses = (depth < 0) != (beyond < 0)
        if not crosses.any():
            return False
        share = (depth[crosses] / (depth[crosses] - beyond[crosses]))[:, None]
        points = quad[crosses] + share * (np.roll(quad, -1, 0)[crosses] - quad[crosses])
        spans.append((float((points @ line).min()), float((points @ line).max())))
    return max(spans[0][0], spans[1][0]) < min(spans[0][1], spans[1][1])


class BackdropWalk:
    """A backdrop that comes and goes while somebody walks (section 5.3).

    `show` and `hide` begin a transition, which each `frame` takes a step further. It is instantaneous while the
    quadrilateral is out of view. An eye that comes to the image's plane would see it flip: from `clearance` on the
    image turns back to geometry, at once if the step went past the plane.

    Parameters
    ----------
    backdrop : Backdrop
        The picture.
    frames : int
        Of a transition, at least 1.
    clearance : float
        Distance from the plane, as a share of the picture's own, at which the image is given up; in (0, 1).

    Attributes
    ----------
    share : float
        0 geometry, 1 image.
    shown : bool
        Where the transition leads.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(2_000)
    >>> camera = cyc.Camera.look_at(scene.center + (0, 0, 3), scene.center, width=64, height=48)
    >>> walk = BackdropWalk(backdrop(scene, camera, 3.0), frames=2)
    >>> walk.show()
    >>> shares = []
    >>> for _ in range(3):
    ...     picture = walk.frame(camera)
    ...     shares.append(walk.share)
    >>> shares
    [0.5, 1.0, 1.0]
    """

    def __init__(self, backdrop: Backdrop, *, frames: int = FRAMES, clearance: float = 0.2) -> None:
        if not frames >= 1:
            raise ValueError(f"frames must be at least 1, got {frames}")
        if not 0.0 < clearance < 1.0:
            raise ValueError(f"clearance must lie in (0, 1), got {clearance}")
        self.backdrop = backdrop
        self.frames = int(frames)
        self.clearance = float(clearance)
        self.shown = False
        self._step = 0

    @property
    def share(self) -> float:
        return self._step / self.frames

    def show(self) -> None:
        """Begins to turn geometry into the image."""
        self.shown = True

    def hide(self) -> None:
        """Begins to turn the image into geometry."""
        self.shown = False

    def frame(self, camera: Camera) -> Composed:
        """Takes the next step and draws.

        Raises
        ------
        ValueError
            If the camera is orthographic.
        """
        plane = self.backdrop.plane
        distance = -float(plane.behind(camera.eye))
        if distance <= self.clearance * plane.height:
            self.shown = False
        if self.shown:
            self._step = min(self._step + 1, self.frames)
        else:
            self._step = max(self._step - 1, 0)
        if not self.backdrop.in_view(camera):
            self._step = self.frames if self.shown else 0
        if distance <= 0.0:
            self._step = 0
        if self._step == 0:
            return Composed.plain(self.backdrop.scene, camera)
        return self.backdrop.draw(camera, share=self.share)


@dataclass(frozen=True, eq=False)
class Cut:
    """A part of a scene, and what its faces are part of."""

    scene: Scene
    faces: Ids


def cut(scene: Scene, faces: Ids, normal: Floats, offset: float, slack: float) -> Cut | None:
    """What of a scene lies on one side of a plane; None for nothing.

    Parameters
    ----------
    scene : Scene
        F faces.
    faces : (F,) ndarray of uint32
        What they are part of.
    normal : (3,) ndarray of float64
        Unit vector toward what is kept.
    offset : float
        ``normal @ x`` of the plane's points.
    slack : float
        Corners within this distance lie on the plane.
    """
    depth = np.asarray(scene.vertices, np.float64) @ normal - offset
    depth[np.abs(depth) <= slack] = 0.0
    side = depth[scene.faces]
    whole = (side >= 0).all(1) & (side > 0).any(1)
    crossing = np.flatnonzero((side > 0).any(1) & (side < 0).any(1))
    if whole.all():
        return Cut(scene, faces)
    if not (whole.any() or len(crossing)):
        return None
    # Turned so that the corner alone on its side comes first; a corner on the plane counts as behind it.
    behind = side[crossing] >= 0
    alone = np.where(behind.sum(1) == 1, behind.argmax(1), (~behind).argmax(1))
    corners = np.take_along_axis(scene.faces[crossing], (alone[:, None] + np.arange(3)) % 3, axis=1)
    d = depth[corners]
    # Where its two edges meet the plane.
    tips, ends = corners[:, [0, 0]].ravel(), corners[:, 1:].ravel()
    share = (d[:, :1] / (d[:, :1] - d[:, 1:])).ravel()
    position = np.asarray(scene.vertices, np.float64)
    meet = position[tips] + share[:, None] * (position[ends] - position[tips])
    first = len(position) + 2 * np.arange(len(crossing))
    one = d[:, 0] > 0
    tip = np.column_stack([corners[:, 0], first, first + 1])[one]
    rest = np.column_stack([first, corners[:, 1], corners[:, 2]])[~one]
    last = np.column_stack([first, corners[:, 2], first + 1])[~one]
    triangles = np.concatenate([scene.faces[whole], tip, rest, last])
    origin = np.concatenate([np.flatnonzero(whole), crossing[one], crossing[~one], crossing[~one]]).astype(np.uint32)
    colors = scene.colors
    if colors is not None and len(colors) == len(position):
        mixed = colors[tips] + share[:, None] * (colors[ends].astype(np.float64) - colors[tips])
        colors = np.concatenate([colors, mixed.round().astype(np.uint8)])
    elif colors is not None:
        colors = colors[origin]
    used, index = np.unique(triangles, return_inverse=True)
    vertices = np.concatenate([position, meet])[used]
    per_vertex = colors is not None and len(colors) == len(position) + len(meet)
    kept = colors[used] if colors is not None and per_vertex else colors
    transparent = None if scene.transparent is None else scene.transparent[origin]
    a, b, c = vertices[index.reshape(-1, 3)].swapaxes(0, 1)
    if not np.cross(b - a, c - a).any():
        return None
    return Cut(Scene(vertices, index.reshape(-1, 3), kept, transparent=transparent), faces[origin])


def _faces(cut: Cut | None, only: Ids | slice = slice(None)) -> Ids:
    return np.empty(0, np.uint32) if cut is None else np.unique(cut.faces[only])


def _homogeneous(camera: Camera, basis: Floats) -> Floats:
    """(3, 3) from combinations of two directions and a point to homogeneous pixels, whose last row is depth."""
    local = camera.world_to_camera[:3, :3] @ basis
    local[:, 2] += camera.world_to_camera[:3, 3]
    return np.asarray(camera.K @ local)
