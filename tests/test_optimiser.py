"""Optimisers of an image against all 6-tuples of borders; the plans made with them."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import placement

ACROSS = np.tan(np.radians(30))
SEARCHES = [
    {"search": "paper", "lookahead": 0},
    {"search": "paper", "lookahead": 2},
    {"search": "paper", "keep": "best"},
    {"search": "annealing", "steps": 300},
    {"search": "windows", "gap": 0.0, "most": 10**6},
]


def borders(low, high):
    """Left, right, bottom, top at depth 1 and depth of boxes before an eye at zero that looks along -z."""
    corners = np.stack([np.where([k & 1, k & 2, k & 4], high, low) for k in range(8)], axis=1)
    x, y = corners[..., 0] / -corners[..., 2], corners[..., 1] / -corners[..., 2]
    return np.stack([x.min(1), x.max(1), y.min(1), y.max(1), -high[:, 2]], axis=1)


def value(rows, counts, total, axis):
    """The dissertation's formula, of the cells with these borders."""
    width, height = np.ptp(rows[:, :2]), np.ptp(rows[:, 2:4])
    size = np.clip(1 - max(width, height) / (2 * ACROSS), 0, 1)
    depth = min(rows[:, 4].min() / axis, 1)
    return 0.6 * (0.2 * size + 0.8 * depth) + 0.4 * counts.sum() / total


def best_of_all(rows, counts, target, axis):
    total = counts.sum()
    found = -1.0
    for limits in itertools.product(*(np.unique(rows[:, k]) for k in range(5))):
        left, right, bottom, top, near = limits
        inside = (rows[:, 0] >= left) & (rows[:, 1] <= right) & (rows[:, 2] >= bottom) & (rows[:, 3] <= top)
        inside &= rows[:, 4] >= near
        if inside.any() and counts[~inside].sum() <= target:
            found = max(found, value(rows[inside], counts[inside], total, axis))
    return found


def cells_in_view(rng, count):
    depth = rng.uniform(1, 8, count)
    low = np.stack([rng.uniform(-0.4, 0.4, count) * depth, rng.uniform(-0.3, 0.3, count) * depth, -depth], axis=1)
    return low, low + rng.uniform(0, 0.2, (count, 3)), rng.integers(1, 50, count)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.9))
def test_no_search_beats_all_tuples_and_windows_finds_their_best(seed, share):
    low, high, counts = cells_in_view(np.random.default_rng(seed), 5)
    target, rows = int(share * counts.sum()), borders(low, high)
    best = best_of_all(rows, counts, target, 10.0)
    for options in SEARCHES:
        found = placement.optimise(low, high, counts, (0, 0, 0), (0, 0, -1), target=target, axis=10.0, **options)
        assert found.remaining == counts.sum() - counts[found.cells].sum() <= target
        assert found.value == pytest.approx(
            value(rows[found.cells], counts[found.cells], counts.sum(), 10.0), abs=1e-12
        )
        assert found.value <= best + 1e-12 and found.bound >= best - 1e-12
    # The last of them, with no gap: extents are halved down to neighbouring numbers.
    assert found.value == pytest.approx(best, abs=1e-9) and found.bound == pytest.approx(best, abs=1e-9)


def test_the_quadrilateral_is_the_outline_of_the_cells():
    low, high, counts = cells_in_view(np.random.default_rng(2), 40)
    found = placement.optimise(low, high, counts, (0, 0, 0), (0, 0, -1), target=int(counts.sum() / 2))
    rows = borders(low, high)[found.cells]
    left, right, bottom, top = rows[:, 0].min(), rows[:, 1].max(), rows[:, 2].min(), rows[:, 3].max()
    corners = found.near * np.array([[left, top, -1], [right, top, -1], [right, bottom, -1], [left, bottom, -1]])
    np.testing.assert_allclose(found.corners, corners, atol=1e-12)
    assert found.near == pytest.approx(rows[:, 4].min()) and found.far == pytest.approx(-low[found.cells, 2].min())
    lists = borders(low, high)
    places = [np.searchsorted(np.unique(lists[:, k]), v) for k, v in enumerate((left, right, bottom, top))]
    np.testing.assert_array_equal(found.borders[:4], places)


def test_coincident_borders_move_as_one():
    # Two rows of equal boxes: each row has one near, one top and one bottom border.
    x = np.arange(-2, 2) * 0.5
    low = np.array([[a, -0.5, z] for z in (-5.0, -8.0) for a in x])
    found = placement.optimise(
        low, low + 0.5, np.ones(8, int), (0, 0, 0), (0, 0, -1), target=4, axis=20.0, search="paper"
    )
    assert found.borders[4] == 1 and found.cells.tolist() == [4, 5, 6, 7]


