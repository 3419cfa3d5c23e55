"""Charts of error against cost, and of lines; needs matplotlib."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy.typing as npt

from . import lab
from .files import whole_file
from .tradeoff import COLORS, COSTS

if TYPE_CHECKING:
    from .tradeoff import Tradeoff

__all__ = ["draw", "lines", "scatter"]

#: Costs whose axes are logarithmic, and their units; a share has a plain axis.
UNITS = {"bytes": "B", "time": "s", "query": "s"}

INK, FAINT, FRONT = "#222222", "#9a9a9a", "#f2c14e"


def draw(chart: Tradeoff, costs: Sequence[str], path: str | os.PathLike[str] | None) -> Any:
    """One panel for each cost, all with the same axis of error; see `Tradeoff.plot`."""
    series = chart.series
    if not series:
        raise ValueError("no row has a figure to draw: all of them failed")
    floor, zero = _levels([row["missed"] for rows in series.values() for row in rows])
    figure = _figure(figsize=(5.4 * len(costs) + 0.6, 5.2), layout="constrained", facecolor="white")
    panels = figure.subplots(1, len(costs), sharey=True, squeeze=False)[0]
    for number, (panel, cost) in enumerate(zip(panels, costs, strict=True)):
        _panel(panel, chart, cost, floor, zero)
        if number == 0:
            panel.set_ylabel("pixels missed, mean share", color=INK)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(labels)), frameon=False)
    figure.suptitle(
        f"What accuracy costs: {chart.faces:,} faces, {chart.eval_views} random views for each point", color=INK
    )
    return _kept(figure, path)


def lines(
    series: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike]],
    *,
    x: str,
    y: str,
    title: str = "",
    limits: Mapping[str, float] | None = None,
    log: Literal["", "x", "y", "xy"] = "",
    points: Collection[str] = (),
    bars: bool = False,
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """One panel with a line for each series.

    Parameters
    ----------
    series : mapping of str to pair of (N,) array_like
        What the legend says, and the values along x and y; those along x may be names.
    x, y, title : str
        What is written beside the axes and above.
    limits : mapping of str to float, optional
        Heights that are drawn as broken lines across.
    log : {"", "x", "y", "xy"}
        Which axes are logarithmic.
    points : collection of str
        Series that are drawn as points.
    bars : bool
        Bars instead of lines.
    path : path-like, optional
        A picture to write, in the format that its suffix names.

    Returns
    -------
    matplotlib.figure.Figure

    Examples
    --------
    >>> figure = lines({"drawn": ([0, 1, 2], [10, 30, 20])}, x="frame", y="faces", limits={"budget": 40})
    >>> [line.get_label() for line in figure.axes[0].get_lines()]
    ['drawn', 'budget']
    """
    figure = _figure(figsize=(8.2, 4.6), layout="constrained", facecolor="white")
    panel = figure.subplots()
    for number, (name, (places, heights)) in enumerate(series.items()):
        color = COLORS[number % len(COLORS)]
        if bars:
            panel.bar(places, heights, color=color, label=name, width=0.8)
        elif name in points:
            panel.plot(places, heights, "o", color=color, markersize=5, label=name)
        else:
            panel.plot(places, heights, "-", color=color, linewidth=1.6, label=name)
    for name, height in (limits or {}).items():
        panel.axhline(height, color=INK, linewidth=1, linestyle=(0, (5, 3)), label=name)
    if "x" in log:
        panel.set_xscale("log")
    if "y" in log:
        panel.set_yscale("log")
    else:
        panel.set_ylim(bottom=0)
    panel.set(xlabel=x, ylabel=y)
    _plain(panel)
    if len(series) + len(limits or {}) > 1:
        handles, labels = panel.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(3, len(labels)), frameon=False)
    if title:
        figure.suptitle(title, color=INK)
    return _kept(figure, path)


def _kept(figure: Any, path: str | os.PathLike[str] | None) -> Any:
    if path is not None:
        with whole_file(path) as file:
            figure.savefig(file, dpi=160, format=os.fspath(path).rsplit(".", 1)[-1].lower())
    return figure


def scatter(rows: list[lab.Row], cost: str, error: str, by: str | None, path: str | os.PathLike[str] | None) -> Any:
    """Error against cost of any rows; see `lab.draw`."""
    from matplotlib.ticker import EngFormatter

    front = lab.pareto(rows, cost=cost, error=error)
    if not front:
        raise ValueError(f"no row has both {cost!r} and {error!r}")
    figure = _figure(figsize=(6.2, 4.2), layout="constrained", facecolor="white")
    panel = figure.add_subplot()
    panel.step([r[cost] for r in front], [r[error] for r in front], where="post", color=FRONT, linewidth=2.5)
    panel.plot([r[cost] for r in front], [r[error] for r in front], "o", color=FRONT, markersize=15, alpha=0.7)
    series: dict[str, list[lab.Row]] = {}
    for row in rows:
        if lab.pareto([row], cost=cost, error=error):
            series.setdefault("" if by is None else f"{by} = {row.get(by)}", []).append(row)
    for number, (name, points) in enumerate(series.items()):
        style = "o" if by is None else "o-"
        x, y = [r[cost] for r in points], [r[error] for r in points]
        panel.plot(x, y, style, color=COLORS[number % len(COLORS)], label=name, markeredgecolor="white")
    panel.set_xlabel(cost, color=INK)
    panel.set_ylabel(error, color=INK)
    for axis, name in ((panel.xaxis, cost), (panel.yaxis, error)):
        if name in UNITS:
            axis.set_major_formatter(EngFormatter(unit=UNITS[name], sep=" "))
    _plain(panel)
    if by is not None:
        panel.legend(frameon=False, fontsize=9)
    return _kept(figure, path)


def _figure(**options: Any) -> Any:
    """A figure that a notebook shows by itself, whatever backend is in use."""
    from matplotlib.figure import Figure

    class Chart(Figure):
        def _repr_png_(self) -> bytes:
            file = io.BytesIO()
            self.savefig(file, dpi=80, format="png")
            return file.getvalue()

    return Chart(**options)


def _levels(missed: Sequence[float]) -> tuple[float, float | None]:
    """The lowest decade of the axis, and where on it "none" is drawn, if anything missed none."""
    positive = [value for value in missed if value > 0]
    floor = 10.0 ** math.floor(math.log10(min(positive))) if positive else 1e-6
    return floor, floor / 10**0.6 if len(positive) < len(missed) else None


def _panel(panel: Any, chart: Tradeoff, cost: str, floor: float, zero: float | None) -> None:
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter, PercentFormatter

    def height(missed: float) -> float:
        return missed if missed > 0 or zero is None else zero

    front = chart.pareto(cost)
    x, y = [row[cost] for row in front], [height(row["missed"]) for row in front]
    panel.step(x, y, where="post", color=FRONT, linewidth=2.5, linestyle=(0, (4, 2)), zorder=1)
    panel.plot(x, y, "o", color=FRONT, markersize=17, alpha=0.75, zorder=1, label="nothing is as cheap and better")
    for number, (name, rows) in enumerate(chart.series.items()):
        color = COLORS[number % len(COLORS)]
        x, y = [row[cost] for row in rows], [height(row["missed"]) for row in rows]
        low = [
            max(0.0, h - max(row["missed_low"], floor)) if row["missed"] > 0 else 0.0
            for h, row in zip(y, rows, strict=True)
        ]
        high = [max(0.0, row["missed_high"] - h) if row["missed"] > 0 else 0.0 for h, row in zip(y, rows, strict=True)]
        panel.errorbar(x, y, yerr=[low, high], fmt="none", ecolor=color, elinewidth=1, alpha=0.45, zorder=2)
        panel.plot(x, y, "-", color=color, linewidth=1.4, zorder=3)
        panel.plot(x, y, "o", color=color, markersize=6.5, label=name, zorder=4, markeredgecolor="white")
        if number == 0 and len(rows) > 1:
            for place, offset, side in ((0, (0, 9), "center"), (-1, (0, -17), "center")):
                panel.annotate(
                    f"{rows[place]['views']:,} views",
                    (x[place], y[place]),
                    xytext=offset,
                    textcoords="offset points",
                    ha=side,
                    fontsize=8.5,
                    color=color,
                    zorder=5,
                )
    panel.set_yscale("log")
    if cost in UNITS:
        panel.set_xscale("log")
        panel.margins(x=0.09)
        panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.xaxis.set_major_formatter(EngFormatter(unit=UNITS[cost], sep=" "))
        panel.xaxis.set_minor_formatter(NullFormatter())
    else:
        panel.set_xlim(0, 1)
        panel.xaxis.set_major_formatter(PercentFormatter(1))
    decades = [10.0**power for power in range(round(math.log10(floor)), 1)]
    panel.set_yticks(decades)
    panel.set_yticks([k * decade for decade in decades for k in range(2, 10) if k * decade <= 1], minor=True)
    panel.yaxis.set_minor_formatter(NullFormatter())
    top = max([floor * 10, *(row["missed_high"] for rows in chart.series.values() for row in rows)])
    panel.set_ylim(floor / (10 if zero is not None else 1.3), min(1.0, top * 2))
    if zero is not None:
        panel.axhspan(floor / 10, floor, color="#f0f0f0", zorder=0, linewidth=0)
        panel.text(
            0.985,
            0.02,
            f"none missed in {chart.eval_views} views",
            transform=panel.transAxes,
            ha="right",
            fontsize=8.5,
            color="#666666",
        )
    panel.set_xlabel(COSTS[cost], color=INK)
    _plain(panel)


def _plain(panel: Any) -> None:
    panel.grid(True, which="major", color="#e4e4e4", linewidth=0.8)
    panel.set_axisbelow(True)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        panel.spines[side].set_color(FAINT)
    panel.tick_params(colors=INK, which="both", color=FAINT)
