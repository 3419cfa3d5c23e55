"""A scene in small cubes: which of them its faces reach into, and which room each is in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt

from .. import _core

__all__ = ["FILLED", "NEAR", "OUTDOORS", "Grid", "Pairs", "Rooms", "pairs_of"]

Floats = npt.NDArray[np.float64]
Labels = npt.NDArray[np.int32]

#: Labels of cubes that belong to no room.
OUTDOORS, FILLED = -1, -2

#: Cubes from a room within which what faces reach into may be seen from it, and an eye may look out of.
NEAR = 4

#: Pairs of face and voxel tested at once: bounds memory to some 100 MB.
_AT_ONCE = 1 << 19


@dataclass(frozen=True, eq=False)
class Grid:
    """Cubes of one size side by side.

    Attributes
    ----------
    low : (3,) ndarray of float64
        The lowest corner of the first one.
    step : float
        Their side, in the scene's units.
    shape : tuple of (int, int, int)
        How many there are along each axis.
    """

    low: Floats
    step: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, bounds: Floats, step: float, margin: int) -> Grid:
        """Covers a box with so many cubes to spare on each side."""
        counts = [ceil(side / step) + 2 * margin for side in (bounds[1] - bounds[0]).tolist()]
        spare = (np.array(counts) * step - (bounds[1] - bounds[0])) / 2
        return cls(bounds[0] - spare, step, (counts[0], counts[1], counts[2]))

    def indices(self, points: Floats) -> npt.NDArray[np.int64]:
        """(N, 3) cubes that points are in; some may lie outside of the grid."""
        return np.floor((points - self.low) / self.step).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Which faces reach into which cubes: pair by pair, `faces` (K,) and `voxels` (K,) flat indices."""

    faces: npt.NDArray[np.int64]
    voxels: npt.NDArray[np.int64]


def pairs_of(grid: Grid, corners: Floats, report: Callable[[int], object]) -> Pairs:
    """The cubes that triangles (F, 3, 3) touch, by the test of separating axes."""
    low = np.maximum(grid.indices(corners.min(axis=1) - 1e-9 * grid.step), 0)
    high = np.minimum(grid.indices(corners.max(axis=1) + 1e-9 * grid.step), np.array(grid.shape) - 1)
    spans = high - low + 1
    counts = spans.prod(axis=1)
    ends = np.cumsum(counts)
    # The kernel takes coordinates of at most 1.
    scale = 1.0 / (grid.step * max(grid.shape))
    unit = (corners - grid.low) * scale
    faces, voxels = [], []
    for begin in range(0, int(ends[-1]), _AT_ONCE):
        flat = np.arange(begin, min(begin + _AT_ONCE, int(ends[-1])))
        face = np.searchsorted(ends, flat, side="right")
        rest = flat - (ends[face] - counts[face])
        rest, k = np.divmod(rest, spans[face, 2])
        i, j = np.divmod(rest, spans[face, 1])
        at = low[face] + np.stack([i, j, k], axis=-1)
        # A hair wider, so that what only touches a side counts on both.
        touched = _core.triangles_overlap_boxes(
            np.ascontiguousarray(unit[face].reshape(-1, 9)),
            (at - 1e-9) * (grid.step * scale),
            (at + (1 + 1e-9)) * (grid.step * scale),
        )
        faces.append(face[touched])
        voxels.append(np.ravel_multi_index(at[touched].T, grid.shape))
        report(int(face[-1]) + 1)
    return Pairs(np.concatenate(faces), np.concatenate(voxels))


@dataclass(frozen=True, eq=False)
class Rooms:
    """Which room each cube is in.

    Attributes
    ----------
    grid : Grid
    labels : (X, Y, Z) ndarray of int32
        The room; OUTDOORS; FILLED where faces, or what is between them, fill the cube.
    """

    grid: Grid
    labels: Labels

    def at(self, point: Floats) -> int:
        """The label at a point; beyond the grid is outdoors."""
        index = self.grid.indices(point)
        if (index < 0).any() or (index >= self.labels.shape).any():
            return OUTDOORS
        return int(self.labels[tuple(index)])

    def near(self, point: Floats, reach: int) -> set[int]:
        """The labels at most `reach` cubes away along each axis, FILLED not among them."""
        index = self.grid.indices(point)
        low, high = np.maximum(index - reach, 0), index + reach + 1
        around = set(np.unique(self.labels[tuple(map(slice, low, np.maximum(high, 0)))]).tolist()) - {FILLED}
        outside = (index - reach < 0).any() or (high > self.labels.shape).any()
        return around | {OUTDOORS} if outside else around