def test_nearest_keeps_images_beyond_it():
    low, high, counts = cells_in_view(np.random.default_rng(4), 60)
    free, kept = (
        placement.optimise(low, high, counts, (0, 0, 0), (0, 0, -1), target=int(0.8 * counts.sum()), nearest=n)
        for n in (0.0, 5.0)
    )
    assert kept.near >= 5 and kept.value <= free.value + 0.001
    assert placement.optimise(low, high, counts, (0, 0, 0), (0, 0, -1), target=0, nearest=5.0) is None


def test_annealing_is_seeded():
    low, high, counts = cells_in_view(np.random.default_rng(5), 60)

    def anneal(seed):
        return placement.optimise(
            low, high, counts, (0, 0, 0), (0, 0, -1), target=300, search="annealing", steps=500, seed=seed
        )

    np.testing.assert_array_equal(anneal(3).cells, anneal(3).cells)


@pytest.fixture(scope="module")
def pipes():
    return cyc.scenes.pipes(20_000)


def test_pipes_meet_the_target_and_windows_meets_the_paper():
    cells = placement.cells(cyc.scenes.pipes(100_000), 5)
    rng = np.random.default_rng(0)
    views = met = 0
    for _ in range(12):
        yaw = rng.uniform(0, 2 * np.pi)
        viewpoint = (-1.5 * np.sin(yaw), rng.uniform(-0.5, 0.5), -1.5 * np.cos(yaw))
        view = (cells.low, cells.high, cells.counts, viewpoint, (np.sin(yaw), 0, np.cos(yaw)))
        target = 20_000
        paper = placement.optimise(*view, target=target, search="paper")
        if paper is None or paper.total <= 25_000:
            continue
        better = placement.optimise(*view, target=target, gap=0.02, most=60)
        views += 1
        met += paper.remaining >= 0.98 * target
        assert paper.remaining <= target and better.remaining <= target
        assert better.value >= paper.value and better.bound >= better.value
    assert views >= 5 and met >= 0.95 * views


@pytest.mark.parametrize("subdivide", ["solve", "count"])
def test_the_paper_s_plans_keep_the_budget(pipes, subdivide):
    plan = placement.place_on_grid(pipes, 10_000, leaf_depth=3, lookahead=0, star_shape="paper", subdivide=subdivide)
    checked = plan.check(frames=300, seed=1)
    assert checked["with image"] > 0 and 0 < checked["most drawn"] <= 10_000
    assert not any(checked[kind] for kind in ("no image", "over budget"))
    assert (plan.images.remaining <= 8_000).all() and (plan.images.yaw[:, 1] > plan.images.yaw[:, 0]).all()
    depth = np.einsum(
        "ij,ij->i", plan.images.corners[:, 0] - plan.viewpoints[plan.images.viewpoint], plan.images.forward
    )
    assert (depth > 0).all()


def test_the_paper_s_spheres_have_two_or_three_spacings(pipes):
    paper = placement.place_on_grid(pipes, 10_000, leaf_depth=3, lookahead=0, star_shape="paper")
    levels = paper.levels[paper.radii > 0]
    spacing = 1.0 / 2.0 ** np.ceil(levels / 2)
    side = float((paper.domain[1] - paper.domain[0]).max()) / 2
    np.testing.assert_allclose(paper.radii[paper.radii > 0], np.where(levels % 2, 3, 2) * spacing * side)


def test_threads_change_no_plan(pipes):
    one, two = (
        placement.place_on_grid(pipes, 10_000, leaf_depth=2, lookahead=0, star_shape="paper", threads=n) for n in (1, 2)
    )
    np.testing.assert_array_equal(one.viewpoints, two.viewpoints)
    for a, b in zip(one.images, two.images, strict=True):
        np.testing.assert_array_equal(a, b)


def test_impossible_budgets_say_where_and_what_would_do(pipes):
    with pytest.raises(ValueError, match=r"budget is 100: (at the viewpoint|the grid grew)"):
        placement.place_on_grid(pipes, 100, leaf_depth=2, star_shape="paper", max_viewpoints=400)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"budget": 0}, "budget must be positive"),
        ({"budget": 2_000}, "no less than the scene's"),
        ({"optimize_to": 600}, "optimize_to"),
        ({"image_fov": 50}, "image_fov"),
        ({"grid": (2, 3, 3)}, "grid"),
        ({"star_shape": "round"}, "star_shape"),
        ({"subdivide": "never"}, "subdivide"),
        ({"search": "random"}, "search"),
        ({"keep": "all"}, "keep"),
        ({"lookahead": 9}, "lookahead"),
        ({"weights": (0.2, 0.9, 0.6, 0.4)}, "weights"),
        ({"up": (0, 1, 1)}, "up"),
    ],
)
def test_bad_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        placement.place_on_grid(**({"scene": cyc.scenes.pipes(2_000), "budget": 500} | change))


def test_a_flat_scene_has_no_place_for_eyes():
    flat = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]])
    with pytest.raises(ValueError, match="the scene is flat"):
        placement.place_on_grid(flat, 1)
