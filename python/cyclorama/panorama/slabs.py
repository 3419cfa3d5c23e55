"""Slabs of range, from the histogram of what is seen (2003 paper, section 3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..arguments import checked_floats, checked_whole

__all__ = ["checked_slabs", "find_slabs"]

Floats = npt.NDArray[np.float64]

# Bins of the histogram, in equal ratios of range, and the width of the Gaussian that smooths it, in bins.
_BINS, _SMOOTH = 256, 4.0


def find_slabs(ranges: npt.ArrayLike, count: int, weights: npt.ArrayLike | None = None) -> list[float]:
    """Where to cut a scene into slabs: at the deepest valleys of the histogram of ranges.

    The paper reads the valleys off a drawing. Here bins have equal ratios, because parallax goes by ratios, counts
    are smoothed, and a valley is as deep as the lower of the two peaks beside it (those that are reached before a
    deeper valley) stands above it. Where there are fewer valleys than cuts are asked for, the slab that spans the
    largest ratio of what is seen is cut at its median.

    Parameters
    ----------
    ranges : (N,) array_like of float
        Of all that is seen from the reference viewpoints; those that aren't finite don't count.
    count : int
        How many slabs.
    weights : (N,) array_like of float, optional
        Say, solid angles.

    Returns
    -------
    list of float
        The `count - 1` ranges between them, ascending.

    Raises
    ------
    ValueError
        If `count` is not 1 to 16, or nothing is seen.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> near, far = rng.normal(2, 0.1, 1000), rng.normal(30, 3, 1000)
    >>> [cut] = find_slabs(np.concatenate([near, far]), 2)
    >>> near.max() < cut < far.min()
    np.True_
    """
    count = checked_whole("slabs", count, 1, 16)
    values = checked_floats("ranges", ranges).ravel()
    mass = np.ones_like(values) if weights is None else checked_floats("weights", weights).ravel()
    if mass.shape != values.shape:
        raise ValueError(f"weights must have {len(values)} entries, got {len(mass)}")
    seen = np.isfinite(values) & (values > 0)
    if not seen.any():
        raise ValueError("nothing is seen: no range is finite")
    logs, mass = np.log(values[seen]), mass[seen]
    low, high = float(logs.min()), float(logs.max())
    if count == 1:
        return []
    if high - low < 1e-9:
        raise ValueError(f"all that is seen has range {math.exp(low):.6g}: it makes one slab, not {count}")
    heights, edges = np.histogram(logs, bins=_BINS, range=(low, high), weights=mass)
    around = np.arange(-3 * int(_SMOOTH), 3 * int(_SMOOTH) + 1)
    kernel = np.exp(-0.5 * (around / _SMOOTH) ** 2)
    # Beyond the ends nothing is seen.
    smooth = np.convolve(heights, kernel / kernel.sum(), mode="same")
    middles = 0.5 * (edges[:-1] + edges[1:])
    valleys = sorted(_valleys(smooth), key=lambda valley: -valley[0])[: count - 1]
    cuts = sorted(float(middles[place]) for _, place in valleys)
    while len(cuts) < count - 1:
        spans = []
        for a, b in zip([-math.inf, *cuts], [*cuts, math.inf], strict=True):
            inside = logs[(logs >= a) & (logs < b)]
            spans.append(float(np.ptp(inside)) if len(inside) else 0.0)
        widest = int(np.argmax(spans))
        bounds = [-math.inf, *cuts, math.inf]
        inside = np.sort(logs[(logs >= bounds[widest]) & (logs < bounds[widest + 1])])
        middle = float(np.median(inside))
        if middle in (inside[0], inside[-1]):
            middle = float(0.5 * (inside[0] + inside[-1]))
        cuts = sorted([*cuts, middle])
    return [math.exp(cut) for cut in cuts]


def _valleys(heights: Floats) -> list[tuple[float, int]]:
    """Depth and place of each valley: how far the lower of its peaks stands above it, by joining peaks from the top."""
    order = np.argsort(-heights, kind="stable")
    owner = np.full(len(heights), -1)
    peaks: list[float] = []
    found = []
    for place in order:
        beside = [owner[p] for p in (place - 1, place + 1) if 0 <= p < len(heights) and owner[p] >= 0]
        if not beside:
            owner[place] = len(peaks)
            peaks.append(float(heights[place]))
            continue
        owner[place] = beside[0]
        if len(beside) == 2 and beside[0] != beside[1]:
            tall, short = sorted(beside, key=lambda peak: -peaks[peak])
            depth = peaks[short] - float(heights[place])
            if depth > 1e-9 * peaks[tall]:
                found.append((depth, _middle(heights, int(place))))
            owner[owner == short] = tall
            owner[place] = tall
    return found


def _middle(heights: Floats, place: int) -> int:
    """The middle of a flat stretch."""
    first = last = place
    while first > 0 and heights[first - 1] == heights[place]:
        first -= 1
    while last + 1 < len(heights) and heights[last + 1] == heights[place]:
        last += 1
    return (first + last) // 2


def checked_slabs(cuts: Sequence[float]) -> list[tuple[float, float]]:
    """Nearest and farthest range of each slab, from the ranges between them.

    Raises
    ------
    ValueError
        If they aren't positive, finite and ascending.

    Examples
    --------
    >>> checked_slabs([2.0, 9.0])
    [(0.0, 2.0), (2.0, 9.0), (9.0, inf)]
    """
    values = checked_floats("slabs", cuts).ravel().tolist()
    bounds = [0.0, *values, math.inf]
    for index, (a, b) in enumerate(pairwise(bounds)):
        if not a < b:
            raise ValueError(
                "slabs must be cut at positive, finite ranges in ascending order: "
                f"slabs[{min(index, len(values) - 1)}] leaves {a:.6g} to {b:.6g}; got {values}"
            )
    return list(pairwise(bounds))
