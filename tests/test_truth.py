"""The oracle itself, where the answer can be worked out by hand."""

import numpy as np
import pytest

import cyclorama as cyc
from reference.truth import Truth

pytest.importorskip("open3d", reason="the truth is Embree's, through Open3D")

CAMERA = cyc.Camera.look_at((0, 0, 4), (0, 0, 0), width=64, height=48)


def square(z, size=1.0, shift=0.0):
    corners = np.array([[-size, -size, z * 1.0], [size, -size, z], [size, size, z], [-size, size, z]])
    corners[:, 0] += shift
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def together(*parts):
    offsets = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    return np.concatenate([v for v, _ in parts]), np.concatenate(
        [f + o for (_, f), o in zip(parts, offsets, strict=True)]
    )


def sphere(level):
    trimesh = pytest.importorskip("trimesh", reason="makes the sphere")
    mesh = trimesh.creation.icosphere(subdivisions=level)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def test_a_square_hides_the_smaller_one_behind_it():
    vertices, faces = together(square(0), square(-0.5, size=0.5))
    assert Truth(vertices, faces).view(CAMERA).visible.tolist() == [True, True, False, False]


def test_on_a_convex_body_the_front_faces_are_visible_and_no_others():
    vertices, faces = sphere(5)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    front = ((CAMERA.eye - corners[:, 0]) * normals).sum(axis=1) > 0
    truth = Truth(vertices, faces).view(CAMERA)
    assert not (truth.visible & ~front).any()
    assert (front & ~truth.visible).sum() <= 2
    judgement = truth.judge(np.ones(len(faces), dtype=bool))
    assert judgement.missed == 0
    assert not front[judgement.false_faces].any()
    # A ray aimed beside the silhouette may, in float32, end on the wrong side of it.
    assert len(judgement.false_faces) >= (~front).sum() - 10


def test_of_coincident_faces_either_answer_is_right():
    vertices, faces = together(square(0), square(0))
    faces[2:] = faces[2:, ::-1]
    view = Truth(vertices, faces).view(CAMERA)
    for answer in ([0, 1], [2, 3], [0, 3], [0, 1, 2, 3]):
        judgement = view.judge(answer)
        assert (judgement.missed, judgement.false) == (0, 0), answer
    assert len(view.judge([0]).missed_faces) == 1


def test_a_face_that_is_coincident_only_in_part_is_missed_for_the_rest():
    vertices, faces = together(square(0), square(0, shift=0.5))
    view = Truth(vertices, faces).view(CAMERA)
    assert view.judge([0, 1]).missed > 0
    assert view.judge([0, 1, 2, 3]).missed == 0


def test_a_face_far_smaller_than_a_pixel_is_found_and_one_without_area_is_no_face():
    tiny = np.array([[0, 0, 0.1], [1e-4, 0, 0.1], [0, 1e-4, 0.1]]), np.array([[0, 1, 2], [0, 1, 1]])
    truth = Truth(*together(square(0), tiny))
    view = truth.view(CAMERA)
    assert view.visible.tolist() == [True, True, True, False]
    assert view.judge([0, 1, 2, 3]).false == 0
    assert view.judge([0, 1]).missed_faces.tolist() == [2]


def test_faces_outside_the_image_or_behind_the_eye_are_not_visible():
    vertices, faces = together(square(0), square(0, size=0.2, shift=9), square(8))
    assert Truth(vertices, faces).view(CAMERA).visible.tolist() == [True] * 2 + [False] * 4


def test_distance_from_zero_changes_nothing():
    vertices, faces = sphere(3)
    near = Truth(vertices, faces).view(CAMERA)
    shift = np.array([3e4, -1e4, 2e4])
    camera = cyc.Camera.look_at(CAMERA.eye + shift, shift, width=64, height=48)
    assert np.mean(near.visible != Truth(vertices + shift, faces).view(camera).visible) < 2e-3


def test_what_is_found_does_not_depend_on_when_it_is_asked():
    truth = Truth(*sphere(3))
    np.testing.assert_array_equal(truth.view(CAMERA, seed=1).visible, truth.view(CAMERA, seed=1).visible)


def test_an_orthographic_camera_is_refused():
    camera = cyc.Camera.orthographic_look_at((0, 0, 4), (0, 0, 0), extent=2.0, width=8, height=8)
    with pytest.raises(ValueError, match="orthographic"):
        Truth(*square(0)).view(camera)
