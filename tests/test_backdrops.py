"""Painted backdrops, and frames drawn with them, against the whole scene drawn from the same eye."""

from __future__ import annotations

import json
import threading
import time

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import BACKGROUND, Camera, DepthImage, LayeredDepthImage
from cyclorama.placement import painting, walking
from cyclorama.placement.backdrops import Backdrops
from cyclorama.placement.drawing import DISPLAYS
from cyclorama.placement.store import Store, size_of
from cyclorama.placing import camera_through
from reference.placement import FewImages

SIZE = (96, 72)
EYE, GAZE = np.array([0.1, 0.05, 0.9]), np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def scene():
    return cyc.scenes.pipes(20_000)


@pytest.fixture(scope="module")
def plan(scene):
    # Deep enough that the eye stands before both planes: -0.1 and 0.2.
    return FewImages(scene, [(0.1, 0.0, 1.6), (0.0, 0.1, 1.2)], 1.3)


@pytest.fixture(scope="module")
def used(plan):
    return painting.uses(plan, 6000)


@pytest.fixture(scope="module")
def backdrops(plan, scene, used, tmp_path_factory):
    made = Backdrops(plan, scene, tmp_path_factory.mktemp("store"), size=(192, 144), on_demand=False)
    made._uses = used
    assert made.paint(progress=False) == 2
    yield made
    made.close()


def image(samples: int = 10, width: int = 4) -> LayeredDepthImage:
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=width, height=1)
    offsets = np.minimum(np.arange(width + 1) * samples, samples)
    return LayeredDepthImage(camera, offsets, np.zeros((samples, 3), np.uint8), np.full(samples, 0.5))


def test_uses_are_frames_that_get_the_image(plan, used):
    assert len(used.of(0)[0]) > 5 and len(used.of(1)[0]) > 5
    for index in (0, 1):
        for eye, gaze in zip(*used.of(index), strict=True):
            assert plan.frame(eye, gaze).image.index == index


def test_construction_cameras_see_all_that_the_frames_see_behind_the_quadrilateral(plan, scene, used):
    eyes, gazes = used.of(0)
    cameras = painting.views_of_use(plan, 0, eyes, gazes, len(eyes), SIZE)
    culled = plan.culled(0)
    points = scene.vertices[scene.faces[culled]].reshape(-1, 3)
    for camera in cameras:
        which = np.linalg.norm(eyes - camera.eye, axis=1).argmin()
        assert np.allclose(camera.eye, eyes[which])
        pixels, depth = painting.frame_camera(plan, eyes[which], gazes[which], SIZE).project(points)
        seen = (depth > 0) & ((pixels >= 0) & (pixels <= SIZE)).all(axis=1)
        at, _ = camera.project(points[seen])
        assert (at >= -1e-6).all() and (at <= (camera.width + 1e-6, camera.height + 1e-6)).all()


def test_the_frame_s_camera_has_the_plan_s_field_of_view_whatever_the_pixels(plan):
    camera = painting.frame_camera(plan, EYE, GAZE, (510, 480))
    assert np.isclose(camera.fov_x, 60) and np.isclose(camera.fov_y, 2 * np.degrees(np.arctan(0.75 * 3**-0.5)))
    assert np.allclose(camera.forward, GAZE) and np.allclose(camera.eye, EYE)


@pytest.mark.parametrize("display", DISPLAYS)
def test_from_the_viewpoint_every_display_shows_the_truth(backdrops, plan, scene, display):
    # As fine an image as the frame, from the same eye: what remains is sampling, at silhouettes.
    viewpoint = plan.viewpoints[0] - (0, 0, 1e-9)
    drawn = backdrops.draw(viewpoint, GAZE, SIZE, display=display)
    view = scene.render(drawn.camera)
    truth = backdrops.color(view)
    assert drawn.stats.image == 0 and drawn.stats.faces + len(plan.culled(0)) == len(scene)
    culled = np.isin(view.ids, plan.culled(0))
    assert culled.mean() > 0.02
    # Geometry is exact wherever the backdrop doesn't hide it.
    np.testing.assert_array_equal(drawn.color[~drawn.backdrop & ~culled], truth[~drawn.backdrop & ~culled])
    assert (drawn.ids[drawn.backdrop] == BACKGROUND).all()
    assert drawn.backdrop[culled].mean() > 0.9
    wrong = np.abs(drawn.color.astype(int) - truth).max(axis=2) > 40
    assert wrong[culled].mean() < 0.25


