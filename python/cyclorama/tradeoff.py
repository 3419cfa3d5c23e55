"""What accuracy costs: one row for each way to bake a scene, and a chart of cost against error.

The papers chart culling and frame rate (2001, figures 5 and 6; 2002, figures 4 to 7) and state the quality beside them.
Here each row has both: what a bake takes (seconds, bytes, how much is still drawn), and what it misses, measured on
random views that it did not learn from. Faces culled are split into those that face away, which the papers' baseline,
back-face culling, would also drop, and those that are hidden by others.
"""

from __future__ import annotations

import html
import os
import statistics
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import lab
from .bakes.baking import bake
from .bakes.confidence import bootstrap_interval, upper_mean
from .bakes.visibility import Visibility
from .framing import Framing
from .lab import Row
from .patches import tile
from .progress import Progress
from .render import BACKGROUND
from .scene import Scene

__all__ = ["Tradeoff", "tradeoff"]

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: A mesh is taken as wound consistently if at least this share of what is seen shows its front, or its back.
CONSISTENT = 0.95

#: Rounds in which each evaluated eye is asked for its faces; medians are kept.
ASKED = 3

#: What a row says, and the words for it on an axis.
COSTS = {
    "bytes": "size of the file",
    "time": "time to bake",
    "query": "time of one answer",
    "drawn": "faces still drawn, of all",
}

#: One colour for each series of the chart, distinct to colour-blind readers (Okabe and Ito's set without its yellow).
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#555555")


def tradeoff(
    scene: Scene,
    views: Sequence[int] = (6, 18, 66, 258, 1026),
    patches: Sequence[int | None] = (None, 1000, 200),
    *,
    resolution: tuple[int, int] | Sequence[tuple[int, int]] = (510, 480),
    fill: str | Sequence[str | None] | None = "rays",
    join: str | Sequence[str] = "cells",
    eval_views: int = 100,
    seed: int = 0,
    progress: Progress = None,
    **options: Any,
) -> Tradeoff:
    """Bakes a scene in every combination, and measures what each takes and what it misses.

    Parameters
    ----------
    scene : Scene
    views : sequence of int
        Numbers of samples.
    patches : sequence of int or None
        Numbers of patches; None for a bit per face. A bake is shared by all of these.
    resolution : (int, int) or sequence of such
        Width and height of the images in pixels.
    fill, join : str or None, or sequence of such
        As for `bake`.
    eval_views : int
        Random views, uniform over directions, at the sampling radius, that the bakes are judged by. They are the same
        for all rows, and no bake learned from them.
    seed : int
        Of the evaluated views.
    progress : bool, callable or None
        One unit is one row.
    **options
        Passed on to `bake`.

    Returns
    -------
    Tradeoff
        In the order views, resolution, fill, join, patches, the last varying fastest.

    Raises
    ------
    ValueError
        If there is nothing to vary or to evaluate. A combination that `bake` refuses is a row with its `error`.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> chart = tradeoff(cyc.scenes.sphere(faces=320), views=[6, 18], patches=[None, 20], resolution=(96, 96),
    ...                  eval_views=5, progress=False)
    >>> [(row["views"], row["patches"]) for row in chart.rows]
    [(6, None), (6, 20), (18, None), (18, 20)]
    """
    if eval_views < 1:
        raise ValueError(f"eval_views must be at least 1, got {eval_views}")
    resolutions: list[Any] = [resolution] if isinstance(resolution[0], int | np.integer) else list(resolution)
    for size in resolutions:
        Framing.of(scene, size)
    grid: dict[str, Sequence[Any]] = {
        "views": views,
        "resolution": [tuple(size) for size in resolutions],
        "fill": [fill] if fill is None or isinstance(fill, str) else fill,
        "join": [join] if isinstance(join, str) else join,
        "patches": patches,
    }
    experiment = _Experiment(scene, eval_views, seed, options)
    rows = lab.sweep(grid, experiment.measure, progress=progress, desc="trade-off")
    return Tradeoff(rows, eval_views=eval_views, faces=len(scene))


@dataclass(frozen=True)
class _Test:
    """What is known of one size of evaluated images, for all its views."""

    eyes: Floats
    #: Faces nearest to a pixel, and how many pixels each has, for each view.
    owners: list[tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64]]]
    #: Faces seen, with those that own no pixel.
    seen: Flags
    #: Faces that turn their back to the eye; None where the mesh is not wound consistently.
    away: Flags | None


