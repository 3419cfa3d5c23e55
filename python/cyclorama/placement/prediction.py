"""How many images a budget asks for, and how much work they are, before any is placed (section 3.5 of the
dissertation).

The model is a unit cube with `primitives` spread evenly, or into one point, or in shares of its volume. All counts come
*printed*, as the dissertation simplifies them, with half the diagonal of a side for H, and *corrected*. The best case
also comes as its *integral*, I_total, where H is each viewpoint's distance to the farthest corner. What is corrected:

- N: the proof needs two rings of viewpoints around the model's own (section 3.2), so that n^3 becomes (n + 4)^3, and n
is at least 3;
  the frustum's pyramid has a width and a height.
- M: the pyramid of new primitives is as high as the frustum, not as wide.
- The average case: each subset has viewpoints only in its share of the volume. The printed N of its example add up to
  25 / rho, above the best case's 12 / rho.
- L: the printed bound is 1.26 T at 60 degrees; no more than all T cells can be in view.

The corrected counts still are a model, and far from what is placed: in it all viewpoints have one radius, no image can
be used by no eye, and every turn brings new primitives as if the frustum began empty. I_total is farther still, as its
H counts what lies beyond the model's sides.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import charts, lab

__all__ = ["AVERAGE", "Case", "Prediction", "chart_images", "chart_images_per_viewpoint", "predict"]

#: The example of section 3.5.1.3: shares of the primitives, and of the volume that each is spread over.
AVERAGE = ((0.25, 0.25), (0.25, 0.5), (0.25, 0.75), (0.25, 1.0))

#: How many times as dense as the whole the cluster of the worst case is (section 3.5.1.2).
CLUSTER = 99.0

#: Rings of viewpoints around the model that the proof needs, on both sides of each axis.
MARGIN = 4

# An even star-shape is three viewpoints across (section 3.2).
_ACROSS = 3

# Points of the integral along each axis of an octant: Gauss-Legendre, exact to 1e-6 for a function as smooth as M.
_NODES = 12


@dataclass(frozen=True)
class Case:
    """One scenario in one form."""

    #: "best", "average" or "worst"; "printed", "corrected", or of the best case "integral".
    scenario: str
    form: str
    #: N, M (its mean over all viewpoints) and their product.
    viewpoints: float
    images_per_viewpoint: float
    images: float
    #: L, of T leaf cells; N V L steps to adapt the grid; 5^(Q+1) log2 L for each image; the two together.
    cells: float
    adapting: float
    optimizing: float
    steps: float


@dataclass(frozen=True)
class Prediction:
    """What section 3.5 expects of a budget; `str` is a table of it."""

    primitives: int
    budget: int
    optimize_to: int
    fov_x: float
    aspect: float
    leaf_cells: int
    views: int
    lookahead: int
    cases: tuple[Case, ...]

    def case(self, scenario: str, form: str = "corrected") -> Case:
        """One of them.

        Raises
        ------
        ValueError
            If there is none of that name.
        """
        for case in self.cases:
            if (case.scenario, case.form) == (scenario, form):
                return case
        raise ValueError(
            f"no case is {scenario!r}, {form!r}: the cases are {[(one.scenario, one.form) for one in self.cases]}"
        )

    def rows(self) -> list[lab.Row]:
        """The cases as rows: N, M, images, L, the steps."""
        return [
            {
                "scenario": case.scenario,
                "form": case.form,
                "N": case.viewpoints,
                "M": case.images_per_viewpoint,
                "images": case.images,
                "L": case.cells,
                "N V L": case.adapting,
                "5^(Q+1) log L": case.optimizing,
                "steps": case.steps,
            }
            for case in self.cases
        ]

    def __str__(self) -> str:
        head = (
            f"{self.primitives:,} primitives, at most {self.budget:,} drawn, images placed for {self.optimize_to:,}\n"
            f"{self.fov_x:g} degrees wide, aspect {self.aspect:.3g}; T = {self.leaf_cells:,} leaf cells, "
            f"V = {self.views:,} views a viewpoint, Q = {self.lookahead}"
        )
        return f"{head}\n\n{lab.table(self.rows())}"


def predict(
    primitives: int,
    budget: int,
    optimize_to: int | None = None,
    *,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    leaf_cells: int = 8**5,
    views: int | None = None,
    lookahead: int = 2,
    subsets: Sequence[tuple[float, float]] = AVERAGE,
    cluster: float = CLUSTER,
) -> Prediction:
    """Viewpoints, images and steps that a budget is expected to need.

    Parameters
    ----------
    primitives : int
        P_total.
    budget : int
        P, the most that is drawn, below `primitives`.
    optimize_to : int, optional
        P_opt, what images are placed for, below `budget`; by default 0.8 of it. The difference is D.
    fov_x : float
        Horizontal field of view in degrees, below 180.
    aspect : float
        Width over height of the frustum. The printed forms have a square one of `fov_x` both ways.
    leaf_cells : int
        T: by default, those of an octree of depth 5.
    views : int, optional
        V, views a viewpoint with a different set of cells: by default 2 T, as each cell comes and goes once in a turn.
    lookahead : int
        Q, how many steps the optimiser looks ahead.
    subsets : sequence of (float, float)
        For the average case: shares of the primitives, which add up to 1, and of the volume that each is spread over.
    cluster : float
        For the worst case: how many times as dense as the whole the cluster is.

    Returns
    -------
    Prediction
        Best, average and worst cases, printed and corrected.

    Raises
    ------
    ValueError
        If a value is out of range.

    Notes
    -----
    The dissertation prints N and M for a square field of 60 degrees: ``12 / rho`` and ``pi / atan(3 sqrt(3) delta /
    sqrt(2))``. The printed form here is that for any field of view.

    Examples
    --------
    >>> prediction = predict(1_000_000, 200_000, 150_000, aspect=1)
    >>> round(prediction.case("best", "printed").viewpoints)
    60
    >>> round(prediction.case("average", "printed").viewpoints), round(prediction.case("average").viewpoints)
    (125, 496)
    """
    _check(primitives, budget, optimize_to, fov_x, aspect, leaf_cells, views, lookahead, subsets, cluster)
    goal = round(0.8 * budget) if optimize_to is None else optimize_to
    turns = 2 * leaf_cells if views is None else views
    rho, delta = budget / primitives, (budget - goal) / primitives
    tan_x = math.tan(math.radians(fov_x) / 2)
    tan_y = tan_x / aspect
    square = 8 * math.sqrt(2) / 3 * tan_x**2 * leaf_cells
    seen = min(8 * math.sqrt(2) / 3 * tan_x * tan_y, 1.0) * leaf_cells
    cases = []

    def add(scenario: str, form: str, viewpoints: float, images: float, cells: float) -> None:
        adapting = viewpoints * turns * cells
        optimizing = 5.0 ** (lookahead + 1) * math.log2(max(2.0, cells))
        steps = adapting + images * optimizing
        cases.append(Case(scenario, form, viewpoints, images / viewpoints, images, cells, adapting, optimizing, steps))

    half = math.sqrt(2) / 2
    density = [count / volume for count, volume in subsets]
    own = viewpoints_of(rho, tan_x, tan_x)
    add("best", "printed", own, own * float(images_at(half, delta, tan_x)), square)
    add("best", "integral", own, own * mean_images(delta, tan_x), square)
    wide = with_margin(viewpoints_of(rho, tan_x, tan_y))
    add("best", "corrected", wide, wide * float(images_at(half, delta, tan_y)), seen)
    parts = [(own * d, own * d * float(images_at(half, delta / d, tan_x))) for d in density]
    add("average", "printed", sum(n for n, _ in parts), sum(i for _, i in parts), square)
    mean = sum(count * float(images_at(half, delta * volume / count, tan_y)) for count, volume in subsets)
    add("average", "corrected", wide, wide * mean, seen)
    own = viewpoints_of(rho / cluster, tan_x, tan_x)
    add("worst", "printed", own, own, square)
    wide = with_margin(viewpoints_of(rho / cluster, tan_x, tan_y))
    add("worst", "corrected", wide, wide, seen)
    return Prediction(primitives, budget, goal, fov_x, aspect, leaf_cells, turns, lookahead, tuple(cases))


def viewpoints_of(rho: float, tan_x: float, tan_y: float) -> float:
    """N of a unit cube, as printed: 27 / R^3, where the pyramid of height R holds a share rho of an even scene.

    Examples
    --------
    >>> tan = math.tan(math.radians(30))
    >>> round(viewpoints_of(0.2, tan, tan), 6)
    60.0
    """
    return 36 * tan_x * tan_y / rho


def with_margin(viewpoints: float) -> float:
    """N with the rings around the model, at least 7^3.

    Examples
    --------
    >>> round(with_margin(8))
    343
    """
    return float(max(_ACROSS, math.cbrt(viewpoints)) + MARGIN) ** 3


def images_at(height: npt.ArrayLike, delta: float, tan_y: float) -> npt.NDArray[np.float64]:
    """M where the pyramid of new primitives reaches `height`: turns of 2 beta in a whole one, that each bring a share
    delta.

    Examples
    --------
    >>> simplified = math.pi / math.atan(3 * math.sqrt(3) * 0.1 / math.sqrt(2))
    >>> math.isclose(images_at(math.sqrt(2) / 2, 0.1, math.tan(math.radians(30))), simplified)
    True
    """
    tangent = 3 * delta / (4 * np.asarray(height, dtype=np.float64) ** 3 * tan_y)
    return np.asarray(math.pi / np.arctan(tangent))


def mean_images(delta: float, tan_y: float) -> float:
    """The mean of M over the viewpoints of a unit cube, each with the distance to its farthest corner for H.

    The dissertation's triple integral, I_total, is N times this.
    """
    points, weights = np.polynomial.legendre.leggauss(_NODES)
    reach = np.square(1 - (points + 1) / 4)
    height = np.sqrt(reach[:, None, None] + reach[:, None] + reach)
    weight = weights[:, None, None] * weights[:, None] * weights / 8
    return float((images_at(height, delta, tan_y) * weight).sum())


def _check(
    primitives: int,
    budget: int,
    optimize_to: int | None,
    fov_x: float,
    aspect: float,
    leaf_cells: int,
    views: int | None,
    lookahead: int,
    subsets: Sequence[tuple[float, float]],
    cluster: float,
) -> None:
    if not 0 < budget < primitives:
        raise ValueError(f"budget must be above 0 and below the {primitives} primitives, got {budget}")
    if optimize_to is not None and not 0 < optimize_to < budget:
        raise ValueError(f"optimize_to must be above 0 and below the budget of {budget}, got {optimize_to}")
    if not 0 < fov_x < 180:
        raise ValueError(f"fov_x must be between 0 and 180 degrees, got {fov_x}")
    if not 0 < aspect < math.inf:
        raise ValueError(f"aspect must be positive, got {aspect}")
    for name, value, least in (("leaf_cells", leaf_cells, 1), ("views", views, 1), ("lookahead", lookahead, 0)):
        if value is not None and value < least:
            raise ValueError(f"{name} must be at least {least}, got {value}")
    for k, (count, volume) in enumerate(subsets):
        if not (0 < count <= 1 and 0 < volume <= 1):
            raise ValueError(f"subsets[{k}] is ({count}, {volume}): both are shares, above 0 and at most 1")
    if not math.isclose(sum(count for count, _ in subsets), 1):
        raise ValueError(f"the subsets' shares of the primitives add up to {sum(c for c, _ in subsets):g}, not 1")
    if not 1 <= cluster < math.inf:
        raise ValueError(f"cluster must be at least 1, as dense as the whole, got {cluster}")


def chart_images(
    placed: Iterable[tuple[int, int, int]] = (),
    *,
    delta: float = 0.05,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    primitives: int = 1_000_000,
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """Figure 3-16: images against the budget, as predicted and as placed.

    Parameters
    ----------
    placed : iterable of (int, int, int)
        Primitives, budget and images of plans.
    delta : float
        (P - P_opt) / P_total of the predictions.
    fov_x, aspect
        As for `predict`.
    primitives : int
        What the predicted images are divided by.
    path : path-like, optional
        A picture to write.

    Returns
    -------
    matplotlib.figure.Figure
        Along x the budget in percent of the primitives, along y images over primitives.
    """
    shares = np.linspace(max(0.02, delta + 0.005), 0.5, 60)
    found = [
        predict(primitives, round(share * primitives), round((share - delta) * primitives), fov_x=fov_x, aspect=aspect)
        for share in shares
    ]
    series: dict[str, tuple[npt.ArrayLike, npt.ArrayLike]] = {
        f"{scenario}, {form}": (100 * shares, [one.case(scenario, form).images / primitives for one in found])
        for scenario in ("worst", "average", "best")
        for form in ("printed", "corrected")
    }
    marks = [(100 * budget / every, images / every) for every, budget, images in placed]
    if marks:
        series["placed"] = ([x for x, _ in marks], [y for _, y in marks])
    return charts.lines(
        series,
        x="budget, % of the primitives",
        y="images over primitives",
        title="What a budget costs (figure 3-16)",
        log="y",
        points=("placed",),
        path=path,
    )


def chart_images_per_viewpoint(
    placed: Iterable[tuple[float, float]] = (),
    *,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """Figure 3-18: images per viewpoint against D, as predicted and as placed.

    Parameters
    ----------
    placed : iterable of (float, float)
        (P - P_opt) / P_total and mean images per viewpoint of plans.
    fov_x, aspect
        As for `predict`.
    path : path-like, optional
        A picture to write.

    Returns
    -------
    matplotlib.figure.Figure
        Along x the difference of budget and what images are placed for, in percent of the primitives.
    """
    deltas = np.geomspace(0.002, 1, 100)
    tan_x = math.tan(math.radians(fov_x) / 2)
    series: dict[str, tuple[npt.ArrayLike, npt.ArrayLike]] = {
        "printed": (100 * deltas, [float(images_at(math.sqrt(2) / 2, d, tan_x)) for d in deltas]),
        "corrected": (100 * deltas, [float(images_at(math.sqrt(2) / 2, d, tan_x / aspect)) for d in deltas]),
        "mean of I_total": (100 * deltas, [mean_images(d, tan_x) for d in deltas]),
    }
    marks = list(placed)
    if marks:
        series["placed"] = ([100 * d for d, _ in marks], [m for _, m in marks])
    return charts.lines(
        series,
        x="budget less what images are placed for, % of the primitives",
        y="images per viewpoint",
        title="Images per viewpoint (figure 3-18)",
        log="y",
        points=("placed",),
        path=path,
    )
