"""Rows of bits for the faces of a view sphere, learned from probes until they find nothing new."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..camera import Camera, CameraArrays
from ..executors import Team
from ..framing import Framing
from ..render import Fill
from ..scene import Scene
from .probing import Prober

__all__ = ["Cells", "Looker", "probe"]

Words = npt.NDArray[np.uint64]
Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

#: Probes of a sphere face that are taken at once, before the next look at whether it needs more.
STEP = 4

#: A sphere face is done when its last STEP probes missed less than this share of their pixels on average: about one
#: pixel in four views of 510 x 480 that a model half fills.
TOLERANCE = 5e-6

#: Bytes of rows that one call to the kernel fills, and that an archive holds.
_BATCH_BYTES, _ARCHIVE_BYTES = 1 << 26, 1 << 29

#: Views of a task that is done elsewhere, at most: some tenths of a second.
_TASK = 16


@dataclass
class Looker:
    """Looks at a scene from around it, at one distance.

    Parameters
    ----------
    scene : Scene
        What to look at.
    framing : Framing
        How.
    distance : float
        In sampling radii; infinite for parallel rays.
    fill : {"rays", "neighbours", None}
        How visible faces that own no pixel are found; see `Scene.visible`.
    threads : int or None
        All cores by default; with a team one for each task.
    team : Team or None
        Takes the views, with the scene as what all tasks need; by default this process does.
    """

    scene: Scene
    framing: Framing
    distance: float = 1.0
    fill: Fill = "rays"
    threads: int | None = None
    done: int = 0
    report: Callable[[int], object] = lambda done: None
    team: Team | None = None

    @property
    def width(self) -> int:
        """Words of a row."""
        return (len(self.scene) + 63) // 64

    @property
    def batch(self) -> int:
        """Views that one call to the kernel takes; depends on the scene alone."""
        return int(np.clip(_BATCH_BYTES // (8 * self.width), 64, 2048))

    def see(self, directions: Floats) -> Words:
        """(N, W) rows of what is seen from each direction."""
        return self.see_cameras(self.framing.cameras(directions, self.distance))

    def see_cameras(self, cameras: list[Camera]) -> Words:
        """(N, W) rows of what these cameras see."""
        if self.team is None:
            found = self.scene.visible(cameras, self.fill, threads=self.threads, progress=self._progress())
            self.done += len(cameras)
            return found.words
        words = np.empty((len(cameras), self.width), dtype=np.uint64)
        parts = self._parts(len(cameras))
        tasks = ((cameras[part], self.fill, self.threads or 1) for part in parts)
        for place, rows in self.team.run(_see, tasks):
            words[parts[place]] = rows
            self.done += len(rows)
            self.report(self.done)
        return words

    def probe(
        self,
        directions: Floats,
        rows: Words,
        row_of: Ints,
        labels: npt.NDArray[np.uint32] | None = None,
        *,
        fill: Fill = None,
    ) -> tuple[Words, Floats]:
        """Asks rows what they miss of some views.

        Parameters
        ----------
        directions : (P, 3) ndarray of float64
            Where to look from.
        rows : (S, W) ndarray of uint64
            Bits per face, or per patch with `labels`.
        row_of : (P,) ndarray of int64
            The row that each view is to be answered by.
        labels : (F,) ndarray of uint32, optional
            Patch of each face.
        fill : {"rays", "neighbours", None}
            How faces that own no pixel are looked for; not with `labels`. Measured (``benches/probes.py``): for the
            time of one probe with rays, several without find more.

        Returns
        -------
        seen : (P, W) ndarray of uint64
            What each view shows, apart from such faces as have no pixel and are in the row already.
        missed : (P,) ndarray of float64
            Share of covered pixels whose face is not in the row.
        """
        if self.team is not None:
            return self._probe_elsewhere(directions, rows, row_of, labels, fill)
        cameras = self.framing.arrays(directions, self.distance)
        seen, missed = probe(self.scene, cameras, rows, row_of, labels, threads=self.threads, progress=self._progress())
        if fill is not None and labels is None:
            known = rows[row_of]
            found = self.scene.visible(
                self.framing.cameras(directions, self.distance),
                fill,
                known=known | seen,
                threads=self.threads,
                progress=False,
            )
            seen |= found.words & ~known
        self.done += len(directions)
        return seen, missed

    def _probe_elsewhere(
        self, directions: Floats, rows: Words, row_of: Ints, labels: npt.NDArray[np.uint32] | None, fill: Fill
    ) -> tuple[Words, Floats]:
        assert self.team is not None
        seen, missed = np.empty((len(row_of), rows.shape[1]), dtype=np.uint64), np.empty(len(row_of))
        parts = self._parts(len(row_of))
        how = self.framing, self.distance, labels, fill, self.threads or 1

        def tasks() -> Iterator[tuple[Any, ...]]:
            for part in parts:
                # Of all rows only those that are asked.
                own, within = np.unique(row_of[part], return_inverse=True)
                yield directions[part], rows[own], within.astype(np.int64), *how

        for place, (found, lacking) in self.team.run(_probe, tasks()):
            seen[parts[place]], missed[parts[place]] = found, lacking
            self.done += len(lacking)
            self.report(self.done)
        return seen, missed

    def _parts(self, count: int) -> list[slice]:
        """Views of a task: so few that its rows are a fraction of a batch."""
        step = min(_TASK, self.batch // 4)
        return [slice(start, min(start + step, count)) for start in range(0, count, step)]

    def _progress(self) -> Callable[[int], object]:
        before = self.done
        return lambda done: self.report(before + done)


def _see(scene: Scene, cameras: list[Camera], fill: Fill, threads: int) -> Words:
    """A task: rows of what some cameras see."""
    return Looker(scene, Framing.of(scene), 1.0, fill, threads).see_cameras(cameras)


def _probe(
    scene: Scene,
    directions: Floats,
    rows: Words,
    row_of: Ints,
    framing: Framing,
    distance: float,
    labels: npt.NDArray[np.uint32] | None,
    fill: Fill,
    threads: int,
) -> tuple[Words, Floats]:
    """A task: what rows miss of some views."""
    return Looker(scene, framing, distance, None, threads).probe(directions, rows, row_of, labels, fill=fill)


def probe(
    scene: Scene,
    cameras: CameraArrays,
    rows: Words,
    row_of: Ints,
    labels: npt.NDArray[np.uint32] | None = None,
    *,
    threads: int | None = None,
    progress: Callable[[int], object] | None = None,
) -> tuple[Words, Floats]:
    """What rows miss of some cameras' views, and what these show; see `Looker.probe`."""
    seen = np.zeros((len(row_of), rows.shape[1]), dtype=np.uint64)
    home = np.ascontiguousarray(row_of, dtype=np.uint32)
    covered, missed = _core.visibility_probe(scene._mesh, cameras, rows, home, seen, labels, threads, progress)
    return seen, missed / np.maximum(covered, 1)


