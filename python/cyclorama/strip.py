"""Several flat pictures from one viewpoint, side by side (section 5.2.1 of the 1998 dissertation).

The seams between the pictures part the scene in wedges around the viewpoint, and in each wedge geometry bends to the
plane of its picture; beyond the first and the last picture it bends to theirs. Where two pictures leave a gap, a
virtual one spans it: geometry, drawn as if it were a picture. All of it is continuous as long as neighbouring planes
meet in their seam.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .backdrop import Composed, Cut, Ids, Part, cut
from .camera import Camera
from .geometry_warp import ImagePlane, Plane
from .placing import camera_through
from .scene import Scene

__all__ = ["Strip"]

Floats = npt.NDArray[np.float64]

# Radians between two seams below which they are one, and the share of their distance below which they are at one depth.
_SAME = 1e-6
# How far an image's edges may lean from the common axis, as the sine of the angle.
_UPRIGHT = 1e-6


@dataclass(eq=False)
class _Panel:
    """A wedge of the scene, None if nothing is in it, and what it bends to; `shown` is None where no image is."""

    wedge: Cut | None
    part: Part | None
    plane: ImagePlane
    shown: bool | None


class Strip:
    """Images with one viewpoint, from left to right.

    Parameters
    ----------
    scene : Scene
        F faces.
    viewpoint : (3,) array_like of float
        The center of projection of all images.
    corners : sequence of N (4, 3) array_like of float
        The quadrilateral of each image, from left to right as seen from the viewpoint: top-left, top-right,
        bottom-right, bottom-left. Their left and right edges are parallel to one axis. Neighbours share an edge, or
        leave a gap.
    size : (int, int)
        Width and height of each picture in pixels.

    Attributes
    ----------
    planes : list of ImagePlane
        Of the images, and of the virtual ones in gaps, from left to right.
    virtual : list of bool
        Which are virtual.

    Raises
    ------
    ValueError
        If a quadrilateral is none, edges are not parallel, images overlap or go around more than the viewpoint, or
        neighbours meet in one direction at different depths: no geometry could meet both (figure 5-6, right).

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(2_000)
    >>> eye = scene.center + (0, 0, 3)
    >>> x, y, z = scene.center + (0, 0, 0.1)
    >>> low, high, a, b, near = y - 0.2, y + 0.2, x - 0.2, x + 0.2, z + 0.1
    >>> left = [[a, high, near], [x, high, z], [x, low, z], [a, low, near]]
    >>> right = [[x, high, z], [b, high, near], [b, low, near], [x, low, z]]
    >>> strip = Strip(scene, eye, [left, right], size=(64, 64))
    >>> camera = cyc.Camera.look_at(eye + (0.2, 0, 0), scene.center, width=64, height=48)
    >>> sorted(set(strip.draw(camera).layer.ravel().tolist()))
    [0, 1, 2, 3]
    """

    def __init__(
        self,
        scene: Scene,
        viewpoint: npt.ArrayLike,
        corners: Sequence[npt.ArrayLike],
        *,
        size: tuple[int, int] = (512, 384),
    ) -> None:
        if not len(corners):
            raise ValueError("corners is empty: a strip has at least one image")
        given = [_plane(f"corners[{index}]", quad, viewpoint) for index, quad in enumerate(corners)]
        eye, axis = given[0].eye, _axis(given)
        self.planes: list[ImagePlane] = []
        self.virtual: list[bool] = []
        for index, plane in enumerate(given):
            if index and not _joined(given[index - 1], plane, index):
                self.planes.append(_gap(given[index - 1], plane, index))
                self.virtual.append(True)
            self.planes.append(plane)
            self.virtual.append(False)
        self._size = size
        seams = [_seam(plane, 0, 3, axis) for plane in self.planes] + [_seam(self.planes[-1], 1, 2, axis)]
        back = _back(seams, axis)
        self.scene = scene
        self._panels = [
            self._panel(index, low, high, size, eye)
            for index, (low, high) in enumerate(zip([back, *seams], [*seams, back], strict=True))
        ]

    def _panel(self, index: int, low: Floats, high: Floats, size: tuple[int, int], eye: Floats) -> _Panel:
        """The wedge between two seams; the first and the last are outside of the strip."""
        place = min(max(index - 1, 0), len(self.planes) - 1)
        plane = self.planes[place]
        inside = 0 < index <= len(self.planes)
        wedge: Cut | None = Cut(self.scene, np.arange(len(self.scene), dtype=np.uint32))
        slack = 1e-9 * plane.height
        for normal in (low, -high):
            if wedge is not None:
                wedge = cut(wedge.scene, wedge.faces, normal, float(normal @ eye), slack)
        camera = camera_through(eye, plane.corners, size) if inside else None
        part = None if wedge is None else Part(wedge.scene, wedge.faces, plane, camera)
        return _Panel(wedge, part, plane, (not self.virtual[place]) if inside else None)

    @property
    def shown(self) -> list[bool]:
        """Which of the N images are shown, from left to right."""
        return [
            bool(panel.shown) for panel, virtual in zip(self._panels[1:-1], self.virtual, strict=True) if not virtual
        ]

    def faces(self, image: int) -> Ids:
        """(K,) the faces that an image replaces, wholly or in part."""
        part = self._image(image).part
        if part is None or part.beyond is None:
            return np.empty(0, np.uint32)
        return np.unique(part.beyond.faces[part.hidden])

    def draw(self, camera: Camera) -> Composed:
        """The scene with the images that are shown, as another camera sees it.

        An image that is hidden is drawn as geometry, bent as if it were there: so an image between others comes and
        goes without any step (figure 5-7, right).

        Raises
        ------
        ValueError
            If the camera is orthographic, or its eye is not in front of all planes.
        """
        out = Composed.empty(camera)
        for panel in self._panels:
            panel.plane.distance(camera.eye)
            if panel.part is not None:
                out.faces += panel.part.draw(out, panel.plane.eye, bool(panel.shown))
        return out

    def hide(self, image: int) -> None:
        """Draws an image between two others as geometry from now on.

        Raises
        ------
        ValueError
            If it is the first or last that is shown: use `drop`.
        """
        shown = np.flatnonzero(self.shown)
        if image in (shown[:1].tolist() + shown[-1:].tolist()):
            raise ValueError(f"image {image} is at the strip's end: drop it, its surroundings move")
        self._image(image).shown = False

    def show(self, image: int) -> None:
        """Shows an image again that `hide` took away."""
        self._image(image).shown = True

    def drop(self, image: int, cameras: Sequence[Camera]) -> tuple[list[Composed], Strip | None]:
        """Takes the first or last image away (figure 5-7, left).

        What bends to its plane has to bend to that of the next image then: the plane turns about the seam between the
        two, and the geometry follows. After the only image everything returns to where it is (section 5.1.3).

        Parameters
        ----------
        image : int
            0 or N - 1.
        cameras : sequence of Camera
            One for each frame of the transition; `backdrop.FRAMES` are usual.

        Returns
        -------
        list of Composed
            The frames; the last is what the remaining strip draws.
        Strip or None
            What remains; None if it was the only image.

        Raises
        ------
        ValueError
            If the image is between others, or there is no camera.
        """
        real = [plane for plane, virtual in zip(self.planes, self.virtual, strict=True) if not virtual]
        if image not in (0, len(real) - 1):
            raise ValueError(f"image {image} of {len(real)} is not at the strip's end: hide it")
        if not len(cameras):
            raise ValueError("cameras is empty: a transition has at least one frame")
        rest = real[1:] if image == 0 else real[:-1]
        remaining = Strip(self.scene, real[0].eye, [p.corners for p in rest], size=self._size) if rest else None
        if remaining is not None:
            for at, shown in enumerate(self.shown[1:] if image == 0 else self.shown[:-1]):
                remaining._image(at).shown = shown
        kept = None if not rest else (rest[0] if image == 0 else rest[-1])
        pictures = [
            self._turned(camera, kept, image == 0, step / len(cameras)) for step, camera in enumerate(cameras, 1)
        ]
        return pictures, remaining

    def _turned(self, camera: Camera, kept: ImagePlane | None, left: bool, share: float) -> Composed:
        """The strip on the way to where `kept` is its end."""
        out = Composed.empty(camera)
        place = self.planes.index(kept) + 1 if kept is not None else None
        for index, panel in enumerate(self._panels):
            if panel.wedge is None or panel.part is None:
                continue
            if place is None or kept is None:
                eye = panel.plane.eye + share * (camera.eye - panel.plane.eye)
                out.faces += panel.part.draw(out, eye, image=False)
            elif index < place if left else index > place:
                plane = _between(panel.plane, kept, share)
                plane.distance(camera.eye)
                out.faces += Part(panel.wedge.scene, panel.wedge.faces, plane).draw(out, plane.eye, image=False)
            else:
                out.faces += panel.part.draw(out, panel.plane.eye, bool(panel.shown))
        return out

    def _image(self, image: int) -> _Panel:
        real = [panel for panel, virtual in zip(self._panels[1:-1], self.virtual, strict=True) if not virtual]
        if not 0 <= image < len(real):
            raise ValueError(f"image must be 0 to {len(real) - 1}, got {image}")
        return real[image]


def _plane(name: str, corners: npt.ArrayLike, viewpoint: npt.ArrayLike) -> ImagePlane:
    try:
        return ImagePlane.of(corners, viewpoint)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _axis(planes: Sequence[ImagePlane]) -> Floats:
    """The direction of all left and right edges, upward."""
    edges = np.array([plane.corners[[0, 1]] - plane.corners[[3, 2]] for plane in planes])
    edges /= np.linalg.norm(edges, axis=-1, keepdims=True)
    axis = edges.mean(axis=(0, 1))
    axis /= np.linalg.norm(axis)
    leaning = np.linalg.norm(np.cross(edges, axis), axis=-1)
    index, side = np.unravel_index(leaning.argmax(), leaning.shape)
    if leaning[index, side] > _UPRIGHT:
        raise ValueError(
            f"the {('left', 'right')[side]} edge of corners[{index}] leans by {leaning[index, side]:.3g} from the "
            f"others: images of a strip have parallel seams"
        )
    return np.asarray(axis)


def _joined(left: ImagePlane, right: ImagePlane, index: int) -> bool:
    """Whether two images share a seam."""
    a, b = left.corners[[1, 2]], right.corners[[0, 3]]
    rays, others = a - left.eye, b - left.eye
    reach = np.linalg.norm(rays, axis=1)
    if (np.linalg.norm(a - b, axis=1) <= _SAME * reach).all():
        return True
    turn = np.linalg.norm(np.cross(rays, others), axis=1) / (reach * np.linalg.norm(others, axis=1))
    if (turn <= _SAME).all():
        raise ValueError(
            f"corners[{index - 1}] and corners[{index}] meet in one direction at different depths: geometry can't bend "
            f"to both; move one until their edges meet"
        )
    return False


def _gap(left: ImagePlane, right: ImagePlane, index: int) -> ImagePlane:
    """A virtual image between two others."""
    a, b = left.corners, right.corners
    try:
        return ImagePlane.of([a[1], b[0], b[3], a[2]], left.eye)
    except ValueError as error:
        raise ValueError(
            f"corners[{index - 1}] and corners[{index}] overlap, or are not from left to right, or no plane spans the "
            f"gap between them: {error}"
        ) from error


def _seam(plane: ImagePlane, top: int, bottom: int, axis: Floats) -> Floats:
    """Unit normal, to the right, of the plane through the eye and an edge."""
    middle = (plane.corners[top] + plane.corners[bottom]) / 2 - plane.eye
    normal = np.cross(middle, axis)
    return np.asarray(normal / np.linalg.norm(normal))


def _back(seams: Sequence[Floats], axis: Floats) -> Floats:
    """Unit normal, to the right of the first seam's back, of the plane opposite to the strip's middle."""
    turns = [np.arctan2(np.cross(a, b) @ -axis, a @ b) for a, b in pairwise(seams)]
    span = float(np.sum(turns))
    if not (min(turns) > 0 and span < np.pi):
        raise ValueError(
            f"the images go {np.degrees(span):.4g} degrees around the viewpoint: an eye in front of all of their "
            f"planes, and geometry beside them, need less than 180"
        )
    middle = seams[0] + seams[-1]
    return np.asarray(-middle / np.linalg.norm(middle))


def _between(plane: Plane, other: Plane, share: float) -> Plane:
    """A plane on the way from one to another that has the same eye; it goes through the line in which they meet."""
    # A plane is where a vector, its normal over the eye's distance, has the product 1 with offsets to the eye.
    mixed = (1 - share) * plane.normal / plane.height + share * other.normal / other.height
    length = float(np.linalg.norm(mixed))
    return Plane(plane.eye, mixed / length, 1 / length)
