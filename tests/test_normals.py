"""Normals in 16 bits: how exact they are, and that samples have those of their surfaces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import Camera, DepthImage, LayeredDepthImage
from cyclorama.normals import decode, encode, of_image


@given(st.tuples(*[st.floats(-1, 1)] * 3))
def test_a_direction_comes_back_within_a_degree(direction):
    length = np.linalg.norm(direction)
    if length < 1e-6:
        return
    assert np.degrees(np.arccos(np.clip(decode(encode(direction)) @ direction / length, -1, 1))) < 1


def test_axes_are_exact_and_what_is_no_direction_has_a_word():
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    np.testing.assert_allclose(decode(encode(axes)), axes, atol=1e-15)
    np.testing.assert_array_equal(decode(encode([[0, 0, 0], [np.nan, 0, 1]])), [[0, 0, 1], [0, 0, 1]])
    with pytest.raises(ValueError, match="shape"):
        encode([1.0, 0.0])


def test_samples_of_a_ball_have_its_normals():
    scene = cyc.scenes.sphere(20_000)
    cameras = [Camera.look_at((x, 0, 4), (0, 0, 0), width=120, height=90) for x in (0.0, 0.5, -0.5)]
    images = [scene.depth_image(camera) for camera in cameras]
    layered = LayeredDepthImage.build(images[0], images[1:], normals=True)
    assert layered.normals.shape == (layered.samples,) and layered.nbytes < 8 * layered.samples + 4 * (120 * 90 + 1) + 1
    pixel = np.repeat(np.arange(layered.counts.size), layered.counts.reshape(-1))
    places = np.stack([pixel % 120, pixel // 120], axis=1) + 0.5 + layered.place / 16
    points = cameras[0].unproject(places, 1 / layered.disparity)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip((decode(layered.normals) * points).sum(axis=1), -1, 1)))
    assert np.median(angles) < 3 and np.percentile(angles, 90) < 12
    small = layered.compact([cameras[0]])
    assert small.normals.shape == (small.samples,)


def test_a_slanted_plane_has_one_normal_and_a_lone_pixel_looks_back():
    camera = Camera.look_at((0, 0, 0), (0, 0, -1), width=40, height=30)
    _, directions = camera.rays()
    normal = np.array([0.3, 0.2, 0.9]) / np.linalg.norm([0.3, 0.2, 0.9])
    depth = -3.0 / (directions @ normal)
    image = DepthImage(np.zeros((30, 40, 3), np.uint8), depth, camera)
    np.testing.assert_allclose(of_image(image), np.broadcast_to(normal, (30, 40, 3)), atol=1e-4)
    alone = np.full((30, 40), np.inf)
    alone[5, 7] = 2.0
    image = DepthImage(np.zeros((30, 40, 3), np.uint8), alone, camera)
    np.testing.assert_allclose(of_image(image)[5, 7], -directions[5, 7] / np.linalg.norm(directions[5, 7]))
