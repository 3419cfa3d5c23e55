"""The depth mesh: where it is cut, what it draws, against real renderers of the same triangles."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import Camera, DepthImage, _core, quality, warp
from peers import need

RIGHT, DOWN, PRESENT = 1, 2, 4


def camera_at(eye, forward=(0, 0, -1), size=(64, 48), fov_y=50.0):
    return Camera.look_at(eye, np.add(eye, forward), fov_y=fov_y, width=size[0], height=size[1])


def mesh(images, camera, **options):
    return warp.forward(images, camera, splat="mesh", **options)


def same(a, b):
    return all((getattr(a, name) == getattr(b, name)).all() for name in ("color", "depth", "hole", "exact", "source"))


def random_image(seed, camera=None, missing=0.1):
    rng = np.random.default_rng(seed)
    camera = camera or camera_at((0, 0, 0), size=(int(rng.integers(1, 90)), int(rng.integers(1, 70))))
    shape = camera.height, camera.width
    depth = rng.uniform(1, 5, shape)
    depth[rng.random(shape) < 0.1] = np.inf
    color = rng.integers(0, 256, (*shape, int(rng.integers(3, 5))), dtype=np.uint8)
    return DepthImage(color, depth, camera, missing=rng.random(shape) < missing)


def bumps(camera, seed=0):
    """A smooth surface before a camera that looks along -z from the origin."""
    rng = np.random.default_rng(seed)
    height, width = camera.height, camera.width
    x, y = np.meshgrid(np.linspace(0, 6, width), np.linspace(0, 5, height))
    depth = 4 + 0.3 * np.sin(x + rng.uniform(0, 6)) * np.cos(y + rng.uniform(0, 6))
    color = np.stack([127 + 90 * np.sin(2 * x), 127 + 90 * np.cos(2 * y), 20 * (x + y)], axis=-1)
    return DepthImage(np.rint(color).astype(np.uint8), depth, camera)


# Where it is cut


def test_a_step_is_cut_and_a_plane_is_not_however_steep():
    camera = Camera([[1000, 0, 4], [0, 1000, 2], [0, 0, 1]], np.eye(4), 8, 4)
    step = np.broadcast_to(np.where(np.arange(8) < 3, 2.0, 3.0), (4, 8))
    joins = DepthImage(np.zeros((4, 8, 3), np.uint8), step, camera).joins
    assert (joins[:, 2] & RIGHT == 0).all() and (joins[:, [0, 1, 3, 4, 5, 6]] & RIGHT != 0).all()
    assert (joins[:3] & DOWN != 0).all() and (joins[3] & DOWN == 0).all() and (joins[:, 7] & RIGHT == 0).all()
    # Disparity is linear on a plane; this one is seen at a hundredth of a degree.
    plane = 1 / np.linspace(1, 0.1, 8)
    steep = DepthImage(np.zeros((4, 8, 3), np.uint8), np.broadcast_to(plane, (4, 8)), camera)
    assert (steep.joins[:, :7] & RIGHT != 0).all()
    assert (steep.cut(slope=0).joins[:, :7] & RIGHT != 0).all()


def test_ids_join_what_the_slope_would_cut():
    camera = Camera([[1000, 0, 2], [0, 1000, 1], [0, 0, 1]], np.eye(4), 4, 1)
    depth, color = [[1.0, 1.0, 2.0, 2.0]], np.zeros((1, 4, 3), np.uint8)
    ids = np.array([[7, 7, 7, 8]], np.uint32)
    image = DepthImage(color, depth, camera, ids=ids)
    assert image.joins.tolist() == [[5, 5, 5, 4]] and image.cut(ids=False).joins.tolist() == [[5, 4, 5, 4]]
    # Faces 0 and 1 share an edge, face 2 is elsewhere.
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [5, 0, 0], [6, 0, 0], [5, 1, 0]]
    scene = cyc.Scene(vertices, [[0, 1, 2], [1, 3, 2], [4, 5, 6]])
    for others, joined in (([0, 0, 1, 1], 5), ([0, 0, 2, 2], 4)):
        image = DepthImage(color, depth, camera, ids=np.array([others], np.uint32))
        assert image.cut(scene=scene, slope=0).joins[0, 1] == joined
    with pytest.raises(ValueError, match=r"ids\[0, 0\] is 7, the scene has 3 faces"):
        DepthImage(color, depth, camera, ids=ids).cut(scene=scene)
    with pytest.raises(ValueError, match="without ids"):
        image.cut(ids=False, scene=scene)
    for slope in (-1, np.nan, np.inf):
        with pytest.raises(ValueError, match="slope"):
            image.cut(slope=slope)


@given(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e6))
def test_cuts_know_no_unit(seed, unit):
    image = random_image(seed)
    larger = DepthImage(image.color, image.depth.astype(float) * unit, image.camera, missing=image.missing)
    # The differences of nearly equal numbers may round to either side of a limit.
    assert (larger.joins != image.joins).mean() < 0.01


@given(st.integers(0, 2**32 - 1))
def test_what_is_missing_or_infinitely_far_joins_only_its_like(seed):
    image = random_image(seed)
    joins, far = image.joins, np.isinf(image.depth)
    assert ((joins & PRESENT != 0) == ~image.missing).all()
    for a, b, flag in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None)), RIGHT),
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None)), DOWN),
    ):
        joined = joins[a] & flag != 0
        assert not (joined & (image.missing[a] | image.missing[b])).any()
        assert not (joined & (far[a] != far[b])).any()
        assert (joined | image.missing[a] | image.missing[b] | ~far[a] | ~far[b]).all()


# What it draws


@given(st.integers(0, 2**32 - 1))
def test_the_identity_is_the_identity(seed):
    image = random_image(seed)
    for cut in (image, image.cut(slope=0), image.cut(slope=1e6)):
        out = mesh(cut, image.camera)
        np.testing.assert_array_equal(out.hole, image.missing)
        known = ~image.missing
        np.testing.assert_array_equal(out.color[known], image.color[known][:, :3])
        np.testing.assert_allclose(1 / out.depth[known], image.disparity[known], rtol=1e-6)
        assert out.exact[known].all() and (out.source[known] == 0).all()
        assert (out.color[image.missing] == 0).all()


@given(st.integers(0, 2**32 - 1), st.floats(0, 0.6), st.floats(0, 360))
def test_it_draws_the_same_triangles_as_a_renderer(seed, distance, angle):
    camera = camera_at((0, 0, 0))
    image = bumps(camera, seed)
    assert (image.joins[:-1, :-1] & 7 == 7).all()
    aside = distance * np.array((np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.5))
    there = camera_at(aside, (0.05, -0.03, -1))
    out = mesh(image, there)
    index = np.arange(image.depth.size).reshape(image.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    faces = np.concatenate([np.c_[a, b, d], np.c_[a, d, c]])
    truth = cyc.Scene(image.points().reshape(-1, 3), faces).render(there)
    inner = np.isfinite(truth.depth)
    assert not out.hole[inner].any()
    np.testing.assert_allclose(out.depth[inner], truth.depth[inner], rtol=1e-4)
    # The outermost half pixel of the image is all that the renderer doesn't have.
    rest = ~inner & ~out.hole
    pixels, _ = camera.project(there.unproject(np.argwhere(rest)[:, ::-1] + 0.5, out.depth[rest]))
    outside = ((pixels < 0.51) | (pixels > np.array((camera.width, camera.height)) - 0.51)).any(axis=1)
    assert outside.all()


def test_a_plane_is_where_opencv_warps_it():
    cv2 = need("cv2")
    scene = cyc.Scene([[-9, -9, -4], [9, -9, -4], [9, 9, -4], [-9, 9, -4]], [[0, 1, 2], [0, 2, 3]])
    size = (200, 150)
    here, there = camera_at((0, 0, 0), size=size), camera_at((0.3, 0.1, -0.2), (0.05, 0.02, -1), size=size)
    image = quality.textured(scene, here, grain=0.3)
    out = mesh(image, there)
    corners = np.array([(x, y, -4.0) for x in (-1, 1) for y in (-0.7, 0.7)])
    # OpenCV's first pixel has its centre at (0, 0).
    src, dst = ((camera.project(corners)[0] - 0.5).astype(np.float32) for camera in (here, there))
    matrix = cv2.getPerspectiveTransform(src, dst)
    expected = cv2.warpPerspective(image.color, matrix, size, flags=cv2.INTER_CUBIC)
    inside = cv2.warpPerspective(np.ones(size[::-1], np.uint8), matrix, size, flags=cv2.INTER_NEAREST) > 0
    inside = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    assert inside.mean() > 0.7 and not out.hole[inside].any()
    # Another cubic than OpenCV's (whose slopes are steeper by half), which rounds positions to 1 / 32 pixel.
    assert np.abs(out.color[inside].astype(int) - expected[inside]).mean() < 1.5
    truth = scene.render(there).depth
    np.testing.assert_allclose(out.depth[~out.hole], truth[~out.hole], rtol=2e-6)


@pytest.mark.parametrize("name", ["kitchen", "bunny"])
def test_it_is_much_better_than_splats_and_has_no_cracks(real_scene, name):
    scene = real_scene(name)
    inside = name == "kitchen"
    eye = np.array((0.84, 1.24, 0.06)) if inside else scene.center + (0, 0, 2.6 * scene.radius)
    here = Camera.look_at(eye, eye + (0.6, -0.1, 0.8) if inside else scene.center, fov_y=50, width=256, height=192)
    mean = scene.depth_image(here).depth
    mean = mean[np.isfinite(mean)].mean()
    there = here.replace(world_to_camera=_moved(here, 0.05 * mean * np.array((0.8, 0.3, -0.5))))
    grain = 8 * mean / here.K[0, 0]
    image, truth = (quality.textured(scene, camera, grain=grain) for camera in (here, there))
    seen = quality.seen(scene, truth, here)
    warped = {splat: warp.forward(image, there, splat=splat) for splat in (3, "mesh")}
    measured = {splat: quality.compare(picture, truth, seen) for splat, picture in warped.items()}
    assert measured["mesh"].psnr > measured[3].psnr + 4
    assert measured["mesh"].cracks < 0.002
    assert measured["mesh"].ssim > measured[3].ssim


def _moved(camera, by):
    """World to camera from so far along the camera's own axes."""
    pose = camera.world_to_camera.copy()
    pose[:3, 3] -= by
    return pose


