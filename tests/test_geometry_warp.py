"""Geometry warping against rays and planes in float64, OpenCV's four-corner mapping, and vertices really moved."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama.geometry_warp import ImagePlane, bend, bent_camera, geometry_matrix
from peers import need

CORNERS = np.array([[-1.2, 0.9, -3.0], [1.2, 0.9, -3.0], [1.2, -0.9, -3.0], [-1.2, -0.9, -3.0]])
EYE = np.array([0.1, -0.2, 0.5])
HEIGHT = 3.5


def turn(seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def looking(seed: int) -> cyc.Camera:
    """A camera at least 0.2 image distances in front of the plane, looking at the quadrilateral."""
    rng = np.random.default_rng(seed)
    eye = np.array([*rng.uniform(-3, 3, 2), -3.0 + HEIGHT * rng.uniform(0.2, 2.0)])
    return cyc.Camera.look_at(eye, [*rng.uniform(-0.5, 0.5, 2), -3.0], fov_y=60, width=510, height=480)


def on_plane(points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Where the rays from an eye through points meet z = -3."""
    return eye + (points - eye) * ((-3.0 - eye[2]) / (points[:, 2] - eye[2]))[:, None]


@pytest.mark.parametrize("seed", range(100))
def test_the_border_is_continuous_to_a_thousandth_of_a_pixel(seed: int) -> None:
    # Points behind the plane that the image's eye sees exactly on the quadrilateral's edges.
    rng = np.random.default_rng(seed)
    side, share = rng.integers(0, 4, 200), rng.uniform(0, 1, (200, 1))
    edge = CORNERS[side] * (1 - share) + CORNERS[(side + 1) % 4] * share
    points = EYE + (edge - EYE) * rng.uniform(1, 50, (200, 1))
    camera = looking(seed)
    u, v, dw, w = geometry_matrix(CORNERS, EYE, camera) @ np.column_stack([points, np.ones(200)]).T
    expected, depth = camera.project(edge)
    ahead = depth > 1e-6
    assert np.abs(np.column_stack([u, v]) / w[:, None] - expected)[ahead].max() < 1e-3
    np.testing.assert_array_equal(w > 0, depth > 0)
    np.testing.assert_allclose(dw, -3.0 - points[:, 2], atol=1e-12 * 200)


@given(st.integers(0, 10_000), st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_the_matrix_shows_points_where_their_rays_meet_the_plane(seed: int, frame: int) -> None:
    # In a frame of reference that is turned, moved and scaled.
    rng = np.random.default_rng(seed)
    rotation, scale, shift = turn(frame), 10 ** rng.uniform(-3, 3), rng.normal(size=3)
    points = np.column_stack([rng.uniform(-5, 5, (50, 2)), rng.uniform(-30, 0.3, 50)])
    camera = looking(seed)
    expected, depth = camera.project(on_plane(points, EYE))
    pose = camera.world_to_camera.copy()
    pose[:3, 3] = scale * pose[:3, 3] - pose[:3, :3] @ rotation.T @ (scale * shift)
    pose[:3, :3] = pose[:3, :3] @ rotation.T
    moved = camera.replace(world_to_camera=pose)

    def place(p: np.ndarray) -> np.ndarray:
        return scale * (p @ rotation.T + shift)

    u, v, _, w = geometry_matrix(place(CORNERS), place(EYE), moved) @ np.column_stack([place(points), np.ones(50)]).T
    ahead = depth > 0.05
    np.testing.assert_allclose((np.column_stack([u, v]) / w[:, None])[ahead], expected[ahead], atol=1e-5)
    bent = bend(points, CORNERS, EYE, camera.eye)
    pixels, _ = camera.project(bent)
    np.testing.assert_allclose(pixels[ahead], expected[ahead], atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_the_plane_maps_as_opencv_s_four_corner_mapping(seed: int) -> None:
    cv2 = need("cv2")
    image = cyc.Camera.look_at(EYE, [EYE[0], EYE[1], -3.0], fov_y=60, width=256, height=256)
    # Four corners say nothing where one of them lies behind the eye.
    cameras = (looking(seed + 100 * more) for more in range(100))
    camera = next(c for c in cameras if (c.project(CORNERS)[1] > 0.1).all())
    source, target = image.project(CORNERS)[0], camera.project(CORNERS)[0]
    homography = cv2.getPerspectiveTransform(source.astype(np.float32), target.astype(np.float32))
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(4), 50)
    points = EYE + (weights @ CORNERS - EYE) * rng.uniform(1, 20, (50, 1))
    expected = cv2.perspectiveTransform(image.project(points)[0][None], homography)[0]
    u, v, _, w = geometry_matrix(CORNERS, EYE, camera) @ np.column_stack([points, np.ones(50)]).T
    # The corners are given to OpenCV in float32: 24 bits of up to some thousand pixels.
    np.testing.assert_allclose(np.column_stack([u, v]) / w[:, None], expected, atol=5e-3)


def test_at_the_image_s_own_viewpoint_nothing_moves() -> None:
    points = np.random.default_rng(0).uniform(-9, 0.4, (100, 3))
    assert np.abs(bend(points, CORNERS, EYE, EYE) - points).max() <= 1e-12
    camera = cyc.Camera.look_at(EYE, (0, 0, -3), width=64, height=48)
    bent, scale = bent_camera(ImagePlane.of(CORNERS, EYE), camera)
    np.testing.assert_allclose(bent.K, camera.K, atol=1e-9)
    np.testing.assert_allclose(bent.world_to_camera, camera.world_to_camera, atol=1e-12)
    assert scale == pytest.approx(1.0)


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_along_a_transition_each_vertex_moves_one_way_on_one_segment_and_ends_exactly(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-1, 1, (30, 2)), rng.uniform(-20, -3, 30)])
    camera = looking(seed)
    ways = []
    for share in np.linspace(0, 1, 6):
        between = camera.eye + share * (EYE - camera.eye)
        ways.append(camera.project(bend(points, CORNERS, between, camera.eye)))
    path = np.stack([pixels for pixels, _ in ways])
    ahead = np.all([depth > 0.05 for _, depth in ways], axis=0)
    path = path[:, ahead]
    np.testing.assert_allclose(path[0], camera.project(points)[0][ahead], atol=1e-8)
    np.testing.assert_allclose(path[-1], camera.project(on_plane(points, EYE))[0][ahead], atol=1e-6)
    whole = path[-1] - path[0]
    length = np.maximum(np.linalg.norm(whole, axis=-1), 1e-9)
    along = ((path - path[0]) * whole).sum(-1) / length
    across = (path - path[0]) @ np.array([[0, 1], [-1, 0]])
    assert np.abs((across * whole).sum(-1) / length).max(initial=0) < 1e-6
    assert np.diff(along, axis=0).min(initial=0) > -1e-6


