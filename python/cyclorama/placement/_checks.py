"""Arguments that the functions of this folder share, checked."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Vector = tuple[float, float, float]
CellArrays = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.uint32]]


def tangents(fov_x: float, aspect: float) -> tuple[float, float]:
    """Tangents of half the field of view, across and upward."""
    if not 0 < fov_x < 180:
        raise ValueError(f"fov_x must be above 0 and below 180 degrees, got {fov_x}")
    if not (np.isfinite(aspect) and aspect > 0):
        raise ValueError(f"aspect must be positive and finite, got {aspect}")
    across = float(np.tan(np.radians(fov_x) / 2))
    return across, across / aspect


def vector(name: str, value: npt.ArrayLike) -> Vector:
    """Three finite numbers."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} must be three finite numbers, got {value!r}")
    x, y, z = array.tolist()
    return x, y, z


def axis(name: str, value: npt.ArrayLike) -> Vector:
    """A vector along an axis."""
    checked = vector(name, value)
    if np.count_nonzero(checked) != 1:
        raise ValueError(f"{name} must lie along one of the axes, got {value!r}: turn the scene so that it does")
    return checked


def cell_arrays(low: npt.ArrayLike, high: npt.ArrayLike, counts: npt.ArrayLike) -> CellArrays:
    """Boxes with their numbers of primitives."""
    lows, highs = (np.ascontiguousarray(a, dtype=np.float64) for a in (low, high))
    for name, array in (("low", lows), ("high", highs)):
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"{name} must have shape (C, 3), got {array.shape}")
        if not np.isfinite(array).all():
            bad = int(np.argmin(np.isfinite(array).all(axis=1)))
            raise ValueError(f"{name}[{bad}] is {array[bad].tolist()}: boxes must be finite")
    numbers = np.asarray(counts)
    if lows.shape != highs.shape or numbers.shape != lows.shape[:1]:
        raise ValueError(f"low {lows.shape}, high {highs.shape} and counts {numbers.shape} must have one entry a cell")
    if (lows > highs).any():
        bad = int(np.argmax((lows > highs).any(axis=1)))
        raise ValueError(f"low[{bad}] is {lows[bad].tolist()}, above high[{bad}], {highs[bad].tolist()}")
    if numbers.size and (not np.issubdtype(numbers.dtype, np.integer) or numbers.min() < 0 or numbers.max() >= 2**32):
        raise ValueError("counts must be integers from 0 to 2^32 - 1")
    return lows, highs, np.ascontiguousarray(numbers, dtype=np.uint32)
