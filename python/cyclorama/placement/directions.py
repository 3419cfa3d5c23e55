"""View-directions sets: the yaws at which what an eye may see changes (1998 dissertation, section 3.3.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from . import _checks

__all__ = ["ViewDirections", "view_directions"]


class ViewDirections(NamedTuple):
    """All that turning about a viewpoint changes: sector i of yaw lies between `yaws[i]` and the next."""

    #: (E,) degrees, ascending in [0, 360), counter-clockwise about `up`, from the axis after it (z for y, x for z).
    yaws: npt.NDArray[np.float64]
    #: (E,) primitives in view in each sector, the last of which reaches over yaw 0; one value if nothing ever changes.
    counts: npt.NDArray[np.uint64]
    #: (E + 1,) the changes at `yaws[i]` are those from `first[i]` to `first[i + 1]`.
    first: npt.NDArray[np.uint32]
    #: (K,) the cells that change, and whether each comes into view.
    cells: npt.NDArray[np.uint32]
    enters: npt.NDArray[np.bool_]
    #: (C,) which cells the last sector has in view.
    at_last: npt.NDArray[np.bool_]

    @property
    def middles(self) -> npt.NDArray[np.float64]:
        """The yaw in the middle of each sector, in degrees."""
        if not len(self.yaws):
            return np.zeros(1)
        following = np.append(self.yaws[1:], self.yaws[0] + 360.0)
        middles: npt.NDArray[np.float64] = (self.yaws + following) / 2 % 360.0
        return middles


def view_directions(
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    counts: npt.ArrayLike,
    viewpoint: npt.ArrayLike,
    *,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    up: npt.ArrayLike = (0, 1, 0),
    threads: int | None = None,
) -> ViewDirections:
    """The yaws at which the set of cells in view changes, and how many primitives are in view between them.

    Parameters
    ----------
    low, high : (C, 3) array_like of float
        Boxes of the cells, as `cells` finds them. Its `leaf_depth` is the depth of pseudo-leaf cells.
    counts : (C,) array_like of int
        How many primitives each cell has.
    viewpoint : (3,) array_like of float
    fov_x : float
        Horizontal field of view in degrees.
    aspect : float
        Width over height.
    up : (3,) array_like of float
        The axis that gazes turn about: along x, y or z.
    threads : int, optional
        All cores by default. The answer doesn't depend on it.

    Returns
    -------
    ViewDirections

    Raises
    ------
    ValueError
        If an argument is out of range; the message names it.

    Notes
    -----
    A cell is in view unless its box lies wholly outside one of the pyramid's four planes. The dissertation watches the
    left and right planes; the tilt of the other two drops high and low cells before those do. The yaws are exact up to
    rounding: nothing is sampled. O(C log C).

    Examples
    --------
    A cell straight along +z is in view while the gaze is within 45 degrees of it:

    >>> found = view_directions([[0, 0, 1]], [[0, 0, 1]], [5], (0, 0, 0), fov_x=90)
    >>> found.yaws, found.counts
    (array([ 45., 315.]), array([0, 5], dtype=uint64))
    """
    arrays = _checks.cell_arrays(low, high, counts)
    tangents = _checks.tangents(fov_x, aspect)
    eye, axis = _checks.vector("viewpoint", viewpoint), _checks.axis("up", up)
    found = ViewDirections(*_core.placement_directions(arrays, eye, axis, tangents, threads))
    return found._replace(yaws=np.degrees(found.yaws))