def test_a_hole_behind_a_pole_stays_a_hole():
    camera = camera_at((0, 0, 0), size=(101, 51))
    depth = np.full((51, 101), 10.0)
    depth[:, 45:56] = 2
    color = np.zeros((51, 101, 3), np.uint8)
    color[:, 45:56], color[:, :45], color[:, 56:] = 255, 100, 100
    image = DepthImage(color, depth, camera)
    out = mesh(image, camera_at((0.2, 0, 0), size=(101, 51)))
    f = camera.K[0, 0]
    pole, wall = (0.2 * f / z for z in (2, 10))
    # The pole's right edge, at 56, and what was behind it, at most half a pixel off and a pixel on.
    row = out.hole[25]
    shadow = np.flatnonzero(row[: 101 - int(wall) - 2])
    assert abs(shadow[0] - (56 - pole)) <= 1 and abs(shadow[-1] + 1 - (56 - wall)) <= 1
    assert (np.diff(shadow) == 1).all()
    assert set(np.unique(out.color[~out.hole])) == {100, 255}
    # What is marked as not exact lies along the edges only.
    unsure = np.flatnonzero(~out.exact[25] & ~row)
    assert len(unsure) <= 4


def test_a_surface_turned_over_is_not_drawn():
    camera = camera_at((0, 0, 0))
    image = bumps(camera)
    behind = Camera.look_at((0, 0, -9), (0, 0, 0), fov_y=50, width=64, height=48)
    assert mesh(image, behind).hole.all()


