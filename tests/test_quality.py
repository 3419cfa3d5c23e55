"""Measures of quality: against scikit-image, against ray casts, and by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import Camera, quality
from peers import need


def pictures(seed, shape=(40, 30, 3)):
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 256, shape, dtype=np.uint8)
    noise = rng.normal(0, rng.uniform(0.5, 60), shape)
    return np.clip(np.rint(truth + noise), 0, 255).astype(np.uint8), truth


@given(st.integers(0, 2**32 - 1), st.sampled_from([(40, 30, 3), (7, 9, 3), (20, 20, 1)]))
def test_errors_are_those_of_scikit_image(seed, shape):
    metrics = need("skimage.metrics")
    picture, truth = pictures(seed, shape)
    assert quality.psnr(picture, truth) == pytest.approx(metrics.peak_signal_noise_ratio(truth, picture), rel=1e-12)
    expected = metrics.structural_similarity(picture, truth, channel_axis=-1)
    assert quality.ssim(picture, truth) == pytest.approx(expected, abs=1e-9)


def test_only_the_pixels_that_count_count():
    metrics = need("skimage.metrics")
    picture, truth = pictures(1)
    where = np.zeros(truth.shape[:2], bool)
    where[10:30, 5:20] = True
    spoilt = picture.copy()
    spoilt[~where] = 0
    assert quality.psnr(spoilt, truth, where=where) == quality.psnr(picture[10:30, 5:20], truth[10:30, 5:20])
    _, image = metrics.structural_similarity(picture, truth, channel_axis=-1, full=True)
    assert quality.ssim(picture, truth, where=where) == pytest.approx(image[where].mean(), abs=1e-9)


def test_nothing_differs_and_nothing_counts():
    picture, _ = pictures(2)
    none = np.zeros(picture.shape[:2], bool)
    assert quality.psnr(picture, picture) == np.inf and quality.ssim(picture, picture) == pytest.approx(1)
    assert np.isnan(quality.psnr(picture, picture, where=none)) and np.isnan(quality.ssim(picture, picture, where=none))


def test_a_texture_is_the_same_from_everywhere():
    scene = cyc.scenes.gear()
    above = Camera.look_at(scene.center + (0, 0, 3 * scene.radius), scene.center, width=200, height=150)
    aside = Camera.look_at(scene.center + scene.radius * np.array((1, 1, 3)), scene.center, width=200, height=150)
    first, second = (quality.textured(scene, camera, grain=scene.radius) for camera in (above, aside))
    pixels, depth = aside.project(first.points())
    x, y = (np.nan_to_num(np.floor(pixels[..., k]), nan=-1).astype(int) for k in (0, 1))
    inside = ~first.missing & (x >= 0) & (x < 200) & (y >= 0) & (y < 150)
    x, y, depth = x[inside], y[inside], depth[inside]
    same = np.abs(second.depth[y, x] - depth) < 0.01 * depth
    assert same.mean() > 0.5
    difference = second.color[y, x][same].astype(int) - first.color[inside][same]
    # At most a pixel apart, of a texture of long waves.
    assert np.abs(difference).mean() < 3
    other = quality.textured(scene, above, seed=1, grain=scene.radius)
    assert np.abs(other.color.astype(int) - first.color).mean() > 10


@given(st.integers(0, 2**32 - 1))
def test_textures_use_all_of_the_range_and_little_beyond(seed):
    points = np.random.default_rng(seed).uniform(-50, 50, (20_000, 3))
    colors = quality.paint(points, 1.0, seed=seed)
    assert 30 < colors.std(axis=0).min() and colors.std(axis=0).max() < 50
    assert ((colors == 0) | (colors == 255)).mean() < 0.01


@pytest.mark.parametrize("name", ["kitchen", "bunny"])
def test_what_is_seen_is_what_rays_reach(real_scene, name):
    o3d = need("open3d")
    scene = real_scene(name)
    if name == "kitchen":
        eye, target, there = (0.84, 1.24, 0.06), (1.84, 1.24, 0.26), (0.82, 1.24, 0.16)
    else:
        target, far = scene.center, 3 * scene.radius
        eye, there = target + (0, 0, far), target + (0.5 * far, 0, 0.8 * far)
    here, there = (Camera.look_at(at, target, width=160, height=120) for at in (eye, there))
    image = scene.depth_image(there)
    answer = quality.seen(scene, image, here)
    assert 0.1 < answer[~image.missing].mean() < 0.98
    points = image.points()[~image.missing]
    pixels, depth = here.project(points)
    inside = (depth > 0) & ((pixels >= 0) & (pixels < (160, 120))).all(axis=1)
    rays = np.c_[np.broadcast_to(eye, points.shape), points - eye].astype(np.float32)
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices.astype(np.float32), scene.faces)
    free = inside & (caster.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy() > 1 - 1e-3)
    # The question is put an eighth of a pixel away: it makes a difference at the borders of shadows only.
    assert (answer[~image.missing] != free).mean() < 0.01


def test_holes_are_told_apart():
    wall = cyc.Scene(
        [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0], [-0.2, -9, 1], [0.2, -9, 1], [0.2, 9, 1], [-0.2, 9, 1]],
        [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
    )
    here, there = (Camera.look_at((x, 0, 4), (x, 0, 0), fov_y=40, width=96, height=96) for x in (0, 0.8))
    truth = quality.textured(wall, there, grain=0.3)
    seen = quality.seen(wall, truth, here)
    # Behind the pole of width 0.4 at depth 3 there is a shadow of width 0.4 * 4 / 3 on the wall at depth 4, beside the
    # pole's image; and a strip of the wall at the right border was outside of the picture.
    pixel = 2 * 4 * np.tan(np.radians(20)) / 96
    border = 4 * np.tan(np.radians(20))
    x = 0.8 + (np.arange(96) + 0.5 - 48) * pixel
    pole = truth.ids[48] >= 2
    expected = ~pole & ((np.abs(x) < 0.2 * 4 / 3) | (x > border))
    np.testing.assert_array_equal(~seen[48] & ~pole, expected)
    warped = cyc.warp.forward(quality.textured(wall, here, grain=0.3), there, splat=1)
    measured = quality.compare(warped, truth, seen)
    assert measured.cracks == (warped.hole & seen).sum() / seen.sum()
    assert measured.disoccluded == (~seen).sum() / seen.size
    warped.hole[:] = False
    assert quality.compare(warped, truth, seen).guessed == 1 and quality.compare(warped, truth, seen).cracks == 0


def test_what_does_not_fit_is_refused():
    picture, truth = pictures(3)
    scene = cyc.scenes.sphere(100)
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), width=8, height=8)
    image = quality.textured(scene, camera)
    for call, said in (
        (lambda: quality.psnr(picture, truth[1:]), "one shape"),
        (lambda: quality.psnr(picture / 255, truth), "uint8"),
        (lambda: quality.psnr(picture, truth, where=np.ones(3, bool)), "where must be"),
        (lambda: quality.ssim(picture[:6], truth[:6]), "7 pixels a side"),
        (lambda: quality.paint(np.zeros((2, 3)), 0.0), "grain"),
        (lambda: quality.paint(np.zeros(2), 1.0), "points"),
        (lambda: quality.seen(scene, cyc.DepthImage(image.color, image.depth, camera), camera), "ids"),
        (lambda: quality.compare(cyc.warp.forward(image, camera), image, np.ones(3, bool)), "known must be"),
    ):
        with pytest.raises(ValueError, match=said):
            call()
