"""The experiment runner, on functions made by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cyclorama import lab


class Clock:
    """Time that passes only when a job says so."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def test_combinations_come_in_the_order_given_the_last_name_fastest():
    got = lab.combinations({"b": (1, 2), "a": range(2)})
    assert got == [{"b": 1, "a": 0}, {"b": 1, "a": 1}, {"b": 2, "a": 0}, {"b": 2, "a": 1}]
    assert list(got[0]) == ["b", "a"]


def test_combinations_may_be_spelled_out():
    assert lab.combinations([{"views": 6}, {"views": 18, "patches": 2}]) == [{"views": 6}, {"views": 18, "patches": 2}]


@pytest.mark.parametrize("grid", [{"views": []}, {"fill": "rays"}])
def test_a_grid_without_values_is_refused_by_name(grid):
    with pytest.raises(ValueError, match=next(iter(grid))):
        lab.combinations(grid)


def test_a_row_holds_its_parameters_and_its_figures():
    assert lab.sweep({"n": [2, 3]}, lambda n: {"square": n * n}, progress=False) == [
        {"n": 2, "square": 4},
        {"n": 3, "square": 9},
    ]


def test_a_run_that_fails_is_a_row_with_its_error_and_the_others_go_on():
    rows = lab.sweep({"n": [1, 0, 2]}, lambda n: {"inverse": 1 / n}, progress=False)
    assert [row.get("inverse") for row in rows] == [1, None, 0.5]
    assert rows[1]["error"] == "ZeroDivisionError: division by zero"


def test_a_run_that_fails_can_end_the_sweep_instead():
    with pytest.raises(ZeroDivisionError):
        lab.sweep({"n": [0]}, lambda n: {"inverse": 1 / n}, errors="raise", progress=False)


def test_ctrl_c_ends_the_sweep():
    def measure(n):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lab.sweep({"n": [1]}, measure, progress=False)


def test_rounds_are_interleaved_and_the_median_is_kept_without_the_warm_up():
    clock, order = Clock(), []
    durations = {"a": iter([100, 1, 9, 2]), "b": iter([100, 5, 6, 7])}

    def timed(name):
        def job():
            order.append(name)
            clock.now += next(durations[name])

        return job

    rows = lab.sweep({"name": "a b".split()}, timed=timed, rounds=3, clock=clock, progress=False)
    assert order == ["a", "b"] * 4
    assert [row["time"] for row in rows] == [2, 6]
    assert rows[0]["times"] == [1, 9, 2]


def test_short_jobs_are_called_until_a_turn_is_filled_and_timed_by_the_call():
    clock, calls = Clock(), {"long": 0, "short": 0}
    durations = {"long": 5.0, "short": 0.25}

    def timed(name):
        def job():
            calls[name] += 1
            clock.now += durations[name]

        return job

    rows = lab.sweep({"name": calls}, timed=timed, rounds=2, at_least=1.0, clock=clock, progress=False)
    assert [row["time"] for row in rows] == [5.0, 0.25]
    assert calls == {"long": 1 + 2 * 1, "short": 1 + 2 * 4}


def test_turns_are_filled_on_a_clock_that_stands_still():
    calls = []
    lab.sweep([{}], timed=lambda: lambda: calls.append(1), rounds=1, at_least=2e-6, clock=Clock(), progress=False)
    assert len(calls) == 1 + round(2e-6 / lab.SHORTEST)


def test_what_a_job_gives_and_takes_once():
    clock = Clock()

    def job():
        clock.now += 3
        return "done"

    assert lab.elapsed(job, clock=clock) == ("done", 3)


def test_no_figure_and_no_parameter_is_named_error():
    with pytest.raises(ValueError, match="figure can't be named 'error'"):
        lab.sweep({"n": [1]}, lambda n: {"error": 0.5}, progress=False)
    with pytest.raises(ValueError, match="parameter can't be named 'error'"):
        lab.sweep({"error": [1]}, lambda error: {"half": 0.5}, progress=False)


def test_turns_that_are_filled_need_a_warm_up():
    with pytest.raises(ValueError, match="warm_up is 0"):
        lab.sweep([{}], timed=lambda: int, warm_up=0, at_least=1, progress=False)


def test_a_job_that_fails_is_not_run_again_and_has_no_time():
    runs = []

    def timed(name):
        def job():
            runs.append(name)
            if name == "bad" and runs.count("bad") == 2:
                raise RuntimeError("broken")

        return job

    good, bad = lab.sweep({"name": ["good", "bad"]}, timed=timed, rounds=3, progress=False)
    assert runs.count("good") == 4 and runs.count("bad") == 2
    assert "time" in good
    assert "time" not in bad and bad["error"] == "RuntimeError: broken"


def test_what_is_measured_may_not_take_the_name_of_a_parameter():
    with pytest.raises(ValueError, match="'n'"):
        lab.sweep({"n": [1]}, lambda n: {"n": 2}, progress=False)


@pytest.mark.parametrize("bad", [{"rounds": 0}, {"warm_up": -1}])
def test_counts_are_checked(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        lab.sweep({"n": [1]}, timed=lambda n: list, progress=False, **bad)
    with pytest.raises(ValueError, match="measure"):
        lab.sweep({"n": [1]})


def test_progress_counts_calls_and_runs_up_to_the_total():
    seen = []
    lab.sweep({"n": [1, 2]}, lambda n: {}, timed=lambda n: list, rounds=2, warm_up=1, progress=seen.append)
    assert seen == list(range(1, 2 + 2 * 3 + 1))


finite = st.floats(0, 10).map(lambda x: round(x, 1))


@given(st.lists(st.tuples(finite, finite), max_size=30))
def test_the_pareto_front_is_what_brute_force_says(points):
    rows = [{"cost": c, "error": e} for c, e in points]
    front = lab.pareto(rows, cost="cost", error="error")

    def beaten(row):
        return any(
            o["cost"] <= row["cost"] and o["error"] <= row["error"] and (o["cost"], o["error"]) != tuple(row.values())
            for o in rows
        )

    expected = sorted({tuple(row.values()) for row in rows if not beaten(row)})
    assert [tuple(row.values()) for row in front] == expected


def test_rows_without_a_finite_figure_are_on_no_front():
    rows = [
        {"time": 1, "missed": float("nan")},
        {"time": 1},
        {"time": 2, "missed": 0},
        {"time": np.float64(3), "missed": 0},
    ]
    assert lab.pareto(rows, cost="time", error="missed") == [{"time": 2, "missed": 0}]


def test_best_minimises_where_the_constraint_holds():
    rows = [{"n": 1, "time": 5}, {"n": 2, "time": 3}, {"n": 3, "time": 1}, {"n": 4, "error": "ValueError: no"}]
    assert lab.best(rows, minimise="time", where=lambda row: row["n"] <= 2)["n"] == 2
    with pytest.raises(ValueError, match="none of 3"):
        lab.best(rows, minimise="time", where=lambda row: False)


def test_a_table_shows_single_values_and_leaves_lists_out():
    text = lab.table(
        [{"mesh": "bunny", "views": 1026, "missed": 2e-5, "times": [1.0]}, {"mesh": "tree", "views": None}]
    )
    assert text.splitlines() == [
        "| mesh  | views | missed |",
        "| ----- | ----: | -----: |",
        "| bunny | 1,026 |  2e-05 |",
        "| tree  |     - |      - |",
    ]