class _Experiment:
    def __init__(self, scene: Scene, eval_views: int, seed: int, options: Mapping[str, Any]) -> None:
        self.scene, self.options = scene, dict(options)
        directions = np.random.default_rng(seed).normal(size=(eval_views, 3))
        self.directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        self._labels: dict[int, tuple[npt.NDArray[np.uint32], float, str]] = {}
        self._tests: dict[tuple[int, int], _Test] = {}
        self._baked: tuple[tuple[Any, ...], Visibility, float] | None = None

    def measure(self, views: int, resolution: tuple[int, int], fill: str | None, join: str, patches: int | None) -> Row:
        vis, seconds = self._bake((views, resolution, fill, join))
        note = ""
        if patches is not None:
            labels, tiling, note = self._tile(patches)
            vis, joining = lab.elapsed(partial(vis.in_patches, labels))
            seconds += tiling + joining
        test = self._test(resolution)
        row: Row = {"time": seconds, "bytes": file_bytes(vis), **_judge(vis, test, len(self.scene))}
        if vis.patches is not None and vis.patches != patches:
            row["made_patches"] = vis.patches
        return row | ({"note": note} if note else {})

    def _bake(self, key: tuple[Any, ...]) -> tuple[Visibility, float]:
        if self._baked is None or self._baked[0] != key:
            views, resolution, fill, join = key
            self._baked = None
            make = partial(bake, self.scene, views, None, resolution, fill=fill, join=join, progress=False)
            vis, seconds = lab.elapsed(partial(make, **self.options))
            self._baked = key, vis, seconds
        return self._baked[1], self._baked[2]

    def _tile(self, count: int) -> tuple[npt.NDArray[np.uint32], float, str]:
        if count not in self._labels:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                divide = partial(tile, self.scene.vertices, self.scene.faces, count, progress=False)
                labels, seconds = lab.elapsed(divide)
            self._labels[count] = labels, seconds, "; ".join(str(warning.message) for warning in caught)
        return self._labels[count]

    def _test(self, resolution: tuple[int, int]) -> _Test:
        if resolution not in self._tests:
            fov_y = self.options.get("fov_y", 45.0)
            cameras = Framing.of(self.scene, resolution, fov_y).cameras(self.directions)
            owners = []
            for camera in cameras:
                ids = self.scene.render(camera).ids
                owners.append(np.unique(ids[ids != BACKGROUND], return_counts=True))
            seen = self.scene.visible(cameras, progress=False).unpack()
            eyes = np.array([camera.eye for camera in cameras])
            self._tests[resolution] = _Test(eyes, owners, seen, self._turned_away(eyes, seen))
        return self._tests[resolution]

    def _turned_away(self, eyes: Floats, seen: Flags) -> Flags | None:
        corners = (self.scene.vertices - self.scene.center)[self.scene.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        offsets = np.einsum("fc,fc->f", normals, corners[:, 0])
        front, back = np.empty_like(seen), np.empty_like(seen)
        for view, eye in enumerate(eyes - self.scene.center):
            side = normals @ eye - offsets
            front[view], back[view] = side > 0, side < 0
        fronts, backs = np.count_nonzero(seen & front), np.count_nonzero(seen & back)
        if fronts >= CONSISTENT * (fronts + backs):
            return ~front
        return ~back if backs >= CONSISTENT * (fronts + backs) else None


def _judge(vis: Visibility, test: _Test, size: int) -> Row:
    missed: list[float] = []
    drawn: list[float] = []
    false: list[float] = []
    backfacing: list[float] = []
    room = np.empty(size, dtype=np.uint32)
    for view, eye in enumerate(test.eyes):
        faces = vis.visible_faces(eye, out=room)
        answered = np.zeros(size, dtype=bool)
        answered[faces] = True
        ids, pixels = test.owners[view]
        missed.append(float(pixels[~answered[ids]].sum() / max(1, pixels.sum())))
        drawn.append(len(faces) / size)
        false.append(float(np.count_nonzero(answered & ~test.seen[view]) / max(1, len(faces))))
        if test.away is not None:
            backfacing.append(float(np.count_nonzero(~answered & test.away[view]) / size))
    views = [{"view": view} for view in range(len(test.eyes))]
    asked = lab.sweep(
        views,
        timed=lambda view: partial(vis.visible_faces, test.eyes[view], out=room),
        rounds=ASKED,
        errors="raise",
        progress=False,
    )
    low, high = bootstrap_interval(missed)
    bound = upper_mean(missed)
    culled = 1 - float(np.mean(drawn))
    away = float(np.mean(backfacing)) if backfacing else None
    return {
        "missed": float(np.mean(missed)),
        "missed_low": low,
        "missed_high": min(high, bound),
        "missed_bound": bound,
        "missed_worst": max(missed),
        "culled": culled,
        "backfacing": away,
        "occluded": None if away is None else max(culled - away, 0.0),
        "drawn": 1 - culled,
        "false": float(np.mean(false)),
        "query": statistics.median(row["time"] for row in asked),
    }


def file_bytes(vis: Visibility) -> int:
    """Size of the file that `vis.save` writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bake.npz"
        vis.save(path)
        return path.stat().st_size


@dataclass(frozen=True)
class Tradeoff:
    """The rows of a sweep over bakes, and what can be made of them.

    Attributes
    ----------
    rows : list of dict
        What was asked: `views`, `resolution`, `fill`, `join`, `patches` (and `made_patches`, where the mesh does not
        allow as many).
        What it takes: `time` in seconds for the bake and its patches (one run), `bytes` of the file, `query` in seconds
        for the faces of one eye (median), `drawn`, the share of the model's faces that is answered.
        What it misses: `missed`, mean share of covered pixels whose nearest face is not in the answer, with the ends of
        its 95 % interval `missed_low` and `missed_high` (bootstrap), `missed_bound` (holds for every distribution, and
        so is wide), and `missed_worst` over the views.
        What it culls: `culled` is 1 - `drawn`, of it `backfacing` and `occluded` (None for a mesh whose faces are
        wound inconsistently, of which no back can be culled); `false`, the share of answered faces that the view
        doesn't see.
        Or `error`, where the bake was refused.
    eval_views : int
        Views that each row was judged by.
    faces : int
        Of the scene.
    """

    rows: list[Row]
    eval_views: int
    faces: int

    def pareto(self, cost: str = "bytes") -> list[Row]:
        """Rows that no other beats in `cost` and `missed`; see `cyclorama.lab.pareto`."""
        return lab.pareto(self.rows, cost=cost, error="missed")

    def best(
        self,
        max_missed: float,
        *,
        minimise: str = "bytes",
        by: str = "missed_high",
        where: Callable[[Mapping[str, Any]], bool] | None = None,
    ) -> Row:
        """The cheapest row that misses no more than asked.

        Parameters
        ----------
        max_missed : float
            Share of covered pixels.
        minimise : str
            Which cost.
        by : str
            What must not exceed `max_missed`: the upper end of the interval of the mean, or any other of the figures
            of what is missed.
        where : callable, optional
            A further constraint: takes a row, says whether it will do.

        Raises
        ------
        ValueError
            If no row will do; the text says how near the best one came.
        """
        judged = [row for row in self.rows if by in row]
        try:
            return lab.best(
                judged, minimise=minimise, where=lambda row: row[by] <= max_missed and (where is None or where(row))
            )
        except ValueError as error:
            nearest = min((row[by] for row in judged), default=float("nan"))
            raise ValueError(f"no row has {by} <= {max_missed:g}; the least is {nearest:.3g}") from error

    def to_dataframe(self) -> Any:
        """The rows as a pandas DataFrame; needs pandas."""
        import pandas as pd

        return pd.DataFrame(self.rows)

    def __repr__(self) -> str:
        return f"<Tradeoff: {len(self.rows)} rows, {self.faces:,} faces, {self.eval_views} views each>\n{self.table()}"

    def table(self) -> str:
        """The rows as text: what was varied, and the main figures."""
        varied = [name for name in ("resolution", "fill", "join") if len({row[name] for row in self.rows}) > 1]
        figures = ["time", "bytes", "missed", "missed_high", "culled", "backfacing", "occluded", "false"]
        made = ["made_patches"] if any("made_patches" in row for row in self.rows) else []
        columns = ["views", "patches", *made, *varied, *figures]
        return lab.table(self.rows, columns + (["error"] if any("error" in row for row in self.rows) else []))

    def _repr_html_(self) -> str:
        head, _, *body = (line.strip("| ").split(" | ") for line in self.table().splitlines())
        rows = ["".join(f"<th>{html.escape(cell.strip())}</th>" for cell in head)]
        rows += ["".join(f"<td style='text-align:right'>{html.escape(c.strip())}</td>" for c in line) for line in body]
        caption = f"{self.faces:,} faces, {self.eval_views} random views for each row"
        return f"<table><caption>{caption}</caption>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"

    def plot(self, path: str | os.PathLike[str] | None = None, *, costs: Iterable[str] = ("bytes", "drawn")) -> Any:
        """Draws error against cost, a panel for each cost, with the Pareto front marked.

        Parameters
        ----------
        path : path, optional
            Where to write the picture; its suffix says the format. A notebook shows the returned figure itself.
        costs : iterable of str
            Of ``"bytes"``, ``"time"``, ``"query"`` and ``"drawn"``.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        ValueError
            If a cost is unknown, or no row has a figure to draw.
        ModuleNotFoundError
            If matplotlib is not installed.
        """
        chosen = list(costs)
        for cost in chosen:
            if cost not in COSTS:
                raise ValueError(f"{cost!r} is no cost: choose from {', '.join(COSTS)}")
        from . import charts

        return charts.draw(self, chosen, path)

    @cached_property
    def series(self) -> dict[str, list[Row]]:
        """The rows that differ only in their number of views, by what they share."""
        good = [row for row in self.rows if "error" not in row]
        varied = [name for name in ("resolution", "fill", "join") if len({row[name] for row in good}) > 1]
        found: dict[str, list[Row]] = {}
        for row in good:
            words = [
                "a bit per face" if row["patches"] is None else f"{row.get('made_patches', row['patches']):,} patches"
            ]
            words += [_said(name, row[name]) for name in varied]
            found.setdefault(", ".join(words), []).append(row)
        return found


def _said(name: str, value: Any) -> str:
    if name == "resolution":
        return f"{value[0]} x {value[1]}"
    return f"{name} {value if value is not None else 'none'}"