class Cells:
    """A row of bits for each face of a view sphere, that only ever gains bits.

    Parameters
    ----------
    rows : (M, W) ndarray of uint64
        What the corners of each sphere face see; changed in place.
    archive : list or None
        Gets the directions of probes and what they saw, batch by batch up to half a gigabyte, for those who split
        sphere faces later.
    """

    def __init__(self, rows: Words, archive: list[tuple[Floats, Words]] | None = None) -> None:
        self.rows = rows
        self.archive = archive
        self._archived = 0
        self.probes = np.zeros(len(rows), dtype=np.int64)
        self.scores: list[tuple[int, Floats]] = []

    @classmethod
    def of_corners(cls, samples: Words, faces: npt.NDArray[np.uint32]) -> Cells:
        """Begins with the union of the corners' rows."""
        rows = samples[faces[:, 0]]
        for k in (1, 2):
            rows |= samples[faces[:, k]]
        return cls(rows)

    def inherit(self, before: Cells) -> None:
        """Goes on with the archive and the scores of cells that these take the place of."""
        self.archive, self._archived, self.scores = before.archive, before._archived, before.scores

    def learn(self, learners: Ints, seen: Words) -> None:
        """Sets in the rows of each probe's learners (-1: none) what it saw."""
        for cells, row in zip(learners.tolist(), seen, strict=True):
            for cell in cells:
                if cell >= 0:
                    self.rows[cell] |= row

    def probe(
        self, looker: Looker, prober: Prober, cells: Ints, limit: int, tolerance: float = TOLERANCE, first: int = 0
    ) -> tuple[Ints, Floats]:
        """Probes some sphere faces until each is done, or has spent its limit.

        Parameters
        ----------
        looker : Looker
            Takes the views.
        prober : Prober
            Places them.
        cells : (K,) ndarray of int64
            Sphere faces.
        limit : int
            Most probes for each.
        tolerance : float
            Mean share of missed pixels over the last probes below which a sphere face is done.
        first : int
            Number of the first probe of each.

        Returns
        -------
        cells : (L,) ndarray of int64
            The sphere faces that are not done.
        missed : (L,) ndarray of float64
            What the last probes of each missed, on average, before they were learned.
        """
        last = np.full(len(cells), np.inf)
        spent = 0
        while len(cells) and spent < limit:
            count = min(STEP, limit - spent)
            probes = prober.place(cells, first + spent, count)
            missed = np.empty(len(probes))
            for start in range(0, len(probes), looker.batch):
                part = slice(start, start + looker.batch)
                batch = probes[part]
                seen, missed[part] = looker.probe(batch.directions, self.rows, batch.home)
                self.learn(batch.learners, seen)
                if self.archive is not None and self._archived + seen.nbytes <= _ARCHIVE_BYTES:
                    self.archive.append((batch.directions, seen))
                    self._archived += seen.nbytes
            prober.tell(probes, missed)
            self.probes[cells] += count
            self.scores.append((first + spent, missed[probes.uniform]))
            spent += count
            last = missed.reshape(len(cells), count).mean(axis=1)
            cells, last = cells[last > tolerance], last[last > tolerance]
        return cells, last
