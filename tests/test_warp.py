"""Forward warps, against a depth-buffered warp written to be read, OpenCV, and what can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import _core
from peers import need
from reference import forward_warp

SIZE = (48, 36)
HERE = cyc.Camera.look_at((0, 0, 0), (0, 0, -4), width=SIZE[0], height=SIZE[1], fov_y=60)


def spheres(camera: cyc.Camera, seed: int = 0, balls: int = 5) -> cyc.DepthImage:
    """Random balls before a bumpy wall, with random colours: a sample is told from any other by its colour."""
    rng = np.random.default_rng(seed)
    height, width = camera.height, camera.width
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(camera.K).T
    depth = 5 + 0.3 * np.sin(7 * rays[..., 0]) * np.cos(5 * rays[..., 1])
    for center, radius in zip(
        rng.uniform((-1, -1, 2), (1, 1, 4), (balls, 3)), rng.uniform(0.1, 0.6, balls), strict=True
    ):
        a, b, c = (rays**2).sum(-1), rays @ center, center @ center - radius**2
        hit = b**2 > a * c
        depth = np.where(hit, np.minimum(depth, (b - np.sqrt(np.where(hit, b**2 - a * c, 0))) / a), depth)
    return cyc.DepthImage(rng.integers(0, 256, (height, width, 3), np.uint8), depth, camera)


def moved(offset: tuple[float, float, float], turn: tuple[float, float] = (0.0, 0.0), **changes: int) -> cyc.Camera:
    """A camera beside `HERE`, in its axes (right, down, forward), looking `turn` radians aside and down."""
    a, b = turn
    ry = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    rx = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    pose = np.eye(4)
    pose[:3, :3] = rx @ ry
    pose[:3, 3] = -pose[:3, :3] @ offset
    return cyc.Camera(
        HERE.K, pose @ HERE.world_to_camera, changes.get("width", SIZE[0]), changes.get("height", SIZE[1])
    )


def arrays(warped: cyc.warp.Warped) -> list[np.ndarray]:
    return [warped.color, warped.depth, warped.hole, warped.exact, warped.source]


def same(a: cyc.warp.Warped, b: cyc.warp.Warped) -> bool:
    return all(x.tobytes() == y.tobytes() for x, y in zip(arrays(a), arrays(b), strict=True))


def doubtful(image: cyc.DepthImage, camera: cyc.Camera, within: float = 1e-3) -> np.ndarray:
    """Pixels beside whose edges a sample falls: rounding decides whose it is."""
    pixel, _ = forward_warp.positions(image, camera)
    at = np.full((camera.height + 2, camera.width + 2), False)
    near = (np.abs(pixel - np.round(pixel)) < within).any(-1)
    for x, y in np.round(pixel[near]).astype(int):
        if -1 <= x <= camera.width and -1 <= y <= camera.height:
            at[y : y + 3, x : x + 3] = True
    return at[1:-1, 1:-1]


moves = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 1.5))
turns = st.tuples(st.floats(-0.6, 0.6), st.floats(-0.4, 0.4))


@given(moves, turns, st.integers(0, 5))
def test_a_depth_buffered_warp_is_that_of_the_reference(offset, turn, seed):
    image, camera = spheres(HERE, seed), moved(offset, turn)
    ours = cyc.warp.forward(image, camera, splat=1, order="zbuffer")
    color, depth, hole = forward_warp.forward([image], camera)
    sure = ~doubtful(image, camera)
    np.testing.assert_array_equal(ours.hole[sure], hole[sure])
    np.testing.assert_array_equal(ours.exact, ~ours.hole)
    np.testing.assert_allclose(ours.depth[sure], depth[sure], rtol=2e-5)
    # Depths that differ by less than float32 tells may have either colour.
    assert (ours.color[sure] != color[sure]).any(-1).mean() < 2e-3


@given(moves, turns, st.sampled_from([3, 5, 9]))
def test_larger_splats_fill_only_pixels_that_no_centre_falls_on(offset, turn, splat):
    image, camera = spheres(HERE), moved(offset, turn)
    for order in ("zbuffer", "occlusion"):
        one = cyc.warp.forward(image, camera, splat=1, order=order)
        ours = cyc.warp.forward(image, camera, splat=splat, order=order)
        color, depth, hole = forward_warp.square(one.color, one.depth, one.hole, splat // 2)
        np.testing.assert_array_equal(ours.color, color)
        np.testing.assert_array_equal(ours.depth, depth)
        np.testing.assert_array_equal(ours.hole, hole)
        np.testing.assert_array_equal(ours.exact, one.exact)


@pytest.mark.parametrize("order", ["occlusion", "zbuffer"])
@pytest.mark.parametrize("splat", [1, 3, 7, "projected", "disparity"])
def test_the_identity_is_the_identity(order, splat):
    image = spheres(HERE)
    ours = cyc.warp.forward(image, HERE, splat=splat, order=order)
    np.testing.assert_array_equal(ours.color, image.color)
    np.testing.assert_allclose(ours.depth, image.depth, rtol=2**-22)
    assert ours.exact.all() and not ours.hole.any() and not ours.source.any()


@given(moves, turns, st.sampled_from([1, 3, 5, "projected", "disparity"]), st.sampled_from(["occlusion", "zbuffer"]))
def test_threads_and_instruction_sets_change_nothing(offset, turn, splat, order):
    images, camera = [spheres(HERE), spheres(moved((0.3, 0.1, -0.2)), 1)], moved(offset, turn, width=67, height=41)
    used, pictures = _core.instruction_set(), []
    try:
        for name in _core.instruction_sets():
            _core.use_instruction_set(name)
            for threads in (1, 2, 3):
                pictures.append(cyc.warp.forward(images, camera, splat=splat, order=order, threads=threads))
    finally:
        _core.use_instruction_set(used)
    assert all(same(pictures[0], other) for other in pictures)


@given(moves, turns)
def test_map_agrees_with_the_reference(offset, turn):
    image, camera = spheres(HERE), moved(offset, turn)
    np.testing.assert_allclose(
        cyc.warp.map(HERE, camera, image.depth), forward_warp.positions(image, camera)[0], rtol=1e-5, atol=1e-4
    )


@given(turns)
def test_map_of_a_pure_rotation_is_opencvs_homography(turn):
    cv2 = need("cv2")
    camera = moved((0, 0, 0), turn)
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    rotation = (camera.world_to_camera @ np.linalg.inv(HERE.world_to_camera))[:3, :3]
    homography = np.linalg.inv(half) @ camera.K @ rotation @ np.linalg.inv(HERE.K) @ half
    x, y = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1]))
    theirs = cv2.perspectiveTransform(np.stack([x, y], -1), homography) + 0.5
    for depth in (1.0, 7.0, np.inf):
        ours = cyc.warp.map(HERE, camera, depth)
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_one_pixel():
    camera = cyc.Camera.look_at((0, 0, 1), (0, 0, 0), width=1, height=1)
    image = cyc.DepthImage(np.full((1, 1, 3), 9, np.uint8), [[1.0]], camera)
    for splat in (1, 3):
        ours = cyc.warp.forward(image, camera, splat=splat)
        assert ours.color.tolist() == [[[9, 9, 9]]] and ours.depth.tolist() == [[1.0]] and ours.exact.all()


def test_no_image_is_all_hole():
    ours = cyc.warp.forward([], HERE)
    assert ours.hole.all() and not ours.color.any() and np.isinf(ours.depth).all() and (ours.source == 255).all()
