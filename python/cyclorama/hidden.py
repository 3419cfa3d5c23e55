"""Faces that nobody ever sees, and mesh files without them.

Random views from outside a scene, or from eyes in a box, are each asked first which of their pixels would be lost if
all faces that no earlier view saw were taken away; then their faces are kept, too. So what the views said is an honest
sample of the error, and it ends when the mean share of lost pixels is proved to be below what is allowed: with 95 %
confidence, whatever the distribution (`cyclorama.bakes.confidence`). That takes no fewer than about ``3 / max_missed``
views. A face that can only be seen from where no view was taken, or through a keyhole, is lost; the share says how
much of a picture such faces are.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import bitfield, loading, parts
from .arguments import checked_number, checked_pair, checked_whole
from .bakes.confidence import upper_mean
from .bakes.evaluation import random_directions
from .bakes.learning import probe
from .camera import Camera, stack
from .files import check_writable, whole_file
from .framing import Framing
from .lab import Row
from .progress import Progress, reporter
from .region import check_box
from .scene import Scene

__all__ = ["Hidden", "Stripped", "never_seen", "strip_hidden"]

#: Views that are asked before what they saw is kept, and from which nothing is asked at the beginning.
ROUND, BEGIN = 256, 66

#: So many views are looked at for faces below a pixel, too, at some five times the time; later ones for pixels only.
CLOSE = 512

#: Eyes outside stand so many sampling radii from the centre, each as often as the others: nearer ones see into what
#: farther ones don't, and the other way round.
DISTANCES = (1.0, 2.0, 4.0)


@dataclass(frozen=True, eq=False)
class Hidden:
    """Which faces no view saw.

    Attributes
    ----------
    seen : (F,) ndarray of bool
        Faces that some view saw, and the transparent ones.
    views : int
        Views that were taken.
    missed : float
        Mean share of the pixels of a view that would have shown a face which no view before it saw.
    bound : float
        Upper bound of that mean for a new view, with 95 % confidence.
    """

    seen: npt.NDArray[np.bool_]
    views: int
    missed: float
    bound: float

    @property
    def faces(self) -> npt.NDArray[np.uint32]:
        """(K,) faces that no view saw, ascending."""
        return np.flatnonzero(~self.seen).astype(np.uint32)

    def __repr__(self) -> str:
        return (
            f"<Hidden: {len(self.faces):,} of {len(self.seen):,} faces, never seen by {self.views:,} views; without "
            f"them a view loses at most {self.bound:.1e} of its pixels on average>"
        )


@dataclass(frozen=True, eq=False)
class Stripped:
    """What `strip_hidden` wrote, and what it left out.

    Attributes
    ----------
    hidden : Hidden
        Faces of the file, in the order of `load`.
    kept : int
        Faces of the new file. A mesh that several nodes show keeps what is seen of any of them.
    parts : list of dict
        A row for each node: `part` (its path), `faces`, `seen` and `kept`.
    """

    hidden: Hidden
    kept: int
    parts: list[Row]

    def __repr__(self) -> str:
        return f"<Stripped: {self.kept:,} of {sum(row['faces'] for row in self.parts):,} faces kept; {self.hidden!r}>"


def never_seen(
    scene: Scene,
    *,
    inside: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    max_missed: float = 1e-3,
    max_views: int | None = None,
    resolution: tuple[int, int] = (510, 480),
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = None,
) -> Hidden:
    """The faces that can't be seen from outside a scene, or from anywhere in a box.

    Parameters
    ----------
    scene : Scene
    inside : pair of (3,) array_like of float, optional
        Lowest and highest corner of the box in which eyes may be, in the scene's units: they look in all directions. By
        default eyes stand around the scene, at 1, 2 and 4 sampling radii, and look at its centre.
    max_missed : float
        Mean share of a view's pixels that may be lost, in (0, 1); it takes at least about three views for each time
        that 1 holds it.
    max_views : int, optional
        Most views. By default four times what `max_missed` takes at the least, and 66 to begin with.
    resolution : (int, int)
        Width and height of the views in pixels.
    seed : int
        Of the views.
    threads : int, optional
        All cores by default. The answer does not depend on it.
    progress : bool, callable or None
        See `cyclorama.progress`; units are views.

    Returns
    -------
    Hidden
        Its `bound` is above `max_missed` if `max_views` were not enough.

    Raises
    ------
    ValueError
        If `max_missed` is not in (0, 1), `max_views` is no number of views, `seed` none, or the box none.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> ball = cyc.scenes.sphere(faces=320)
    >>> never_seen(ball, max_missed=0.05, progress=False).faces
    array([], dtype=uint32)
    """
    if not 0 < checked_number("max_missed", max_missed, 1) < 1:
        raise ValueError(f"max_missed must be a share between 0 and 1, got {max_missed}")
    most = BEGIN + int(np.ceil(4 * 3.2 / max_missed)) if max_views is None else checked_whole("max_views", max_views, 1)
    checked_whole("seed", seed, 0)
    views: _Outside | _Inside
    if inside is None:
        views = _Outside(Framing.of(scene, resolution), seed)
    elif len(inside) == 2:
        views = _Inside(*inside, checked_pair("resolution", resolution), seed)
    else:
        raise ValueError(f"inside must be two corners, the lowest and the highest, got {inside!r}")
    row = np.zeros((1, bitfield.width(len(scene))), dtype=np.uint64)
    scores: list[float] = []
    taken, bound = 0, 1.0
    with reporter(progress, most, "views") as report:
        while taken < most and bound > max_missed:
            count = min(ROUND if taken else BEGIN, most - taken)
            cameras = views.take(count)
            known = row.repeat(count, axis=0)
            if taken:
                shown, missed = probe(scene, stack(cameras), row, np.zeros(count, dtype=np.int64), threads=threads)
                scores += missed.tolist()
                known |= shown
                row |= np.bitwise_or.reduce(shown, axis=0)
            if taken < CLOSE:
                row |= scene.visible(cameras, known=known, threads=threads, progress=False).union()
            taken += count
            bound = upper_mean(scores)
            report(taken)
        report(most)
    seen = bitfield.unpack(row, len(scene))[0]
    return Hidden(seen, taken, float(np.mean(scores)) if scores else 1.0, bound)


def strip_hidden(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    inside: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    max_missed: float = 1e-3,
    max_views: int | None = None,
    resolution: tuple[int, int] = (510, 480),
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = None,
) -> Stripped:
    """Writes a mesh file without the faces that are never seen.

    Nodes keep their places, names and materials, also those of which nothing is left, and a mesh that several nodes
    show is still one. What trimesh doesn't read (animations, cameras, extensions) is not in the new file.

    Parameters
    ----------
    source : path
        A file that `load` reads.
    out : path
        What to write, in any format that trimesh writes with the same nodes: GLB for those that have several.
    inside, max_missed, max_views, resolution, seed, threads, progress
        See `never_seen`.

    Returns
    -------
    Stripped

    Raises
    ------
    ValueError
        If the file can't be read, nothing in it is ever seen, or trimesh doesn't write such files, or writes several.
    OSError
        If `out` can't be written.

    Examples
    --------
    >>> import tempfile, trimesh
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     balls = [trimesh.creation.icosphere(radius=radius) for radius in (1.0, 0.5)]
    ...     _ = trimesh.Scene(balls).export(f"{folder}/nested.glb")
    ...     strip_hidden(f"{folder}/nested.glb", f"{folder}/shell.glb", max_missed=0.05, progress=False).kept
    1280
    """
    source, out = Path(source), Path(out)
    if out.exists() and out.samefile(source):
        raise ValueError(f"{out} is the file that is read; give the new one another name")
    check_writable(out)
    _check_format(out)
    scene = loading.load(source)
    found = never_seen(
        scene,
        inside=inside,
        max_missed=max_missed,
        max_views=max_views,
        resolution=resolution,
        seed=seed,
        threads=threads,
        progress=progress,
    )
    if not found.seen.any():
        raise ValueError(f"{source}: no view saw any of its faces; nothing would be left")
    mesh = loading.read_file(source)
    keep = _shown(mesh, scene, found.seen)
    seen = parts.count(scene.parts, np.flatnonzero(found.seen))
    kept = parts.count(scene.parts, np.flatnonzero(keep))
    _drop(mesh, scene, keep)
    written = mesh.export(file_type=out.suffix[1:].lower())
    with whole_file(out) as file:
        file.write(written.encode() if isinstance(written, str) else written)
    rows: list[Row] = [
        {"part": part.path, "faces": len(part), "seen": int(s), "kept": int(k)}
        for part, s, k in zip(scene.parts, seen, kept, strict=True)
    ]
    return Stripped(found, int(keep.sum()), rows)


def _check_format(out: Path) -> None:
    """Refuses, before any work, what one file can't be of."""
    try:
        trimesh: Any = import_module("trimesh")
    except ImportError as error:
        raise ImportError("writing meshes needs trimesh: pip install 'cyclorama[mesh]'") from error
    try:
        written = trimesh.Scene(trimesh.creation.box()).export(file_type=out.suffix[1:].lower())
    except ImportError as error:
        raise ImportError(
            f"{out}: trimesh needs {error.name} to write {out.suffix}: pip install {error.name}"
        ) from error
    except (ValueError, KeyError) as error:
        raise ValueError(f"{out}: trimesh does not write {out.suffix or 'files without an ending'}: {error}") from error
    if not isinstance(written, str | bytes):
        raise ValueError(f"{out}: {out.suffix} is several files; .glb has the same in one")


