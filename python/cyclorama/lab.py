"""Experiments over grids of parameters: rows of figures, honest timing, and the rows that nothing beats.

A *row* is a dict: the parameters of one run, then what was measured. Speed is timed in rounds that visit every run
in turn (A B C, A B C, ...), so that a machine which slows down for a while slows all of them alike, and the median over
rounds is kept. A run that fails stays in the table, with its error in place of its figures.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
import os
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from .files import whole_file
from .progress import Progress, reporter

__all__ = ["Row", "best", "combinations", "draw", "elapsed", "load", "medians", "pareto", "save", "sweep", "table"]

Row = dict[str, Any]

T = TypeVar("T")

#: The key under which a row names what went wrong.
ERROR = "error"

#: Seconds that a call takes at least, to be divided by: some clocks stand still for as long.
SHORTEST = 1e-7


def combinations(grid: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]]) -> list[Row]:
    """Every combination of the values, in the order given, the last name varying fastest.

    Parameters
    ----------
    grid : mapping of str to iterable, or iterable of mappings
        The values of each parameter; or the combinations themselves.

    Returns
    -------
    list of dict

    Raises
    ------
    ValueError
        If a parameter has no values, or is a string where its values were to be.

    Examples
    --------
    >>> combinations({"views": [6, 18], "rings": [1, 2]})
    [{'views': 6, 'rings': 1}, {'views': 6, 'rings': 2}, {'views': 18, 'rings': 1}, {'views': 18, 'rings': 2}]
    """
    if not isinstance(grid, Mapping):
        return [dict(parameters) for parameters in grid]
    values = {}
    for name, choices in grid.items():
        if isinstance(choices, str):
            raise ValueError(f"grid[{name!r}] is the string {choices!r}, not a sequence of values")
        values[name] = list(choices)
        if not values[name]:
            raise ValueError(f"grid[{name!r}] has no values")
    return [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]


def sweep(
    grid: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]],
    measure: Callable[..., Mapping[str, Any]] | None = None,
    *,
    timed: Callable[..., Callable[[], object]] | None = None,
    rounds: int = 5,
    warm_up: int = 1,
    at_least: float = 0.0,
    errors: Literal["record", "raise"] = "record",
    clock: Callable[[], float] = time.perf_counter,
    progress: Progress = None,
    desc: str = "sweep",
) -> list[Row]:
    """One row for every combination of parameters, in their order.

    Parameters
    ----------
    grid : mapping of str to iterable, or iterable of mappings
        As for `combinations`.
    measure : callable, optional
        Called once with each combination as keywords; what it returns joins the row.
    timed : callable, optional
        Called once with each combination; returns the job to time, a function without arguments. The jobs of all
        combinations are made before the first is timed, and run in turn. The row gets `time`, the median in seconds,
        and `times`, one for each round.
    rounds : int
        How often every job is timed.
    warm_up : int
        Rounds before the timed ones.
    at_least : float
        Seconds that each turn of a job fills, for jobs so short that the clock's step would show: it is called as often
        as the last round of the warm-up says, and `time` is that of one call.
    errors : {"record", "raise"}
        Whether a run that fails is a row, or ends the sweep.
    clock : callable
        Seconds since some moment.
    progress : bool, callable or None
        As everywhere; one unit is one call of `measure`, or one run of a job.
    desc : str
        What the bar says.

    Returns
    -------
    list of dict
        Where a call raised an `Exception`, the row has `error`, its type and its message, and lacks what it did not
        come to (with `errors="record"`).

    Raises
    ------
    ValueError
        If there is nothing to do, a count is negative, turns are to be filled without a warm-up, or a figure has the
        name of a parameter or the reserved `error`.

    Examples
    --------
    >>> rows = sweep({"n": [1, 0]}, lambda n: {"half": 1 / n}, progress=False)
    >>> rows[0]
    {'n': 1, 'half': 1.0}
    >>> rows[1]
    {'n': 0, 'error': 'ZeroDivisionError: division by zero'}
    """
    if measure is None and timed is None:
        raise ValueError("a sweep needs something to measure or to time")
    if rounds < 1:
        raise ValueError(f"rounds must be at least 1, got {rounds}")
    if warm_up < 0:
        raise ValueError(f"warm_up must be at least 0, got {warm_up}")
    if not (math.isfinite(at_least) and at_least >= 0):
        raise ValueError(f"at_least must be seconds, not negative, got {at_least!r}")
    if at_least and not warm_up:
        raise ValueError("at_least needs a round of warm-up, which says how often to call a job: warm_up is 0")
    if errors not in ("record", "raise"):
        raise ValueError(f"errors must be 'record' or 'raise', got {errors!r}")
    attempt = _record if errors == "record" else _raise
    asked = combinations(grid)
    if any(ERROR in parameters for parameters in asked):
        raise ValueError(f"a parameter can't be named {ERROR!r}: that is where a row says what went wrong")
    rows = [dict(parameters) for parameters in asked]
    turns = warm_up + rounds if timed is not None else 0
    total = len(rows) * (turns + (measure is not None))
    with reporter(progress, total, desc) as report:
        done = 0
        if measure is not None:
            for parameters, row in zip(asked, rows, strict=True):
                figures = attempt(row, partial(measure, **parameters))
                if ERROR not in row:
                    _join(row, figures)
                done += 1
                report(done)
        if timed is not None:
            turn_taking = _Turns(warm_up, turns, at_least, clock)
            _time(asked, rows, timed, turn_taking, attempt, lambda turn: report(done + turn))
    return rows


@dataclass(frozen=True)
class _Turns:
    """How jobs take turns: of all rounds the first are the warm-up."""

    warm_up: int
    all: int
    at_least: float
    clock: Callable[[], float]


def _time(
    asked: Sequence[Row],
    rows: Sequence[Row],
    timed: Callable[..., Callable[[], object]],
    turns: _Turns,
    attempt: Callable[[Row, Callable[[], Any]], Any],
    report: Callable[[int], object],
) -> None:
    jobs: list[Callable[[], object] | None] = []
    for parameters, row in zip(asked, rows, strict=True):
        jobs.append(None if ERROR in row else attempt(row, partial(timed, **parameters)))
    times: list[list[float]] = [[] for _ in rows]
    calls = [1] * len(rows)
    for turn in range(turns.all):
        for place, (row, job) in enumerate(zip(rows, jobs, strict=True)):
            if job is not None and ERROR not in row:
                _, seconds = elapsed(partial(attempt, row, partial(_repeat, job, calls[place])), clock=turns.clock)
                times[place].append(seconds / calls[place])
                if turn < turns.warm_up and turns.at_least:
                    calls[place] = max(1, math.ceil(turns.at_least / max(times[place][-1], SHORTEST)))
            report(turn * len(rows) + place + 1)
    for row, kept in zip(rows, times, strict=True):
        if kept and ERROR not in row:
            _join(row, {"time": statistics.median(kept[turns.warm_up :]), "times": kept[turns.warm_up :]})


def _repeat(job: Callable[[], object], calls: int) -> None:
    for _ in range(calls):
        job()


def _raise(row: Row, job: Callable[[], Any]) -> Any:
    """What `job` returns."""
    return job()


def _record(row: Row, job: Callable[[], Any]) -> Any:
    """What `job` returns; None if it fails, which the row then says."""
    try:
        return job()
    except Exception as error:
        row[ERROR] = f"{type(error).__name__}: {error}"
        return None


def _join(row: Row, figures: Mapping[str, Any]) -> None:
    for name in figures:
        if name == ERROR:
            raise ValueError(f"a figure can't be named {ERROR!r}: that is where a row says what went wrong")
        if name in row:
            raise ValueError(f"the figure {name!r} has the name of a parameter or of another figure")
    row.update(figures)


def pareto(rows: Iterable[Mapping[str, Any]], *, cost: str, error: str) -> list[Row]:
    """The rows that no other row beats: none is both as cheap and as accurate, and better in one of the two.

    Parameters
    ----------
    rows : iterable of mappings
        Rows without a finite number under both names are left out.
    cost, error : str
        Names of two figures, the less the better.

    Returns
    -------
    list of dict
        From the cheapest to the most accurate; of equal rows the first.

    Examples
    --------
    >>> rows = [{"time": 1, "missed": 9}, {"time": 2, "missed": 9}, {"time": 3, "missed": 1}]
    >>> pareto(rows, cost="time", error="missed")
    [{'time': 1, 'missed': 9}, {'time': 3, 'missed': 1}]
    """
    finite = [dict(row) for row in rows if _is_finite(row.get(cost)) and _is_finite(row.get(error))]
    front: list[Row] = []
    for row in sorted(finite, key=lambda row: (row[cost], row[error])):
        if not front or row[error] < front[-1][error]:
            front.append(row)
    return front


def best(
    rows: Iterable[Mapping[str, Any]], *, minimise: str, where: Callable[[Mapping[str, Any]], bool] | None = None
) -> Row:
    """The row with the least of one figure among those that meet a constraint.

    Parameters
    ----------
    rows : iterable of mappings
        Rows that failed, and rows without a finite number under `minimise`, are left out.
    minimise : str
        Name of a figure.
    where : callable, optional
        Takes a row, says whether it will do.

    Returns
    -------
    dict
        Of equal rows the first.

    Raises
    ------
    ValueError
        If no row will do.

    Examples
    --------
    >>> rows = [{"time": 1, "missed": 9}, {"time": 3, "missed": 1}, {"time": 4, "missed": 0}]
    >>> best(rows, minimise="time", where=lambda row: row["missed"] <= 1)
    {'time': 3, 'missed': 1}
    """
    finite = [row for row in rows if ERROR not in row and _is_finite(row.get(minimise))]
    kept = [row for row in finite if where is None or where(row)]
    if not kept:
        raise ValueError(f"none of {len(finite)} rows with a figure {minimise!r} meets the constraint")
    return dict(min(kept, key=lambda row: row[minimise]))


def medians(
    jobs: Mapping[str, Callable[[], object]], rounds: int = 5, *, warm_up: int = 1, at_least: float = 0.0
) -> dict[str, float]:
    """Milliseconds of each job, median over rounds in which they take turns.

    Parameters
    ----------
    jobs : mapping of str to callable
    rounds, warm_up : int
    at_least : float
        As for `sweep`.

    Examples
    --------
    >>> sorted(medians({"one": lambda: 1, "two": lambda: 2}))
    ['one', 'two']
    """
    rows = sweep(
        {"job": jobs},
        timed=lambda job: jobs[job],
        rounds=rounds,
        warm_up=warm_up,
        at_least=at_least,
        errors="raise",
        progress=False,
    )
    return {row["job"]: 1e3 * row["time"] for row in rows}


def elapsed(job: Callable[[], T], *, clock: Callable[[], float] = time.perf_counter) -> tuple[T, float]:
    """What a job gives, and the seconds that it took this once.

    For what is too long to be repeated, or can't be: the rest is compared by `sweep` or `medians`.

    Parameters
    ----------
    job : callable
    clock : callable
        Seconds since some moment.

    Examples
    --------
    >>> total, seconds = elapsed(lambda: sum(range(10)))
    >>> total, seconds >= 0
    (45, True)
    """
    start = clock()
    given = job()
    return given, clock() - start


def save(rows: Iterable[Mapping[str, Any]], path: str | os.PathLike[str]) -> None:
    """Writes rows as CSV or Parquet, by the suffix; `load` reads them back.

    Parameters
    ----------
    rows : iterable of mappings
    path : path
        ``.csv``, or ``.parquet``, which needs pyarrow (extra `lab`). Either is whole or not there.

    Raises
    ------
    ValueError
        If the suffix is another one, or there are no rows.
    ModuleNotFoundError
        If pyarrow is asked for and not installed.

    Notes
    -----
    A cell of a CSV file is a string as it is, or else JSON: numbers, ``null``, ``true``, lists. What a row lacks is an
    empty cell.
    """
    kept = [{name: _plain(value) for name, value in row.items()} for row in rows]
    if not kept:
        raise ValueError("there are no rows to save")
    names = list(dict.fromkeys(name for row in kept for name in row))
    if _suffix(path) == ".csv":
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([[_text(row[name]) if name in row else "" for name in names] for row in kept])
        with whole_file(path) as file:
            file.write(text.getvalue().encode())
        return
    import pyarrow
    from pyarrow import parquet

    columns = {name: [row.get(name) for row in kept] for name in names}
    with whole_file(path) as file:
        parquet.write_table(pyarrow.table(columns), file)


def load(path: str | os.PathLike[str]) -> list[Row]:
    """Reads what `save` wrote.

    Returns
    -------
    list of dict
        Tuples have become lists. From Parquet, figures that a row lacked are None, but for its `error`.

    Raises
    ------
    ValueError
        If the suffix is neither ``.csv`` nor ``.parquet``.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "rows.csv"
    >>> save([{"views": 6, "fill": "rays", "missed": 0.25}, {"views": 18, "fill": None, "error": "full"}], path)
    >>> print(path.read_text())
    views,fill,missed,error
    6,rays,0.25,
    18,null,,full
    <BLANKLINE>
    >>> load(path)[1]
    {'views': 18, 'fill': None, 'error': 'full'}
    """
    if _suffix(path) == ".csv":
        with open(path, newline="", encoding="utf-8") as file:
            return [{name: _value(cell) for name, cell in row.items() if cell} for row in csv.DictReader(file)]
    from pyarrow import parquet

    found: list[Row] = parquet.read_table(path).to_pylist()
    return [{name: v for name, v in row.items() if name != ERROR or v is not None} for row in found]


def draw(
    rows: Iterable[Mapping[str, Any]],
    *,
    cost: str,
    error: str,
    by: str | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """A chart of error against cost, each row a point, with the front of those that nothing beats.

    Parameters
    ----------
    rows : iterable of mappings
    cost, error : str
        Names of two figures, the less the better.
    by : str, optional
        Name of a parameter; rows with the same value are joined by a line.
    path : path, optional
        Where to write the picture.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it by itself.

    Raises
    ------
    ValueError
        If no row has both figures.
    """
    from . import charts

    return charts.scatter([dict(row) for row in rows], cost, error, by, path)


def _suffix(path: str | os.PathLike[str]) -> str:
    suffix = Path(path).suffix
    if suffix not in (".csv", ".parquet"):
        raise ValueError(f"rows are saved as .csv or .parquet, got {os.fspath(path)!r}")
    return suffix


def _plain(value: Any) -> Any:
    """Without NumPy's types and tuples."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return [_plain(part) for part in value] if isinstance(value, list | tuple) else value


