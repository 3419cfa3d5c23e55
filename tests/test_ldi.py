"""Layered images: built, warped, compacted, cast, against plain NumPy, Open3D, and themselves."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import Camera, DepthImage, LayeredDepthImage
from cyclorama.camera import stack
from cyclorama.ldi import construction_cameras, quadrilateral
from cyclorama.normals import decode
from peers import need
from reference import layered as reference

WIDTH, HEIGHT = 30, 22
seeds = st.integers(0, 2**32 - 1)


def camera_at(eye=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), width=WIDTH, height=HEIGHT, focal=28.0):
    """A camera that looks along +z, turned about its axes by some radians."""
    a, b, c = turn
    about_x = [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
    about_y = [[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]]
    about_z = [[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]]
    pose = np.eye(4)
    pose[:3, :3] = np.array(about_x) @ about_y @ about_z
    pose[:3, 3] = -pose[:3, :3] @ eye
    return Camera([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]], pose, width, height)


def surfaces(rng, camera, share=0.1):
    """A picture of blocks at random depths with some pixels missing."""
    shape = (camera.height, camera.width)
    depth = np.full(shape, 6.0)
    for _ in range(6):
        y, x = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        slope = rng.uniform(-0.02, 0.02, 2)
        ys, xs = np.mgrid[y : min(shape[0], y + 9), x : min(shape[1], x + 9)]
        depth[ys, xs] = rng.uniform(1.5, 5.5) + slope[0] * (ys - y) + slope[1] * (xs - x)
    return DepthImage(rng.integers(0, 256, (*shape, 3), np.uint8), depth, camera, missing=rng.random(shape) < share)


def random_layers(rng, camera, most=4, lowest=0.15, highest=1.0):
    """Up to `most` samples a pixel, some of them infinitely far."""
    counts = rng.integers(0, most + 1, camera.width * camera.height)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    pixel = np.repeat(np.arange(len(counts)), counts)
    # A few levels of depth, so that there are surfaces and not only noise.
    disparity = rng.choice(np.linspace(lowest, highest, 5), len(pixel)) * rng.uniform(0.98, 1.02, len(pixel))
    disparity[rng.random(len(pixel)) < 0.05] = 0.0
    disparity = disparity[np.lexsort((-disparity, pixel))]
    color, place = rng.integers(0, 256, (len(pixel), 3), np.uint8), rng.integers(-8, 8, (len(pixel), 2))
    return LayeredDepthImage(camera, offsets, color, disparity, place)


def same_picture(a, b):
    return all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in ("color", "depth", "hole", "exact", "source")
    )


# What can be worked out by hand


def test_one_image_warped_to_its_own_camera_is_itself():
    image = surfaces(np.random.default_rng(1), camera_at())
    layered = LayeredDepthImage.build(image)
    assert layered.samples == (~image.missing).sum() and layered.merged == ()
    for splat in (1, 3):
        back = layered.warp(image.camera, splat)
        seen = back.exact
        np.testing.assert_array_equal(back.color[seen], image.color[seen])
        assert splat > 1 or np.array_equal(seen, ~image.missing)
    np.testing.assert_array_equal(layered.layer(0).missing, image.missing)


def test_what_is_hidden_from_one_image_comes_from_another():
    # A post before a wall; the eye moves sideways and sees the wall behind it.
    def picture(camera, colors=((200, 0, 0), (0, 0, 200))):
        x = np.arange(camera.width) + 0.5 - camera.width / 2
        post = np.abs(x / 28.0 * 2.0 + camera.eye[0]) < 0.2
        depth = np.broadcast_to(np.where(post, 2.0, 6.0), (camera.height, camera.width))
        return DepthImage(
            np.where(post[None, :, None], *np.array(colors, np.uint8)) + np.zeros_like(depth, np.uint8)[..., None],
            depth,
            camera,
        )

    aside = camera_at((0.4, 0, 0))
    truth = picture(aside)
    inside = slice(4, -4)
    single = LayeredDepthImage.build(picture(camera_at()))
    both = LayeredDepthImage.build(picture(camera_at()), [picture(camera_at((0.8, 0, 0)))])
    assert single.warp(aside).hole[:, inside].any()
    warped = both.warp(aside)
    assert not warped.hole[:, inside].any()
    assert (warped.color[:, inside] == truth.color[:, inside]).all(axis=-1).mean() > 0.9
    assert both.kept[0] == single.samples and 0 < both.kept[1] < single.samples / 4


def test_two_surfaces_within_the_tolerance_become_one_unless_their_colours_differ():
    camera = camera_at()
    shape = (HEIGHT, WIDTH)
    far, near = (
        DepthImage(np.full((*shape, 3), c, np.uint8), np.full(shape, z), camera) for c, z in ((50, 4.0), (90, 3.9))
    )
    # A pixel is 4 / 28 = 0.14 wide there: 0.1 is less, but more than half of it.
    assert LayeredDepthImage.build(far, [near], tolerance=1.0).samples == far.missing.size
    assert LayeredDepthImage.build(far, [near], tolerance=0.5).samples == 2 * far.missing.size
    assert LayeredDepthImage.build(far, [near], tolerance=1.0, color_tolerance=39).samples == 2 * far.missing.size


def test_samples_near_corners_stay_where_they_are_asked_for():
    # A wall, and the same wall from eyes whose samples lie a fraction of a pixel right of and below the first ones.
    depth, focal = 4.0, 28.0
    shape = (HEIGHT, WIDTH)
    wall = [
        DepthImage(
            np.full((*shape, 3), 90, np.uint8),
            np.full(shape, depth),
            camera_at((x * depth / focal, x * depth / focal, 0)),
        )
        for x in (0.0, 0.125, 0.375, 0.4375)
    ]
    assert LayeredDepthImage.build(wall[0], wall[1:], corners=False).samples == WIDTH * HEIGHT
    assert LayeredDepthImage.build(wall[0], wall[1:2]).samples == WIDTH * HEIGHT
    dense = LayeredDepthImage.build(wall[0], wall[1:])
    # One more each, from the first image that has it, and none twice.
    assert dense.samples == 2 * WIDTH * HEIGHT and dense.kept == (WIDTH * HEIGHT, 0, WIDTH * HEIGHT, 0)
    near = camera_at((0, 0, 0.3 * depth))
    single, double = (image.warp(near, 1).hole.mean() for image in (LayeredDepthImage.build(wall[0]), dense))
    assert double < 0.5 * single


def test_an_empty_layered_image_is_a_picture_that_is_all_hole():
    camera = camera_at()
    empty = LayeredDepthImage(camera, np.zeros(WIDTH * HEIGHT + 1, int), [], [])
    for cull in (False, "exact", "paper"):
        out = empty.warp(camera_at((0.1, 0, 0)), cull=cull)
        assert out.hole.all() and not out.color.any() and np.isinf(out.depth).all() and out.stats.eliminated == 0
    nothing = DepthImage(np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.full((HEIGHT, WIDTH), np.inf), camera)
    assert LayeredDepthImage.build(nothing).samples == 0
    assert empty.octree().count.tolist() == [0]
    assert empty.cull_faults(camera).eliminated == 0


def test_images_of_other_sizes_and_cameras_are_merged():
    rng = np.random.default_rng(2)
    images = [
        surfaces(rng, camera_at()),
        surfaces(rng, camera_at((0.2, 0, 0), width=11, height=40)),
        surfaces(rng, camera_at(width=1, height=1)),
    ]
    assert LayeredDepthImage.build(images[0], images[1:]).samples >= images[0].missing.size * 0.8


def test_samples_behind_the_new_eye_are_dropped_and_a_look_back_sees_nothing():
    image = surfaces(np.random.default_rng(3), camera_at(), share=0.0)
    layered = LayeredDepthImage.build(image)
    assert layered.warp(camera_at((0, 0, 7.0))).hole.all()
    assert layered.warp(camera_at(turn=(0, np.pi, 0))).hole.all()


@pytest.mark.parametrize("cull", [False, "exact"])
@pytest.mark.parametrize("order", ["occlusion", "zbuffer"])
def test_samples_before_the_near_plane_are_as_if_they_were_not_there(order, cull):
    rng, ahead, near = np.random.default_rng(11), 0.4, 2.0
    camera = camera_at(width=50, height=40)
    layered = random_layers(rng, camera)
    # The eye moves straight ahead: of a depth only that step is taken.
    keep = (ahead + near) * layered.disparity <= 1
    assert 0.2 < keep.mean() < 0.8
    pixel = np.repeat(np.arange(layered.counts.size), layered.counts.reshape(-1))
    offsets = np.concatenate([[0], np.cumsum(np.bincount(pixel[keep], minlength=layered.counts.size))])
    beyond = LayeredDepthImage(camera, offsets, layered.color[keep], layered.disparity[keep], layered.place[keep])
    target = camera_at((0, 0, ahead), width=50, height=40)
    out = layered.warp(target.replace(near=near), order=order, cull=cull)
    assert same_picture(out, beyond.warp(target, order=order)) and not out.hole.all()


def test_a_sky_stays_where_it_is_when_the_eye_moves():
    camera = camera_at()
    layered = LayeredDepthImage.build(
        DepthImage.from_disparity(np.full((HEIGHT, WIDTH, 3), 9, np.uint8), np.zeros((HEIGHT, WIDTH)), camera)
    )
    out = layered.warp(camera_at((50.0, 3.0, -8.0)))
    assert not out.hole.any() and np.isinf(out.depth).all()


# Against plain NumPy


@pytest.mark.parametrize("corners", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_building_agrees_with_loops(seed, corners):
    rng = np.random.default_rng(seed)
    eyes = [(0, 0, 0), (0.3, 0.1, 0.0), (-0.2, 0.0, 0.4), (0.0, 0.2, -0.5)]
    images = [surfaces(rng, camera_at(eye, turn=(0, 0.05 * n, 0.02 * n))) for n, eye in enumerate(eyes)]
    layered = LayeredDepthImage.build(images[0], images[1:], tolerance=1.5, color_tolerance=100, corners=corners)
    expected = reference.merge(images, 1.5, 100, corners)
    # A sample may lie so near to a pixel's side, or a depth to the tolerance, that rounding decides.
    agree = [len(own) == count for own, count in zip(expected, layered.counts.reshape(-1), strict=True)]
    assert np.mean(agree) > 0.995
    for pixel in np.flatnonzero(agree):
        own = slice(layered.offsets[pixel], layered.offsets[pixel + 1])
        np.testing.assert_allclose(layered.disparity[own], [d for d, _, _ in expected[pixel]], rtol=1e-6)
        colors = np.array([c for _, c, _ in expected[pixel]]).reshape(-1, 3)
        places = np.array([p for _, _, p in expected[pixel]]).reshape(-1, 2)
        np.testing.assert_array_equal(layered.color[own], colors)
        assert np.abs(layered.place[own] - places).max(initial=0) <= 1


@pytest.mark.parametrize("splat", [1, 3, 5])
@pytest.mark.parametrize(
    ("eye", "turn"),
    [
        ((0, 0, 0), (0, 0, 0)),
        ((0.3, 0.1, 0.2), (0.05, -0.1, 0.1)),
        ((0.1, 0, 0.9), (0, 0, 0)),
        ((0, 0.1, -1), (0, 0.2, 0)),
        ((0.4, 0, 2.0), (0, 1.4, 0)),
    ],
)
def test_warping_agrees_with_loops(eye, turn, splat):
    layered = random_layers(np.random.default_rng(4), camera_at())
    target = camera_at(eye, turn, width=33, height=25)
    out = layered.warp(target, splat, order="zbuffer")
    color, hole = reference.warp(layered, target, splat)
    # float32 against float64: a sample on a pixel's side. Of infinitely far ones any may be shown.
    assert (hole == out.hole).mean() > 0.995
    assert (color == out.color).all(axis=-1)[np.isfinite(out.depth) | hole].mean() > 0.985


# Properties


@given(
    seed=seeds,
    splat=st.sampled_from([1, 3, 5]),
    order=st.sampled_from(["occlusion", "zbuffer"]),
    move=st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    turn=st.tuples(*[st.floats(-0.6, 0.6)] * 3),
)
def test_leaving_out_what_is_hidden_changes_no_pixel(seed, splat, order, move, turn):
    rng = np.random.default_rng(seed)
    layered = random_layers(rng, camera_at(width=50, height=40), most=int(rng.integers(1, 12)))
    target = camera_at(move, turn, width=60, height=200, focal=rng.uniform(15, 60))
    whole, culled = (layered.warp(target, splat, order=order, cull=cull) for cull in (False, "exact"))
    assert same_picture(whole, culled)
    stats = culled.stats
    assert stats.drawn + stats.hidden + stats.outside == stats.samples == layered.samples
    assert (whole.exact.sum() <= stats.drawn) and whole.stats.hidden == 0


@given(seed=seeds, move=st.tuples(*[st.floats(-1.0, 1.0)] * 3), cull=st.sampled_from([False, "exact", "paper"]))
@settings(max_examples=15)
def test_threads_change_nothing(seed, move, cull):
    rng = np.random.default_rng(seed)
    images = [surfaces(rng, camera_at((0.1 * n, 0, 0), width=70, height=300)) for n in range(3)]
    layered = [LayeredDepthImage.build(images[0], images[1:], threads=threads) for threads in (1, 2, 5)]
    for name in ("offsets", "color", "disparity", "place"):
        assert all(np.array_equal(getattr(layered[0], name), getattr(other, name)) for other in layered)
    pictures = [
        layered[0].warp(camera_at(move, width=80, height=400), cull=cull, threads=threads) for threads in (1, 2, 5)
    ]
    assert all(same_picture(pictures[0], other) and other.stats == pictures[0].stats for other in pictures)


@given(seed=seeds)
@settings(max_examples=10)
def test_the_order_alone_is_right_almost_everywhere(seed):
    # The occlusion-compatible order compares no depths; where lines through the epipole fall between pixels it may err.
    rng = np.random.default_rng(seed)
    images = [surfaces(rng, camera_at((0.15 * n, 0, 0), width=96, height=64, focal=80.0), share=0.0) for n in range(3)]
    layered = LayeredDepthImage.build(images[0], images[1:])
    target = camera_at(rng.uniform(-0.3, 0.3, 3), width=96, height=64, focal=80.0)
    by_depth, by_order = layered.warp(target, 1, order="zbuffer"), layered.warp(target, 1)
    np.testing.assert_array_equal(by_depth.hole, by_order.hole)
    assert np.isclose(by_depth.depth, by_order.depth, rtol=0.1).mean() > 0.98


@given(seed=seeds, loss=st.sampled_from([0.0, 0.01, 0.1]))
@settings(max_examples=15)
def test_compaction_keeps_what_the_views_show(seed, loss):
    rng = np.random.default_rng(seed)
    images = [surfaces(rng, camera_at((0.2 * n, 0, 0))) for n in range(3)]
    layered = LayeredDepthImage.build(images[0], images[1:], tolerance=0.2)
    views = [camera_at(rng.uniform(-0.3, 0.3, 3)) for _ in range(4)]
    small = layered.compact(views, loss=loss)
    before, after = ([image.warp(view) for view in views] for image in (layered, small))
    if loss == 0:
        assert all(same_picture(a, b) for a, b in zip(before, after, strict=True))
        np.testing.assert_array_equal(
            np.minimum(small._kernel.shown(stack(views), 1, "occlusion"), 1), np.ones(small.samples)
        )
    else:
        assert small.samples <= layered.compact(views).samples
        shown = sum(a.exact.sum() for a in before)
        lost = sum((a.exact & ~(b.exact & (a.depth == b.depth))).sum() for a, b in zip(before, after, strict=True))
        assert lost <= 2 * loss * shown + 4


# Rays


def test_casting_counts_what_open3d_counts_and_begins_with_the_picture():
    o3d = need("open3d")
    scene = cyc.scenes.gear()
    camera = Camera.look_at(scene.center + (0.3, 0.2, 2.5 * scene.radius), scene.center, width=80, height=60)
    layered = LayeredDepthImage.cast(scene, camera)
    view = scene.render(camera)
    np.testing.assert_array_equal(layered.layer(0).missing, np.isinf(view.depth))
    np.testing.assert_allclose(layered.layer(0).depth, view.depth, rtol=1e-6)
    np.testing.assert_array_equal(
        layered.layer(0).color[~layered.layer(0).missing], view.color[np.isfinite(view.depth)]
    )
    rays = o3d.t.geometry.RaycastingScene()
    rays.add_triangles(scene.vertices.astype(np.float32), scene.faces)
    origins, directions = camera.rays()
    counts = rays.count_intersections(
        o3d.core.Tensor(np.concatenate([origins, directions], -1).astype(np.float32))
    ).numpy()
    assert (counts == layered.counts).mean() > 0.98 and layered.counts.max() > 3
    assert LayeredDepthImage.cast(scene, camera, 2).counts.max() == 2
    red = LayeredDepthImage.cast(
        scene, camera, 1, color=lambda faces, points: np.full((len(faces), 3), (255, 0, 0), np.uint8)
    )
    assert (red.color == (255, 0, 0)).all()


def test_normals_of_hits_are_those_of_their_faces():
    o3d = need("open3d")
    scene = cyc.scenes.gear()
    camera = Camera.look_at(scene.center + (0.3, 0.2, 2.5 * scene.radius), scene.center, width=80, height=60)
    layered = LayeredDepthImage.cast(scene, camera, normals=True)
    assert layered.normals.dtype == np.uint16 and len(layered.normals) == layered.samples
    rays = o3d.t.geometry.RaycastingScene()
    rays.add_triangles(scene.vertices.astype(np.float32), scene.faces)
    origins, directions = camera.rays()
    hits = rays.cast_rays(o3d.core.Tensor(np.concatenate([origins, directions], -1).astype(np.float32)))
    true = hits["primitive_normals"].numpy()
    true = np.where((true * directions).sum(-1, keepdims=True) > 0, -true, true)
    there = layered.counts > 0
    found = decode(layered.normals[layered.offsets[:-1].reshape(there.shape)[there]])
    # Sixteen bits hold a direction to a degree; on an edge either face may be hit.
    assert ((found * true[there]).sum(-1) > np.cos(np.radians(1))).mean() > 0.99
    every = decode(layered.normals)
    pixel = np.repeat(np.arange(there.size), layered.counts.reshape(-1))
    assert ((every * directions.reshape(-1, 3)[pixel]).sum(-1) < np.sin(np.radians(1))).all()
    assert LayeredDepthImage.cast(scene, camera).normals is None


def test_a_tolerance_leaves_out_hits_that_lie_close_behind():
    sheets = cyc.scenes.layers(200, layers=5)
    camera = Camera.look_at((0, 0, 9), (0, 0, 0), width=16, height=12)
    assert LayeredDepthImage.cast(sheets, camera).counts.max() == 5
    assert LayeredDepthImage.cast(sheets, camera, tolerance=1e4).counts.max() == 1


# What it must show


def textured(scene, camera):
    """A picture whose colours depend on the place in the world, in detail."""
    view = scene.render(camera)
    points = np.nan_to_num(DepthImage.from_view(view).points())
    waves = [np.sin(points @ w + k) for k, w in enumerate([(9, 7, 5), (23, -17, 19), (-31, 29, 11)])]
    color = np.stack([127 + 60 * waves[0] + 60 * waves[k] for k in range(3)], -1)
    return DepthImage.from_view(view, color=np.clip(color, 0, 255).astype(np.uint8))


@pytest.mark.parametrize(
    ("name", "eye", "target", "up"),
    [("fzk_haus", (4.5, 2, 1.6), (5.42, 2.38, 1.6), (0, 0, 1)), ("sibenik", (6, 5, 0), (5, 5, 0), (0, 1, 0))],
)
def test_nine_images_of_an_interior_make_one_without_holes(real_scene, name, eye, target, up):
    scene = real_scene(name)
    inner = Camera.look_at(eye, target, up, fov_y=35, width=256, height=192)
    depth = scene.render(inner).depth
    reach = 0.1 * depth[np.isfinite(depth)].mean()
    corners = quadrilateral(inner, max(reach, 0.9 * float(depth.min())))
    cameras = construction_cameras(inner.eye, corners, reach, (256, 192), margin=0.1)
    images = [textured(scene, camera) for camera in cameras]
    layered = LayeredDepthImage.build(images[0], images[1:])
    turn = inner.world_to_camera[:3, :3]
    extent = 2 * np.abs([turn @ (camera.eye - inner.eye) for camera in cameras[1:]]).max(axis=0)
    rng = np.random.default_rng(5)
    rows = []
    for _ in range(6):
        step = rng.normal(size=3)
        step *= rng.random() ** (1 / 3) / np.linalg.norm(step)
        there = inner.eye + turn.T @ (extent * (step[0], step[1], abs(step[2])))
        pose = inner.world_to_camera.copy()
        pose[:3, 3] = -turn @ there
        camera = inner.replace(world_to_camera=pose)
        truth = textured(scene, camera)
        seen = ~truth.missing
        order = sorted(images, key=lambda image: -np.linalg.norm(image.camera.eye - there))
        single = cyc.warp.forward(images[0], camera)
        all_nine = cyc.warp.forward(order, camera, order="zbuffer")
        one = layered.warp(camera, cull="exact")
        errors = [np.square(out.color[seen].astype(float) - truth.color[seen]).mean() for out in (one, all_nine)]
        rows.append((single.hole[seen].mean(), one.hole[seen].mean(), *errors))
    holes_single, holes, error, error_nine = np.mean(rows, axis=0)
    assert holes <= 0.1 * holes_single
    assert 10 * np.log10(error / error_nine) <= 0.5
    assert layered.samples <= sum((~image.missing).sum() for image in images) / 3
    assert layered.samples <= 3 * images[0].missing.size
    assert layered.nbytes <= 8 * layered.samples + 4 * images[0].missing.size + 4


def test_more_than_half_of_a_dense_scene_is_left_out(real_scene):
    camera = Camera.look_at((0.84, 1.24, 0.06), (0.84, 1.24, 1), width=256, height=192)
    layered = LayeredDepthImage.cast(real_scene("kitchen"), camera)
    moved = Camera.look_at((0.94, 1.24, 0.06), (0.94, 1.24, 1), width=256, height=192)
    for target in (camera, moved):
        whole, culled = layered.warp(target), layered.warp(target, cull="exact")
        assert same_picture(whole, culled)
        assert culled.stats.eliminated >= 0.5


# No more images than an error needs


def test_construction_images_are_merged_until_the_error_is_met():
    scene = cyc.scenes.pipes(3000)
    eye = scene.center + (0, 0, 2.0 * scene.radius)
    inner = Camera.look_at(eye, scene.center, fov_y=40, width=80, height=60)
    cameras = construction_cameras(eye, quadrilateral(inner, scene.radius), 0.5 * scene.radius, (80, 60), margin=0.1)
    images = [textured(scene, camera) for camera in cameras]
    judges = [
        textured(scene, Camera.look_at(eye + step, scene.center, fov_y=40, width=80, height=60))
        for step in ((0.1, 0, -0.2), (-0.1, 0.1, -0.1))
    ]
    everything = LayeredDepthImage.build(images[0], images[1:], max_error=0.0, held_out=judges)
    assert sorted(everything.merged) == list(range(8)) and len(everything.errors) == 9
    enough = (everything.errors[0] + min(everything.errors)) / 2
    some = LayeredDepthImage.build(images[0], images[1:], max_error=enough, held_out=judges)
    assert some.errors[-1] <= enough < min(some.errors[:-1]) and len(some.merged) < 8
    assert some.errors == everything.errors[: len(some.errors)]
    none = LayeredDepthImage.build(images[0], images[1:], max_error=255.0)
    assert none.merged == () and len(none.errors) == 1


# Bad input


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"offsets": [0, 2]}, "offsets must be"),
        ({"offsets": [0, 2, 4]}, "offsets run from 0 to 4"),
        ({"offsets": [0, 4, 3]}, r"offsets\[2\] is 3"),
        ({"offsets": [0, -1, 3]}, r"offsets\[1\] is -1"),
        ({"disparity": [0.5, np.nan, 0.2]}, r"disparities\[1\] is NaN"),
        ({"disparity": [0.5, -0.1, 0.2]}, r"disparities\[1\] is -0.1"),
        ({"disparity": [0.5, 0.6, 0.2]}, r"disparities\[1\] is 0.6, nearer than 0.5"),
        ({"color": np.zeros((2, 3), np.uint8)}, "color must be"),
        ({"color": np.full((3, 3), 256)}, r"color\[0, 0\] is 256"),
        ({"color": np.full((3, 3), -1)}, r"color\[0, 0\] is -1"),
        ({"place": np.full((3, 2), 8)}, r"place\[0, 0\] is 8"),
        ({"camera": Camera.orthographic_look_at((0, 0, 1), (0, 0, 0), width=2, height=1)}, "orthographic"),
    ],
)
def test_bad_samples_are_refused(changes, message):
    good = {
        "camera": camera_at(width=2, height=1),
        "offsets": [0, 2, 3],
        "color": np.zeros((3, 3), np.uint8),
        "disparity": [0.5, 0.25, 1.0],
    }
    assert LayeredDepthImage(**good).samples == 3
    with pytest.raises(ValueError, match=message):
        LayeredDepthImage(**(good | changes))


def test_bad_arguments_are_refused():
    image = surfaces(np.random.default_rng(6), camera_at())
    layered = LayeredDepthImage.build(image)
    for call, message in [
        (lambda: LayeredDepthImage.build(image, [3]), r"construction\[0\]"),
        (lambda: LayeredDepthImage.build(None), "central must be"),
        (lambda: LayeredDepthImage.build(image, tolerance=-1), "tolerance"),
        (lambda: LayeredDepthImage.build(image, tolerance=np.nan), "tolerance"),
        (lambda: LayeredDepthImage.build(image, color_tolerance=300), "color_tolerance"),
        (lambda: LayeredDepthImage.build(image, max_error=-1.0), "max_error"),
        (lambda: LayeredDepthImage.build(image, held_out=[image]), "held_out"),
        (lambda: LayeredDepthImage.build(image, max_error=1.0), "construction is empty"),
        (lambda: LayeredDepthImage.build(image, [image], max_error=1.0, held_out=[]), "held_out is empty"),
        (lambda: LayeredDepthImage.build(image, [image] * 256), "256 images"),
        (lambda: layered.warp(3), "camera must be"),
        (lambda: layered.warp(image.camera, 2), "splat"),
        (lambda: layered.warp(image.camera, "disparity"), "cull='paper'"),
        (lambda: layered.warp(image.camera, cull="all"), "cull must be"),
        (lambda: layered.warp(image.camera, order="random"), "order must be"),
        (lambda: layered.warp(image.camera, "mesh"), "neighbours"),
        (lambda: layered.warp(image.camera, "projected", cull="paper"), "needs cull=False"),
        (lambda: layered.warp(image.camera, threads=0), "threads"),
        (lambda: layered.warp(image.camera, thresholds=(0, 1), cull="paper"), "thresholds"),
        (lambda: layered.warp(image.camera, out=layered.warp(camera_at(width=3))), r"out\.color must be"),
        (lambda: layered.compact([]), "cameras is empty"),
        (lambda: layered.compact([image.camera], loss=2), "loss"),
        (lambda: layered.layer(-1), "index"),
        (lambda: LayeredDepthImage.cast(cyc.scenes.layers(20, 5), image.camera, 0), "layers"),
    ]:
        with pytest.raises(ValueError, match=message):
            call()


@pytest.mark.parametrize("name", ["color", "depth", "hole", "exact", "source"])
@pytest.mark.parametrize("cull", [False, "exact", "paper"])
def test_memory_that_would_be_filled_in_the_wrong_order_is_refused(name, cull):
    image = surfaces(np.random.default_rng(8), camera_at())
    layered = LayeredDepthImage.build(image)
    good = cyc.warp.Warped.empty(image.camera)
    array = getattr(good, name)
    turned, frozen = np.asfortranarray(array), array.copy()
    frozen.flags.writeable = False
    for bad in (turned, frozen, array[:-1].copy(), array.astype(np.float64)):
        with pytest.raises(ValueError, match=rf"out\.{name} must be"):
            layered.warp(image.camera, cull=cull, out=dataclasses.replace(good, **{name: bad}))


def test_memory_of_an_earlier_answer_is_reused_and_may_shine_through():
    image = surfaces(np.random.default_rng(7), camera_at())
    layered = LayeredDepthImage.build(image)
    first = layered.warp(image.camera, 1)
    before = first.color.copy()
    second = layered.warp(camera_at((0.5, 0, 0)), 1, out=first, background=first)
    assert second.color is first.color and second.hole.any()
    np.testing.assert_array_equal(second.color[second.hole], before[second.hole])