def test_depth_decides_where_geometry_and_backdrop_meet(backdrops, scene, plan):
    drawn = backdrops.draw(EYE, GAZE, SIZE)
    view = scene.render(drawn.camera)
    geometry = scene.render(drawn.camera, plan.frame(EYE, GAZE).faces)
    assert (drawn.depth <= geometry.depth).all()
    assert (drawn.depth[drawn.backdrop] < geometry.depth[drawn.backdrop]).all()
    # Nothing lies before the nearest face but by the sampling of silhouettes.
    near = drawn.depth < 0.98 * view.depth
    assert near.mean() < 0.02


def test_the_layered_backdrop_beats_the_other_displays(backdrops, used):
    eyes, gazes = (np.concatenate([used.of(i)[k][::3] for i in (0, 1)]) for k in (0, 1))
    rows = {row["display"]: row for row in walking.walk(backdrops, eyes, gazes, size=SIZE, progress=False)}
    assert rows["ldi"]["frames"] == len(eyes) and rows["ldi"]["pixels"] > 0.02
    for other in ("warp", "mesh", "quad", "geometry"):
        assert rows["ldi"]["psnr"] > rows[other]["psnr"] + 1, other
    assert rows["ldi"]["lost"] < rows["warp"]["lost"] / 4
    assert rows["ldi"]["holes"] < 0.02


def test_holes_are_only_where_the_culled_space_is_seen(plan, scene, used, tmp_path):
    # An image of nothing: all of its space is unknown, and nothing else is.
    made = Backdrops(plan, scene, tmp_path, size=(8, 6))
    made._uses = used
    camera = camera_through(plan.viewpoints[0], plan.images.corners[0], (8, 6))
    made.store.put(0, LayeredDepthImage(camera, np.zeros(49, int), np.empty((0, 3), np.uint8), []))
    viewpoint = plan.viewpoints[0] - (0, 0, 1e-9)
    drawn = made.draw(viewpoint, GAZE, SIZE, prefetch=False)
    view = scene.render(drawn.camera)
    culled = np.isin(view.ids, plan.culled(0))
    assert not drawn.backdrop.any() and drawn.hole[culled].all()
    held = scene.vertices[scene.faces[plan.culled(0)]].reshape(-1, 3)
    pixels, _ = drawn.camera.project(held)
    _, x = np.argwhere(drawn.hole).T
    assert x.min() >= np.floor(pixels[:, 0].min()) - 1 and x.max() <= pixels[:, 0].max() + 1
    # Geometry before the plane hides whatever is unknown.
    front = drawn.camera.project(plan.images.corners[0])[1].min()
    assert not drawn.hole[drawn.depth < front].any() and drawn.hole.any()
    made.close()


def test_a_smaller_warp_is_scaled_up(backdrops):
    whole, small = (backdrops.draw(EYE, GAZE, SIZE, warp_size=size) for size in (None, (48, 36)))
    assert small.color.shape == whole.color.shape
    assert (whole.backdrop == small.backdrop).mean() > 0.9
    difference = np.abs(whole.color.astype(int) - small.color).max(axis=2)
    assert 0 < (difference > 0).mean() < 0.2


