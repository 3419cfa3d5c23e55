"""The complexity model of section 3.5 against its printed formulas, SciPy's integral and a random scene."""

import math

import numpy as np
import pytest
from scipy.integrate import tplquad

from cyclorama import placement
from cyclorama.placement import prediction
from cyclorama.placement.prediction import images_at, mean_images, predict

TAN_30 = math.tan(math.radians(30))


@pytest.mark.parametrize("rho", [0.1, 0.15, 0.25, 0.5])
def test_printed_forms_are_the_dissertation_s_at_60_degrees(rho):
    delta = rho / 5
    found = predict(10_000_000, round(rho * 1e7), round((rho - delta) * 1e7), aspect=1, leaf_cells=1000, lookahead=3)
    one = found.case("best", "printed")
    m = [math.pi / math.atan(3 * math.sqrt(3) * delta / math.sqrt(2) * i) for i in (1, 2, 3, 4)]
    assert one.viewpoints == pytest.approx(12 / rho)
    assert one.images == pytest.approx(12 / rho * m[0])
    assert found.case("best", "integral").images == pytest.approx(12 / rho * mean_images(delta, TAN_30))
    assert found.case("worst", "printed").images == pytest.approx(12 * 99 / rho)
    average = found.case("average", "printed")
    assert average.viewpoints == pytest.approx(25 / rho)
    assert average.images == pytest.approx(sum(12 / rho / i * m[i - 1] for i in (1, 2, 3, 4)))
    assert one.cells == pytest.approx(8 * math.sqrt(2) / 9 * 1000)
    assert one.optimizing == pytest.approx(5**4 * math.log2(one.cells))
    assert one.adapting == pytest.approx(one.viewpoints * 2000 * one.cells)
    assert one.steps == pytest.approx(one.adapting + one.images * one.optimizing)


def test_corrected_forms_have_the_margin_the_volume_and_no_more_cells_than_there_are():
    found = predict(1_000_000, 200_000, 150_000, aspect=1, leaf_cells=4096)
    for scenario, own in (("best", 60), ("average", 60), ("worst", 99 * 60)):
        case = found.case(scenario)
        assert case.viewpoints == pytest.approx((own ** (1 / 3) + 4) ** 3)
        assert case.cells == 4096
    assert found.case("best", "printed").cells > 4096
    coarse = predict(1_000_000, 999_999, 150_000, aspect=1)
    assert coarse.case("best").viewpoints == pytest.approx(7**3)
    even = predict(1_000_000, 200_000, 150_000, subsets=[(0.5, 1.0), (0.5, 1.0)], aspect=1)
    # Twice as much of a subset of half the primitives fits the room: about half as many images a viewpoint.
    assert even.case("average").images == pytest.approx(found.case("best").images / 2, rel=0.05)


def test_one_even_subset_is_the_best_case():
    found = predict(1_000_000, 200_000, subsets=[(1.0, 1.0)])
    assert found.optimize_to == 160_000
    for form in ("printed", "corrected"):
        best, average = found.case("best", form), found.case("average", form)
        assert (average.viewpoints, average.images) == pytest.approx((best.viewpoints, best.images))


@pytest.mark.parametrize("delta", [0.01, 0.1, 0.5])
def test_the_mean_of_m_is_the_integral_of_the_dissertation(delta):
    """8 times the integral over an octant of K = cube root of N over 2, over N: in units of K."""
    n = 60.0
    k = n ** (1 / 3) / 2

    def m(x, y, z):
        height = math.sqrt((1 - x / (2 * k)) ** 2 + (1 - y / (2 * k)) ** 2 + (1 - z / (2 * k)) ** 2)
        return float(images_at(height, delta, TAN_30))

    total, error = tplquad(m, 0, k, 0, k, 0, k, epsrel=1e-5)
    assert mean_images(delta, TAN_30) == pytest.approx(8 * total / n, rel=1e-5 + 8 * error / n)


def test_the_frustum_of_an_even_scene_holds_what_the_formula_says(rng):
    """N is 27 / R^3: a pyramid of that height, inside a scene of random points, holds the budget."""
    points = rng.random((400_000, 3))
    tan_x, tan_y, rho = 0.577, 0.433, 0.02
    height = (27 / prediction.viewpoints_of(rho, tan_x, tan_y)) ** (1 / 3)
    x, y, z = (points - [0.5, 0.5, 0.1]).T
    inside = (z > 0) & (z < height) & (abs(x) < tan_x * z) & (abs(y) < tan_y * z)
    expected = rho * len(points)
    assert abs(inside.sum() - expected) < 5 * math.sqrt(expected)


def test_more_budget_needs_fewer_images_and_more_room_fewer_a_viewpoint():
    images = [
        predict(1_000_000, b, b - 50_000).case(s, f).images
        for s in ("best", "worst")
        for f in ("printed", "corrected")
        for b in (100_000, 200_000, 400_000)
    ]
    assert all(a > b > c for a, b, c in np.reshape(images, (4, 3)))
    means = [mean_images(d, TAN_30) for d in (0.01, 0.1, 0.5, 1)]
    assert means == sorted(means, reverse=True)
    assert means[-1] > 2


def test_a_prediction_reads_as_a_table():
    text = str(placement.predict(1_000_000, 200_000, 150_000))
    assert text.startswith("1,000,000 primitives, at most 200,000 drawn, images placed for 150,000\n60 degrees wide")
    assert text.count("printed") == text.count("corrected") == 3 * text.count("integral") == 3
    with pytest.raises(ValueError, match="no case is 'median', 'corrected'"):
        placement.predict(10, 5).case("median")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"budget": 0}, "budget must be above 0 and below the 1000 primitives, got 0"),
        ({"budget": 1000}, "budget must be above 0 and below"),
        ({"optimize_to": 100}, "optimize_to must be above 0 and below the budget of 100, got 100"),
        ({"fov_x": 180}, "fov_x must be between 0 and 180 degrees, got 180"),
        ({"aspect": 0}, "aspect must be positive"),
        ({"leaf_cells": 0}, "leaf_cells must be at least 1"),
        ({"lookahead": -1}, "lookahead must be at least 0"),
        ({"subsets": [(0.5, 1.0)]}, "add up to 0.5, not 1"),
        ({"subsets": [(1.0, 0.0)]}, r"subsets\[0\] is"),
        ({"cluster": 0.5}, "cluster must be at least 1"),
    ],
)
def test_what_is_out_of_range_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        predict(**{"primitives": 1000, "budget": 100} | arguments)


def test_the_figures_have_the_curves_and_what_was_placed(tmp_path):
    pytest.importorskip("matplotlib", reason="needs matplotlib to draw")
    figure = prediction.chart_images([(1_000_000, 200_000, 331)], path=tmp_path / "3-16.png")
    curves = {line.get_label(): line for line in figure.axes[0].get_lines()}
    assert curves["placed"].get_ydata()[0] == 331e-6
    low, middle, high = (np.asarray(curves[f"{s}, printed"].get_ydata()) for s in ("best", "average", "worst"))
    assert ((low < middle) & (low < high)).all()
    assert curves["best, corrected"].get_ydata()[0] < curves["worst, corrected"].get_ydata()[0]
    figure = prediction.chart_images_per_viewpoint([(0.05, 1.3)], path=tmp_path / "3-18.svg")
    assert figure.axes[0].get_lines()[-1].get_ydata()[0] == 1.3
    assert {path.name for path in tmp_path.iterdir()} == {"3-16.png", "3-18.svg"}
