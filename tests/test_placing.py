"""Where construction images are taken, by hand and against the rule of the 1998 dissertation's section 4.3.2."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cyclorama import Camera
from cyclorama.ldi import camera_through, construction_cameras, quadrilateral

CAMERA = Camera.look_at((1, 2, 3), (4, 2, -1), fov_y=40, width=64, height=48)


def test_just_outside_the_star_shape_they_are_half_way_to_the_edges():
    corners = quadrilateral(CAMERA, 2.0)
    cameras = construction_cameras(CAMERA.eye, corners, 2.0, (64, 48))
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    half = (middles - CAMERA.eye) / 2
    np.testing.assert_allclose([camera.eye for camera in cameras], CAMERA.eye + [(0, 0, 0), *half, *-half], atol=1e-12)
    np.testing.assert_allclose(cameras[0].world_to_camera, CAMERA.world_to_camera, atol=1e-12)
    np.testing.assert_allclose(cameras[0].K, CAMERA.K, rtol=1e-12)


@given(distance=st.floats(0.05, 100), radius=st.floats(0.1, 10))
def test_they_stay_in_the_star_shape_and_before_the_quadrilateral(distance, radius):
    # As printed the rule leaves it once the image is beyond about twice the radius.
    cameras = construction_cameras(CAMERA.eye, quadrilateral(CAMERA, distance), radius)
    steps = np.array([camera.eye for camera in cameras]) - CAMERA.eye
    assert np.linalg.norm(steps, axis=1).max() <= radius * (1 + 1e-9)
    assert (steps @ CAMERA.forward).max() < distance


@given(st.tuples(*[st.floats(-0.9, 0.9)] * 3), st.floats(0, 0.5))
def test_the_quadrilateral_fills_the_image_but_for_the_margin(step, margin):
    corners = quadrilateral(CAMERA, 2.0)
    camera = camera_through(CAMERA.eye + step, corners, (64, 48), margin=margin)
    more = np.ceil(margin * np.array([64, 48]))
    pixels, depth = camera.project(corners)
    expected = np.array([(0, 0), (64, 0), (64, 48), (0, 48)]) + more
    np.testing.assert_allclose(pixels, expected, atol=1e-9)
    assert (camera.width, camera.height) == tuple((64, 48) + 2 * more)
    np.testing.assert_allclose(depth, depth[0])
    assert camera.near == 0 and camera_through(CAMERA.eye, corners, clip=True).near == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: quadrilateral(CAMERA, 0.0), "distance"),
        (lambda: quadrilateral(CAMERA, np.inf), "distance"),
        (lambda: quadrilateral(Camera.orthographic_look_at((0, 0, 1), (0, 0, 0)), 1.0), "orthographic"),
        (lambda: camera_through((0, 0), quadrilateral(CAMERA, 2.0)), "eye"),
        (lambda: camera_through(CAMERA.eye, np.zeros((3, 3))), "corners"),
        (lambda: camera_through(CAMERA.eye, np.zeros((4, 3))), "span no plane"),
        (lambda: camera_through(CAMERA.eye + 5 * CAMERA.forward, quadrilateral(CAMERA, 2.0)), "not before"),
        (lambda: construction_cameras(CAMERA.eye, quadrilateral(CAMERA, 2.0), -1.0), "star_radius"),
    ],
)
def test_what_is_no_place_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
