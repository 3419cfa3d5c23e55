"""Parts of a scene: the nodes of the file that it came from, and what is known of each.

A file of an assembly names what it holds: a building's doors, an engine's bolts. `load` keeps for each node its name,
its place in the hierarchy and the range of its faces, so that any answer about faces is one about parts, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import bitfield
from .bitfield import Bitfields
from .lab import Row

__all__ = ["Part", "count", "seen", "table"]

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Part:
    """A node of a scene, with faces of its own.

    Parameters
    ----------
    name : str
        Of the node; of the file, where it has no nodes.
    path : str
        Names from the root down to this node, with slashes between them.
    start, stop : int
        Its faces are `start` to `stop` - 1 of the scene.

    Examples
    --------
    >>> len(Part("bolt", "engine/bolt", 10, 14))
    4
    """

    name: str
    path: str
    start: int
    stop: int

    def __len__(self) -> int:
        """Number of faces."""
        return self.stop - self.start


def check(parts: Sequence[Part] | None, face_count: int) -> tuple[Part, ...]:
    """Parts that follow each other and together are all faces; one nameless part if there are none.

    Raises
    ------
    ValueError
        If a part does not begin where the one before it ends, or they end before or after the last face.
    """
    if parts is None:
        return (Part("", "", 0, face_count),)
    end = 0
    for index, part in enumerate(parts):
        if part.start != end or part.stop < part.start:
            raise ValueError(f"parts[{index}] is faces {part.start} to {part.stop}; it must begin at face {end}")
        end = part.stop
    if end != face_count:
        raise ValueError(f"parts end at face {end}, the scene has {face_count}")
    return tuple(parts)


def count(parts: Sequence[Part], faces: npt.ArrayLike) -> Ints:
    """How many of some faces each part has.

    Parameters
    ----------
    parts : sequence of P Part
        As `Scene.parts`.
    faces : (K,) array_like of int
        Each face once, in any order: what a view or an eye sees, for example.

    Returns
    -------
    (P,) ndarray of int64

    Raises
    ------
    ValueError
        If a face is in none of the parts.

    Examples
    --------
    >>> count([Part("box", "box", 0, 12), Part("lid", "box/lid", 12, 14)], [3, 4, 13])
    array([2, 1])
    """
    ids = np.sort(np.asarray(faces, dtype=np.int64).ravel())
    last = parts[-1].stop if parts else 0
    if len(ids) and (ids[0] < 0 or ids[-1] >= last):
        raise ValueError(f"face {ids[0] if ids[0] < 0 else ids[-1]} is in none of the parts, which have {last} faces")
    ends = np.searchsorted(ids, [part.stop for part in parts])
    return np.diff(ends, prepend=0).astype(np.int64)


def seen(parts: Sequence[Part], faces: npt.ArrayLike) -> list[Part]:
    """The parts of which some of these faces are.

    Parameters
    ----------
    parts : sequence of Part
        As `Scene.parts`.
    faces : (K,) array_like of int
        Each face once.

    Returns
    -------
    list of Part
        In their order in the scene.

    Raises
    ------
    ValueError
        As for `count`.

    Examples
    --------
    >>> seen([Part("box", "box", 0, 12), Part("lid", "box/lid", 12, 14)], [13])
    [Part(name='lid', path='box/lid', start=12, stop=14)]
    """
    return [part for part, many in zip(parts, count(parts, faces), strict=True) if many]


def table(parts: Sequence[Part], views: Bitfields) -> list[Row]:
    """What some views see of each part: from how many, and from which one most.

    Parameters
    ----------
    parts : sequence of Part
        As `Scene.parts`.
    views : Bitfields
        A row of faces for each view: of `Scene.visible`, or `bitfields` of a bake without patches.

    Returns
    -------
    list of dict
        A row a part: `part` (its path), `faces`, `seen` (those that some view sees), `views` (how many see any of
        them), `best` (the view that sees most of them, None where none sees any) and `best_seen` (how many it sees).

    Raises
    ------
    ValueError
        If the rows have another number of faces.

    Examples
    --------
    >>> views = Bitfields.from_ids([[0, 1], [1]], 3)
    >>> rows = table([Part("box", "box", 0, 2), Part("nut", "box/nut", 2, 3)], views)
    >>> [(row["part"], row["seen"], row["views"], row["best"]) for row in rows]
    [('box', 2, 2, 0), ('box/nut', 0, 0, None)]
    """
    check(parts, views.size)
    ever = count(parts, bitfield.ids(views.union()))
    by_view = np.array([count(parts, views.ids(row)) for row in range(len(views))], dtype=np.int64)
    by_view = by_view.reshape(len(views), len(parts))
    rows: list[Row] = []
    for index, part in enumerate(parts):
        of_part = by_view[:, index]
        best = int(of_part.argmax()) if of_part.any() else None
        rows.append(
            {
                "part": part.path,
                "faces": len(part),
                "seen": int(ever[index]),
                "views": int(np.count_nonzero(of_part)),
                "best": best,
                "best_seen": 0 if best is None else int(of_part[best]),
            }
        )
    return rows
