"""Close looks through the gaps that few eyes of a box looked through.

Faces that one eye of many saw are seen through some gap, and most faces that no eye saw lie behind the same ones: of
those that many more eyes find, four of five are within a degree of a face that one to four eyes saw, as seen from the
box. So images of some degrees are taken around those *rare* faces, each in a tenth of the time of an eye that looks all
around: half of them from near an eye that saw the face, at various distances from it, half from anywhere in the box, as
other faces behind the gap may be seen from another side. A face that is found so is looked at in the same way, from
where it was found.

This also tells which rare faces would have been found without the eyes that saw them: those that a look shows which
some other eye's sighting led to. The others measure what is still missed, see `cyclorama.region`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import bitfield
from .camera import Camera
from .render import Fill
from .scene import Scene
from .witnesses import toward

__all__ = ["Findings", "look_closely"]

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Looks at a face for each eye that saw it, at most: half of them from near it.
_LOOKS = 12

#: How far a look near an eye is from it, at least and at most, in sides of the box; the logarithms are spread evenly.
_NEAR = (0.02, 0.5)

#: Degrees that a look shows around a face, and from its middle to its border at most.
_MARGIN, _WIDEST = 3.0, 40.0

#: How many finds in a row lead on from one to the next.
_GENERATIONS = 6

#: Faces looked at in one call to the kernel.
_STEP = 16


@dataclass(frozen=True)
class Findings:
    """What close looks found.

    Parameters
    ----------
    eyes : (N, 3) ndarray of float64
        Where those looks were taken from that showed faces never seen before.
    faces : (N,) list of ndarray of int64
        These faces.
    again : (R,) ndarray of bool
        Which of the rare faces were shown by a look that the sighting of one led to by an eye that does not see it.
    """

    eyes: Floats
    faces: list[npt.NDArray[np.int64]]
    again: Flags


def look_closely(
    scene: Scene,
    box: Floats,
    rare: npt.NDArray[np.int64],
    eyes: Floats,
    sightings: Flags,
    seen: Flags,
    elsewhere: Callable[[int], Floats],
    *,
    most: int,
    resolution: int,
    fill: Fill,
    seed: int,
    threads: int | None,
) -> Findings:
    """Looks at rare faces and at what comes into view beside them.

    Parameters
    ----------
    scene : Scene
        F faces.
    box : (2, 3) ndarray of float64
        Opposite corners.
    rare : (R,) ndarray of int64
        Faces that few eyes saw.
    eyes : (N, 3) ndarray of float64
        From where was looked.
    sightings : (N, R) ndarray of bool
        Which eye saw which rare face.
    seen : (F,) ndarray of bool
        The faces known to be visible, rare ones among them.
    elsewhere : callable
        Gives so many places in the box.
    most : int
        About as many looks are taken, at most twice as many.
    resolution : int
        Pixels along each side of a look's image.
    fill, threads
        As for `Scene.visible`.
    seed : int
        For the places of looks.

    Returns
    -------
    Findings
    """
    rng = np.random.default_rng([seed, 1])
    common, seen = seen.copy(), seen.copy()
    common[rare] = False
    column = {int(face): index for index, face in enumerate(rare)}
    # Those first that the fewest eyes saw: a face, from where it was seen, the eye that led there, and over how many.
    order = np.argsort(sightings.sum(axis=0), kind="stable")
    queue = deque((int(rare[k]), eyes[root], int(root), 0) for k in order for root in np.flatnonzero(sightings[:, k]))
    each = int(np.clip(most // max(len(queue), 1), 2, _LOOKS))
    places, faces, again = [np.empty((0, 3))], [], np.zeros(len(rare), bool)
    spent = 0
    while queue and spent < 2 * most:
        step = [queue.popleft() for _ in range(min(_STEP, len(queue)))]
        looks = [
            (place, face, root, generation)
            for face, eye, root, generation in step
            for place in (*_beside(eye, box, each - each // 2, rng), *elsewhere(each // 2))
        ]
        cameras = [_close_up(place, scene.vertices[scene.faces[face]], resolution) for place, face, _, _ in looks]
        known = np.repeat(bitfield.pack(common[None]), len(cameras), axis=0)
        rows = scene.visible(cameras, fill, known=known, threads=threads, progress=False).words & ~known
        spent += len(looks)
        for index in np.flatnonzero(rows.any(axis=1)):
            place, _, root, generation = looks[index]
            shown = np.flatnonzero(bitfield.unpack(rows[index : index + 1], len(scene))[0])
            for face in shown[seen[shown]]:
                k = column.get(int(face))
                again[k] |= k is not None and not sightings[root, k]
            new = shown[~seen[shown]]
            if len(new):
                seen[new] = True
                places.append(place[None])
                faces.append(new)
                if generation + 1 < _GENERATIONS:
                    queue.extend((int(face), place, root, generation + 1) for face in new)
    return Findings(np.concatenate(places), faces, again)


def _beside(eye: Floats, box: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Places near an eye: on the sides of the box that it is on."""
    size = box[1] - box[0]
    share = (eye - box[0]) / np.maximum(size, 1e-300)
    near, far = _NEAR
    reach = near * (far / near) ** rng.random((count, 1))
    shares = np.clip(share + (2 * rng.random((count, 3)) - 1) * reach, 0, 1)
    return np.where((eye == box[0]) | (eye == box[1]), eye, box[0] + shares * size)


def _close_up(eye: Floats, triangle: npt.NDArray[np.floating], size: int) -> Camera:
    """A camera that shows a triangle and what is around it."""
    away = triangle - eye
    away = away / np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None]
    turn = toward(eye, triangle)
    angle = np.arccos(np.clip((away @ turn[2]).min(), -1, 1)) + np.radians(_MARGIN)
    half = size / 2
    focal = half / np.tan(min(angle, np.radians(_WIDEST)))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ eye
    return Camera([[focal, 0, half], [0, focal, half], [0, 0, 1]], pose, size, size)