class _Outside:
    """Cameras around a scene."""

    def __init__(self, framing: Framing, seed: int) -> None:
        self.framing, self.seed, self.taken = framing, seed, 0

    def take(self, count: int) -> list[Camera]:
        directions = random_directions(count, [self.seed, self.taken])
        distance = (self.taken + np.arange(count)) % len(DISTANCES)
        self.taken += count
        groups = [self.framing.cameras(directions[distance == k], DISTANCES[k]) for k in range(len(DISTANCES))]
        return [camera for group in groups for camera in group]


class _Inside:
    """Cameras with a field of view of 90 degrees in a box, turned anywhere."""

    def __init__(self, low: npt.ArrayLike, high: npt.ArrayLike, resolution: tuple[int, int], seed: int) -> None:
        self.box, self.resolution, self.seed, self.taken = check_box(low, high), resolution, seed, 0

    def take(self, count: int) -> list[Camera]:
        directions = random_directions(count, [self.seed, self.taken])
        eyes = self.box[0] + np.random.default_rng([self.seed, self.taken, 1]).random((count, 3)) * np.diff(
            self.box, axis=0
        )
        self.taken += count
        return [
            Camera.look_at(eye, eye + direction, (0, 1, 0), 90.0, *self.resolution)
            for eye, direction in zip(eyes, directions, strict=True)
        ]