def test_what_lies_behind_the_eye_is_dropped():
    camera = camera_at((0, 0, 0))
    image = bumps(camera)
    assert mesh(image, camera_at((0, 0, -6))).hole.all()
    through = mesh(image, camera_at((0, 0, -4)))
    assert np.isfinite(through.depth[~through.hole]).all() and (through.depth[~through.hole] > 0).all()


def test_the_near_plane_is_kept():
    camera = camera_at((0, 0, 0))
    image = bumps(camera)
    near = mesh(image, camera.replace(near=4.0))
    assert (near.depth[~near.hole] >= 4 - 0.1).all() and 0.1 < near.hole.mean() < 0.9


def test_the_nearest_of_several_images_is_shown():
    camera = camera_at((0, 0, 0))
    shape = (48, 64)
    far = DepthImage(np.full((*shape, 3), 10, np.uint8), np.full(shape, 9.0), camera)
    missing = np.zeros(shape, bool)
    missing[:, 32:] = True
    near = DepthImage(np.full((*shape, 3), 200, np.uint8), np.full(shape, 3.0), camera, missing=missing)
    for images, number in (([far, near], 1), ([near, far], 0)):
        out = mesh(images, camera)
        assert (out.source[:, :31] == number).all() and (out.source[:, 33:] == 1 - number).all()
        assert (out.color[:, :31] == 200).all() and (out.color[:, 33:] == 10).all()