@pytest.mark.parametrize("seed", range(8))
def test_the_bent_camera_draws_what_moved_vertices_would_show(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centers = np.column_stack([rng.uniform(-3, 3, (300, 2)), rng.uniform(-12, -3.8, 300)])
    vertices = (centers[:, None] + rng.normal(0, 0.25, (300, 3, 3))).reshape(-1, 3)
    faces = np.arange(900).reshape(-1, 3)
    camera = looking(seed).with_size(102, 96)
    plane = ImagePlane.of(CORNERS, EYE)
    bent, scale = bent_camera(plane, camera)
    moved = cyc.Scene(bend(vertices, CORNERS, EYE, camera.eye), faces).render(camera)
    drawn = cyc.Scene(vertices, faces).render(bent)
    differ = moved.ids != drawn.ids
    # Two ways to round the same edges.
    assert differ.mean() < 1e-3
    same = ~differ & (moved.ids != cyc.BACKGROUND)
    np.testing.assert_allclose(drawn.depth[same] * scale, moved.depth[same], rtol=1e-5)


def test_bad_quadrilaterals_and_eyes_are_refused_by_name() -> None:
    camera = looking(0)
    bad = CORNERS.copy()
    bad[2, 2] += 0.5
    with pytest.raises(ValueError, match=r"corners\[\d\] lies .* off the plane"):
        geometry_matrix(bad, EYE, camera)
    with pytest.raises(ValueError, match="run the other way round"):
        geometry_matrix(CORNERS[::-1], EYE, camera)
    with pytest.raises(ValueError, match=r"convex and in order around, corners\[\d\]"):
        geometry_matrix(np.vstack([CORNERS[:3], [[0.9, 0.7, -3.0]]]), EYE, camera)
    with pytest.raises(ValueError, match="span no area"):
        geometry_matrix(CORNERS[[0, 0, 0, 0]], EYE, camera)
    with pytest.raises(ValueError, match="image_eye lies on the plane"):
        geometry_matrix(CORNERS, (0, 0, -3), camera)
    with pytest.raises(ValueError, match=r"corners\[1, 2\] is nan"):
        geometry_matrix(np.where(np.arange(12).reshape(4, 3) == 5, np.nan, CORNERS), EYE, camera)
    with pytest.raises(ValueError, match=r"shape \(4, 3\), got \(3, 3\)"):
        geometry_matrix(CORNERS[:3], EYE, camera)
    for z, where in ((-3.0, "on"), (-4.0, "behind")):
        with pytest.raises(ValueError, match=f"lies {where} the image's plane"):
            bend(CORNERS, CORNERS, EYE, (0, 0, z))
    with pytest.raises(ValueError, match="orthographic camera has no eye"):
        geometry_matrix(CORNERS, EYE, cyc.Camera.orthographic_look_at((0, 0, 1), (0, 0, 0)))
