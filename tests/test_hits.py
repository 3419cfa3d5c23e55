"""All that rays meet: layer after layer, against drawing what is left."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import BACKGROUND, Camera
from cyclorama.hits import hits

SHEETS = cyc.scenes.layers(60, layers=6)
CAMERA = Camera.look_at((0.2, 0.1, 9), (0, 0, 0), width=24, height=18)


def test_the_first_layer_of_some_faces_is_their_picture():
    scene = cyc.scenes.pipes(2000)
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=48, height=36)
    some = np.arange(0, len(scene), 3)
    _, first = next(hits(scene, camera, some).layers())
    view = scene.render(camera, some)
    np.testing.assert_array_equal(first.ids, view.ids)
    np.testing.assert_array_equal(first.depth, view.depth)


def test_each_layer_is_the_picture_of_what_the_ones_before_it_leave():
    found = hits(SHEETS, CAMERA)
    left, layers = np.arange(len(SHEETS)), list(found.layers())
    assert len(layers) == 6
    for _, layer in layers:
        # A sheet hides the next one wholly, so that what is left begins with that.
        np.testing.assert_array_equal(layer.ids, SHEETS.render(CAMERA, left).ids)
        left = np.setdiff1d(left, layer.ids)


@settings(max_examples=30, deadline=None)
@given(st.sets(st.integers(0, len(SHEETS) - 1)), st.integers(1, 4))
def test_leaving_faces_out_leaves_their_hits_out_and_no_more(faces, most):
    some = np.array(sorted(faces), dtype=np.int64)
    whole, fewer, first = hits(SHEETS, CAMERA), hits(SHEETS, CAMERA, some), hits(SHEETS, CAMERA, some, most=most)
    kept = np.isin(whole.faces, some)
    np.testing.assert_array_equal(fewer.faces, whole.faces[kept])
    np.testing.assert_array_equal(fewer.pixels, whole.pixels[kept])
    np.testing.assert_array_equal(fewer.depths, whole.depths[kept])
    rank = np.arange(len(fewer.faces)) - fewer.offsets[:-1].astype(int)[fewer.pixels]
    np.testing.assert_array_equal(first.faces, fewer.faces[rank < most])
    assert sum(len(own) for own, _ in fewer.layers()) == len(fewer.faces)


def test_transparent_faces_are_met_only_where_they_are_asked_for():
    transparent = np.arange(len(SHEETS)) < 20
    scene = cyc.Scene(SHEETS.vertices, SHEETS.faces, transparent=transparent)
    assert not transparent[hits(scene, CAMERA).faces].any()
    assert transparent[hits(scene, CAMERA, np.arange(20)).faces].all()


def test_of_a_deep_pile_only_what_is_wanted_is_kept():
    # All hits at once would be 400 MB.
    child = textwrap.dedent("""
        import resource
        import numpy as np
        import cyclorama as cyc
        from cyclorama.hits import hits
        corners = [[(-9, -9, -t), (9, -9, -t), (0, 9, -t)] for t in np.arange(1000) / 1000]
        pile = cyc.Scene(np.concatenate(corners), np.arange(3000).reshape(-1, 3))
        camera = cyc.Camera.look_at((0, 0, 1), (0, 0, 0), width=256, height=192)
        hits(pile, camera.with_size(8, 8), most=2)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        assert len(hits(pile, camera, most=2).faces) == 2 * 256 * 192
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    """)
    ran = subprocess.run([sys.executable, "-c", child], capture_output=True, text=True, check=True)
    assert int(ran.stdout) < 100_000


def test_of_hits_that_are_equally_deep_one_is_kept():
    twice = cyc.Scene(SHEETS.vertices, np.concatenate([SHEETS.faces, SHEETS.faces]))
    once, both = hits(SHEETS, CAMERA), hits(twice, CAMERA)
    np.testing.assert_array_equal(both.faces % len(SHEETS), once.faces)
    np.testing.assert_array_equal(both.depths, once.depths)


def test_where_nothing_is_met_there_is_no_layer():
    away = Camera.look_at((0, 0, 9), (0, 0, 20), width=4, height=3)
    assert list(hits(SHEETS, away).layers()) == []
    assert (hits(SHEETS, CAMERA, []).offsets == 0).all()
    (_, view), *_ = hits(SHEETS, CAMERA, [0], most=1).layers()
    assert set(np.unique(view.ids)) <= {0, BACKGROUND}


def test_a_face_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match=r"faces\[1\] is 60, the scene has 60 faces"):
        hits(SHEETS, CAMERA, [0, 60])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"most": 0}, "most must be an integer of at least 1, got 0"),
        ({"most": 1.5}, "most must be an integer of at least 1, got 1.5"),
        ({"near": np.nan}, "near must be .* got nan"),
        ({"near": -1}, "near must be .* got -1"),
        ({"threads": 1.5}, "threads must be .* got 1.5"),
        ({"camera": [CAMERA, CAMERA]}, "camera must be a Camera, got list"),
    ],
)
def test_other_wrong_arguments_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        hits(**{"scene": SHEETS, "camera": CAMERA} | options)
