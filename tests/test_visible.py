"""Which faces a view sees: against hand answers, Embree, and the ways it can fail."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from peers import need
from reference.truth import Truth

DIRECTION = np.array([0.48, 0.31, 0.82])


def whole(scene: cyc.Scene, direction=DIRECTION, **kwargs) -> cyc.Camera:
    """A camera that the whole scene just fits."""
    direction = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    eye = scene.center + direction * scene.radius / np.sin(np.radians(22.5))
    return cyc.Camera.look_at(eye, scene.center, **kwargs)


def front_facing(scene: cyc.Scene, eye: np.ndarray) -> np.ndarray:
    a, b, c = (np.asarray(scene.vertices, float)[scene.faces[:, k]] for k in range(3))
    return np.einsum("fc,fc->f", np.cross(b - a, c - a), eye - a) > 0


@pytest.mark.parametrize("faces", [2_000, 330_000])
def test_of_a_closed_convex_mesh_the_front_facing_faces_are_visible(faces):
    scene = cyc.scenes.sphere(faces)
    camera = whole(scene)
    seen = scene.visible(camera).unpack()[0]
    front = front_facing(scene, camera.eye)
    assert not (seen & ~front).any()
    assert (front & ~seen).sum() <= 1e-4 * front.sum()


@pytest.mark.parametrize(
    "make",
    [cyc.scenes.nested_boxes, cyc.scenes.window_box, cyc.scenes.notch, cyc.scenes.tubes],
    ids=lambda f: f.__name__,
)
def test_hand_answers(make):
    scene = make()
    for sight in scene.sights:
        camera = cyc.Camera.look_at(sight.eye, scene.center)
        seen = set(scene.visible(camera).ids(0).tolist())
        assert set(np.asarray(sight.seen).tolist()) <= seen
        assert not seen & set(np.asarray(sight.hidden).tolist())


@pytest.mark.parametrize("name", ["bunny", "tree", "legocar", "x_wing", "engine_2cylinder", "bamboo_truss"])
def test_a_view_of_a_real_mesh_misses_and_invents_next_to_nothing(real_scene, name):
    need("open3d")
    scene = real_scene(name)
    camera = whole(scene)
    judgement = Truth(scene.vertices, scene.faces).view(camera, seed=5).judge(scene.visible(camera).ids(0))
    # What was asked; a face more or less is luck where few are visible.
    assert len(judgement.missed_faces) <= 0.01 * judgement.visible + 1
    assert len(judgement.false_faces) <= 0.001 * judgement.reported + 2


def test_a_bare_buffer_loses_what_rays_find(real_scene):
    scene = real_scene("x_wing")
    camera = whole(scene)
    bare, guessed, confirmed = (scene.visible(camera, fill).count()[0] for fill in (None, "neighbours", "rays"))
    assert bare < 0.6 * confirmed
    assert bare < guessed


def test_fills_only_add(real_scene):
    scene = real_scene("tree")
    camera = whole(scene)
    bare = scene.visible(camera, None)
    for fill in ("neighbours", "rays"):
        assert bare.difference(scene.visible(camera, fill)).count()[0] == 0
    one, two = (scene.visible(camera, "neighbours", rings=rings) for rings in (1, 2))
    assert one.difference(two).count()[0] == 0
    assert two.count() > one.count()


def test_many_rings_flood_all_that_faces_the_eye():
    scene = cyc.scenes.nested_boxes(2)
    ball = cyc.scenes.sphere(2_000)
    camera = whole(ball, width=40, height=40)
    flooded = ball.visible(camera, "neighbours", rings=1000).unpack()[0]
    np.testing.assert_array_equal(flooded, front_facing(ball, camera.eye))
    assert scene.visible(whole(scene), "neighbours", rings=1000).count()[0] <= 6


def test_transparent_faces_hide_nothing_and_are_always_set():
    boxes = cyc.scenes.nested_boxes(2)
    camera = whole(boxes)
    plain = boxes.visible(camera).unpack()[0]
    hidden = ~plain
    glass = cyc.Scene(boxes.vertices, boxes.faces, transparent=plain)
    for fill in (None, "neighbours", "rays"):
        seen = glass.visible(camera, fill).unpack()[0]
        assert seen[plain].all()
        assert seen[hidden].any()
    away = cyc.Camera.look_at(camera.eye, 2 * camera.eye - boxes.center)
    np.testing.assert_array_equal(glass.visible(away).unpack()[0], plain)


def test_known_faces_are_kept_and_change_nothing_else(real_scene):
    scene = real_scene("tree")
    cameras = [whole(scene), whole(scene, (-1, 0.2, 0.1))]
    plain = scene.visible(cameras)
    known = cyc.Bitfields.from_ids([[0, 1, 2], []], len(scene))
    answer = scene.visible(cameras, known=known)
    np.testing.assert_array_equal(answer.words, plain.words | known.words)
    out = np.zeros_like(plain.words)
    assert scene.visible(cameras, out=out).words is out
    np.testing.assert_array_equal(out, plain.words)


@pytest.mark.parametrize("fill", [None, "neighbours", "rays"])
def test_threads_and_engines_give_the_same_bits(real_scene, fill):
    scene = real_scene("tree")
    cameras = [whole(scene, d, width=160, height=120) for d in cyc.sphere.octahedron(0)[0]]
    plain = scene.visible(cameras, fill).words
    np.testing.assert_array_equal(scene.visible(cameras, fill, threads=1).words, plain)
    np.testing.assert_array_equal(scene.visible(cameras, fill, threads=3, engine="raycast").words, plain)


@given(power=st.integers(-60, 60), shift=st.tuples(*[st.integers(-(2**14), 2**14)] * 3))
def test_scaling_or_moving_the_scene_changes_nothing(power, shift):
    scene = cyc.scenes.tree(faces=400)
    corners = np.round(np.asarray(scene.vertices, float) * 2**10) / 2**10
    scale, shift = 2.0**power, np.array(shift, float)
    here = cyc.Scene(corners, scene.faces)
    there = cyc.Scene((corners + shift) * scale, scene.faces)
    camera = whole(here, width=90, height=80)
    pose = camera.world_to_camera.copy()
    pose[:3, 3] = (pose[:3, 3] - pose[:3, :3] @ shift) * scale
    moved = cyc.Camera(camera.K, pose, camera.width, camera.height)
    a, b = here.visible(camera).unpack()[0], there.visible(moved).unpack()[0]
    # The pose of the moved camera is rounded: a face that shows by a hair may come or go.
    assert (a != b).sum() <= 2


def test_subpixel_faces_far_away_are_all_found():
    scene = cyc.scenes.sphere(2_000)
    eye = scene.center + 1e5 * scene.radius * DIRECTION
    camera = cyc.Camera.look_at(eye, scene.center)
    assert scene.visible(camera, None).count()[0] <= 4
    seen = scene.visible(camera).unpack()[0]
    front = front_facing(scene, camera.eye)
    assert not (seen & ~front).any()
    assert (front & ~seen).sum() <= 0.01 * front.sum()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fill": "magic"}, "fill"),
        ({"engine": "gpu"}, "engine"),
        ({"rings": 0}, "rings"),
        ({"supersampling": 0}, "supersampling"),
        ({"points": -1}, "points"),
        ({"threads": 0}, "threads"),
        ({"known": np.zeros((2, 1), np.uint64)}, "known"),
        ({"out": np.zeros((1, 1), np.uint32)}, "out"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    scene = cyc.scenes.nested_boxes(1)
    with pytest.raises(ValueError, match=message):
        scene.visible(whole(scene), **arguments)


def test_no_cameras_see_nothing():
    assert len(cyc.scenes.nested_boxes(1).visible([])) == 0
