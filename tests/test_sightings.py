"""Which views see a face, and where to look next."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama.bitfield import Bitfields
from cyclorama.framing import Framing
from cyclorama.sightings import next_best, sightings


@pytest.fixture(scope="module")
def gear():
    scene = cyc.scenes.gear()
    return scene, Framing.of(scene, (96, 72)).cameras(cyc.sphere.octahedron(0)[0])


def test_pixels_are_those_of_the_pictures(gear):
    scene, cameras = gear
    found = sightings(scene, cameras, progress=False)
    table = np.zeros((len(cameras), len(scene)), dtype=np.int64)
    for row, camera in zip(table, cameras, strict=True):
        ids = scene.render(camera).ids
        np.add.at(row, ids[ids != cyc.BACKGROUND], 1)
    for view, row in enumerate(table):
        faces, pixels = found.of_view(view)
        np.testing.assert_array_equal(faces, np.flatnonzero(row))
        np.testing.assert_array_equal(pixels, row[faces])
    np.testing.assert_array_equal(found.views, (table > 0).sum(axis=0))
    np.testing.assert_array_equal(found.best_pixels, table.max(axis=0))
    np.testing.assert_array_equal(found.best, np.where(table.any(axis=0), table.argmax(axis=0), -1))
    for face in np.flatnonzero(found.views)[::97]:
        views, pixels = found.of_face(int(face))
        assert sorted(views) == np.flatnonzero(table[:, face]).tolist()
        np.testing.assert_array_equal(pixels, np.sort(table[table[:, face] > 0, face])[::-1])
    with pytest.raises(IndexError):
        found.of_face(len(scene))
    with pytest.raises(IndexError):
        found.of_view(-1)


def test_no_view_shows_nothing(gear):
    scene, _ = gear
    found = sightings(scene, [], progress=False)
    assert len(found) == 0 and not found.views.any() and (found.best == -1).all()


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_each_next_view_adds_as_much_as_any_could(data):
    faces, views = 12, 5
    scene = cyc.Scene(np.random.default_rng(0).normal(size=(3 * faces, 3)), np.arange(3 * faces).reshape(-1, 3))
    flags = np.array(
        data.draw(st.lists(st.lists(st.booleans(), min_size=faces, max_size=faces), min_size=views, max_size=views))
    )
    seen = np.array(data.draw(st.lists(st.booleans(), min_size=faces, max_size=faces)))
    weight = np.array(data.draw(st.lists(st.integers(0, 5), min_size=faces, max_size=faces)), dtype=float)
    chosen = next_best(scene, Bitfields.pack(flags), seen, count=views, weight=weight)
    known = seen.copy()
    for view in chosen:
        gains = [weight[row & ~known].sum() for row in flags]
        assert view.gain == gains[view.view] == max(gains) > 0
        np.testing.assert_array_equal(view.faces, np.flatnonzero(flags[view.view] & ~known))
        known |= flags[view.view]
        assert view.left == weight[flags.any(axis=0) & ~known].sum()
    assert len(chosen) == views or max((weight[row & ~known].sum() for row in flags), default=0) == 0


def test_the_far_side_is_looked_at_next(gear):
    scene, cameras = gear
    front = scene.visible(cameras[:1], progress=False).ids(0)
    (best,) = next_best(scene, cameras, front, progress=False)
    assert best.view != 0 and not np.isin(best.faces, front).any()


def test_bad_questions_are_refused(gear):
    scene, cameras = gear
    with pytest.raises(ValueError, match=r"seen\[1\] is 999999"):
        next_best(scene, cameras, [0, 999999], progress=False)
    with pytest.raises(ValueError, match="count must be an integer of at least 1"):
        next_best(scene, cameras, count=0, progress=False)
    with pytest.raises(ValueError, match="weight must be 'area'"):
        next_best(scene, cameras, weight="size", progress=False)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"weight\[0\] is -1.0"):
        next_best(scene, cameras, weight=-np.ones(len(scene)), progress=False)
    with pytest.raises(ValueError, match="rows of 3 faces"):
        next_best(scene, Bitfields.zeros(1, 3))
