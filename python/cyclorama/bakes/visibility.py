"""What of a scene can be seen from where: the answer side of a bake.

A `Visibility` holds, for each viewpoint of a sphere around the scene, which faces it sees (the 2001 paper's
ID-bitfields, or the 2002 paper's patch bitfields), and for each triangle between viewpoints which faces any eye in it
may see (its *cell*). An eye is answered by the cells that its rays cross:

* on the sampling sphere, by the cell that it lies in;
* farther out, by all cells that a ray from the eye to the scene passes through, at most ``asin(r / R) - asin(r / d)``
  from the eye's direction (r the scene's radius, R the sphere's, d the eye's distance). The 2002 paper (section 4.3)
  takes only the nearest cell, and loses what deep tubes show;
* between the sphere and the scene's bounding sphere, by the cells that the rays cross when followed backward: nothing
  is between the eye and there;
* inside the bounding sphere, by the whole model;
* between two baked distances, by the crossed cells of both.

All but the first and the fourth hold more than the eye sees, and nothing less than its cells do.
"""

from __future__ import annotations

import html
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import bitfield, sphere
from ..bitfield import Bitfields
from ..fingerprint import fingerprint
from ..framing import Framing, unit_directions
from ..scene import Scene
from .viewsphere import ViewSphere

__all__ = ["Settings", "Shell", "Visibility", "fold"]

Words = npt.NDArray[np.uint64]
Ids = npt.NDArray[np.uint32]
Floats = npt.NDArray[np.float64]

#: An eye this near a baked distance, relatively, is at it.
_SAME_DISTANCE = 1e-9


@dataclass(frozen=True)
class Settings:
    """How a bake was made; stored with it."""

    resolution: tuple[int, int]
    fov_y: float
    fill: str | None
    join: str
    join_count: int
    seed: int


@dataclass(frozen=True)
class Shell:
    """What is seen from one distance.

    Parameters
    ----------
    distance : float
        From the centre, in sampling radii; infinite for parallel rays.
    bitfields : Bitfields
        (N rows) what each viewpoint sees.
    cells : Bitfields or None
        (M rows) what eyes in each face of the sphere see; None where corner samples are joined instead.
    """

    distance: float
    bitfields: Bitfields
    cells: Bitfields | None


