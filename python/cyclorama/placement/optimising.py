"""Which part of a view becomes an image: the cost-benefit function and its optimisers (1998, section 3.3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from . import _checks

__all__ = ["Subset", "optimise"]

#: B1, B2, B and C of section 3.6.1.
WEIGHTS = (0.2, 0.8, 0.6, 0.4)

Search = Literal["windows", "paper", "annealing"]

#: How a search is passed to the kernel: its name, look-ahead, what it keeps, effort, seed and gap.
SearchArguments = tuple[str, int, str, int, int, float]


class Subset(NamedTuple):
    """Cells that an image replaces, and what that is worth."""

    #: (K,) which cells, ascending.
    cells: npt.NDArray[np.uint32]
    #: Primitives in view, and those that are left to draw.
    total: int
    remaining: int
    #: The cost-benefit function, in [0, 1], and what no subset of the view exceeds (infinite if the search can't say).
    value: float
    bound: float
    #: (4, 3) the image's quadrilateral: top-left, top-right, bottom-right, bottom-left.
    corners: npt.NDArray[np.float64]
    #: Depths of the nearest and the farthest point of the cells; the quadrilateral is at the first.
    near: float
    far: float
    #: The 6-tuple: places of the left, right, bottom, top, nearest and farthest border in ascending lists of all
    #: borders of their kind, in which coincident ones are one.
    borders: list[int]
    #: How many subsets (of "windows": families of subsets) were evaluated.
    evaluated: int


def search_arguments(
    search: str, lookahead: int, keep: str, steps: int, seed: int, gap: float, most: int
) -> SearchArguments:
    """The options of a search, checked."""
    if search not in ("windows", "paper", "annealing"):
        raise ValueError(f"search must be 'windows', 'paper' or 'annealing', got {search!r}")
    if keep not in ("last", "best"):
        raise ValueError(f"keep must be 'last' or 'best', got {keep!r}")
    if not 0 <= lookahead <= 6:
        raise ValueError(f"lookahead must be 0 to 6 iterations (each takes five times longer), got {lookahead}")
    if steps < 1 or most < 1:
        raise ValueError(f"steps and most must be at least 1, got {steps} and {most}")
    if not 0 <= gap < 1:
        raise ValueError(f"gap must be at least 0 and below 1, got {gap}")
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed must be 0 to 2^64 - 1, got {seed}")
    return search, lookahead, keep, steps if search == "annealing" else most, seed, gap


def weight_arguments(weights: Sequence[float]) -> list[float]:
    """B1, B2, B and C, checked: so that values stay in [0, 1]."""
    values = np.asarray(weights, dtype=np.float64)
    if values.shape != (4,) or not (values >= 0).all():
        raise ValueError(f"weights must be four numbers B1, B2, B, C, none negative, got {weights!r}")
    if values[:2].sum() > 1 + 1e-12 or values[2:].sum() > 1 + 1e-12:
        raise ValueError(f"weights must have B1 + B2 and B + C at most 1, got {weights!r}")
    return [float(v) for v in values]


def optimise(
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    counts: npt.ArrayLike,
    viewpoint: npt.ArrayLike,
    forward: npt.ArrayLike,
    *,
    target: int,
    nearest: float = 0.0,
    axis: float | None = None,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    up: npt.ArrayLike = (0, 1, 0),
    weights: Sequence[float] = WEIGHTS,
    search: Search = "windows",
    lookahead: int = 1,
    keep: Literal["last", "best"] = "last",
    steps: int = 5000,
    seed: int = 0,
    gap: float = 0.001,
    most: int = 2000,
) -> Subset | None:
    """The contiguous subset of the cells in view that an image should replace.

    Parameters
    ----------
    low, high : (C, 3) array_like of float
        Boxes of the cells, as `cells` finds them.
    counts : (C,) array_like of int
        How many primitives each cell has.
    viewpoint, forward : (3,) array_like of float
        Where the image is taken from, and the gaze.
    target : int
        How many primitives may be left to draw: P_opt.
    nearest : float
        The least depth of the image, in scene units: the radius of the viewpoint's star-shape.
    axis : float, optional
        A: length of the model's longest side. By default that of all cells.
    fov_x, aspect, up
        The field of view in degrees, width over height, and the upward direction.
    weights : sequence of four floats
        B1 (small images), B2 (far ones), B (both), C (few primitives); by default those of section 3.6.1.
    search : {"windows", "paper", "annealing"}
        "paper" moves one border at a time, by halves, chosen by looking `lookahead` moves ahead, and keeps the "last"
        subset that leaves few enough or the "best" on the way there. "annealing" takes `steps` random steps. "windows"
        finds the best of all subsets up to `gap`, or until `most` evaluations, never a worse one than "paper" without
        look-ahead.
    lookahead : int
        Q of section 3.5.2, which names no number. Measured: 1 is worth its time, more is not.
    keep, steps, seed, gap, most
        See `search`.

    Returns
    -------
    Subset or None
        `None` if no image at depth `nearest` or more leaves few enough primitives.

    Raises
    ------
    ValueError
        If an argument is out of range; the message names it.

    Notes
    -----
    CB = B (B1 (1 - max(I_w, I_h) / max(S_w, S_h)) + B2 d / A) + C (1 - g_c / G_c), where d is the depth of the subset's
    nearest point along the gaze; both parts of the benefit are clamped to [0, 1]: an image may be wider than the screen
    or farther away than A. Cells that reach to the plane of the eye are never part of an image.

    Examples
    --------
    Two cells, one behind the other; the far one is worth more:

    >>> low, high = [[-1, -1, -3], [-1, -1, -9]], [[1, 1, -2], [1, 1, -8]]
    >>> found = optimise(low, high, [10, 30], (0, 0, 0), (0, 0, -1), target=10)
    >>> found.cells, found.remaining, found.near
    (array([1], dtype=uint32), 10, 8.0)
    """
    arrays = _checks.cell_arrays(low, high, counts)
    eye, gaze, upward = (_checks.vector(n, v) for n, v in (("viewpoint", viewpoint), ("forward", forward), ("up", up)))
    if np.linalg.norm(np.cross(gaze, upward)) <= 1e-9 * np.linalg.norm(gaze) * np.linalg.norm(upward):
        raise ValueError(f"forward {gaze} and up {upward} must not be parallel or zero")
    if target < 0:
        raise ValueError(f"target must not be negative, got {target}")
    if not (np.isfinite(nearest) and nearest >= 0):
        raise ValueError(f"nearest must be finite and not negative, got {nearest}")
    if axis is None:
        axis = float((arrays[1].max(axis=0) - arrays[0].min(axis=0)).max()) if len(arrays[2]) else 1.0
    if not (np.isfinite(axis) and axis > 0):
        raise ValueError(f"axis must be positive and finite, got {axis}")
    found = _core.placement_optimise(
        arrays,
        eye,
        gaze,
        upward,
        _checks.tangents(fov_x, aspect),
        int(target),
        float(nearest),
        axis,
        weight_arguments(weights),
        search_arguments(search, lookahead, keep, steps, seed, gap, most),
    )
    return None if found is None else Subset(**found)
