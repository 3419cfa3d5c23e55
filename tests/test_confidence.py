"""Bounds of means: they hold as often as they say, also where Student's t does not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cyclorama.bakes.confidence import STAKES, WEIGHTS, bootstrap_interval, upper_mean

shares = st.lists(st.floats(0, 1), min_size=1, max_size=60)


def test_views_that_miss_nothing_bound_the_mean_by_three_over_their_number():
    for count in (100, 1000, 30000):
        bound = upper_mean(np.zeros(count))
        # The stake of 1 alone needs (1 + m)^n = 20, with half of the capital 40.
        assert 20 ** (1 / count) - 1 < bound < (20 / WEIGHTS[0]) ** (1.001 / count) - 1


def test_the_bound_is_the_least_mean_that_bets_refuse():
    values = np.random.default_rng(0).beta(0.2, 5, 50)
    bound = upper_mean(values, 0.9)

    def capital(mean: float) -> float:
        return float(sum(w * np.prod(1 + b * (mean - values)) for b, w in zip(STAKES, WEIGHTS, strict=True)))

    assert capital(bound * 1.001) >= 10 > capital(bound * 0.999)


@given(shares)
def test_the_bound_is_above_the_mean_and_within_the_shares(values: list[float]):
    assert np.mean(values) <= upper_mean(values) <= 1


@given(shares, st.integers(0, 59))
def test_a_view_that_misses_more_never_lowers_the_bound(values: list[float], index: int):
    worse = list(values)
    worse[index % len(values)] = 1.0
    assert upper_mean(worse) >= upper_mean(values) * 0.999


@pytest.mark.parametrize(("rare", "size"), [(0.01, 1.0), (0.002, 0.5), (0.3, 0.05)])
def test_the_bound_holds_for_skewed_shares_wherever_one_stops(rare: float, size: float):
    rng = np.random.default_rng(7)
    stops = (50, 100, 200, 400)
    broken = 0
    for _ in range(200):
        values = np.where(rng.random(stops[-1]) < rare, size * rng.random(stops[-1]), 0)
        broken += any(upper_mean(values[:stop]) < rare * size / 2 for stop in stops)
    assert broken <= 200 * 0.05 + 2 * np.sqrt(200 * 0.05 * 0.95)


def test_the_bootstrap_covers_many_skewed_shares_better_than_student():
    rng = np.random.default_rng(3)
    mean = 0.1 * 0.01
    ours = student = 0
    for seed in range(150):
        values = np.where(rng.random(120) < 0.1, rng.exponential(0.01, 120).clip(max=1), 0)
        low, high = bootstrap_interval(values, seed=seed, draws=800)
        ours += low <= mean <= high
        half = 1.98 * values.std(ddof=1) / np.sqrt(len(values))
        student += abs(values.mean() - mean) <= half
    assert ours >= 0.9 * 150 and ours > student


def test_equal_values_leave_the_bootstrap_speechless():
    assert bootstrap_interval([0.25] * 10) == (0.25, 0.25)
    assert bootstrap_interval([]) == (0.0, 1.0) and upper_mean([]) == 1.0


def test_what_is_no_share_is_refused():
    for bad in ([0.5, 1.5], [np.nan], [-0.1]):
        with pytest.raises(ValueError, match="values"):
            upper_mean(bad)
    for confidence in (0, 1, 2):
        with pytest.raises(ValueError, match="confidence"):
            bootstrap_interval([0.5], confidence)
