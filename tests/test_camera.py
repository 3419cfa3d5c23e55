"""Cameras against Open3D, OpenCV, pyrender and trimesh, and against their own inverses."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from cyclorama import Camera
from cyclorama.camera import stack
from peers import need

coordinates = st.floats(-100, 100, allow_nan=False, width=32)
points = st.tuples(coordinates, coordinates, coordinates)
sides = st.integers(1, 900)


@st.composite
def cameras(draw, orthographic=None):
    """Cameras anywhere, off-centre and skewed ones too."""
    eye, target, up = np.array(draw(points)), np.array(draw(points)), np.array(draw(points))
    assume(np.linalg.norm(target - eye) > 1e-3 and np.linalg.norm(up) > 1e-3)
    width, height = draw(sides), draw(sides)
    if draw(st.booleans()) if orthographic is None else orthographic:
        camera = Camera.orthographic_look_at(eye, target, up, draw(st.floats(0.01, 100)), width, height)
    else:
        camera = Camera.look_at(eye, target, up, draw(st.floats(1, 170)), width, height)
    K = camera.K.copy()
    K[0, 0] *= draw(st.floats(0.5, 2))
    K[0, 1] = K[0, 0] * draw(st.floats(-0.2, 0.2))
    K[:2, 2] += draw(st.floats(-50, 50)), draw(st.floats(-50, 50))
    return camera.replace(K=K, near=draw(st.sampled_from([0.0, 0.25])))


def through(matrix, points):
    """Points through a 4 x 4 matrix, divided."""
    homogeneous = np.c_[points, np.ones(len(points))] @ np.asarray(matrix).T
    return homogeneous[:, :3] / homogeneous[:, 3:]


def in_front(camera, rng, count=50):
    """World points that lie inside the image, at depths from 0.5 to 20."""
    pixels = rng.uniform(0, (camera.width, camera.height), (count, 2))
    return camera.unproject(pixels, rng.uniform(0.5, 20, count))


# What can be worked out by hand


def test_look_at_by_hand():
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), fov_y=90, width=200, height=100)
    np.testing.assert_allclose(camera.K, [[50, 0, 100], [0, 50, 50], [0, 0, 1]], rtol=1e-15)
    np.testing.assert_array_equal(camera.world_to_camera, [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 5], [0, 0, 0, 1]])
    np.testing.assert_array_equal(camera.eye, (0, 0, 5))
    np.testing.assert_array_equal(camera.forward, (0, 0, -1))
    pixels, depth = camera.project([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 6)])
    np.testing.assert_allclose(pixels[:3], [(100, 50), (110, 50), (100, 40)])
    np.testing.assert_array_equal(depth, (5, 5, 5, -1))
    assert np.isnan(pixels[3]).all()
    assert camera.fov_y == pytest.approx(90) and camera.fov_x == pytest.approx(2 * math.degrees(math.atan(2)))


def test_the_first_pixel_has_its_centre_at_one_half():
    camera = Camera.look_at((1, 2, 5), (0, 0, 0), width=7, height=4)
    origins, directions = camera.rays()
    pixels, depth = camera.project(origins + 3 * directions)
    x, y = np.meshgrid(np.arange(7) + 0.5, np.arange(4) + 0.5)
    np.testing.assert_allclose(pixels, np.stack([x, y], -1), atol=1e-12)
    np.testing.assert_allclose(depth, np.full((4, 7), 3.0), rtol=1e-14)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_at_a_pole_the_next_axis_is_up(axis, sign):
    up, up_there = np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
    pole = Camera.look_at(5 * sign * up, (0, 0, 0), up=up)
    assert pole == Camera.look_at(5 * sign * up, (0, 0, 0), up=up_there)
    assert pole.project(up_there)[0][1] < pole.project(-up_there)[0][1]


def test_up_changes_exactly_where_the_limit_is():
    limit = math.acos(0.999)
    for angle, changed in ((limit * 1.01, False), (limit * 0.99, True)):
        eye = np.array((0, math.cos(angle), math.sin(angle)))
        right = Camera.look_at(eye, (0, 0, 0)).world_to_camera[0, :3]
        np.testing.assert_allclose(right, (-1, 0, 0) if changed else (1, 0, 0), atol=1e-12)


def test_an_orthographic_camera_keeps_sizes_at_any_depth_and_has_no_eye():
    camera = Camera.orthographic_look_at((0, 0, 5), (0, 0, 0), extent=4, width=80, height=40)
    pixels, depth = camera.project([(0, 2, 0), (0, 2, -100), (4, 0, 3)])
    np.testing.assert_allclose(pixels, [(40, 0), (40, 0), (80, 20)], atol=1e-12)
    np.testing.assert_allclose(depth, (5, 105, 2))
    assert camera.fov_x == camera.fov_y == 0
    with pytest.raises(ValueError, match="no eye"):
        camera.eye  # noqa: B018


def test_a_scene_far_away_loses_nothing():
    near_home = Camera.look_at((1, 2, 5), (0, 0.5, 0))
    offset = np.array((3e6, -4e6, 1e6))
    far_out = Camera.look_at(near_home.eye + offset, np.array((0, 0.5, 0)) + offset)
    at = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    np.testing.assert_allclose(far_out.project(at + offset)[0], near_home.project(at)[0], atol=1e-5)


# Properties


@given(cameras(), st.integers(0, 2**32 - 1))
def test_project_undoes_unproject(camera, seed):
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(-100, 1000, (20, 2))
    depth = rng.uniform(0.1, 1000, 20)
    back, z = camera.project(camera.unproject(pixels, depth))
    # A world point is rounded at its own size; seen at depth z a step of that size is so many pixels.
    rounding = 1e-12 * (np.abs(camera.unproject(pixels, depth)).max() + 200)
    focal = np.abs(camera.K[:2, :2]).max()
    np.testing.assert_allclose(z, depth, atol=rounding)
    np.testing.assert_allclose(back, pixels, atol=1e-9 + rounding * focal * (1 if camera.orthographic else 1e5))


@given(cameras())
def test_rays_meet_their_pixel_at_every_depth(camera):
    camera = camera.with_size(5, 3)
    origins, directions = camera.rays()
    x, y = np.meshgrid(np.arange(5) + 0.5, np.arange(3) + 0.5)
    pixels = np.stack([x, y], -1)
    for depth in (0.5, 7.0):
        expected = camera.unproject(pixels, np.full((3, 5), depth))
        np.testing.assert_allclose(origins + depth * directions, expected, rtol=1e-9, atol=1e-9)
    if not camera.orthographic:
        np.testing.assert_array_equal(origins, np.broadcast_to(camera.eye, (3, 5, 3)))


@given(cameras(), st.floats(0.01, 1), st.floats(2, 1e4) | st.just(math.inf))
def test_opengl_there_and_back_is_the_same_camera(camera, near, far):
    assume(not (camera.orthographic and math.isinf(far)))
    view, projection = camera.to_opengl(near, far)
    back = Camera.from_opengl(view, projection, camera.width, camera.height)
    assert (back.width, back.height, back.orthographic) == (camera.width, camera.height, camera.orthographic)
    np.testing.assert_allclose(back.world_to_camera, camera.world_to_camera, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.K, camera.K, rtol=1e-12, atol=1e-12 * np.abs(camera.K).max())
    assert back.near == pytest.approx(near, rel=1e-9)


@given(cameras(), st.integers(0, 2**32 - 1))
def test_opengl_puts_points_where_project_does(camera, seed):
    at = in_front(camera, np.random.default_rng(seed))
    ndc = through(np.matmul(*reversed(camera.to_opengl(0.25, 40))), at)
    pixels, depth = camera.project(at)
    window = (ndc[:, :2] * (1, -1) + 1) / 2 * (camera.width, camera.height)
    np.testing.assert_allclose(window, pixels, rtol=1e-6, atol=1e-6)
    order = np.argsort(depth)
    assert (np.diff(ndc[order, 2]) > -1e-9).all()
    np.testing.assert_array_equal(np.abs(ndc[:, 2]) < 1, (depth > 0.25) & (depth < 40))


@given(points, points, st.floats(0.1, 10))
def test_a_distant_pinhole_becomes_orthographic(target, way, extent):
    way = np.array(way)
    assume(np.linalg.norm(way) > 1e-3)
    way /= np.linalg.norm(way)
    flat = Camera.orthographic_look_at(target + way, target, extent=extent, width=100, height=100)
    at = target + np.random.default_rng(1).uniform(-extent / 4, extent / 4, (20, 3))
    worst = []
    for distance in (1e3 * extent, 1e4 * extent):
        fov = math.degrees(2 * math.atan(extent / 2 / distance))
        pinhole = Camera.look_at(target + distance * way, target, fov_y=fov, width=100, height=100)
        worst.append(np.abs(pinhole.project(at)[0] - flat.project(at)[0]).max())
    # A point `d` before the target's plane is seen 1 + d / distance larger: at most 50 pixels times that.
    assert worst[0] <= 50 * 0.5e-3 and worst[1] <= 50 * 0.5e-4


@given(cameras())
def test_equal_cameras_hash_alike_and_survive_pickling(camera):
    copy = pickle.loads(pickle.dumps(camera))
    assert copy == camera and hash(copy) == hash(camera) and copy is not camera
    assert not copy.K.flags.writeable
    assert camera != camera.replace(near=camera.near + 1) and camera != "camera"


@given(cameras(), st.floats(0.3, 4))
def test_scaled_cameras_see_the_same(camera, factor):
    scaled = camera.scaled(factor)
    stretch = np.array((scaled.width / camera.width, scaled.height / camera.height))
    at = in_front(camera, np.random.default_rng(2), 10)
    np.testing.assert_allclose(scaled.project(at)[0], camera.project(at)[0] * stretch, rtol=1e-6, atol=1e-6)
    assert scaled.fov_y == pytest.approx(camera.fov_y, abs=1e-9)


@given(st.lists(cameras(), max_size=4))
def test_stack_holds_every_camera_in_order(several):
    K, pose, size, near, orthographic = stack(several)
    n = len(several)
    assert (K.shape, pose.shape, size.shape, near.shape) == ((n, 3, 3), (n, 4, 4), (n, 2), (n,))
    assert (K.dtype, pose.dtype, size.dtype, near.dtype, orthographic.dtype) == (float, float, np.uint32, float, bool)
    assert all(array.flags.c_contiguous for array in (K, pose, size, near, orthographic))
    for i, camera in enumerate(several):
        assert camera == Camera(K[i], pose[i], *size[i], near=near[i], orthographic=orthographic[i])


# Peers


@given(cameras(orthographic=False), st.integers(0, 2**32 - 1))
@example(Camera.look_at((0, 0, 1), (0, 1e-5, 0), fov_y=1, width=1, height=1), 0)
def test_project_agrees_with_opencv(camera, seed):
    cv2, Rotation = need("cv2"), need("scipy.spatial.transform").Rotation
    # OpenCV's K has no skew, and says pixel centres are at whole numbers: the images are half a pixel apart.
    K = camera.K.copy()
    K[0, 1] = 0
    camera = camera.replace(K=K)
    at = in_front(camera, np.random.default_rng(seed))
    # Not OpenCV's own rotation vector, which near half a turn is right to 1e-6 only.
    rotation = Rotation.from_matrix(camera.world_to_camera[:3, :3]).as_rotvec()
    translation = camera.world_to_camera[:3, 3]
    theirs = K.copy()
    theirs[:2, 2] -= 0.5
    expected = cv2.projectPoints(at, rotation, translation, theirs, None)[0][:, 0]
    np.testing.assert_allclose(camera.project(at)[0] - 0.5, expected, rtol=1e-6, atol=1e-5)
    imported = Camera.from_opencv(theirs, camera.world_to_camera, camera.width, camera.height, pixel_center=0)
    np.testing.assert_allclose(imported.K, camera.K, atol=1e-9)


@given(cameras(orthographic=False))
def test_rays_agree_with_open3d(camera):
    o3d = need("open3d")
    camera = camera.with_size(9, 7)
    args = (o3d.core.Tensor(camera.K), o3d.core.Tensor(camera.world_to_camera), 9, 7)
    expected = o3d.t.geometry.RaycastingScene.create_rays_pinhole(*args).numpy()
    origins, directions = camera.rays()
    np.testing.assert_allclose(origins, expected[..., :3], rtol=1e-4, atol=1e-4)
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    theirs = expected[..., 3:] / np.linalg.norm(expected[..., 3:], axis=-1, keepdims=True)
    np.testing.assert_allclose(unit, theirs, atol=1e-5)
    np.testing.assert_allclose(directions @ camera.forward, 1, rtol=1e-9)


@given(cameras(), st.floats(0.01, 1), st.floats(2, 100))
def test_projection_matrices_agree_with_pyrender(camera, near, far):
    pyrender = need("pyrender")
    (fx, _, cx), (_, fy, cy), _ = camera.K
    width, height = camera.width, camera.height
    if camera.orthographic:
        # pyrender's has its axis in the middle of the image.
        camera = camera.replace(K=[[fx, 0, width / 2], [0, fy, height / 2], [0, 0, 1]])
        theirs = pyrender.OrthographicCamera(width / fx / 2, height / fy / 2, znear=near, zfar=far)
    else:
        camera = camera.replace(K=[[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        theirs = pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=near, zfar=far)
    # With a size pyrender replaces an orthographic camera's own width by that of square pixels.
    expected = theirs.get_projection_matrix(*(() if camera.orthographic else (width, height)))
    np.testing.assert_allclose(camera.to_opengl(near, far)[1], expected, rtol=1e-9, atol=1e-9)
    imported = Camera.from_opengl(camera.to_opengl(near, far)[0], expected, width, height)
    np.testing.assert_allclose(imported.K, camera.K, rtol=1e-6, atol=1e-6)


def test_look_at_agrees_with_pyrender_s_perspective_camera():
    pyrender = need("pyrender")
    camera = Camera.look_at((3, 1, 2), (0, 0, 0), fov_y=37, width=320, height=200)
    theirs = pyrender.PerspectiveCamera(math.radians(37), znear=0.1, zfar=50).get_projection_matrix(320, 200)
    np.testing.assert_allclose(camera.to_opengl(0.1, 50)[1], theirs, rtol=1e-12, atol=1e-12)


def test_rays_agree_with_trimesh():
    trimesh = need("trimesh")
    camera = Camera.look_at((3, 1, 2), (0.5, 0, 0), fov_y=37, width=32, height=20)
    scene = trimesh.Scene()
    scene.camera = trimesh.scene.Camera(resolution=(32, 20), fov=(camera.fov_x, camera.fov_y))
    scene.camera_transform = np.linalg.inv(camera.to_opengl()[0])
    origins, directions, _ = scene.camera_rays()
    ours_origins, ours = camera.rays()
    np.testing.assert_allclose(origins.reshape(32, 20, 3).swapaxes(0, 1), ours_origins, atol=1e-12)
    theirs = directions.reshape(32, 20, 3).swapaxes(0, 1)
    # trimesh spreads its pixels from edge to edge, ours have their centres inside: compare the four-pixel middle.
    middle = ours[9:11, 15:17].mean(axis=(0, 1)), theirs[9:11, 15:17].mean(axis=(0, 1))
    np.testing.assert_allclose(*(vector / np.linalg.norm(vector) for vector in middle), atol=1e-6)
    spread = np.cross(ours[0, 0], ours[0, -1]), np.cross(theirs[0, 0], theirs[0, -1])
    np.testing.assert_allclose(*(vector / np.linalg.norm(vector) for vector in spread), atol=0.05)


# Bad input

GOOD = (((100, 0, 32), (0, 100, 24), (0, 0, 1)), np.eye(4), 64, 48)


@pytest.mark.parametrize("fov", [0, 180, -45, 181, math.nan, math.inf, "wide", None])
def test_a_field_of_view_outside_0_to_180_is_refused(fov):
    with pytest.raises(ValueError, match=r"fov_y must be .*got " + (str(float(fov)) if fov in (0, 180) else "")):
        Camera.look_at((0, 0, 5), (0, 0, 0), fov_y=fov)


@pytest.mark.parametrize("size", [(0, 10), (10, 0), (-1, 10), (10.5, 10), (10, 40000), ("a", 10)])
def test_an_image_without_a_size_is_refused(size):
    with pytest.raises(ValueError, match=r"width|height"):
        Camera.look_at((0, 0, 5), (0, 0, 0), width=size[0], height=size[1])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"eye": (0, 0, 0)}, "same point"),
        ({"eye": (0, math.nan, 0)}, r"eye\[1\] is nan"),
        ({"eye": (0, 0)}, r"eye must have shape \(3,\)"),
        ({"target": (0, 0, math.inf)}, r"target\[2\] is inf"),
        ({"up": (0, 0, 0)}, "up must be a direction"),
        ({"near": -1}, "near must be at least 0"),
        ({"near": math.nan}, "near must be finite"),
    ],
)
def test_look_at_names_what_is_wrong(change, says):
    with pytest.raises(ValueError, match=says):
        Camera.look_at(**({"eye": (0, 0, 5), "target": (0, 0, 0)} | change))


@pytest.mark.parametrize(
    ("K", "says"),
    [
        (np.zeros((3, 3)), "K must be"),
        (np.diag([0, 100, 1]), "positive focal lengths, got fx=0"),
        (np.diag([100, -1, 1]), "fy=-1"),
        (np.eye(4), "shape"),
        ([[100, 0, math.nan], [0, 100, 24], [0, 0, 1]], r"K\[0, 2\] is nan"),
        ([[100, 0, 0], [0, 100, 0], [32, 24, 1]], "K must be"),
        ("K", "numbers"),
    ],
)
def test_intrinsics_that_are_none_are_refused(K, says):
    with pytest.raises(ValueError, match=says):
        Camera(K, *GOOD[1:])


@pytest.mark.parametrize(
    ("pose", "says"),
    [
        (np.eye(3), "shape"),
        (2 * np.eye(4), "last row"),
        (np.diag([2, 1, 1, 1]), "rotation.*by 3"),
        (np.diag([-1, 1, 1, 1]), "mirrors"),
        (np.full((4, 4), np.nan), "nan"),
        (np.diag([1, 1, 0, 1]), "rotation"),
    ],
)
def test_poses_that_are_none_are_refused(pose, says):
    with pytest.raises(ValueError, match=says):
        Camera(GOOD[0], pose, *GOOD[2:])


def test_opengl_matrices_that_are_none_are_refused():
    view, projection = Camera(*GOOD).to_opengl(0.1, 10)
    for bad, says in (
        (np.eye(4)[::-1], "last row"),
        (projection @ np.diag([1, 1, -1, 1]), "last row"),
        (projection + np.outer(np.eye(4)[0], np.eye(4)[3]), "shifts"),
        (np.full((4, 4), np.inf), "finite"),
    ):
        with pytest.raises(ValueError, match=says):
            Camera.from_opengl(view, bad, 64, 48)
    reversed_depth = projection.copy()
    reversed_depth[2] *= -1
    with pytest.raises(ValueError, match="give near="):
        Camera.from_opengl(view, reversed_depth, 64, 48)
    assert Camera.from_opengl(view, reversed_depth, 64, 48, near=0.1).near == 0.1
    for near, far in ((0, 10), (-1, 10), (2, 1), (1, 1), (1, math.nan)):
        with pytest.raises(ValueError, match="near"):
            Camera(*GOOD).to_opengl(near, far)
    with pytest.raises(ValueError, match="finite clip planes"):
        Camera(*GOOD, orthographic=True).to_opengl(1)


def test_other_bad_input_is_named():
    camera = Camera(*GOOD)
    with pytest.raises(ValueError, match="pixel_center"):
        Camera.from_opencv(*GOOD, pixel_center=1)
    with pytest.raises(ValueError, match="extent"):
        Camera.orthographic_look_at((0, 0, 5), (0, 0, 0), extent=0)
    with pytest.raises(ValueError, match="points"):
        camera.project([1, 2])
    with pytest.raises(ValueError, match="depth must have shape"):
        camera.unproject([(1, 2), (3, 4)], 1.0)
    with pytest.raises(ValueError, match=r"cameras\[1\]"):
        stack([camera, np.eye(4)])
    with pytest.raises(ValueError, match="factor"):
        camera.scaled(0)
    with pytest.raises(ValueError, match="fov"):
        camera.replace(fov=3)
    assert np.isnan(camera.unproject((3, 4), math.inf)).all()


def test_a_camera_never_changes():
    camera = Camera(*GOOD)
    with pytest.raises(AttributeError, match="replace"):
        camera.near = 1.0
    with pytest.raises(AttributeError):
        del camera.near
    with pytest.raises(ValueError, match="read-only"):
        camera.K[0, 0] = 1
