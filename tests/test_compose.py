"""Pictures laid over one another, against the same rule in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import BACKGROUND, Camera
from cyclorama.compose import Canvas, entered

#: Few values, so that depths are often equal; infinity is nothing.
DEPTHS = np.array([0.5, 1.0, 1.004, 1.01, 2.0, np.inf], np.float32)


def oracle(canvas, layer, at, label, scale, names, twice):
    """The rule, array by array: what is shown is strictly nearer than what is there, by half a percent if that is in
    both; holes are where the ray comes into the space of the layer first, and it is not known what it shows."""
    color, depth, ids, hole, shown_layer = (array.copy() for array in canvas)
    y, x = at
    height, width = layer["depth"].shape
    part = np.s_[y : y + height, x : x + width]
    limit = depth[part].copy()
    if twice is not None:
        known = np.append(twice, False)[np.minimum(ids[part], len(twice))]
        limit[known] *= np.float32(0.995)
    before = layer["depth"] if layer["before"] is None else layer["before"]
    shown = before * np.float32(scale) < limit
    unknown = np.zeros((height, width), bool) if layer["hole"] is None else layer["hole"]
    if layer["within"] is not None:
        shown &= layer["within"]
        hole[part] |= unknown & layer["within"] & ~shown
    hole[part][shown] = unknown[shown]
    if layer["color"] is not None:
        color[part][shown] = layer["color"][shown]
    new = np.full((height, width), BACKGROUND) if layer["ids"] is None else layer["ids"].copy()
    if names is not None:
        there = new != BACKGROUND
        new[there] = names[new[there]]
    ids[part][shown], depth[part][shown] = new[shown], (layer["depth"] * np.float32(scale))[shown]
    shown_layer[part][shown] = label
    return (color, depth, ids, hole, shown_layer), int(shown.sum())


def some_ids(rng, shape, faces):
    ids = rng.integers(0, faces + 1, shape).astype(np.uint32)
    ids[ids == faces] = BACKGROUND
    return ids


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), tall=st.booleans())
def test_layers_follow_the_rule(seed, tall):
    rng = np.random.default_rng(seed)
    # Tall pictures are cut between threads.
    height, width = (int(rng.integers(130, 200)), 3) if tall else rng.integers(1, 12, 2).tolist()
    shape = (height, width)
    canvas = (
        rng.integers(0, 256, (*shape, 3), np.uint8),
        rng.choice(DEPTHS, shape),
        some_ids(rng, shape, 9),
        rng.random(shape) < 0.2,
        rng.integers(-1, 3, shape, np.int32),
    )
    h, w = int(rng.integers(1, height + 1)), int(rng.integers(1, width + 1))
    at = int(rng.integers(0, height - h + 1)), int(rng.integers(0, width - w + 1))
    maybe = iter(rng.random(7) < 0.6)
    layer = {
        "depth": rng.choice(DEPTHS, (h, w)),
        "before": rng.choice(DEPTHS, (h, w)) if next(maybe) else None,
        "color": rng.integers(0, 256, (h, w, 3), np.uint8) if next(maybe) else None,
        "ids": some_ids(rng, (h, w), 5) if next(maybe) else None,
        "hole": rng.random((h, w)) < 0.4 if next(maybe) else None,
        "within": rng.random((h, w)) < 0.7 if next(maybe) else None,
    }
    names = rng.integers(0, 100, 5).astype(np.uint32) if next(maybe) else None
    twice = rng.random(9) < 0.5 if next(maybe) else None
    scale = float(rng.choice([1.0, 0.5, 1.7]))
    expected, count = oracle(canvas, layer, at, 8, scale, names, twice)
    color, depth, ids, hole, shown = (array.copy() for array in canvas)
    found = Canvas(color, depth, ids, shown, hole).lay(label=8, at=at, scale=scale, names=names, twice=twice, **layer)
    assert found == count
    for one, two in zip((color, depth, ids, hole, shown), expected, strict=True):
        np.testing.assert_array_equal(one, two)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_rays_enter_a_space_where_points_along_them_do(seed):
    rng = np.random.default_rng(seed)
    camera = Camera.look_at(rng.normal(size=3), rng.normal(size=3), width=7, height=5, fov_y=70)
    low = rng.normal(size=3) - 0.5
    high = low + rng.uniform(0.2, 2, 3)
    box = np.vstack([np.column_stack([np.eye(3), -low]), np.column_stack([-np.eye(3), high])])
    near = float(rng.choice([0.0, rng.uniform(0, 2)]))
    depth = rng.uniform(0, 3, (5, 7)).astype(np.float32)
    found = entered(box, camera, depth, near)
    _, rays = camera.rays()
    steps = np.linspace(0, 3, 1500)
    points = camera.eye + steps[:, None, None, None] * rays
    inside = ((points >= low) & (points <= high)).all(axis=-1) & (steps[:, None, None] >= near)
    first = np.where(inside.any(axis=0), steps[inside.argmax(axis=0)], np.inf)
    # A step is as much as the points can't tell.
    step = steps[1]
    assert found[first < depth].all()
    unclear = (np.abs(first - depth) <= step) | (inside.sum(axis=0) == 0)
    assert not found[(first >= depth) & ~unclear].any()
    grown = ((points >= low - 4 * step) & (points <= high + 4 * step)).all(axis=-1).any(axis=0)
    assert not found[~grown].any()


def test_a_ray_along_a_side_is_inside_or_not():
    camera = Camera.look_at((0, 0, 2), (0, 0, 0), width=3, height=1, fov_y=40)
    depth = np.full((1, 3), 9, np.float32)
    for offset, inside in ((0.5, True), (-0.5, False)):
        # Parallel to the ray in the middle.
        assert entered(np.array([[1.0, 0, 0, offset]]), camera, depth)[0, 1] == inside


def test_a_canvas_shows_two_renders_as_one_of_both():
    scene = cyc.scenes.pipes(3_000)
    camera = Camera.look_at(scene.center + (0, 0, 2.5), scene.center, width=80, height=60)
    half = np.arange(len(scene) // 2, dtype=np.uint32)
    one, two = scene.render(camera, half), scene.render(camera, half + len(half))
    whole = scene.render(camera, np.concatenate([half, half + len(half)]))
    canvas = Canvas(one.color.copy(), one.depth, one.ids, np.zeros(one.ids.shape, np.int32))
    assert canvas.lay(two.depth, 1, color=two.color, ids=two.ids) == (canvas.layer == 1).sum() > 100
    np.testing.assert_array_equal(canvas.depth, whole.depth)
    # Coincident faces may be told from either.
    assert (canvas.ids == whole.ids).mean() > 0.999 and (canvas.color == whole.color).mean() > 0.999


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"at": (1, 0)}, r"3 x 2 pixels at column 0 and row 1 is not inside of the canvas of 3 x 2"),
        ({"before": np.zeros((1, 3), np.float32)}, "before has 3 pixels, depth 6"),
        ({"ids": np.full((2, 3), 4, np.uint32), "names": np.zeros(4, np.uint32)}, "names face 4 at pixel 0"),
        ({"color": np.zeros((2, 4, 3), np.uint8)}, "color has 8 pixels, depth 6"),
    ],
)
def test_layers_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Canvas.empty(2, 3).lay(np.zeros((2, 3), np.float32), 1, **changes)
