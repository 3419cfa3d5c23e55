"""The comparison of renderers, on answers made wrong on purpose."""

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import validation
from cyclorama.render import BACKGROUND

CAMERA = cyc.Camera.look_at((1, 2, 4), (0, 0, 0), width=80, height=60)


@pytest.fixture(scope="module")
def gear():
    return cyc.scenes.gear()


def counts(scene, ids, depth, reach=1 / 1024):
    return validation.compare(scene, CAMERA, ids, depth, reach=reach)


def test_our_own_answer_is_the_same_everywhere(gear):
    view = gear.render(CAMERA)
    got = counts(gear, view.ids, view.depth)
    assert got["covered"] == got["same"] == got["agree"] == (view.ids != BACKGROUND).sum()


def test_another_face_at_the_same_depth_agrees_and_is_not_the_same(gear):
    view = gear.render(CAMERA)
    seen = view.ids != BACKGROUND
    got = counts(gear, np.where(seen, np.uint32(0), view.ids), view.depth * np.float32(1 + 5e-5))
    assert got["agree"] == seen.sum()
    assert got["same"] < 0.1 * seen.sum()


def test_a_wrong_face_in_the_middle_of_another_is_unexplained(gear):
    square = cyc.Scene([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2], [0, 2, 3]])
    view = square.render(CAMERA)
    ids, depth = view.ids.copy(), view.depth.copy()
    ids[30, 40], depth[30, 40] = BACKGROUND, np.inf
    got = counts(square, ids, depth)
    assert (got["explained"], got["unexplained"]) == (0, 1)


def test_a_picture_shifted_by_less_than_the_reach_is_explained(gear):
    K = CAMERA.K.copy()
    K[0, 2] += 0.2
    shifted = gear.render(CAMERA.replace(K=K))
    got = counts(gear, shifted.ids, shifted.depth, reach=0.2)
    assert got["explained"] > 0
    assert got["unexplained"] == 0
    assert counts(gear, shifted.ids, shifted.depth)["unexplained"] > 0


def test_every_installed_peer_agrees_on_a_mesh_with_deep_teeth(gear):
    rows = validation.validate(gear, views=2, size=(200, 150), progress=False)
    assert [row["peer"] for row in rows] == ["our two engines", "Open3D", "trimesh with embreex", "pyrender", "OpenCV"]
    for row in rows:
        assert row.get("ok") or "skipped" in row, row


@pytest.mark.parametrize("bad", [{"views": 0}, {"names": ["OpenGL 9"]}])
def test_bad_input_is_refused(gear, bad):
    with pytest.raises(ValueError, match=r"views|OpenGL 9"):
        validation.validate(gear, **bad)
