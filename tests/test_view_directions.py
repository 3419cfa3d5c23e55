"""View-directions sets against plain NumPy, box by box."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import placement

UPS = [(1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, 1), (0, 0, -2)]


def gaze(yaw, up):
    """The forward vector of a yaw in degrees: from the axis after `up`, counter-clockwise about it."""
    axis = int(np.flatnonzero(up)[0])
    start = np.eye(3)[(axis + 1) % 3]
    up = np.asarray(up, float) / np.linalg.norm(up)
    return np.cos(np.radians(yaw)) * start + np.sin(np.radians(yaw)) * np.cross(up, start)


def in_view(low, high, eye, forward, up, fov_x, aspect):
    """Cells with some corner inside each of the four planes."""
    right = np.cross(forward, up) / np.linalg.norm(up)
    upward = np.cross(right, forward)
    across = np.tan(np.radians(fov_x / 2))
    planes = [right + across * forward, across * forward - right]
    planes += [upward + across / aspect * forward, across / aspect * forward - upward]
    corners = np.stack([np.where([k & 1, k & 2, k & 4], high, low) for k in range(8)], axis=1)
    return ((corners - eye) @ np.array(planes).T).max(axis=1).min(axis=1) >= 0


def random_cells(rng, count, flat=0.2):
    low = rng.uniform(-1, 1, (count, 3))
    size = rng.choice([0.02, 0.2, 1.5], (count, 1)) * rng.random((count, 3)) * (rng.random((count, 3)) > flat)
    return low, low + size, rng.integers(0, 100, count)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(UPS), st.floats(5, 170), st.floats(0.3, 3))
def test_sectors_count_what_a_plain_loop_counts(seed, up, fov_x, aspect):
    rng = np.random.default_rng(seed)
    low, high, counts = random_cells(rng, 60)
    eye = rng.uniform(-1.5, 1.5, 3)
    found = placement.view_directions(low, high, counts, eye, fov_x=fov_x, aspect=aspect, up=up)
    widths = np.diff(np.append(found.yaws, found.yaws[:1] + 360)) if len(found.yaws) else np.array([360.0])
    for yaw, width, count in zip(found.middles, widths, found.counts, strict=True):
        # Narrower sectors have no middle that rounding leaves inside them.
        if width > 1e-9:
            assert count == counts[in_view(low, high, eye, gaze(yaw, up), up, fov_x, aspect)].sum()
    for yaw in rng.uniform(0, 360, 20):
        sector = np.searchsorted(found.yaws, yaw, side="right") - 1
        assert found.counts[sector] == counts[in_view(low, high, eye, gaze(yaw, up), up, fov_x, aspect)].sum()


def test_changes_lead_from_sector_to_sector():
    rng = np.random.default_rng(3)
    low, high, counts = random_cells(rng, 200)
    found = placement.view_directions(low, high, counts, (0.2, 0.1, -1.4))
    seen = found.at_last.copy()
    for i, yaw in enumerate(found.middles):
        changed = slice(found.first[i], found.first[i + 1])
        for cell, enters in zip(found.cells[changed], found.enters[changed], strict=True):
            assert seen[cell] != enters
            seen[cell] = enters
        assert found.counts[i] == counts[seen].sum(), yaw
    np.testing.assert_array_equal(seen, found.at_last)


def test_cells_of_a_real_scene_agree(real_scene):
    scene = real_scene("engine_2cylinder")
    cells = placement.cells(scene, 3)
    assert cells.counts.sum() == len(scene)
    np.testing.assert_array_equal(np.sort(cells.order), np.arange(len(scene)))
    corners = scene.vertices[scene.faces[cells.order]].astype(float)
    cell = np.repeat(np.arange(len(cells.counts)), cells.counts)
    assert (corners >= cells.low[cell][:, None]).all() and (corners <= cells.high[cell][:, None]).all()
    eye = scene.bounds[0] * 0.7 + scene.bounds[1] * 0.3
    found = placement.view_directions(cells.low, cells.high, cells.counts, eye)
    for sector in np.random.default_rng(0).choice(len(found.counts), 50):
        forward = gaze(found.middles[sector], (0, 1, 0))
        seen = in_view(cells.low, cells.high, eye, forward, (0, 1, 0), 60, 4 / 3)
        assert found.counts[sector] == cells.counts[seen].sum()


def test_threads_change_nothing():
    low, high, counts = random_cells(np.random.default_rng(1), 5000)
    one, two = (placement.view_directions(low, high, counts, (0, 0, 0), threads=n) for n in (1, 2))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)


def test_nothing_around_and_everything_around():
    none = placement.view_directions(np.zeros((0, 3)), np.zeros((0, 3)), [], (0, 0, 0))
    assert len(none.yaws) == 0 and none.counts.tolist() == [0] and none.middles.tolist() == [0]
    around = placement.view_directions([[-1, -1, -1]], [[1, 1, 1]], [7], (0, 0, 0))
    assert len(around.yaws) == 0 and around.counts.tolist() == [7]
    above = placement.view_directions([[1, 3, 0]], [[1, 3, 0]], [7], (0, 0, 0))
    assert above.counts.tolist() == [0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"counts": [1, 2]}, "one entry a cell"),
        ({"counts": [-1]}, "counts must be integers"),
        ({"low": [[0, 0, 2]]}, r"low\[0\]"),
        ({"high": [[0, np.nan, 2]]}, r"high\[0\]"),
        ({"viewpoint": (0, 0)}, "viewpoint"),
        ({"fov_x": 180}, "fov_x"),
        ({"aspect": 0}, "aspect"),
        ({"up": (0, 1, 0.1)}, "along one of the axes"),
        ({"up": (0, 0, 0)}, "along one of the axes"),
    ],
)
def test_bad_input_is_named(change, message):
    good = {"low": [[0, 0, 1]], "high": [[0, 0, 1]], "counts": [1], "viewpoint": (0, 0, 0)}
    with pytest.raises(ValueError, match=message):
        placement.view_directions(**(good | change))


def test_leaf_depth_is_checked():
    with pytest.raises(ValueError, match="leaf_depth must be 0 to 10, got 11"):
        placement.cells(cyc.scenes.sphere(100), 11)
