"""What eyes see past the portals of a building, through openings that nobody told of or found.

Cells and portals say what can be seen only if they are all the openings there are. In a real mesh they seldom are:
walls have gaps, and a search in cubes closes those that are narrower than two of them. So it is looked: from eyes in
all cells and outdoors, at what owns a pixel of an image around them, and what of it the portals don't show is drawn
with the eye's cell from then on, together with the faces around it. Other cells see it through their portals, as what
is drawn with a cell is seen as far as the view into the cell goes.

Where something was seen, more is seen nearby: each such eye is followed by others beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .. import bitfield
from ..progress import Report
from ..region import cube_around

if TYPE_CHECKING:
    from .building import Building

__all__ = ["Leaks", "look"]

Floats = npt.NDArray[np.float64]

#: Most of a scene's faces that lie side by side and are drawn together if one of them is seen. In a castle one of 3,000
#: further eyes saw what 4,000 had not; with half as many, 6.
_TOGETHER = 1 / 20

#: Pixels along each side of the six images around an eye.
_RESOLUTION = 96

#: Eyes looked from in one call to the kernel.
_STEP = 16

#: Eyes that follow beside one that saw something, and how far away, as a share of the cell's size.
_FOLLOWING, _BESIDE = 8, 0.05

#: Places tried for an eye in a cell before it is given up.
_TRIES = 1000

#: Share of the scene's size around it in which eyes outdoors are.
_OUTDOORS = 0.1

#: The planes of a view in all directions: none.
_EVERYWHERE = np.empty((0, 4))


@dataclass(frozen=True, eq=False)
class Leaks:
    """What was seen past the portals.

    Attributes
    ----------
    faces : list of (K,) ndarray of uint32
        The faces to draw with each cell, and outdoors last.
    eyes : (N, 3) ndarray of float64
        From where it was looked.
    lost : (N,) ndarray of bool
        Whether an eye saw what neither the portals nor those before it had shown.
    """

    faces: list[npt.NDArray[np.uint32]]
    eyes: Floats
    lost: npt.NDArray[np.bool_]

    def __repr__(self) -> str:
        quiet = len(self.lost) - 1 - int(np.flatnonzero(self.lost).max(initial=-1))
        seen = f"{int(self.lost.sum()):,} of {len(self.eyes):,} eyes saw past portals"
        return f"<Leaks: {seen}, the last {quiet:,} nothing new>"


def look(building: Building, count: int, seed: int, threads: int | None, report: Report) -> Leaks:
    """Looks from so many eyes."""
    scene = building.scene
    together = _together(np.asarray(scene.vertices, np.float64)[scene.faces].mean(axis=1))
    # Those that let light through are in every answer: where they are seen, the portals say.
    opaque = np.ones(len(scene), bool) if scene.transparent is None else ~scene.transparent
    extra = np.zeros((len(building.faces), len(scene)), bool)
    places = _Eyes(building, seed)
    eyes, lost = np.empty((0, 3)), np.zeros(0, bool)
    while len(eyes) < count:
        step = np.array([places.next() for _ in range(min(_STEP, count - len(eyes)))])
        cameras = [camera for eye in step for camera in cube_around(eye, _RESOLUTION)]
        seen = scene.visible(cameras, None, threads=threads, progress=False)
        words = np.bitwise_or.reduce(seen.words.reshape(len(step), 6, -1), axis=1)
        for eye, flags in zip(step, bitfield.unpack(words, len(scene)), strict=True):
            held, crossed = building.places(eye)
            shown = building.kernel.walk(eye.tolist(), _EVERYWHERE, held, crossed)[0]
            flags[shown] = False
            flags &= opaque & ~extra[held].any(axis=0)
            lost = np.append(lost, flags.any())
            if lost[-1]:
                extra[held[0]] |= np.isin(together, together[flags])
                places.follow(eye, held[0])
        eyes = np.concatenate([eyes, step])
        report(len(eyes))
    faces = [
        np.union1d(known, np.flatnonzero(more)).astype(np.uint32)
        for known, more in zip(building.faces, extra, strict=True)
    ]
    return Leaks(faces, eyes, lost)


class _Eyes:
    """Where is looked from: in each cell and outdoors by turns, every other time anywhere, and beside what saw more."""

    def __init__(self, building: Building, seed: int) -> None:
        self._building = building
        self._rng = np.random.default_rng(seed)
        low, high = building.scene.bounds
        spare = _OUTDOORS * (high - low).max()
        self._bounds = np.stack([low - spare, high + spare])
        self._boxes = [np.stack([cell.low, cell.high]) for cell in building.cells] + [self._bounds]
        self._following: list[Floats] = []
        self._turn = 0

    def next(self) -> Floats:
        """The next one."""
        while self._following:
            eye = self._following.pop()
            if self._building.is_open(eye):
                return eye
        while True:
            self._turn += 1
            place, anywhere = divmod(self._turn, 2)
            place %= len(self._boxes)
            box = self._bounds if anywhere else self._boxes[place]
            for _ in range(_TRIES):
                eye = np.asarray(self._rng.uniform(*box))
                if self._building.is_open(eye) and (anywhere or place in self._building.places(eye)[0]):
                    return eye

    def follow(self, eye: Floats, place: int) -> None:
        """More eyes beside one that is in a place."""
        reach = _BESIDE * np.ptp(self._boxes[place], axis=0).max()
        self._following.extend(eye + self._rng.uniform(-reach, reach, (_FOLLOWING, 3)))


def _together(middles: Floats) -> npt.NDArray[np.int64]:
    """A number for each face: those that lie side by side have the same."""
    most = max(1.0, _TOGETHER * len(middles))
    numbers = np.zeros(len(middles), np.int64)
    groups, count = [np.arange(len(middles))], 0
    while groups:
        group = groups.pop()
        if len(group) <= most:
            numbers[group] = count
            count += 1
            continue
        axis = np.ptp(middles[group], axis=0).argmax()
        order = group[np.argsort(middles[group, axis], kind="stable")]
        groups += [order[: len(order) // 2], order[len(order) // 2 :]]
    return numbers
