"""Images with depth: every way of saying how far, real files, and what is refused."""

import dataclasses
import json
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import Camera, DepthImage, disparity_from_zbuffer
from peers import need

CAMERA = Camera.look_at((1, 2, 5), (0, 0.5, 0), fov_y=60, width=8, height=6)
SHAPE = (6, 8)
COLOR = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
DEPTH = np.linspace(1, 9, 48).reshape(SHAPE)

depths = st.floats(1e-6, 1e6)


def rotation(x, y, z, w):
    """The matrix of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.fixture(scope="module")
def room(data):
    """`room(k)`: frame k, 1 to 5, of `rgbd_room` with its estimated pose."""
    need("PIL")
    folder = data / "rgbd_room"
    said = json.loads((folder / "calib.json").read_text())
    poses = np.loadtxt(folder / "pose.txt")

    def frame(k):
        tx, ty, tz, *quaternion = poses[k - 1]
        pose = np.eye(4)
        turn = rotation(*np.array(quaternion) / np.linalg.norm(quaternion))
        pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ (tx, ty, tz)
        K = [[said["fx"], 0, said["cx"]], [0, said["fy"], said["cy"]], [0, 0, 1]]
        camera = Camera.from_opencv(K, pose, said["width"], said["height"], pixel_center=0)
        return DepthImage.read_rgbd(
            folder / f"color_{k}.png", folder / f"depth_{k}.png", camera, scale=said["depth_scale"]
        )

    return frame


# Four ways of saying how far


def test_depth_and_disparity_by_hand():
    image = DepthImage(COLOR, np.full(SHAPE, 4.0), CAMERA)
    assert (image.disparity == 0.25).all() and image.disparity.dtype == np.float32
    assert (image.depth == 4).all() and not image.missing.any() and image.ids is None
    np.testing.assert_array_equal(image.color, COLOR)


@given(st.lists(depths, min_size=48, max_size=48))
def test_what_is_given_is_rounded_once_and_inverted_once(values):
    given_depth = np.reshape(values, SHAPE)
    image = DepthImage(COLOR, given_depth, CAMERA)
    np.testing.assert_array_equal(image.depth, given_depth.astype(np.float32))
    np.testing.assert_array_equal(image.disparity, (1 / image.depth.astype(np.float64)).astype(np.float32))
    other = DepthImage.from_disparity(COLOR, 1 / given_depth, CAMERA)
    np.testing.assert_array_equal(other.disparity, (1 / given_depth).astype(np.float32))
    np.testing.assert_allclose(other.depth, image.depth, rtol=2 * np.finfo(np.float32).eps)


def test_infinity_is_missing_unless_a_mask_says_otherwise():
    depth = DEPTH.copy()
    depth[2, 3] = np.inf
    assert np.argwhere(DepthImage(COLOR, depth, CAMERA).missing).tolist() == [[2, 3]]
    sky = DepthImage(COLOR, depth, CAMERA, missing=np.zeros(SHAPE, bool))
    assert not sky.missing.any() and sky.disparity[2, 3] == 0 and np.isinf(sky.depth[2, 3])
    flat = DepthImage.from_disparity(COLOR, np.zeros(SHAPE), CAMERA)
    assert not flat.missing.any() and np.isinf(flat.depth).all()


def test_what_the_mask_hides_is_not_looked_at():
    missing = np.zeros(SHAPE, bool)
    missing[:2] = True
    for bad in (np.nan, -1.0, 0.0, np.inf):
        depth = np.where(missing, bad, DEPTH)
        for make in (DepthImage, DepthImage.from_disparity, DepthImage.from_range):
            image = make(COLOR, depth, CAMERA, missing=missing)
            assert (image.missing == missing).all()
            assert (image.disparity[missing] == 0).all() and np.isinf(image.depth[missing]).all()


def test_range_is_measured_along_the_ray():
    image = DepthImage(COLOR, DEPTH, CAMERA)
    along = np.linalg.norm(image.points() - CAMERA.eye, axis=-1)
    assert (along > DEPTH + 0.01).any()
    np.testing.assert_allclose(DepthImage.from_range(COLOR, along, CAMERA).depth, image.depth, rtol=1e-6)


@given(depths, st.floats(1.5, 1e4), st.floats(0.01, 0.99))
def test_the_formula_undoes_what_opengl_stores(near, ratio, where):
    far = near * ratio
    depth = near * ratio**where
    _, clip = Camera.look_at((0, 0, 1), (0, 0, 0)).to_opengl(near, far)
    z, w = (clip @ (0, 0, -depth, 1))[2:]
    stored = z / w / 2 + 0.5
    # What is left of 1 - z is (near / depth) at best, of numbers of the size of 1.
    np.testing.assert_allclose(disparity_from_zbuffer(stored, near, far) * depth, 1, rtol=1e-14 * ratio)
    # The dissertation's value is near / depth.
    np.testing.assert_allclose(1 - stored * (far - near) / far, near / depth, rtol=1e-14 * ratio)


def test_a_cleared_depth_buffer_is_missing():
    assert np.isnan(disparity_from_zbuffer(1.0, 0.1, 100))
    z = np.full(SHAPE, 0.5)
    z[0] = 1
    image = DepthImage.from_zbuffer(COLOR, z, CAMERA, 0.1, 100)
    assert (image.missing == (z == 1)).all()
    np.testing.assert_allclose(image.depth[1:], 1 / (0.5 / 0.1 + 0.5 / 100), rtol=1e-6)


def test_a_depth_buffer_of_24_bits_is_nearly_the_depth():
    scene = cyc.scenes.sphere(2000)
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=64, height=64)
    view = scene.render(camera)
    near, far = 0.5, 20.0
    with np.errstate(invalid="ignore"):
        z = (1 / near - 1 / view.depth) / (1 / near - 1 / far)
    z = np.where(np.isfinite(view.depth), np.rint(z * 2**24) / 2**24, 1)
    image = DepthImage.from_zbuffer(view.color, z, camera, near, far)
    assert (image.missing == np.isinf(view.depth)).all()
    np.testing.assert_allclose(image.depth, view.depth, rtol=1e-5)


# Where they come from


def test_a_render_comes_back_bit_for_bit():
    scene = cyc.scenes.gear()
    camera = Camera.look_at(scene.center + (0, 0, 3 * scene.radius), scene.center, width=64, height=48)
    view, image = scene.render(camera), scene.depth_image(camera)
    for name in ("depth", "ids", "color"):
        np.testing.assert_array_equal(getattr(image, name), getattr(view, name))
    assert (image.missing == (view.ids == cyc.BACKGROUND)).all() and image.camera == camera
    nothing = scene.depth_image(Camera.look_at((0, 0, 99), (0, 0, 100), width=4, height=4))
    assert nothing.missing.all()


def test_an_rgbd_frame_is_where_open3d_puts_it(room):
    o3d = need("open3d")
    frame = room(1)
    # Said in the README of the data.
    assert frame.shape == (480, 640) and 0.318 < frame.missing.mean() < 0.320
    assert 0.4 < frame.depth[~frame.missing].min() and frame.depth[~frame.missing].max() < 10
    fx, fy = frame.camera.K[0, 0], frame.camera.K[1, 1]
    cx, cy = frame.camera.K[:2, 2] - 0.5
    lens = o3d.camera.PinholeCameraIntrinsic(640, 480, fx, fy, cx, cy)
    depth = o3d.geometry.Image(np.where(frame.missing, 0, frame.depth).astype(np.float32))
    cloud = o3d.geometry.PointCloud.create_from_depth_image(
        depth, lens, frame.camera.world_to_camera, depth_scale=1.0, depth_trunc=100.0
    )
    np.testing.assert_allclose(frame.points()[~frame.missing], np.asarray(cloud.points), atol=1e-5)


def test_a_stereo_pair_is_where_its_disparities_say(data):
    image = pytest.importorskip("PIL.Image")
    folder = data / "stereo_motorcycle"
    said = json.loads((folder / "calib.json").read_text())
    left = np.asarray(image.open(folder / "left.png"))
    disparity = np.load(folder / "disp.npz")["arr_0"]
    height, width = disparity.shape
    f, doffs, baseline = said["focal_px"], said["cx_right_minus_left"], said["baseline_m"]
    K = np.array([[f, 0, said["cx_left"]], [0, f, said["cy"]], [0, 0, 1]])
    camera = Camera.from_opencv(K, np.eye(4), width, height, pixel_center=0)
    picture = DepthImage.from_stereo(left, disparity, camera, baseline, offset=doffs)
    assert (picture.missing == np.isinf(disparity)).all() and 0.07 < picture.missing.mean() < 0.08
    known = ~picture.missing
    np.testing.assert_allclose(picture.depth[known], baseline * f / (disparity[known] + doffs), rtol=1e-6)
    # The right camera is a baseline to the right, its principal point so many pixels further.
    aside = np.eye(4)
    aside[0, 3] = -baseline
    there = K.copy()
    there[0, 2] += doffs
    right = Camera.from_opencv(there, aside, width, height, pixel_center=0)
    at = cyc.warp.map(camera, right, picture.depth)[known]
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    np.testing.assert_allclose(at[:, 0], x[known] - disparity[known], atol=1e-3)
    np.testing.assert_allclose(at[:, 1], y[known], atol=1e-9)


# What never changes


def test_nothing_can_be_changed():
    depth = DEPTH.copy()
    image = DepthImage(COLOR, depth, CAMERA)
    depth[:] = 7
    assert (image.depth == DEPTH.astype(np.float32)).all()
    for name in ("color", "depth", "disparity", "missing"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(image, name)[0, 0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        image.camera = None


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("make", [DepthImage, DepthImage.from_disparity])
def test_a_file_holds_all_of_it(tmp_path, make, channels, rng):
    color = rng.integers(0, 256, (*SHAPE, channels), dtype=np.uint8)
    missing = rng.random(SHAPE) < 0.3
    ids = rng.integers(0, 99, SHAPE, dtype=np.uint32) if channels == 3 else None
    image = make(color, rng.uniform(0.5, 2, SHAPE), CAMERA.replace(near=0.25), missing=missing, ids=ids)
    image.save(tmp_path / "image.npz")
    for other in (DepthImage.load(tmp_path / "image.npz"), pickle.loads(pickle.dumps(image))):
        for name in ("color", "depth", "disparity", "missing", "ids"):
            np.testing.assert_array_equal(getattr(other, name), getattr(image, name))
        assert other.camera == image.camera


def test_a_damaged_file_says_so(tmp_path):
    path = tmp_path / "image.npz"
    DepthImage(COLOR, DEPTH, CAMERA).save(path)
    whole = path.read_bytes()
    for part in (b"", whole[:100], whole[: len(whole) // 2]):
        path.write_bytes(part)
        with pytest.raises(ValueError, match=r"image.npz is not a whole depth image"):
            DepthImage.load(path)
    np.savez(path, header=np.array('{"format": "something else"}'))
    with pytest.raises(ValueError, match="something else"):
        DepthImage.load(path)
    with pytest.raises(FileNotFoundError):
        DepthImage.load(tmp_path / "none.npz")


# What is refused


def bad(value, at=(2, 3)):
    array = DEPTH.copy()
    array[at] = value
    return array


@pytest.mark.parametrize("make", [DepthImage, DepthImage.from_range])
@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, -np.inf, 1e-40, 1e40])
def test_a_wrong_depth_is_named(make, value):
    # A range is only checked against the limits once it is a depth.
    with pytest.raises(ValueError, match=r"^(depth|range)\[2, 3\] is "):
        make(COLOR, bad(value), CAMERA)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 1e-40, 1e40])
def test_a_wrong_disparity_is_named(value):
    with pytest.raises(ValueError, match=r"^disparity\[2, 3\] is "):
        DepthImage.from_disparity(COLOR, bad(value), CAMERA)


@pytest.mark.parametrize(
    ("said", "arguments", "options"),
    [
        ("depth must have shape (6, 8), as the camera has, got (8, 6)", (COLOR, DEPTH.T, CAMERA), {}),
        ("depth must have shape (6, 8), as the camera has, got ()", (COLOR, 1.0, CAMERA), {}),
        ("depth must be real numbers, got dtype complex128", (COLOR, DEPTH + 1j, CAMERA), {}),
        ("depth must be real numbers, got dtype <U1", (COLOR, np.full(SHAPE, "1"), CAMERA), {}),
        ("color must be (6, 8, 3 or 4) uint8, got (6, 8, 2) uint8", (COLOR[..., :2], DEPTH, CAMERA), {}),
        ("color must be (6, 8, 3 or 4) uint8, got (5, 8, 3) uint8", (COLOR[1:], DEPTH, CAMERA), {}),
        ("color must be (6, 8, 3 or 4) uint8, got (6, 8, 3) float64", (COLOR / 255, DEPTH, CAMERA), {}),
        ("missing must be (6, 8) bool", (COLOR, DEPTH, CAMERA), {"missing": np.zeros(SHAPE)}),
        ("missing must be (6, 8) bool", (COLOR, DEPTH, CAMERA), {"missing": np.zeros((8, 6), bool)}),
        ("ids must be (6, 8) uint32", (COLOR, DEPTH, CAMERA), {"ids": np.zeros(SHAPE, int)}),
        ("camera must be a Camera, got NoneType", (COLOR, DEPTH, None), {}),
    ],
)
def test_bad_arguments_are_named(said, arguments, options):
    with pytest.raises(ValueError) as error:
        DepthImage(*arguments, **options)
    assert said in str(error.value)


def test_cameras_that_are_none_are_refused():
    flat = Camera.orthographic_look_at((0, 0, 1), (0, 0, 0), width=8, height=6)
    with pytest.raises(ValueError, match="orthographic"):
        DepthImage(COLOR, DEPTH, flat)
    with pytest.raises(ValueError, match="focal lengths"):
        CAMERA.replace(K=np.diag([0.0, 1.0, 1.0]))
    with pytest.raises(ValueError, match="mirrors"):
        CAMERA.replace(world_to_camera=np.diag([-1.0, 1, 1, 1]))


def test_planes_and_values_of_a_depth_buffer_are_checked():
    for near, far in ((0, 1), (1, 1), (2, 1), (np.nan, 1), (np.inf, np.inf), (-1, 1)):
        with pytest.raises(ValueError, match="clip planes"):
            disparity_from_zbuffer(0.5, near, far)
    for value in (-0.1, 1.1, np.nan):
        with pytest.raises(ValueError, match=r"z\[1\] is "):
            disparity_from_zbuffer([0.5, value], 1, 2)


def test_stereo_and_files_are_checked(tmp_path):
    pillow = pytest.importorskip("PIL.Image")
    for baseline in (0, -1, np.nan):
        with pytest.raises(ValueError, match="baseline"):
            DepthImage.from_stereo(COLOR, DEPTH, CAMERA, baseline)
    with pytest.raises(ValueError, match=r"disparity_px\[2, 3\] is -4.0: with offset 3.0"):
        DepthImage.from_stereo(COLOR, bad(-4.0), CAMERA, 0.1, offset=3.0)
    with pytest.raises(ValueError, match="offset"):
        DepthImage.from_stereo(COLOR, DEPTH, CAMERA, 0.1, offset=np.inf)
    color, depth = tmp_path / "color.png", tmp_path / "depth.png"
    pillow.fromarray(COLOR).save(color)
    with pytest.raises(FileNotFoundError):
        DepthImage.read_rgbd(color, depth, CAMERA)
    with pytest.raises(ValueError, match="one channel"):
        DepthImage.read_rgbd(color, color, CAMERA)
    pillow.fromarray(np.ones((3, 3), np.uint16)).save(depth)
    with pytest.raises(ValueError, match=r"\(6, 8\).*\(3, 3\)"):
        DepthImage.read_rgbd(color, depth, CAMERA)
    with pytest.raises(ValueError, match="scale"):
        DepthImage.read_rgbd(color, depth, CAMERA, scale=0)