@given(st.integers(0, 2**32 - 1))
def test_threads_and_instruction_sets_change_nothing(seed):
    rng = np.random.default_rng(seed)
    images = [random_image(seed + k, camera_at(rng.uniform(-0.3, 0.3, 3), size=(90, 70))) for k in range(2)]
    there = camera_at(rng.uniform(-0.3, 0.3, 3), (*rng.uniform(-0.2, 0.2, 2), -1), size=(111, 77))
    one = mesh(images, there, threads=1)
    for threads in (2, 3, 7):
        assert same(one, mesh(images, there, threads=threads))
    best = _core.instruction_set()
    try:
        for name in _core.instruction_sets():
            _core.use_instruction_set(name)
            assert same(one, mesh(images, there))
    finally:
        _core.use_instruction_set(best)


def test_memory_and_backgrounds_are_used_as_for_splats():
    camera = camera_at((0, 0, 0))
    image = bumps(camera)
    there = camera_at((0.5, 0, 0))
    first = mesh(image, there)
    behind = np.full((48, 64, 3), 77, np.uint8)
    out = warp.Warped.empty(there)
    again = mesh(image, there, out=out, background=behind)
    assert again.color is out.color and (again.hole == first.hole).all() and first.hole.any()
    assert (again.color[again.hole] == 77).all() and (again.color[~again.hole] == first.color[~first.hole]).all()
    kept = mesh([], there, out=out, background=out)
    assert kept.hole.all() and (kept.color[first.hole] == 77).all()
    assert mesh([], there).hole.all() and (mesh([], there).color == 0).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_the_smallest_images_are_drawn(size):
    camera = camera_at((0, 0, 0), size=size)
    image = DepthImage(np.full((size[1], size[0], 3), 9, np.uint8), np.full(size[::-1], 2.0), camera)
    out = mesh(image, camera.with_size(size[0] * 8, size[1] * 8))
    assert not out.hole.any() and (out.color == 9).all()
    np.testing.assert_allclose(out.depth, 2, rtol=1e-6)
