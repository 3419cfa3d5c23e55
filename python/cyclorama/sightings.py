"""The question the other way round: which views see a face, with how many pixels, and where to look next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from . import bitfield
from .arguments import checked_whole
from .bitfield import Bitfields
from .camera import Camera
from .progress import Progress, reporter
from .render import BACKGROUND, View
from .scene import Scene

__all__ = ["NextView", "Sightings", "next_best", "sightings"]

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sightings:
    """How many pixels of each view show each face; only those that show any.

    Attributes
    ----------
    starts : (V + 1,) ndarray of int64
        Entries `starts[v]` to `starts[v + 1]` - 1 are of view v.
    faces, pixels : (N,) ndarray of int64
        Of each entry: a face and its pixels; the faces of a view ascend.
    face_count : int
        Faces of the scene, F.
    """

    starts: Ints
    faces: Ints
    pixels: Ints
    face_count: int

    def __len__(self) -> int:
        """Number of views."""
        return len(self.starts) - 1

    def __repr__(self) -> str:
        seen = np.count_nonzero(self.views)
        return f"<Sightings: {len(self):,} views show {seen:,} of {self.face_count:,} faces>"

    @cached_property
    def views(self) -> Ints:
        """(F,) in how many views each face has a pixel."""
        return np.bincount(self.faces, minlength=self.face_count)

    @cached_property
    def best(self) -> Ints:
        """(F,) the view in which each face has most pixels, the first of equals; -1 where it has none in any."""
        best = np.full(self.face_count, -1, dtype=np.int64)
        order, starts = self._by_face
        some = np.flatnonzero(self.views)
        best[some] = self._view[order[starts[some]]]
        return best

    @cached_property
    def best_pixels(self) -> Ints:
        """(F,) the most pixels that each face has in one view."""
        most = np.zeros(self.face_count, dtype=np.int64)
        np.maximum.at(most, self.faces, self.pixels)
        return most

    def of_view(self, view: int) -> tuple[Ints, Ints]:
        """Faces that a view shows, ascending, and the pixels of each.

        Raises
        ------
        IndexError
            If there is no such view.
        """
        if not 0 <= view < len(self):
            raise IndexError(f"view {view} is not one of the {len(self)}")
        part = slice(self.starts[view], self.starts[view + 1])
        return self.faces[part], self.pixels[part]

    def of_face(self, face: int) -> tuple[Ints, Ints]:
        """Views that show a face, the one with most pixels first, and its pixels in each.

        Raises
        ------
        IndexError
            If there is no such face.
        """
        if not 0 <= face < self.face_count:
            raise IndexError(f"face {face} is not one of the {self.face_count}")
        order, starts = self._by_face
        part = order[starts[face] : starts[face + 1]]
        return self._view[part], self.pixels[part]

    @cached_property
    def _view(self) -> Ints:
        return np.repeat(np.arange(len(self)), np.diff(self.starts))

    @cached_property
    def _by_face(self) -> tuple[Ints, Ints]:
        """Entries sorted by face, then by falling pixels, and where each face begins."""
        order = np.lexsort((self._view, -self.pixels, self.faces))
        return order, np.concatenate([[0], np.cumsum(self.views)])


@dataclass(frozen=True)
class NextView:
    """A view that adds to what is seen.

    Attributes
    ----------
    view : int
        Index among the candidates.
    faces : (K,) ndarray of uint32
        Faces that it is the first to see.
    gain : float
        Their weight.
    left : float
        Weight of the faces that no view seen or chosen so far shows, though some candidate does.
    """

    view: int
    faces: npt.NDArray[np.uint32]
    gain: float
    left: float

    def __repr__(self) -> str:
        return f"<NextView: candidate {self.view}, the first to see {len(self.faces):,} faces, {self.left:.4g} left>"


def sightings(
    scene: Scene, cameras: Camera | Sequence[Camera], *, threads: int | None = None, progress: Progress = None
) -> Sightings:
    """Counts the pixels of each face in each view.

    Parameters
    ----------
    scene : Scene
        F faces.
    cameras : Camera or sequence of V Camera
    threads : int, optional
        All cores by default.
    progress : bool, callable or None
        See `cyclorama.progress`; units are views.

    Returns
    -------
    Sightings
        A face that lies between the pixels of a view has none there, though it may be visible: `Scene.visible` finds
        those.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> ball = cyc.scenes.sphere(faces=80)
    >>> around = [cyc.Camera.look_at(eye, ball.center) for eye in ([0, 0, 4], [0, 0, -4])]
    >>> found = sightings(ball, around, progress=False)
    >>> found.of_face(int(found.of_view(1)[0][0]))[0]
    array([1])
    """
    counted: list[tuple[Ints, Ints]] = []
    view: View | None = None
    views = [cameras] if isinstance(cameras, Camera) else list(cameras)
    with reporter(progress, len(views), "views") as report:
        for camera in views:
            fits = view is not None and view.ids.shape == (camera.height, camera.width)
            view = scene.render(camera, out=view if fits else None, threads=threads)
            counts = np.bincount(view.ids[view.ids != BACKGROUND], minlength=len(scene))
            faces = np.flatnonzero(counts)
            counted.append((faces, counts[faces]))
            report(len(counted))
    starts = np.cumsum([0] + [len(faces) for faces, _ in counted])
    none = np.empty(0, dtype=np.int64)
    faces, pixels = (np.concatenate([none, *(part[k] for part in counted)]) for k in (0, 1))
    return Sightings(starts, faces, pixels, len(scene))


def next_best(
    scene: Scene,
    candidates: Sequence[Camera] | Bitfields,
    seen: npt.ArrayLike = (),
    *,
    count: int = 1,
    weight: Literal["area", "faces"] | npt.ArrayLike = "area",
    threads: int | None = None,
    progress: Progress = None,
) -> list[NextView]:
    """Which of some views to take next, if what is seen already is known.

    Each view is the one that adds most to those before it: for any number of them, together they add at least 63 % of
    what the best choice of as many would (Nemhauser, Wolsey and Fisher, Mathematical Programming 14, 1978).

    Parameters
    ----------
    scene : Scene
        F faces.
    candidates : sequence of Camera, or Bitfields
        Views that could be taken, or what they see (`Scene.visible`).
    seen : (K,) array_like of int or (F,) array_like of bool
        Faces that are seen already.
    count : int
        Most views to choose.
    weight : {"area", "faces"} or (F,) array_like of float
        What a face is worth: its area, one, or a number each.
    threads, progress
        See `Scene.visible`.

    Returns
    -------
    list of NextView
        In the order in which to take them; ends early when no candidate adds anything.

    Raises
    ------
    ValueError
        If a face is none of the scene, a weight is negative or not finite, or sizes do not fit.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> ball = cyc.scenes.sphere(faces=80)
    >>> around = [cyc.Camera.look_at(eye, ball.center) for eye in ([0, 0, 4], [0.1, 0, 4], [0, 0, -4])]
    >>> [view.view for view in next_best(ball, around, count=2, progress=False)]
    [0, 2]
    """
    checked_whole("count", count, 1)
    worth = _worth(scene, weight)
    if not isinstance(candidates, Bitfields):
        candidates = scene.visible(candidates, threads=threads, progress=progress)
    if candidates.size != len(scene):
        raise ValueError(f"candidates are rows of {candidates.size} faces, the scene has {len(scene)}")
    rows = [candidates.ids(row) for row in range(len(candidates))]
    open_faces = ~_mask(seen, len(scene)) & bitfield.unpack(candidates.union()[None], len(scene))[0]
    chosen: list[NextView] = []
    while rows and len(chosen) < count:
        gains = np.array([worth[row[open_faces[row]]].sum() for row in rows])
        best = int(gains.argmax())
        if gains[best] <= 0:
            break
        new = rows[best][open_faces[rows[best]]]
        open_faces[new] = False
        chosen.append(NextView(best, new, float(gains[best]), float(worth[open_faces].sum())))
    return chosen


def _worth(scene: Scene, weight: str | npt.ArrayLike) -> Floats:
    if isinstance(weight, str):
        if weight == "faces":
            return np.ones(len(scene))
        if weight != "area":
            raise ValueError(f"weight must be 'area', 'faces' or a number a face, got {weight!r}")
        a, b, c = (scene.vertices[scene.faces[:, k]].astype(np.float64) for k in range(3))
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
    worth = np.asarray(weight, dtype=np.float64)
    if worth.shape != (len(scene),):
        raise ValueError(f"weight must have shape ({len(scene)},), got {worth.shape}")
    bad = np.flatnonzero(~(np.isfinite(worth) & (worth >= 0)))
    if len(bad):
        raise ValueError(f"weight[{bad[0]}] is {worth[bad[0]]}: weights are finite and not negative")
    return worth


def _mask(seen: npt.ArrayLike, face_count: int) -> npt.NDArray[np.bool_]:
    array = np.asarray(seen)
    if array.dtype == np.bool_:
        if array.shape != (face_count,):
            raise ValueError(f"seen must be ({face_count},) bool, got {array.shape}")
        return array.copy()
    mask = np.zeros(face_count, dtype=bool)
    if array.size:
        bad = np.flatnonzero((array < 0) | (array >= face_count))
        if len(bad):
            raise ValueError(f"seen[{bad[0]}] is {array[bad[0]]}, the scene has {face_count} faces")
        mask[array.astype(np.int64)] = True
    return mask
