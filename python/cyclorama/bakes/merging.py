"""Bakes of the same scene, joined: each row is the union of theirs."""

from __future__ import annotations

from functools import reduce

import numpy as np

from ..bitfield import Bitfields
from .visibility import Shell, Visibility

__all__ = ["merge"]


def merge(*bakes: Visibility) -> Visibility:
    """Joins bakes of one scene over one view sphere, such as several machines made with other seeds or other parts.

    Parameters
    ----------
    *bakes : Visibility
        Of the same mesh, sphere, distances, patches and `join`.

    Returns
    -------
    Visibility
        Answers what any of them answers, so that it misses no more than the best of them. Statements stay true and are
        kept.

    Raises
    ------
    ValueError
        If there is none, or one differs from the first; the message says in what.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(faces=320)
    >>> first, second = (cyc.bake(scene, 6, resolution=(64, 64), seed=s, progress=False) for s in (0, 1))
    >>> merged = merge(first, second)
    >>> bool(merged.probes.sum() == first.probes.sum() + second.probes.sum())
    True
    """
    if not bakes:
        raise ValueError("merge needs at least one bake")
    for index, bake in enumerate(bakes):
        if not isinstance(bake, Visibility):
            raise ValueError(f"bakes[{index}] must be a Visibility, got {type(bake).__name__}")
    first = bakes[0]
    for index, other in enumerate(bakes[1:], start=1):
        _check_alike(first, other, index)
    shells = []
    for k, shell in enumerate(first.shells):
        others = [bake.shells[k] for bake in bakes]
        cells = [other.cells for other in others if other.cells is not None]
        shells.append(Shell(shell.distance, _union([o.bitfields for o in others]), _union(cells) if cells else None))
    longest = max(len(bake.found) for bake in bakes)
    padded = [np.vstack([bake.found, np.zeros((longest - len(bake.found), 2))]) for bake in bakes]
    faces = np.sum([p[:, 1] for p in padded], axis=0)
    missed = np.sum([p[:, 0] * p[:, 1] for p in padded], axis=0)
    return Visibility(
        first.sphere,
        shells,
        model_radius=first.model_radius,
        size=first.size,
        labels=first.labels,
        settings=first.settings,
        mesh=first.mesh,
        probes=np.sum([bake.probes for bake in bakes], axis=0),
        found=np.column_stack([missed / np.maximum(faces, 1), faces]),
        statement="; ".join(dict.fromkeys(bake.statement for bake in bakes if bake.statement)),
    )


def _union(rows: list[Bitfields]) -> Bitfields:
    return Bitfields(reduce(np.bitwise_or, [r.words for r in rows]), rows[0].size)


def _check_alike(first: Visibility, other: Visibility, index: int) -> None:
    def refuse(what: str) -> None:
        raise ValueError(f"bakes[{index}] differs from bakes[0]: {what}")

    if other.mesh != first.mesh:
        refuse("it is of another mesh")
    a, b = first.sphere, other.sphere
    if not (np.array_equal(a.points, b.points) and np.array_equal(a.faces, b.faces)):
        refuse(f"its sphere has other viewpoints ({len(b.points)}, {len(a.points)})")
    if a.radius != b.radius or not np.array_equal(a.center, b.center):
        refuse(f"its sphere has another centre or radius ({b.radius:.6g}, {a.radius:.6g})")
    if other.distances != first.distances:
        refuse(f"its distances are {other.distances}, not {first.distances}")
    if (other.settings.join, other.settings.join_count) != (first.settings.join, first.settings.join_count):
        refuse(f"it joins {other.settings.join!r} ({other.settings.join_count}), not {first.settings.join!r}")
    same_labels = (
        other.labels is first.labels is None
        if other.labels is None or first.labels is None
        else np.array_equal(other.labels, first.labels)
    )
    if not same_labels:
        refuse("its patches are others")
