"""A bake that takes no more than the scene needs to miss no more than it may.

1. *Resolution.* The smallest of a few whose views, seen from the same eyes, lack at most a tenth of the allowed share.
2. *Views.* Starting from a coarse sphere, every face is probed. One that still misses too much, and whose corners
disagree, is
   split (`cyclorama.sphere.subdivide`), and its parts begin again with their corners and with those probes of the
   whole that lie in them. Sphere faces whose corners agree, or that probes complete, stay as they are.
3. *Spare samples.* A viewpoint that a split brought in, and without which the culling would hardly be less, is
dropped: its
   sphere faces are joined to the whole they came from, with the union of their rows, which misses no more.
4. *Patches.* The fewest of a few counts that keep a stated share of the culling.
5. *Proof.* Random views, uniform over all directions, are scored, and only then learned from. The bound of
   `cyclorama.bakes.confidence.upper_mean` on their scores holds for the rows as they are at the end, at whichever view
   one stops. It stops at the allowed share, or when the views allotted are spent: then the statement says how far it
   came.

The proof needs no fewer than ``3 / max_missed`` views. Their pixels are few: the expected share of missed pixels does
not depend on how many pixels sample the picture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .. import bitfield, sphere
from ..executors import Team
from ..fingerprint import fingerprint
from ..framing import Framing
from ..progress import Progress, reporter
from ..render import Fill
from ..scene import Scene
from .confidence import upper_mean
from .learning import Cells, Looker
from .probing import Prober
from .viewsphere import ViewSphere
from .visibility import Settings, Visibility

if TYPE_CHECKING:
    from .baking import Views

__all__ = ["bake_within"]

Words = npt.NDArray[np.uint64]
Floats = npt.NDArray[np.float64]
Faces = npt.NDArray[np.uint32]
Ints = npt.NDArray[np.int64]

#: Views of the sphere that refinement begins with, at most, and that it ends with, at most.
FIRST_VIEWS, MOST_VIEWS = 66, 1025

#: A sphere face may be split if this share of what its corners see together is not seen by the average one of them.
DISAGREEMENT = 0.02

#: Shares of the allowance: for what the sampling resolution alone loses, and for what a finished sphere face misses.
RESOLUTION_SHARE, CELL_SHARE = 0.1, 0.5

#: Share of the culling that patches have to keep.
KEPT_CULLING = 0.9

#: A viewpoint is spare if without it the answers around it hold at most this share of the scene's faces more.
SPARE = 0.005

#: Chance that the statement is right, and views allotted to it: as a multiple of the 3 / max_missed it takes at least,
#: and at most.
CONFIDENCE = 0.95
PATIENCE, MOST_PROOFS = 6, 250_000

#: Height in pixels of the pictures that the proof is drawn in.
_PROOF_HEIGHT = 120


def bake_within(
    scene: Scene,
    max_missed: float,
    views: Views,
    patches: int | npt.ArrayLike | None,
    framing: Framing,
    fill: Fill,
    probes: int,
    strategy: str,
    seed: int,
    threads: int | None,
    progress: Progress,
    team: Team | None,
) -> Visibility:
    """`cyclorama.bake` with ``max_missed=``."""
    from .baking import mean_scores, patch_labels, shell_of, view_points

    if not 0 < max_missed < 1:
        raise ValueError(f"max_missed must lie in (0, 1), got {max_missed}")
    start = min(views, FIRST_VIEWS) if isinstance(views, int | np.integer) else views
    points, faces, _ = view_points(scene, start)
    with reporter(progress, MOST_VIEWS + 4 * MOST_VIEWS * probes, "views") as report:
        looker = Looker(scene, framing, 1.0, fill, threads, team=team)
        chosen = _resolution(looker, points, max_missed)
        sampler = Looker(scene, chosen, 1.0, fill, threads, team=team)
        sampler.report, looker.report = (lambda done, other=o: report(done + other.done) for o in (looker, sampler))
        refined = _Refinement(sampler, looker, points, faces, max_missed, probes, strategy, seed)
        refined.run()
        refined.drop_spare()
        view_sphere = ViewSphere(refined.points, refined.faces, scene.center, framing.sampling_radius)
        labels = patch_labels(scene, patches)
        if patches is None:
            labels = _fewest_patches(scene, refined.cells.rows, view_sphere.solid_angles)
        shell = shell_of(1.0, refined.samples, refined.cells.rows, len(scene), labels)
        assert shell.cells is not None
        proof = _Proof(looker, view_sphere, shell.cells.words, labels, max_missed, seed)
        statement = proof.run()
    return Visibility(
        view_sphere,
        [shell],
        model_radius=scene.radius,
        size=len(scene),
        labels=labels,
        settings=Settings(chosen.resolution, framing.fov_y, fill, "cells", 3, seed),
        mesh=fingerprint(scene),
        probes=refined.cells.probes,
        found=mean_scores(refined.cells.scores),
        statement=statement,
    )


def _resolution(looker: Looker, points: Floats, max_missed: float) -> Framing:
    """The smallest images whose samples lack at most a share of the allowance in the same views at the asked size."""
    directions = points[np.linspace(0, len(points) - 1, min(8, len(points))).astype(int)]
    rows = np.arange(len(directions))
    width, height = looker.framing.resolution
    for factor in (0.5, 1.0):
        framing = looker.framing.with_resolution((max(1, round(width * factor)), max(1, round(height * factor))))
        seen = Looker(looker.scene, framing, 1.0, looker.fill, looker.threads, team=looker.team).see(directions)
        if looker.probe(directions, seen, rows)[1].mean() <= RESOLUTION_SHARE * max_missed:
            return framing
    return looker.framing.with_resolution((2 * width, 2 * height))


class _Refinement:
    """A view sphere that is split where probes still miss."""

    def __init__(
        self,
        sampler: Looker,
        looker: Looker,
        points: Floats,
        faces: Faces,
        max_missed: float,
        probes: int,
        strategy: str,
        seed: int,
    ) -> None:
        self.sampler, self.looker = sampler, looker
        self.points, self.faces = points, faces
        self.given = len(points)
        self.tolerance = CELL_SHARE * max_missed
        self.limit, self.strategy, self.seed = probes, strategy, seed
        self.samples = sampler.see(points)
        self.cells = Cells.of_corners(self.samples, faces)
        self.cells.archive = []

    def run(self) -> None:
        """Probes and splits until every sphere face is done, or no more can be split; the rest get more probes."""
        fresh = np.arange(len(self.faces))
        undone = np.empty(0, dtype=np.int64)
        first = max(8, self.limit // 2)
        while len(fresh):
            failed, missed = self.cells.probe(self.looker, self._prober(), fresh, first, self.tolerance)
            apart = self._disagreement(failed) > DISAGREEMENT
            undone = np.concatenate([undone, failed[~apart]])
            split, missed = failed[apart], missed[apart]
            room = (MOST_VIEWS - len(self.points)) // 5
            worst = np.argsort(-missed, kind="stable")
            undone = np.concatenate([undone, split[worst[room:]]])
            # Where there is no room for another split, more probes have to do.
            fresh, kept = self._split(np.sort(split[worst[:room]]))
            undone = undone[kept[undone]]
        self.cells.probe(self.looker, self._prober(), np.sort(undone), 2 * self.limit, self.tolerance, first=first)

    def _prober(self) -> Prober:
        return Prober(self.points, self.faces, self.seed, self.strategy)

    def _disagreement(self, cells: Ints) -> Floats:
        """Share of the corners' union that the average corner does not see."""
        corners = self.samples[self.faces[cells]]
        union = bitfield.count(np.bitwise_or.reduce(corners, axis=1))
        alone = bitfield.count(corners.reshape(-1, corners.shape[2])).reshape(-1, 3).mean(axis=1)
        return np.asarray(1 - alone / np.maximum(union, 1))

    def _split(self, which: Ints) -> tuple[Ints, npt.NDArray[np.bool_]]:
        """Splits sphere faces; returns the new parts, and which of the old faces are still whole."""
        whole = np.ones(len(self.faces), dtype=bool)
        if len(which) == 0:
            return np.empty(0, dtype=np.int64), whole
        points, faces, parents = sphere.subdivide(self.points, self.faces, which)
        while len(points) > MOST_VIEWS:
            which = which[: len(which) // 2]
            points, faces, parents = sphere.subdivide(self.points, self.faces, which)
        whole = np.bincount(parents, minlength=len(self.faces)) == 1
        new = np.flatnonzero(~whole[parents])
        self.samples = np.concatenate([self.samples, self.sampler.see(points[len(self.points) :])])
        self.points, self.faces = points, faces
        before = self.cells
        self.cells = Cells.of_corners(self.samples, faces)
        self.cells.inherit(before)
        kept = np.flatnonzero(whole[parents])
        self.cells.rows[kept] = before.rows[parents[kept]]
        self.cells.probes[kept] = before.probes[parents[kept]]
        self._recall(new)
        return new, whole

    def _recall(self, new: Ints) -> None:
        """Gives new sphere faces what earlier probes inside them saw."""
        is_new = np.zeros(len(self.faces), dtype=bool)
        is_new[new] = True
        prober, locator = self._prober(), sphere.Locator(self.points, self.faces)
        for directions, seen in self.cells.archive or []:
            home = locator.locate(directions).astype(np.int64)
            learners = prober.learners(home, prober.weights(home, directions))
            learners[~is_new[learners]] = -1
            useful = (learners >= 0).any(axis=1)
            self.cells.learn(learners[useful], seen[useful])

    def drop_spare(self) -> None:
        """Takes out viewpoints that splits brought in and that the culling can spare."""
        for vertex in range(len(self.points) - 1, self.given - 1, -1):
            star = np.flatnonzero((self.faces == vertex).any(axis=1))
            area = ViewSphere(self.points, self.faces[star], np.zeros(3), 1.0).solid_angles
            union = np.bitwise_or.reduce(self.cells.rows[star], axis=0)
            more = bitfield.count(union)[0] - bitfield.count(self.cells.rows[star]) @ area
            filled = _without(self.points, self.faces[star], vertex) if more <= SPARE * len(self.looker.scene) else None
            if filled is not None:
                self._replace(vertex, star, filled, union)

    def _replace(self, vertex: int, star: Ints, filled: Faces, union: Words) -> None:
        """Puts the triangles that fill a viewpoint's star in its place; each answers what any part of the star did."""
        faces = np.concatenate([np.delete(self.faces, star, axis=0), filled])
        cells = self.cells
        spent = int(cells.probes[star].sum()) // len(filled)
        cells.rows = np.concatenate([np.delete(cells.rows, star, axis=0), np.tile(union, (len(filled), 1))])
        cells.probes = np.append(np.delete(cells.probes, star), np.full(len(filled), spent))
        self.faces = np.where(faces > vertex, faces - 1, faces).astype(np.uint32)
        self.points = np.delete(self.points, vertex, axis=0)
        self.samples = np.delete(self.samples, vertex, axis=0)


def _without(points: Floats, star: Faces, vertex: int) -> Faces | None:
    """Triangles that cover what a point's own triangles cover, without the point; None where they would turn over."""
    following = {}
    for triangle in star.tolist():
        at = triangle.index(vertex)
        following[triangle[(at + 1) % 3]] = triangle[(at + 2) % 3]
    ring = [next(iter(following))]
    while len(ring) < len(following):
        ring.append(following[ring[-1]])
    triangles = []
    while len(ring) > 2:
        for k in range(len(ring)):
            a, b, c = (ring[k - 1], ring[k], ring[(k + 1) % len(ring)])
            others = [points[p] for p in ring if p not in (a, b, c)]
            if _turn(points[a], points[b], points[c]) > 1e-9 and not any(
                _within(p, points[a], points[b], points[c]) for p in others
            ):
                triangles.append((a, b, c))
                del ring[k]
                break
        else:
            return None
    return np.array(triangles, dtype=np.uint32)


def _turn(a: Floats, b: Floats, c: Floats) -> float:
    """Positive where a, b, c turn left as seen from outside."""
    return float(a @ np.cross(b, c))


def _within(p: Floats, a: Floats, b: Floats, c: Floats) -> bool:
    return min(_turn(a, b, p), _turn(b, c, p), _turn(c, a, p)) >= 0


def _fewest_patches(scene: Scene, rows: Words, weights: Floats) -> npt.NDArray[np.uint32] | None:
    """Labels of the fewest patches, of a few counts, that keep a share of the culling; None where only all faces do."""
    from ..patches import tile
    from .visibility import count_faces, fold

    def culling(words: Words, size: int, labels: npt.NDArray[np.uint32] | None) -> float:
        return float((1 - count_faces(words, size, labels) / len(scene)) @ weights)

    needed = KEPT_CULLING * culling(rows, len(scene), None)
    count = 250
    while count <= len(scene) // 4:
        labels = tile(scene.vertices, scene.faces, count)
        folded = fold(rows, labels)
        if culling(folded.words, folded.size, labels) >= needed:
            return labels
        count *= 2
    return None


class _Proof:
    """Random views that are scored, and only then learned from, until their scores bound what is missed."""

    def __init__(
        self,
        looker: Looker,
        view_sphere: ViewSphere,
        rows: Words,
        labels: npt.NDArray[np.uint32] | None,
        max_missed: float,
        seed: int,
    ) -> None:
        width, height = looker.framing.resolution
        scale = min(1.0, _PROOF_HEIGHT / height)
        framing = looker.framing.with_resolution((max(1, round(width * scale)), max(1, round(height * scale))))
        self.looker = Looker(looker.scene, framing, 1.0, None, looker.threads, looker.done, looker.report, looker.team)
        self.view_sphere, self.cells, self.labels = view_sphere, Cells(rows), labels
        self.max_missed, self.seed = max_missed, seed

    def run(self) -> str:
        """Learns in place; returns what is proved."""
        from .evaluation import random_directions

        allotted = int(min(MOST_PROOFS, max(1000, PATIENCE * 3 / self.max_missed)))
        scores = np.empty(0)
        bound = 1.0
        while len(scores) < allotted and bound > self.max_missed:
            count = min(self.looker.batch, allotted - len(scores))
            directions = random_directions(count, [self.seed, 2, len(scores)])
            home = self.view_sphere.locate(directions)
            seen, missed = self.looker.probe(directions, self.cells.rows, home, self.labels)
            news = missed > 0
            self.cells.learn(home[news, None], seen[news])
            scores = np.append(scores, missed)
            bound = upper_mean(scores, CONFIDENCE)
        reached = (
            f"mean share of missed pixels over all directions is at most {bound:.3g} with {CONFIDENCE:.0%} confidence"
        )
        drawn = f"{len(scores):,} random views, each scored before it was learned from"
        detail = f"from {drawn}; their mean was {scores.mean():.2g}"
        if bound <= self.max_missed:
            return f"max_missed={self.max_missed:g} reached: {reached} ({detail})"
        return f"max_missed={self.max_missed:g} not reached: {reached} ({detail})"