def test_the_picture_does_not_depend_on_threads(backdrops, plan, scene, used, tmp_path):
    one, two = (backdrops.draw(EYE, GAZE, SIZE, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.color, two.color)
    np.testing.assert_array_equal(one.hole, two.hole)
    again = backdrops.make(1, threads=2)
    np.testing.assert_array_equal(again.disparity, backdrops.store.get(1).disparity)
    np.testing.assert_array_equal(again.color, backdrops.store.get(1).color)


def test_painting_goes_on_where_it_was_interrupted(plan, scene, used, tmp_path):
    made = Backdrops(plan, scene, tmp_path, size=SIZE, construction=3)
    made._uses = used

    def stop(done: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made.paint(threads=1, progress=stop)
    left = made.store.missing()
    assert len(left) < 2 and not list(tmp_path.glob("*.part"))
    kept = {path: path.read_bytes() for path in tmp_path.glob("*.npz")}
    assert made.paint(progress=False) == len(left)
    assert made.store.missing() == [] and made.paint(progress=False) == 0
    assert all(path.read_bytes() == data for path, data in kept.items())


def test_images_are_made_on_demand_or_refused(plan, scene, used, tmp_path):
    made = Backdrops(plan, scene, tmp_path, size=SIZE, construction=2)
    made._uses = used
    assert made.draw(EYE, GAZE, SIZE, prefetch=False).stats.image is not None
    assert (made.store.made, len(made.store.missing())) == (1, 1)
    strict = Backdrops(plan, scene, tmp_path, size=SIZE, construction=2, on_demand=False)
    with pytest.raises(FileNotFoundError, match="not painted"):
        strict.store.get(made.store.missing()[0])


def test_a_store_of_something_else_is_refused(plan, scene, tmp_path):
    Backdrops(plan, scene, tmp_path, size=SIZE)
    with pytest.raises(ValueError, match=r"another size: \[96, 72\], not \[48, 36\]"):
        Backdrops(plan, scene, tmp_path, size=(48, 36))
    other = FewImages(scene, [(0.1, 0.0, 1.7), (0.0, 0.1, 1.2)], 1.3)
    with pytest.raises(ValueError, match="another plan"):
        Backdrops(other, scene, tmp_path, size=SIZE)
    moved = cyc.Scene(scene.vertices + 1, scene.faces)
    with pytest.raises(ValueError, match="another scene"):
        Backdrops(plan, moved, tmp_path, size=SIZE)
    manifest = tmp_path / "manifest.json"
    manifest.write_bytes(manifest.read_bytes()[:40])
    with pytest.raises(ValueError, match="no whole manifest"):
        Backdrops(plan, scene, tmp_path, size=SIZE)
    manifest.write_text(json.dumps({"format": "bake 1"}))
    with pytest.raises(ValueError, match="its format is 'bake 1'"):
        Backdrops(plan, scene, tmp_path, size=SIZE)


def test_a_file_that_is_cut_off_is_refused_with_its_name(tmp_path):
    store = Store(cyc.LayeredDepthImage.load, size_of, tmp_path, 2, {})
    store.put(0, image())
    path = store.path(0)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(ValueError, match=r"000000\.npz is not a whole image"):
        store.missing()
    with pytest.raises(ValueError, match=r"000000\.npz is not a whole layered image"):
        store.get(0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"where": "here"}, "where must be"),
        ({"construction": 255}, "construction must be an integer from 0 to 254"),
        ({"size": (0, 5)}, "size must be two numbers of pixels"),
        ({"memory": -1}, "memory must be a number of bytes"),
    ],
)
def test_wrong_arguments_are_refused(plan, scene, tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        Backdrops(plan, scene, tmp_path, **options)


def test_an_unknown_display_is_refused(backdrops):
    with pytest.raises(ValueError, match="display must be one of"):
        backdrops.draw(EYE, GAZE, SIZE, display="film")


def test_what_was_used_last_stays_in_memory(tmp_path):
    one = size_of(image())
    store = Store(cyc.LayeredDepthImage.load, size_of, tmp_path, 4, {}, memory=2 * one)
    for index in range(4):
        store.put(index, image())
    for index in (0, 1, 0, 2):
        store.get(index)
    assert store.in_memory == (0, 2) and store.bytes_in_memory == 2 * one
    assert (store.hits, store.loads) == (1, 3)
    assert Store(cyc.LayeredDepthImage.load, size_of, tmp_path, 4, {}, memory=0).get(3).samples == 10


def test_prefetching_loads_the_most_wanted_that_memory_holds(tmp_path):
    one = size_of(image())
    store = Store(cyc.LayeredDepthImage.load, size_of, tmp_path, 6, {}, memory=3 * one)
    for index in range(6):
        store.put(index, image())
    store.get(5)
    store.get(4)
    store.prefetch([4, 2, 0, 1, 3])
    assert store.wait(10)
    assert sorted(store.in_memory) == [0, 2, 4]
    loads = store.loads
    for index in (4, 2, 0):
        store.get(index)
    assert store.loads == loads
    store.close()
    with pytest.raises(ValueError, match="closed"):
        store.prefetch([1])


def test_two_that_want_an_image_make_it_once(tmp_path):
    started = threading.Event()

    def make(_: int) -> LayeredDepthImage:
        started.set()
        time.sleep(0.05)
        return image()

    store = Store(cyc.LayeredDepthImage.load, size_of, tmp_path, 1, {}, make=make)
    got: list[LayeredDepthImage] = []
    threads = [threading.Thread(target=lambda: got.append(store.get(0))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert store.made == 1 and started.is_set() and len({id(one) for one in got}) == 1


def test_the_nearest_viewpoints_come_first(backdrops, plan, monkeypatch):
    orders = []
    monkeypatch.setattr(backdrops.store, "prefetch", orders.append)
    for index, viewpoint in enumerate(plan.viewpoints):
        backdrops.prefetch(viewpoint)
        assert orders[-1][0] == index and sorted(orders[-1]) == [0, 1]


def test_colours_are_the_same_from_everywhere(scene):
    lit = painting.Lit(scene)
    seen: dict[int, bytes] = {}
    for eye in ((0, 0, 3), (0.5, 0.4, 2), (-1, 0.3, 2.5)):
        view = scene.render(Camera.look_at(eye, (0, 0, 0), width=40, height=30))
        for face, color in zip(view.ids.ravel().tolist(), lit(view).reshape(-1, 3), strict=True):
            assert seen.setdefault(face, color.tobytes()) == color.tobytes()
    assert len(seen) > 50 and seen[int(BACKGROUND)] == b"\xff\xff\xff"


def test_a_path_stays_in_its_box_and_takes_small_steps():
    eyes, gazes = walking.path((0, 1, 2), (1, 3, 5), 200, seed=3)
    assert (eyes >= (0, 1, 2)).all() and (eyes <= (1, 3, 5)).all()
    assert np.abs(np.diff(eyes, axis=0)).max() < 0.05 * 3
    assert np.allclose(np.linalg.norm(gazes, axis=1), 1) and (gazes[:, 1] == 0).all()


def tilted(slope: float) -> DepthImage:
    """A wall whose disparity grows to the right."""
    camera = Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=60, width=64, height=48)
    x = np.arange(64) + 0.5
    disparity = np.tile(0.5 + slope * (x - 32), (48, 1)).astype(np.float32)
    color = np.zeros((48, 64, 3), np.uint8)
    color[..., 0], color[..., 1] = 3 * np.arange(64), 5 * np.arange(48)[:, None]
    return DepthImage.from_disparity(color, disparity, camera, missing=np.zeros((48, 64), np.bool_))


@pytest.mark.parametrize("slope", [0.0, 0.004, -0.004])
@pytest.mark.parametrize("step", [0.3, 0.9, 1.2])
def test_projected_pieces_leave_no_cracks_in_one_surface(slope, step):
    # Up to 3.5 times as near as it was taken: squares of three pixels leave cracks, pieces don't.
    wall = tilted(slope)
    layered = LayeredDepthImage.build(wall)
    camera = Camera.look_at((0, 0, -step), (0, 0, -9), fov_y=40, width=96, height=72)
    warped = layered.warp(camera, splat="projected")
    # The plane of the wall, met by the rays of the camera: 1 = n . p.
    points = wall.points().reshape(-1, 3)
    normal = np.linalg.lstsq(points, np.ones(len(points)), rcond=None)[0]
    origins, directions = camera.rays()
    t = (1 - origins @ normal) / (directions @ normal)
    there = origins + t[..., None] * directions
    pixels, _ = wall.camera.project(there.reshape(-1, 3))
    inside = ((pixels >= 1) & (pixels <= (63, 47))).all(axis=1).reshape(t.shape)
    assert inside.mean() > 0.3 and not warped.hole[inside].any()
    depth = camera.project(there.reshape(-1, 3))[1].reshape(t.shape)
    # A sample is up to one of its own pixels away: 1.25 halves and a quarter of a target pixel, and so is its depth.
    assert np.abs(warped.depth / depth - 1)[inside].max() < 0.04
    off = np.abs(warped.color[..., 0].astype(float) / 3 - pixels[:, 0].reshape(t.shape) + 0.5)[inside]
    assert off.max() < 1.6


def test_projected_pieces_hide_what_is_behind_them():
    wall, camera = tilted(0.0), Camera.look_at((0, 0, -1.3), (0, 0, -9), fov_y=40, width=96, height=72)
    behind = DepthImage(np.full((48, 64, 3), 255, np.uint8), np.full((48, 64), 9.0, np.float32), wall.camera)
    layered = LayeredDepthImage.build(wall, [behind])
    assert layered.samples == 2 * 64 * 48
    shown = layered.warp(camera, splat="projected")
    assert (shown.depth < 1).all() and (shown.color[..., 2] == 0).all()
    # Squares let it shine through.
    assert (layered.warp(camera, splat=3).depth > 1).any()


def test_projected_pieces_refuse_what_they_cannot_do():
    layered = LayeredDepthImage.build(tilted(0.0))
    for options in ({"cull": "exact"}, {"cull": "paper"}, {"order": "occlusion"}):
        with pytest.raises(ValueError, match="splat='projected' needs"):
            layered.warp(layered.camera, splat="projected", **options)
