"""Id-buffers, and the rows of bits that say which faces a view sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from .bitfield import Bitfields
from .camera import Camera, stack
from .progress import Progress, reporter

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["BACKGROUND", "View", "render", "visible"]

BACKGROUND = np.uint32(0xFFFFFFFF)
"""Id stored where a pixel's ray leaves the scene."""

Engine = Literal["auto", "raster", "raycast"]
Fill = Literal["rays", "neighbours"] | None


@dataclass(frozen=True)
class View:
    """What one camera sees.

    Attributes
    ----------
    ids : (H, W) ndarray of uint32
        The nearest face at each pixel centre, `BACKGROUND` where there is none.
    depth : (H, W) ndarray of float32
        Its distance along the optical axis, infinity where there is none.
    camera : Camera
        The camera that was asked.
    """

    ids: npt.NDArray[np.uint32]
    depth: npt.NDArray[np.float32]
    camera: Camera
    _scene: Scene = field(repr=False)

    @cached_property
    def color(self) -> npt.NDArray[np.uint8]:
        """(H, W, 3) uint8: the scene's colours (light grey where it has none) lit from the eye, on white."""
        picture = np.empty((*self.ids.shape, 3), np.uint8)
        self._scene._mesh.shade(stack([self.camera]), self.ids, picture, self._scene.colors)
        return picture

    def __repr__(self) -> str:
        owners = np.unique(self.ids[self.ids != BACKGROUND])
        height, width = self.ids.shape
        return f"<View: {width} x {height}, {len(owners):,} faces own a pixel>"


def render(
    scene: Scene,
    camera: Camera,
    faces: npt.ArrayLike | None = None,
    engine: Engine = "auto",
    *,
    out: View | None = None,
    threads: int | None = None,
) -> View:
    """Draw one view; see `Scene.render`."""
    if not isinstance(camera, Camera):
        raise ValueError(f"camera must be a Camera, got {type(camera).__name__}")
    shape = (camera.height, camera.width)
    if out is None:
        ids, depth = np.empty(shape, np.uint32), np.empty(shape, np.float32)
    elif out.ids.shape != shape:
        raise ValueError(f"out has shape {out.ids.shape}, the camera {shape}")
    else:
        ids, depth = out.ids, out.depth
    only = None if faces is None else face_ids(faces, len(scene))
    scene._mesh.render(stack([camera]), ids, depth, only, engine, threads)
    return View(ids, depth, camera, scene)


def visible(
    scene: Scene,
    cameras: Camera | Sequence[Camera],
    fill: Fill = "rays",
    *,
    rings: int = 1,
    supersampling: int = 3,
    points: int = 24,
    engine: Engine = "auto",
    known: Bitfields | npt.NDArray[np.uint64] | None = None,
    out: npt.NDArray[np.uint64] | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Bitfields:
    """The faces that each of S cameras sees, as rows of bits.

    A face is visible if some point of it, inside the image, is the nearest surface on its ray. An id-buffer alone
    (`fill=None`) loses most visible faces of a real model: those that fall between its pixel centres.

    Parameters
    ----------
    scene : Scene
        F faces. Transparent ones hide nothing and are set in every row (2001 paper, section 3.4).
    cameras : Camera or sequence of S Camera
        Of any sizes and kinds.
    fill : {"rays", "neighbours", None}
        What is done about faces that own no pixel. "rays" looks at points on each one that the picture doesn't hide,
        and takes it only where such a point is really the nearest surface: nothing invisible is answered.
        "neighbours" takes the faces beside visible ones that turn the same side to the eye (2001 paper,
        section 3.1.1), a guess that adds hidden faces along every silhouette. `None` is the bare id-buffer.
    rings : int
        For "neighbours": how often. Many rings flood all that faces the eye.
    supersampling : int
        For "rays": how finely cluttered views are looked at, those in which 0.65 faces a visible one or more remain
        that the picture doesn't hide and no point decided (not scans seen whole, but trees, engines and rooms). Such
        faces get points as dense as so many samples along each side of a pixel. Where things far apart lie side by
        side nearly everywhere, as leaves do, a finer picture with so many samples is drawn of what is cluttered. 1
        does neither.
    points : int
        For "rays": points tested on a face before it is given up, of which those after the fourth only in cluttered
        views, and there on thin faces alone, if no finer picture is drawn; a long thin face gets more, up to 12 times
        as many.
    engine : {"auto", "raster", "raycast"}
        Both give the same bits.
    known : Bitfields or (S, W) ndarray of uint64, optional
        Faces already known to be visible, a row per camera: set in the answer and not looked for again.
    out : (S, W) ndarray of uint64, optional
        Memory for the answer; W is ceil(F / 64). Bits that are set in it stay set.
    threads : int, optional
        All cores by default. The answer doesn't depend on it. Memory grows with threads, not with cameras: each has one
        image, 8 bytes a sample, and for "rays" a byte a face and some 400 bytes for each face that the picture neither
        shows nor hides: for a million faces some 100 MB (a ball) to 400 MB (pipes).
    progress : bool or callable, optional
        A bar by default, where somebody watches.

    Returns
    -------
    Bitfields
        S rows of F bits.

    Raises
    ------
    ValueError
        If an argument is none of the above or doesn't fit the scene.
    KeyboardInterrupt
        At Ctrl-C, within a view's time.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> camera = cyc.Camera.look_at([0.3, 0.3, 900], [0.3, 0.3, 0])
    >>> scene.visible(camera, fill=None).count(), scene.visible(camera).count()
    (array([0]), array([1]))
    """
    views = [cameras] if isinstance(cameras, Camera) else list(cameras)
    if fill is not None and not isinstance(fill, str):
        raise ValueError(f"fill must be 'rays', 'neighbours' or None, got {fill!r}")
    for name, value in (("rings", rings), ("supersampling", supersampling), ("points", points)):
        if not isinstance(value, (int, np.integer)) or not 1 <= value <= 64 * 1024:
            raise ValueError(f"{name} must be an integer of at least 1, got {value!r}")
    shape = (len(views), (len(scene) + 63) // 64)
    rows = np.zeros(shape, np.uint64) if out is None else out
    if rows.shape != shape or rows.dtype != np.uint64 or not rows.flags.c_contiguous or not rows.flags.writeable:
        raise ValueError(f"out must be a writeable, row-major {shape} uint64 array, got {rows.shape} {rows.dtype}")
    if known is not None:
        words = known.words if isinstance(known, Bitfields) else np.asarray(known)
        if words.shape != shape or words.dtype != np.uint64:
            raise ValueError(f"known must be {shape} uint64, got {words.shape} {words.dtype}")
        rows |= words
    if views:
        with reporter(progress, len(views), "views") as report:
            scene._mesh.visible(stack(views), rows, fill, engine, threads, report, rings, supersampling, points)
    return Bitfields(rows, len(scene))


def face_ids(faces: npt.ArrayLike, face_count: int) -> npt.NDArray[np.uint32]:
    """Numbers of faces, checked to be there."""
    array = np.asarray(faces)
    if array.ndim != 1 or (len(array) and array.dtype.kind not in "iu"):
        raise ValueError(f"faces must be (K,) integers, got {array.shape} {array.dtype}")
    # Checked before they are narrowed to 32 bits.
    for index in np.flatnonzero((array < 0) | (array >= face_count)):
        raise ValueError(f"faces[{index}] is {array[index]}, the scene has {face_count} faces")
    return np.ascontiguousarray(array, dtype=np.uint32)
