"""Figures of plans: what they show is what frames draw."""

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.placement import figures
from peers import need


@pytest.fixture(scope="module")
def plan():
    return cyc.place_images(cyc.scenes.pipes(20_000), 9_000, progress=False)


def lines_of(figure):
    return {line.get_label(): np.asarray(line.get_ydata()) for line in figure.axes[0].get_lines()}


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (1, 2, 0)])
@pytest.mark.parametrize("steepest", [0.0, 20.0])
def test_a_walk_stays_inside_and_looks_where_it_goes(up, steepest):
    bounds = np.array([[-1, 5, 2], [3, 6, 9.0]])
    eyes, gazes = figures.walk(bounds, 400, seed=3, up=up, steepest=steepest)
    assert ((eyes >= bounds[0]) & (eyes <= bounds[1])).all()
    pitch = np.degrees(np.arcsin(gazes @ up / np.linalg.norm(up)))
    assert np.abs(pitch).max() <= steepest + 1e-9
    steps = np.roll(eyes, -1, axis=0) - np.roll(eyes, 1, axis=0)
    assert ((steps * gazes).sum(axis=1) > 0).mean() > 0.99
    assert np.linalg.norm(steps, axis=1).max() < 0.2 * np.linalg.norm(bounds[1] - bounds[0])
    np.testing.assert_array_equal(figures.walk(bounds, 400, seed=3, up=up, steepest=steepest)[0], eyes)


def test_a_path_never_crosses_the_budget_and_images_save(plan):
    path = figures.follow(plan, *figures.walk(plan.domain, 200, up=plan.up))
    assert path.drawn.max() <= plan.budget < path.alone.max()
    assert (path.drawn <= path.alone).all()
    np.testing.assert_array_equal(path.image >= 0, path.alone > plan.budget)
    np.testing.assert_array_equal(np.isnan(path.distance), path.image < 0)
    np.testing.assert_array_equal(path.drawn[path.image < 0], path.alone[path.image < 0])


def test_the_path_chart_shows_it(plan, tmp_path):
    need("matplotlib")
    eyes, gazes = figures.walk(plan.domain, 60, up=plan.up)
    shown = lines_of(figures.chart_path(plan, eyes, gazes, path=tmp_path / "path.png"))
    path = figures.follow(plan, eyes, gazes)
    np.testing.assert_array_equal(shown["frustum culling alone"], path.alone)
    np.testing.assert_array_equal(shown["with images"], path.drawn)
    assert (shown["budget, 9,000"] == 9_000).all()
    assert (tmp_path / "path.png").stat().st_size > 1000


def test_bars_are_of_all_viewpoints_and_points_of_frames_with_an_image(plan):
    need("matplotlib")
    assert figures.images_of_viewpoints(plan).sum() == len(plan.images)
    bars = figures.chart_images_of_viewpoints(plan).axes[0].patches
    assert sum(bar.get_height() for bar in bars) == len(plan.viewpoints)
    points = lines_of(figures.chart_targets(plan, frames=50))["frames"]
    assert 0 < len(points) <= 50
    assert (points <= plan.budget).all()