def _shown(mesh: Any, scene: Scene, seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Faces that stay: what is seen of a mesh at any of the nodes that show it."""
    keep = seen.copy()
    for nodes in _meshes(mesh, scene).values():
        together = np.logical_or.reduce([seen[part.start : part.stop] for part in nodes])
        for part in nodes:
            keep[part.start : part.stop] = together
    return keep


def _drop(mesh: Any, scene: Scene, keep: npt.NDArray[np.bool_]) -> None:
    for name, nodes in _meshes(mesh, scene).items():
        geometry = mesh if name is None else mesh.geometry[name]
        stays = keep[nodes[0].start : nodes[0].stop]
        if stays.any() or name is None:
            geometry.update_faces(stays)
            geometry.remove_unreferenced_vertices()
        else:
            mesh.delete_geometry(name)


def _meshes(mesh: Any, scene: Scene) -> dict[str | None, list[parts.Part]]:
    """The parts that show each mesh of a file."""
    if not hasattr(mesh, "graph"):
        return {None: list(scene.parts)}
    shows: dict[str | None, list[parts.Part]] = {}
    nodes = [
        node for node in mesh.graph.nodes_geometry if len(getattr(mesh.geometry[mesh.graph[node][1]], "faces", ()))
    ]
    for node, part in zip(nodes, scene.parts, strict=True):
        shows.setdefault(mesh.graph[node][1], []).append(part)
    return shows