class Visibility:
    """What of a scene can be seen from any eye around it; made by `bake`, `merge` or `Visibility.load`.

    Parameters
    ----------
    sphere : ViewSphere
        Viewpoints (N of them) and the faces between them (M).
    shells : sequence of Shell
        By rising distance; the first is the sampling sphere itself unless other distances were asked for.
    model_radius : float
        Radius of the scene's bounding sphere around the sphere's centre, in the user's units.
    size : int
        Number of faces of the scene, F.
    labels : (F,) ndarray of uint32 or None
        Patch of each face; rows then have a bit per patch.
    settings : Settings
        How the rows were made.
    mesh : str
        The scene's fingerprint.
    probes : (M,) ndarray of int64
        Probes spent on each sphere face, over all shells.
    found : (P, 2) ndarray of float64
        Share of pixels that probe number k of the faces found missing, before it was learned, on average, and of how
        many faces.
    statement : str
        What is known of the error, and how surely; empty if nothing was tested.
    """

    def __init__(
        self,
        sphere: ViewSphere,
        shells: Sequence[Shell],
        *,
        model_radius: float,
        size: int,
        labels: Ids | None,
        settings: Settings,
        mesh: str,
        probes: npt.NDArray[np.int64],
        found: npt.NDArray[np.float64] | None = None,
        statement: str = "",
    ) -> None:
        self.sphere = sphere
        self.shells = tuple(shells)
        self.model_radius = float(model_radius)
        self.size = int(size)
        self.labels = labels
        self.settings = settings
        self.mesh = mesh
        self.probes = probes
        self.found = np.empty((0, 2)) if found is None else found
        self.statement = statement

    # What is stored ------------------------------------------------------------------------------------------------

    @property
    def bitfields(self) -> Bitfields:
        """(N rows) what each viewpoint of the first shell sees: a bit per face, or per patch if there are `labels`."""
        return self.shells[0].bitfields

    @property
    def cells(self) -> Bitfields | None:
        """(M rows) what eyes in each sphere face of the first shell see; None with ``join="samples"``."""
        return self.shells[0].cells

    @property
    def distances(self) -> tuple[float, ...]:
        """Baked distances from the centre, in sampling radii."""
        return tuple(shell.distance for shell in self.shells)

    @property
    def patches(self) -> int | None:
        """Number of patches, or None if the rows have a bit per face."""
        return None if self.labels is None else self.bitfields.size

    @property
    def nbytes(self) -> int:
        """Bytes of the rows in memory, with the labels."""
        rows = sum(s.bitfields.nbytes + (s.cells.nbytes if s.cells is not None else 0) for s in self.shells)
        return rows + (self.labels.nbytes if self.labels is not None else 0)

    @property
    def framing(self) -> Framing:
        """The cameras of the bake."""
        return Framing(self.sphere.center, self.model_radius, self.settings.resolution, self.settings.fov_y)

    def check(self, scene: Scene) -> None:
        """Makes sure that this was baked from `scene`.

        Raises
        ------
        ValueError
            If it was another mesh, or the same with moved vertices or faces in another order.
        """
        if len(scene) != self.size:
            raise ValueError(f"baked from a mesh of {self.size} faces, this scene has {len(scene)}")
        if fingerprint(scene) != self.mesh:
            raise ValueError("baked from another mesh: the fingerprints of vertices and faces differ")

    # Answers -------------------------------------------------------------------------------------------------------

    def crossed(self, eye: npt.ArrayLike) -> list[tuple[int, npt.NDArray[np.int64]]] | None:
        """Shells, and the sphere faces of each, that the rays from an eye to the scene cross.

        Parameters
        ----------
        eye : (3,) array_like of float
            In the user's units.

        Returns
        -------
        list of (int, (K,) ndarray of int64), or None
            Index of the shell and its faces, ascending; None for an eye inside the scene's bounding sphere.

        Raises
        ------
        ValueError
            If `eye` is not three finite numbers.
        """
        return self._crossed(*self.sphere.toward(eye))

    def row(self, eye: npt.ArrayLike) -> Words:
        """(W,) words: a bit for each face (or patch) that may be seen from `eye`; see `visible_faces`."""
        return self._row(self.crossed(eye))

    def visible_faces(self, eye: npt.ArrayLike, out: Ids | None = None) -> Ids:
        """Faces to draw for an eye anywhere.

        Parameters
        ----------
        eye : (3,) array_like of float
            In the user's units. Where it is decides what is joined; the module's text says how. Inside the scene's
            bounding sphere that is the whole model.
        out : (N,) ndarray of uint32, optional
            Room for the answer; N = F is always enough.

        Returns
        -------
        (K,) ndarray of uint32
            Ascending; the front of `out`, if given.

        Raises
        ------
        ValueError
            If `eye` is not three finite numbers, or `out` is too small.
        """
        return self._faces(self.row(eye), out)

    def visible_along(self, direction: npt.ArrayLike, out: Ids | None = None) -> Ids:
        """Faces to draw for a camera of parallel rays.

        Parameters
        ----------
        direction : (3,) array_like of float
            From the scene toward the camera, of any length but zero.
        out : (N,) ndarray of uint32, optional
            As for `visible_faces`.

        Returns
        -------
        (K,) ndarray of uint32
            Ascending: what the cells that the rays cross hold together.

        Raises
        ------
        ValueError
            If the direction is zero or not finite, or `out` is too small.
        """
        unit = unit_directions(np.asarray(direction, dtype=np.float64)[None])[0]
        return self._faces(self._row(self._crossed(unit, math.inf)), out)

    def visible_patches(self, eye: npt.ArrayLike) -> Ids:
        """(K,) patches to draw for an eye anywhere, ascending; see `visible_faces`.

        Raises
        ------
        ValueError
            If the bake has no patches, or `eye` is not three finite numbers.
        """
        if self.labels is None:
            raise ValueError("this bake has a bit per face and no patches: bake with patches=")
        return bitfield.ids(self.row(eye))

    def samples(self, eye: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """(3,) or (6,) viewpoints that surround the direction of an eye: rows of `bitfields` (2001, section 3.2.1).

        Raises
        ------
        ValueError
            If `eye` is not three finite numbers, or is the centre itself, which has no direction.
        """
        direction, distance = self.sphere.toward(eye)
        if distance == 0:
            raise ValueError("eye is the centre of the scene: no direction, and no samples around it")
        face = int(self.sphere.locate(direction)[0])
        return np.asarray(sphere.surrounding(self.sphere.faces, face, count=self.settings.join_count), dtype=np.int64)

    # Figures -------------------------------------------------------------------------------------------------------

    def culling_rate(self, weight: str = "solid_angle") -> float:
        """Share of the scene's faces that need not be drawn, averaged over the first shell.

        Parameters
        ----------
        weight : {"solid_angle", "faces"}
            Average over directions (2002, section 4.1), or over the faces of the sphere (2001, section 4).

        Returns
        -------
        float
            In [0, 1].

        Raises
        ------
        ValueError
            If `weight` is neither.
        """
        if weight not in ("solid_angle", "faces"):
            raise ValueError(f"weight must be 'solid_angle' or 'faces', got {weight!r}")
        culled = 1 - self.answered() / self.size
        return float(culled @ self.sphere.solid_angles if weight == "solid_angle" else culled.mean())

    def culling_shares(self, scene: Scene) -> tuple[float, float]:
        """Parts of `culling_rate`: faces that turn away from the eye, and faces that are hidden.

        Parameters
        ----------
        scene : Scene
            What this was baked from.

        Returns
        -------
        backfacing, occluded : float
            Shares of the scene's faces, averaged over directions by eyes in the middles of the sphere's faces. Which
            side of the faces is their front is taken from what is answered most.

        Raises
        ------
        ValueError
            If this was baked from another scene.
        """
        self.check(scene)
        corners = scene.vertices.astype(np.float64)[scene.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        offsets = np.einsum("ij,ij->i", normals, corners[:, 0] - self.sphere.center)
        middles = self.sphere.points[self.sphere.faces].mean(axis=1)
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        culled_away = culled_toward = kept_away = kept_toward = 0.0
        faces = 0
        for rows in self.cell_rows():
            for row in rows:
                kept = bitfield.unpack(row, self.bitfields.size)[0]
                kept = kept if self.labels is None else kept[self.labels]
                toward = normals @ (self.shells[0].distance * self.sphere.radius * middles[faces]) > offsets
                weight = self.sphere.solid_angles[faces] / self.size
                culled_toward += weight * np.count_nonzero(~kept & toward)
                culled_away += weight * np.count_nonzero(~kept & ~toward)
                kept_toward += weight * np.count_nonzero(kept & toward)
                kept_away += weight * np.count_nonzero(kept & ~toward)
                faces += 1
        outward = kept_toward >= kept_away
        return (culled_away, culled_toward) if outward else (culled_toward, culled_away)

    def in_patches(self, labels: npt.ArrayLike) -> Visibility:
        """The same bake with a bit per patch instead of one per face (2002, section 3.1).

        Parameters
        ----------
        labels : (F,) array_like of int
            Patch of each face.

        Returns
        -------
        Visibility
            A patch is visible where any of its faces is.

        Raises
        ------
        ValueError
            If this bake has patches already, or there is not one label for each face.
        """
        patch = np.asarray(labels)
        if self.labels is not None:
            raise ValueError("this bake has patches already: its rows no longer tell faces apart")
        if patch.shape != (self.size,) or patch.dtype.kind not in "iu" or patch.min() < 0:
            raise ValueError(f"labels must be ({self.size},) integers from 0, got {patch.shape} {patch.dtype}")
        patch = patch.astype(np.uint32)
        shells = [
            Shell(s.distance, fold(s.bitfields.words, patch), None if s.cells is None else fold(s.cells.words, patch))
            for s in self.shells
        ]
        return Visibility(
            self.sphere,
            shells,
            model_radius=self.model_radius,
            size=self.size,
            labels=patch,
            settings=self.settings,
            mesh=self.mesh,
            probes=self.probes,
            found=self.found,
            statement=self.statement,
        )

    def answered(self, shell: int = 0) -> npt.NDArray[np.int64]:
        """(M,) number of faces that eyes in each face of the sphere are answered."""
        counts = [count_faces(rows, self.bitfields.size, self.labels) for rows in self.cell_rows(shell)]
        return np.concatenate(counts)

    def info(self) -> dict[str, Any]:
        """Figures of this bake, by name: plain numbers and strings."""
        probes = int(self.probes.sum())
        return {
            "faces": self.size,
            "patches": self.patches,
            "views": len(self.sphere.points),
            "sphere_faces": len(self.sphere.faces),
            "distances": list(self.distances),
            **{key: list(v) if isinstance(v, tuple) else v for key, v in asdict(self.settings).items()},
            "probes": probes,
            "culling_rate": self.culling_rate(),
            "bytes": self.nbytes,
            "sampling_radius": self.sphere.radius,
            "model_radius": self.model_radius,
            "fingerprint": self.mesh,
            "statement": self.statement,
        }

    def __len__(self) -> int:
        """Number of viewpoints, N."""
        return len(self.sphere.points)

    def __repr__(self) -> str:
        units = f"{self.size:,} faces" + (f" in {self.patches:,} patches" if self.patches is not None else "")
        figures = f"{self.culling_rate():.1%} culled, {self.nbytes / 2**20:.1f} MiB"
        return f"<Visibility: {units}, {len(self):,} views, {figures}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(key)}</th><td>{html.escape(_shown(value))}</td></tr>"
            for key, value in self.info().items()
        )
        return f"<table><caption>{html.escape(repr(self))}</caption>{rows}</table>"

    # Files ---------------------------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an ``.npz`` file that plain NumPy opens; see `cyclorama.bakes.storage` for what is in it.

        Raises
        ------
        OSError
            If the file cannot be written; what was there before is then still there.
        """
        from . import storage

        storage.save(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Visibility:
        """Reads what `save` wrote.

        Raises
        ------
        ValueError
            If the file is truncated or not one of these.
        OSError
            If it cannot be read.
        """
        from . import storage

        return storage.load(path)

    # -----------------------------------------------------------------------------------------------------------------

    def _crossed(self, direction: Floats, distance: float) -> list[tuple[int, npt.NDArray[np.int64]]] | None:
        radii = [shell.distance * self.sphere.radius for shell in self.shells]
        for index, radius in enumerate(radii):
            if distance == radius or abs(distance - radius) <= _SAME_DISTANCE * radius < math.inf:
                return [(index, self.sphere.locate(direction))]
        if distance <= self.model_radius:
            return None
        outer = sum(radius < distance for radius in radii)
        return [
            (k, self.sphere.crossed(direction, sphere.crossing_angle(self.model_radius, radii[k], distance)))
            for k in (outer - 1, outer)
            if 0 <= k < len(radii)
        ]

    def _row(self, crossed: list[tuple[int, npt.NDArray[np.int64]]] | None) -> Words:
        if crossed is None:
            return everything(self.bitfields.size)
        rows = [self._joined(self.shells[index], faces) for index, faces in crossed]
        return rows[0] if len(rows) == 1 else np.bitwise_or.reduce(rows)

    def _faces(self, row: Words, out: Ids | None) -> Ids:
        if self.labels is None:
            return bitfield.ids(row, out=out)
        found = np.flatnonzero(bitfield.unpack(row, self.bitfields.size)[0][self.labels]).astype(np.uint32)
        if out is None:
            return found
        if len(out) < len(found):
            raise ValueError(f"out has room for {len(out)} ids, the answer has {len(found)}")
        out[: len(found)] = found
        return out[: len(found)]

    def _joined(self, shell: Shell, faces: npt.NDArray[np.int64]) -> Words:
        """Union over some faces of the sphere."""
        if shell.cells is not None:
            return shell.cells.union(faces)
        return shell.bitfields.union(np.unique(corner_samples(self.sphere.faces, faces, self.settings.join_count)))

    def cell_rows(self, shell: int = 0) -> Iterator[Words]:
        """The rows of all sphere faces, some at a time."""
        chosen, count = self.shells[shell], len(self.sphere.faces)
        step = max(1, (1 << 24) // max(1, chosen.bitfields.words.shape[1] * 8))
        for start in range(0, count, step):
            faces = np.arange(start, min(start + step, count))
            if chosen.cells is not None:
                yield chosen.cells.words[faces]
            else:
                corners = corner_samples(self.sphere.faces, faces, self.settings.join_count)
                yield np.bitwise_or.reduce(chosen.bitfields.words[corners], axis=1)


def corner_samples(faces: npt.NDArray[np.uint32], which: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    """(K, 3) or (K, 6) viewpoints around some faces of the sphere."""
    return sphere.surrounding(faces, which, count=count).astype(np.int64)


def fold(rows: Words, labels: npt.NDArray[np.uint32]) -> Bitfields:
    """Rows with a bit per patch, set where any face of the patch is.

    Examples
    --------
    >>> fold(bitfield.pack([True, False, False]), np.array([1, 1, 0], dtype=np.uint32)).unpack()
    array([[False,  True]])
    """
    size = int(labels.max()) + 1
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(size))
    # A label that no face has leaves an empty run, to which reduceat would give the next face.
    used = np.bincount(labels, minlength=size) > 0
    folded = np.zeros((len(rows), bitfield.width(size)), dtype=np.uint64)
    step = max(1, (1 << 26) // len(labels))
    for first in range(0, len(rows), step):
        flags = bitfield.unpack(rows[first : first + step], len(labels))[:, order]
        patch_flags = np.zeros((len(flags), size), dtype=bool)
        patch_flags[:, used] = np.logical_or.reduceat(flags, starts[used], axis=1)
        folded[first : first + step] = bitfield.pack(patch_flags)
    return Bitfields(folded, size)


def count_faces(rows: Words, size: int, labels: Ids | None) -> npt.NDArray[np.int64]:
    """(S,) number of faces in rows of bits per face, or per patch."""
    if labels is None:
        return bitfield.count(rows)
    return bitfield.unpack(rows, size) @ np.bincount(labels, minlength=size)


def everything(size: int) -> Words:
    """(W,) words in which every one of `size` bits is set."""
    words = np.full(bitfield.width(size), ~np.uint64(0))
    if size % 64:
        words[-1] = (np.uint64(1) << np.uint64(size % 64)) - np.uint64(1)
    return words


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else str(value)
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
