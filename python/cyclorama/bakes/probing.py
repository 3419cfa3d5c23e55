"""Probes: views inside the faces of a view sphere, placed where they find most of what the corners miss.

A face of the scene that the corners of a sphere face do not see is seen from some part of the sphere face. Such a part
is bounded by planes through the scene's edges; it is a half-plane, a strip or a wedge far more often than an island.
Half-planes that reach a triangle hold one of its corners; strips and wedges cross its edges. So every second probe
looks from an edge, where two sphere faces learn from it; the others are spread over the inside.
``benches/probes.py`` charts this order against others: after as many probes it misses half as much as an even spread
on a scan, and as much on foliage; going back to where most was found gains nothing more, and answers more that is not
needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["STRATEGIES", "Prober", "Probes", "neighbours"]

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

#: Orders in which probes can be placed.
STRATEGIES = ("edges", "spread", "random", "guided")

#: Steps of the sequences that fill a square (Roberts) and a segment (golden ratio) evenly.
_PLANE_STEP = np.array([0.7548776662466927, 0.5698402909980532])
_LINE_STEP = 0.6180339887498949

#: How far a guided probe strays from the view that found most, as a share of the way to a random one.
_STRAY = 0.3


@dataclass(frozen=True)
class Probes:
    """P views to take.

    Parameters
    ----------
    directions : (P, 3) ndarray of float64
        Unit vectors from the centre.
    home : (P,) ndarray of int64
        The sphere face that each lies in, and would be answered by.
    learners : (P, 4) ndarray of int64
        The sphere faces that learn what it sees; the first is `home`, -1 fills up.
    uniform : (P,) ndarray of bool
        Whether it was placed without regard to edges or earlier finds, so that its score is a fair one.
    """

    directions: Floats
    home: Ints
    learners: Ints
    uniform: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.home)

    def __getitem__(self, part: slice) -> Probes:
        return Probes(self.directions[part], self.home[part], self.learners[part], self.uniform[part])


class Prober:
    """Places probes in the faces of a view sphere, by the seed and by what was found, and by nothing else.

    Parameters
    ----------
    points : (N, 3) ndarray of float64
        Unit vectors.
    faces : (M, 3) ndarray of uint32
        Triangles of them.
    seed : int
        Of the random shifts, one for each sphere face.
    strategy : {"edges", "spread", "random", "guided"}
        Edges and inside by turns; evenly over the inside; at random inside; every second one near the best find so far.
    margin : float
        A neighbour learns from a probe that is this near to it, as a share of the sphere face's height.
    """

    def __init__(
        self, points: Floats, faces: npt.NDArray[np.uint32], seed: int = 0, strategy: str = "edges", margin: float = 0.1
    ) -> None:
        if strategy not in STRATEGIES:
            raise ValueError(f"strategy must be one of {', '.join(STRATEGIES)}, got {strategy!r}")
        self.corners = points[faces]
        self.across = neighbours(faces)
        self.strategy = strategy
        self.margin = margin
        self.seed = seed
        self._shift = np.random.default_rng([seed, 0]).random((len(faces), 3))
        self._best = np.zeros(len(faces))
        self._best_at = self.corners.mean(axis=1)

    def place(self, cells: Ints, first: int, count: int) -> Probes:
        """Probes number `first` to ``first + count - 1`` of each of some sphere faces.

        Parameters
        ----------
        cells : (K,) ndarray of int64
            Sphere faces.
        first, count : int
            Which probes of each.

        Returns
        -------
        Probes
            K times `count` of them, in the order of `cells`.
        """
        home = np.repeat(cells, count)
        number = np.tile(np.arange(first, first + count), len(cells))
        weights = self._inside(home, number)
        uniform = np.ones(len(home), dtype=bool)
        second = number % 2 == 1
        if self.strategy == "edges":
            weights[second] = self._on_edges(home[second], number[second] // 2)
        directions = np.einsum("pk,pkx->px", weights, self.corners[home])
        if self.strategy == "guided":
            second &= self._best[home] > 0
            near = home[second]
            directions[second] = _STRAY * directions[second] + (1 - _STRAY) * self._best_at[near]
            self._best[near] /= 2
        if self.strategy in ("edges", "guided"):
            uniform[second] = False
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return Probes(directions, home, self.learners(home, weights), uniform)

    def learners(self, home: Ints, weights: Floats) -> Ints:
        """(P, 4) sphere faces that learn from views at these barycentric weights of their homes; -1 fills up."""
        return np.column_stack([home, np.where(weights < self.margin, self.across[home], -1)])

    def weights(self, home: Ints, directions: Floats) -> Floats:
        """(P, 3) barycentric weights of directions in the sphere faces that they pass through."""
        weights = np.linalg.solve(np.swapaxes(self.corners[home], 1, 2), directions[:, :, None])[:, :, 0]
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def tell(self, probes: Probes, missed: Floats) -> None:
        """What share of the pixels of each probe was missing: guides the next ones."""
        for probe in np.argsort(missed, kind="stable"):
            cell = probes.home[probe]
            if missed[probe] > self._best[cell]:
                self._best[cell] = missed[probe]
                self._best_at[cell] = probes.directions[probe]

    def _inside(self, home: Ints, number: Ints) -> Floats:
        """Barycentric weights of points inside the sphere faces."""
        if self.strategy == "random":
            rows = [np.random.default_rng([self.seed, 1, c, k]).random(2) for c, k in zip(home, number, strict=True)]
            square = np.array(rows).reshape(-1, 2)
        else:
            square = (self._shift[home, :2] + number[:, None] * _PLANE_STEP) % 1
        folded = np.where(square.sum(axis=1, keepdims=True) > 1, 1 - square, square)
        return np.column_stack([folded, 1 - folded.sum(axis=1)])

    def _on_edges(self, home: Ints, number: Ints) -> Floats:
        """Barycentric weights of points on the sphere faces' edges, each edge in its turn."""
        along = (self._shift[home, 2] + number * _LINE_STEP) % 1
        weights = np.zeros((len(home), 3))
        rows, edge = np.arange(len(home)), number % 3
        weights[rows, (edge + 1) % 3] = along
        weights[rows, (edge + 2) % 3] = 1 - along
        return weights


def neighbours(faces: npt.NDArray[np.uint32]) -> Ints:
    """The sphere face on the other side of each edge.

    Parameters
    ----------
    faces : (M, 3) ndarray of uint32
        A closed triangulation.

    Returns
    -------
    (M, 3) ndarray of int64
        Column k: across the edge opposite to corner k.

    Examples
    --------
    >>> neighbours(np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], dtype=np.uint32)).tolist()
    [[3, 1, 2], [3, 2, 0], [3, 0, 1], [1, 0, 2]]
    """
    corners = faces.astype(np.int64)
    ends = np.stack([np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)], axis=-1).reshape(-1, 2)
    ends.sort(axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    pairs = order.reshape(-1, 2)
    across = np.empty(len(order), dtype=np.int64)
    across[pairs[:, 0]], across[pairs[:, 1]] = pairs[:, 1] // 3, pairs[:, 0] // 3
    return across.reshape(-1, 3)
