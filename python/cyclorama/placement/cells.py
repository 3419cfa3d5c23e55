"""Cells of an octree: the groups of primitives that a placement counts and culls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from ..scene import Scene

__all__ = ["Cells", "cells"]

Floats = npt.NDArray[np.float64]

#: The deepest level; the same bound as the kernel's.
MOST_LEVELS = 10


class Cells(NamedTuple):
    """Groups of primitives and the boxes that hold them."""

    #: (C, 3) least and greatest coordinates.
    low: Floats
    high: Floats
    #: (C,) how many primitives each has; every primitive is in one cell.
    counts: npt.NDArray[np.uint32]
    #: (C,) where the faces of each begin in `order`.
    first: npt.NDArray[np.uint32]
    #: (F,) all faces, those of a cell one after another.
    order: npt.NDArray[np.uint32]

    def faces(self, chosen: npt.NDArray[np.integer]) -> npt.NDArray[np.uint32]:
        """The faces of some cells, ascending."""
        spans = [self.order[self.first[c] : self.first[c] + self.counts[c]] for c in chosen]
        return np.sort(np.concatenate(spans)) if spans else np.zeros(0, np.uint32)


def cells(scene: Scene, leaf_depth: int = 5) -> Cells:
    """The cells of a scene under an octree.

    Parameters
    ----------
    scene : Scene
    leaf_depth : int
        Level of the leaves, the pseudo-leaf cells of section 3.3.1: 0 to 10. A face lies in the deepest cell that is no
        smaller than it and holds its middle, so the cells above have some too.

    Returns
    -------
    Cells
        Boxes, and faces in an order in which those of a cell follow each other.

    Raises
    ------
    ValueError
        If `leaf_depth` is out of range.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> found = cells(cyc.scenes.sphere(500), leaf_depth=2)
    >>> int(found.counts.sum()) == len(cyc.scenes.sphere(500))
    True
    """
    if not 0 <= leaf_depth <= MOST_LEVELS:
        raise ValueError(f"leaf_depth must be 0 to {MOST_LEVELS}, got {leaf_depth}")
    return Cells(*_core.placement_cells(scene._mesh, leaf_depth))