def _text(value: Any) -> str:
    if isinstance(value, str) and isinstance(_value(value), str) and value:
        return value
    return json.dumps(value)


def _value(cell: str) -> Any:
    try:
        return json.loads(cell)
    except json.JSONDecodeError:
        return cell


def table(rows: Iterable[Mapping[str, Any]], columns: Sequence[str] | None = None) -> str:
    """The rows as a table of plain text, which Markdown also understands.

    Parameters
    ----------
    rows : iterable of mappings
    columns : sequence of str, optional
        Which figures, in which order; by default all that hold a single value.

    Examples
    --------
    >>> print(table([{"views": 6, "missed": 0.012345}, {"views": 18, "missed": 0.0}]))
    | views | missed |
    | ----: | -----: |
    |     6 | 0.0123 |
    |    18 |      0 |
    """
    kept = [dict(row) for row in rows]
    if columns is None:
        names = dict.fromkeys(name for row in kept for name in row)
        columns = [name for name in names if not any(isinstance(row.get(name), list | tuple | dict) for row in kept)]
    cells = [[_cell(row.get(name)) for name in columns] for row in kept]
    right = [all(_is_number(row.get(name)) or row.get(name) is None for row in kept) for name in columns]
    widths = [max([3, len(name), *(len(line[k]) for line in cells)]) for k, name in enumerate(columns)]

    def line(values: Sequence[str]) -> str:
        aligned = (v.rjust(w) if r else v.ljust(w) for v, w, r in zip(values, widths, right, strict=True))
        return "| " + " | ".join(aligned) + " |"

    rule = ["-" * (w - 1) + (":" if r else "-") for w, r in zip(widths, right, strict=True)]
    return "\n".join([line(list(columns)), line(rule), *map(line, cells)])


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool | str) or not _is_number(value):
        return str(value)
    if float(value).is_integer() and abs(value) < 1e15:
        return f"{int(value):,}"
    return f"{value:.3g}"


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) or (hasattr(value, "dtype") and value.ndim == 0 and value.dtype.kind in "iuf")


def _is_finite(value: Any) -> bool:
    return _is_number(value) and math.isfinite(value)
