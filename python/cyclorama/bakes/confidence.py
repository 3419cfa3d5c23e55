"""What a finite number of views says about the mean over all of them.

The share of pixels that a view misses lies in [0, 1], is zero for most views and is large for a few. The interval of
Student's t, which leans on the centre of the data, is too short for it. Here are two others:

* :func:`upper_mean` holds for every distribution on [0, 1] and every number of views, and costs what that must cost:
  no fewer than about ``3 / e`` views can show a mean below ``e`` with 95 % confidence, whatever they say.
* :func:`bootstrap_interval` asks the views themselves how skewed they are (bootstrap-t on the mean). It is right for
  many views, too short where the rare bad view is not among them.

Why ``upper_mean`` holds. Bet on "the mean is at least m": from a capital of 1, every view x multiplies the capital by
``1 + b (m - x)`` for a stake ``0 <= b <= 1``. It never becomes negative, and if the mean really is m or more, no view
is expected to raise it. So the chance that it ever reaches 20 is at most 1/20 (Ville's inequality): a mean m for which
it did is refused with 95 % confidence, at whichever view one stops. The bound is the least m that is refused. A
mixture of stakes is a capital too, so no stake has to be chosen.

If what is measured improves meanwhile (a view is scored first and then learned from), the capital for the last,
smallest mean grows no faster than the one whose every bet is on the mean of its own time; so the bound holds for the
last state as well.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["bootstrap_interval", "upper_mean"]

#: Stakes of the mixture; the largest is right for views that nearly all miss next to nothing, and gets half of the
#: capital.
STAKES = 2.0 ** -np.arange(6)
WEIGHTS = np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])


def upper_mean(values: npt.ArrayLike, confidence: float = 0.95) -> float:
    """Upper bound of the mean of values in [0, 1], valid for every distribution and every count.

    Parameters
    ----------
    values : (N,) array_like of float
        Independent draws, each in [0, 1], in the order in which they were drawn.
    confidence : float
        Chance that the bound holds, in (0, 1).

    Returns
    -------
    float
        The bound; 1 if there are no values.

    Raises
    ------
    ValueError
        If a value is outside [0, 1], or `confidence` outside (0, 1).

    Examples
    --------
    >>> bool(upper_mean(np.zeros(100)) < 0.04)
    True
    """
    x = _shares(values)
    needed = np.log(1.0 / _risk(confidence))
    low, high = (float(x.mean()), 1.0) if len(x) else (1.0, 1.0)
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        capital = np.log1p(STAKES[:, None] * (middle - x)).sum(axis=1)
        refused = np.logaddexp.reduce(capital + np.log(WEIGHTS)) >= needed
        low, high = (low, middle) if refused else (middle, high)
    return float(high)


def bootstrap_interval(
    values: npt.ArrayLike, confidence: float = 0.95, *, seed: int = 0, draws: int = 4000
) -> tuple[float, float]:
    """Central interval of the mean by bootstrap-t: approximate, but as skewed as the data.

    Parameters
    ----------
    values : (N,) array_like of float
        Independent draws, each in [0, 1].
    confidence : float
        Chance that the interval covers the mean, for many values.
    seed : int
        Seed of the resampling.
    draws : int
        Number of resamples.

    Returns
    -------
    (low, high) : tuple of float
        Both ends, within [0, 1]. If no value differs from the others, that value twice: the interval can't tell; see
        :func:`upper_mean`.

    Raises
    ------
    ValueError
        As :func:`upper_mean`.

    Examples
    --------
    >>> low, high = bootstrap_interval([0.0] * 95 + [0.01] * 5)
    >>> bool(low < 0.0005 < high)
    True
    """
    x = _shares(values)
    risk = _risk(confidence)
    if len(x) == 0:
        return 0.0, 1.0
    mean = float(x.mean())
    error = float(x.std(ddof=1) / np.sqrt(len(x))) if len(x) > 1 else 0.0
    if error == 0:
        return mean, mean
    resampled = x[np.random.default_rng(seed).integers(len(x), size=(draws, len(x)))]
    spread = resampled.std(axis=1, ddof=1) / np.sqrt(len(x))
    means = resampled.mean(axis=1)
    # A resample of equal values (often zeros) knows no spread. Where few values differ there are many of those, and the
    # others say little of the far side: there the resampled means themselves reach farther.
    t = ((means - mean)[spread > 0]) / spread[spread > 0]
    tails = [risk / 2, 1 - risk / 2]
    low, high = np.quantile(t, tails) if len(t) else (0.0, 0.0)
    nearest, farthest = np.quantile(means, tails)
    return max(0.0, float(min(mean - high * error, nearest))), min(1.0, float(max(mean - low * error, farthest)))


def _shares(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    x = np.asarray(values, dtype=np.float64).ravel()
    bad = np.flatnonzero(~((x >= 0) & (x <= 1)))
    if len(bad):
        raise ValueError(f"values[{bad[0]}] is {x[bad[0]]}: shares lie in [0, 1]")
    return x


def _risk(confidence: float) -> float:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must lie in (0, 1), got {confidence}")
    return 1 - confidence
