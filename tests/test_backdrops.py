"""Painted backdrops, and frames drawn with them, against the whole scene drawn from the same eye."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import BACKGROUND, Camera, DepthImage, LayeredDepthImage
from cyclorama.placement import drawing, painting, walking
from cyclorama.placement.backdrops import Backdrops
from cyclorama.placement.drawing import DISPLAYS
from cyclorama.placement.foreground import Foreground
from cyclorama.placement.groups import Group, Groups
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
    made = Backdrops(plan, scene, tmp_path_factory.mktemp("store"), size=(192, 144), spread=9.0, on_demand=False)
    made._uses = used
    assert made.paint(progress=False) == 2
    yield made
    made.close()


def image(samples: int = 10, width: int = 4) -> LayeredDepthImage:
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=width, height=1)
    offsets = np.minimum(np.arange(width + 1) * samples, samples)
    return LayeredDepthImage(camera, offsets, np.zeros((samples, 3), np.uint8), np.full(samples, 0.5))


def test_uses_are_frames_that_get_the_image(plan, used):
    for index in (0, 1):
        own = used.of(index)
        assert own.stop - own.start > 5
        for eye, gaze in zip(used.eyes[own], used.gazes[own], strict=True):
            assert plan.frame(eye, gaze).image.index == index


def test_halves_of_a_group_are_its_frames_and_have_the_image_too(plan, used, scene):
    groups = Groups(plan, used, scene.bounds)
    whole = groups.group(0)
    assert len(whole.eyes) > used.of(0).stop - used.of(0).start
    for eye, gaze in zip(whole.eyes, whole.gazes, strict=True):
        assert plan.frame(eye, gaze).image.index == 0
    halves = [groups.group(0, node) for node in (2, 3)]
    both = np.vstack([half.places for half in halves])
    assert sorted(map(tuple, both)) == sorted(map(tuple, whole.places))
    assert max(half.spread for half in halves) < whole.spread
    assert all(len(half.eyes) >= 2 for half in halves) == groups.can_divide(whole)


def test_the_frame_s_camera_has_the_plan_s_field_of_view_whatever_the_pixels(plan):
    camera = painting.frame_camera(plan, EYE, GAZE, (510, 480))
    assert np.isclose(camera.fov_x, 60) and np.isclose(camera.fov_y, 2 * np.degrees(np.arctan(0.75 * 3**-0.5)))
    assert np.allclose(camera.forward, GAZE) and np.allclose(camera.eye, EYE)


def test_in_a_tangle_what_few_pictures_miss_is_peeled(plan, used, scene, monkeypatch):
    group = Groups(plan, used, scene.bounds).group(0)
    foreground = Foreground(plan, scene)
    asked = {"size": SIZE, "construction": 2, "color": lambda view: np.zeros((*view.ids.shape, 3), np.uint8)}
    peeled = painting.paint_group(plan, scene, group, foreground, **asked)
    again = painting.paint_group(plan, scene, group, foreground, threads=1, **asked)
    monkeypatch.setattr(painting, "_LAYERS", 1)
    flat = painting.paint_group(plan, scene, group, foreground, **asked)
    monkeypatch.setattr(painting, "_LAYERS", 200)
    content = painting.paint_group(plan, scene, group, foreground, max_holes=1.0, **asked)
    assert peeled.holes < flat.holes / 4 and flat.holes > 0.02
    assert peeled.image.samples > flat.image.samples
    # Where pictures are enough nothing is peeled.
    assert content.image.samples < flat.image.samples and content.holes > peeled.holes
    np.testing.assert_array_equal(peeled.image.disparity, again.image.disparity)


def test_nothing_is_peeled_where_the_last_picture_that_may_join_is_enough(plan, used, scene, monkeypatch):
    group, peels = Groups(plan, used, scene.bounds).group(0), []

    def peel(*asked, **options):
        peels.append(asked)
        return SimpleNamespace(layers=lambda: [])

    monkeypatch.setattr(painting, "hits", peel)
    left = painting.paint_group(plan, scene, group, None, size=SIZE, construction=3, max_holes=0.0).holes
    assert len(peels) == 1 and left > 0
    painted = painting.paint_group(plan, scene, group, None, size=SIZE, construction=3, max_holes=left)
    assert painted.holes == left and len(peels) == 1


def test_what_every_frame_draws_as_geometry_is_not_peeled(scene, used, monkeypatch):
    plan = FewImages(scene, [(0.1, 0.0, 1.6), (0.0, 0.1, 1.2)], 1.3)
    plan.budget = len(plan._rest[0]) + 600
    group, peels = Groups(plan, used, scene.bounds).group(0), []

    def peel(scene, camera, faces, **options):
        peels.append(set(faces.tolist()))
        return SimpleNamespace(layers=lambda: [])

    monkeypatch.setattr(painting, "hits", peel)
    foreground = Foreground(plan, scene)
    for spent in (foreground, None):
        painting.paint_group(plan, scene, group, spent, size=SIZE, construction=1, max_holes=-1.0)
    asked, everything = peels
    assert asked < everything and everything <= set(plan.culled(0).tolist())
    frames = [plan.frame(eye, gaze) for eye, gaze in zip(group.eyes, group.gazes, strict=True)]
    cameras = [painting.frame_camera(plan, eye, gaze, SIZE) for eye, gaze in zip(group.eyes, group.gazes, strict=True)]
    drawn = [set(foreground.rest(f, c).faces.tolist()) for f, c in zip(frames, cameras, strict=True)]
    assert not asked & set.intersection(*drawn)


def test_sheets_closer_than_a_pixel_is_wide_are_peeled_as_one(monkeypatch):
    # A staircase: each of 100 sheets is seen above the one before it, and the lowest rays meet all.
    steps = [[(-3, -1, z), (3, -1, z), (0, y, z)] for y, z in np.linspace((0, -2), (2, -2.1), 100)]
    scene = cyc.Scene(np.concatenate(steps), np.arange(300).reshape(-1, 3))
    plan = FewImages(scene, [(0, 0, 1.6)], 1.3, wide=100.0)
    eyes = np.random.default_rng(0).uniform((-0.3, -0.2, 0.3), (0.3, 0.6, 0.6), (40, 3))
    group, layers, hits = Group(0, 1, eyes, np.tile([0.0, 0.0, -1.0], (40, 1)), 2.0), [], painting.hits

    def peel(scene, camera, faces, **options):
        assert len(faces) > 80
        found = hits(scene, camera, faces, **options)
        layers.append(len(list(found.layers())))
        return found

    monkeypatch.setattr(painting, "hits", peel)
    painted = painting.paint_group(plan, scene, group, None, size=SIZE, construction=1, max_holes=-1.0)
    assert layers[0] < 10 and painted.holes < 0.01


@pytest.mark.parametrize("display", DISPLAYS)
def test_where_an_image_is_taken_every_display_shows_the_truth(backdrops, plan, scene, used, display):
    # As fine an image as the frame, from the same eye: what remains is sampling, at silhouettes. A layered image is
    # taken amid the eyes that use it, the others are from the viewpoint.
    group = backdrops.groups.group(0)
    amid = group.eyes[group.central()], group.gazes[group.central()]
    eye, gaze = amid if display == "ldi" else (plan.viewpoints[0] - (0, 0, 1e-9), GAZE)
    drawn = backdrops.draw(eye, gaze, SIZE, display=display)
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
    eyes, gazes = used.eyes[::3], used.gazes[::3]
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
    key = backdrops.leaves(1)[0]
    again = backdrops.make(backdrops._group(key), threads=2).image
    np.testing.assert_array_equal(again.disparity, backdrops.store.get(key).disparity)
    np.testing.assert_array_equal(again.color, backdrops.store.get(key).color)


def test_painting_goes_on_where_it_was_interrupted(plan, scene, used, tmp_path):
    made = Backdrops(plan, scene, tmp_path, size=SIZE, spread=9.0, construction=3)
    made._uses = used

    def stop(done: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made.paint(threads=1, progress=stop)
    left = made.missing()
    assert len(left) < 2 and not list(tmp_path.glob("*.part"))
    kept = {path: path.read_bytes() for path in tmp_path.glob("*.npz")}
    assert made.paint(progress=False) == len(left)
    assert made.missing() == [] and made.paint(progress=False) == 0
    assert all(path.read_bytes() == data for path, data in kept.items())


def test_a_killed_process_leaves_whole_images_and_the_next_one_goes_on(plan, scene, used, tmp_path):
    # The child is killed from outside as soon as one image is there, in the middle of the next.
    child = textwrap.dedent(f"""
        import sys
        import numpy as np
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        import cyclorama as cyc
        from cyclorama.placement.backdrops import Backdrops
        from cyclorama.placement.painting import Uses
        from reference.placement import FewImages
        scene = cyc.scenes.pipes(20_000)
        plan = FewImages(scene, [(0.1, 0.0, 1.6), (0.0, 0.1, 1.2)], 1.3)
        made = Backdrops(plan, scene, {str(tmp_path)!r}, size={SIZE}, spread=2.0, construction=2)
        known = np.load({str(tmp_path / "uses")!r} + ".npz")
        made._uses = Uses(*(known[name] for name in ("eyes", "gazes", "image")))
        made.paint(threads=1, progress=False)
    """)
    np.savez(tmp_path / "uses", eyes=used.eyes, gazes=used.gazes, image=used.image)
    process = subprocess.Popen([sys.executable, "-c", child])
    while process.poll() is None and len(list(tmp_path.glob("0*.npz"))) < 1:
        time.sleep(0.002)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    made = Backdrops(plan, scene, tmp_path, size=SIZE, spread=2.0, construction=2)
    made._uses = used
    assert made.missing()
    kept = {path: path.read_bytes() for path in tmp_path.glob("0*.npz")}
    assert made.paint(progress=False) > 0 and made.missing() == []
    assert kept and all(path.read_bytes() == data for path, data in kept.items())
    whole = [made.store.get(key).samples for i in (0, 1) for key in made.leaves(i)]
    assert min(whole) > 0 and len(whole) > 2


def test_groups_are_divided_until_the_error_holds_or_cannot(plan, scene, used, tmp_path):
    def painted(limit):
        made = Backdrops(plan, scene, tmp_path / str(limit), size=(48, 36), spread=9.0, construction=4, max_error=limit)
        made._uses = used
        group = made.groups.group(0)
        # A few frames are enough to divide again and again.
        made.groups._groups[0, 1] = replace(group, eyes=group.eyes[:24], gazes=group.gazes[:24])
        made.image(0, EYE, GAZE)
        return made

    loose = painted(200.0)
    limit = 0.9 * loose.notes.get(0)["error"]
    tight, none = painted(limit), painted(0.0)
    notes = [made.notes.get(0) for made in (loose, tight, none)]
    assert not notes[0]["divided"] and notes[0]["error"] <= 200 and loose.unmet() == {}
    assert notes[1]["divided"] and notes[2]["divided"]
    # Nothing is without any error: what is left can't be divided, and is said.
    (key,) = none.unmet()
    assert none.unmet()[key] > 0 and len(none.groups.group(0, key // 2 + 1).eyes) < 8
    assert all(error > limit for error in tight.unmet().values())


def test_what_the_image_of_a_group_does_not_know_others_fill(plan, scene, used, tmp_path, monkeypatch):
    made = Backdrops(plan, scene, tmp_path, size=(96, 72), spread=9.0, construction=2, max_error=0.0)
    made._uses = used
    group = made.groups.group(0)
    made.groups._groups[0, 1] = replace(group, eyes=group.eyes[:12], gazes=group.gazes[:12])
    own = made.image(0, EYE, GAZE)
    alone = list(made.images(0, EYE, GAZE))
    assert len(alone) == 1 and alone[0] is own
    for eye, gaze in zip(group.eyes[:12], group.gazes[:12], strict=True):
        made.image(0, eye, gaze)
    # Each painted image once, that of the frame's own group first.
    images = list(made.images(0, EYE, GAZE))
    paths = {made.store.path(key) for key in range(64) if made.store.has(key)}
    assert images[0] is own and len({id(image) for image in images}) == len(images) == len(paths) > 1
    camera = painting.frame_camera(plan, EYE, GAZE, SIZE)
    wanted = np.ones(SIZE[::-1], np.bool_)
    first = own.warp(camera, splat="projected")
    filled, samples = drawing._layered(made.pictures, 0, camera, "projected", wanted, None)
    assert 0 < filled.hole.sum() < first.hole.sum() and samples > own.samples
    for name in ("color", "depth", "source"):
        np.testing.assert_array_equal(getattr(filled, name)[~first.hole], getattr(first, name)[~first.hole])
    # What is filled is what some other image shows there.
    more = first.hole & ~filled.hole
    others = np.stack([image.warp(camera, splat="projected", where=first.hole).depth for image in images[1:]])
    assert (others[:, more] == filled.depth[more]).any(axis=0).all()


def test_the_rest_of_a_budget_draws_what_is_nearest(scene):
    plan = FewImages(scene, [(0.1, 0.0, 1.6), (0.0, 0.1, 1.2)], 1.3)
    foreground = Foreground(plan, scene)
    camera = painting.frame_camera(plan, EYE, GAZE, SIZE)
    cells = foreground.cells(0)
    depths = (scene.vertices[scene.faces].astype(float) - camera.eye) @ GAZE
    culled = np.zeros(len(scene), np.bool_)
    culled[plan.culled(0)] = True
    seen = np.unique(scene.render(camera, plan.culled(0)).ids)[:-1]
    nearest = [foreground.of(cells, camera, room) for room in (-5, 0, 100, 1000, 10**6)]
    for near, room in zip(nearest, (0, 0, 100, 1000, 10**6), strict=True):
        assert len(near.faces) <= room and culled[near.faces].all()
        # Whatever the image shows before that depth is drawn.
        before = seen[depths[seen].min(axis=1) < near.depth * (1 - 1e-6)]
        assert np.isin(before, near.faces).all()
    assert [near.depth for near in nearest] == sorted(near.depth for near in nearest)
    assert len(nearest[2].faces) == 100 and np.isinf(nearest[4].depth)


def test_painting_asks_an_image_for_what_its_frames_do_not_spend_the_budget_on(scene, used, monkeypatch):
    plan = FewImages(scene, [(0.1, 0.0, 1.6), (0.0, 0.1, 1.2)], 1.3)
    group = Groups(plan, used, scene.bounds).group(1)
    plan.budget, frame = len(plan._rest[1]) + 300, plan.frame

    def painted(foreground=None, **more):
        monkeypatch.setattr(plan, "frame", lambda *asked, **options: SimpleNamespace(**vars(frame(*asked)) | more))
        made = painting.paint_group(plan, scene, group, foreground, size=SIZE, construction=2)
        return made.error, made.holes, made.image.samples

    foreground = Foreground(plan, scene)
    alone = painted(foreground)
    # Coarser levels of detail fill the budget, too: nothing is left to spend.
    assert painted(foreground, levels=(np.arange(300, dtype=np.uint32),)) == painted() != alone
    # So does what another image of the frame stands for, which is nearer.
    images = [SimpleNamespace(index=index) for index in (0, 1)]
    assert painted(foreground, images=images) not in (painted(), alone)


def test_what_is_drawn_as_geometry_is_not_taken_from_the_image(scene, used, tmp_path):
    plan = FewImages(scene, [(0.1, 0.0, 1.6), (0.0, 0.1, 1.2)], 1.3)
    plan.budget = len(scene)
    made = Backdrops(plan, scene, tmp_path, size=SIZE, spread=9.0, construction=2)
    made._uses = used
    drawn = made.draw(EYE, GAZE, SIZE, prefetch=False)
    # There is room for all: the truth, and no image is painted.
    np.testing.assert_array_equal(drawn.ids, scene.render(drawn.camera).ids)
    assert not drawn.backdrop.any() and not list(tmp_path.glob("*.npz"))
    plan.budget = drawn.stats.faces - drawn.stats.nearer // 2
    half = made.draw(EYE, GAZE, SIZE, prefetch=False)
    assert plan.budget - 5 <= half.stats.faces <= plan.budget and half.backdrop.any()
    truth = made.color(scene.render(half.camera))
    own = np.isin(scene.render(half.camera).ids, half.nearer)
    # Geometry is exact, but where silhouettes of the image lie over it.
    assert (half.color[own] == truth[own]).all(axis=1).mean() > 0.97


def test_images_are_made_on_demand_or_refused(plan, scene, used, tmp_path):
    made = Backdrops(plan, scene, tmp_path, size=SIZE, spread=9.0, construction=2)
    made._uses = used
    index = made.draw(EYE, GAZE, SIZE, prefetch=False).stats.image
    there = list(tmp_path.glob("*.npz"))
    assert len(there) == 1 and not made.store.has(1 - index)
    strict = Backdrops(plan, scene, tmp_path, size=SIZE, spread=9.0, construction=2, on_demand=False)
    assert strict.draw(EYE, GAZE, SIZE, prefetch=False).backdrop.any()
    with pytest.raises(FileNotFoundError, match="not painted"):
        strict.image(1 - index, EYE, GAZE)


def test_a_store_of_something_else_is_refused(plan, scene, tmp_path):
    Backdrops(plan, scene, tmp_path, size=SIZE)
    with pytest.raises(ValueError, match=r"another size: \[96, 72\], not \[48, 36\]"):
        Backdrops(plan, scene, tmp_path, size=(48, 36))
    other = FewImages(scene, [(0.1, 0.0, 1.7), (0.0, 0.1, 1.2)], 1.3)
    with pytest.raises(ValueError, match="another plan"):
        Backdrops(other, scene, tmp_path, size=SIZE)
    # Of several differences the first one is named, always the same.
    with pytest.raises(ValueError, match="another plan"):
        Backdrops(other, scene, tmp_path, size=(48, 36), spread=0.1, construction=2, max_holes=0.1, max_error=9.0)
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
        ({"size": 512}, "size must be two numbers of pixels, got 512"),
        ({"color": "red"}, "color must take a View and give its colours, got 'red'"),
        ({"max_holes": np.nan}, "max_holes must be finite and at least 0, got nan"),
        ({"spread": "wide"}, "spread must be finite and at least 0, got 'wide'"),
        ({"max_error": -1}, "max_error must be finite and at least 0, got -1"),
        ({"region": "here"}, "region must be numbers, got 'here'"),
        ({"region": [[0, 0, 0], [0, 0, 99]]}, "region must be lowest and highest coordinates"),
        ({"memory": -1}, "memory must be a number of bytes"),
    ],
)
def test_wrong_arguments_are_refused(plan, scene, tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        Backdrops(plan, scene, tmp_path, **options)


@pytest.mark.parametrize("threads", [0, -1, 1.5])
def test_painting_takes_a_thread_at_least(backdrops, threads):
    with pytest.raises(ValueError, match="threads must be a whole number of at least 1"):
        backdrops.paint(threads=threads)


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


def test_two_that_want_an_image_paint_it_once(plan, scene, used, tmp_path, monkeypatch):
    made = Backdrops(plan, scene, tmp_path, size=SIZE, spread=9.0, construction=2)
    made._uses = used
    painted = []
    make = made.make

    def counted(group, threads=None):
        painted.append(group.node)
        return make(group, threads)

    monkeypatch.setattr(made, "make", counted)
    got: list[LayeredDepthImage] = []
    threads = [threading.Thread(target=lambda: got.append(made.image(0, EYE, GAZE))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(painted) == 1 and len({id(one) for one in got}) == 1


def test_what_was_prefetched_is_there_while_another_image_is_being_loaded(tmp_path):
    one, loading, go_on = size_of(image()), threading.Event(), threading.Event()

    def slow(path):
        if path.stem != "000000":
            loading.set()
            assert go_on.wait(20)
        return LayeredDepthImage.load(path)

    store = Store(slow, size_of, tmp_path, 3, {}, memory=2 * one)
    for index in range(3):
        store.put(index, image())
    store.prefetch([0])
    assert store.wait(20)
    store.prefetch([0, 1, 2])
    assert loading.wait(20)
    # The background thread is in the middle of a load, and holds nothing that this needs.
    assert store.get(0).samples == 10 and store.loads == 1
    go_on.set()
    assert store.wait(20) and store.bytes_in_memory <= 2 * one and set(store.in_memory) == {0, 1}
    store.close()


def test_images_used_nearby_come_first(backdrops, monkeypatch):
    orders = []
    monkeypatch.setattr(backdrops.store, "prefetch", orders.append)
    keys, centers = backdrops.notes.centers()
    assert sorted(keys) == sorted(backdrops.leaves(0) + backdrops.leaves(1))
    for key, center in zip(keys, centers, strict=True):
        backdrops.prefetch(center)
        assert orders[-1][0] == key and sorted(orders[-1]) == sorted(keys)


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


@pytest.mark.parametrize("seed", range(6))
def test_wanted_pixels_are_the_same_whatever_is_left_out(backdrops, seed):
    rng = np.random.default_rng(seed)
    layered = backdrops.store.get(seed % 2)
    eye = layered.camera.eye + rng.normal(size=3) * (0.0, 0.1, 0.4)[seed % 3]
    ahead = layered.camera.forward + rng.normal(size=3) * 0.3
    camera = Camera.look_at(eye, eye + ahead, width=101, height=77, fov_y=rng.uniform(20, 80))
    if seed > 3:
        camera = camera.replace(near=1.0)
    whole = layered.warp(camera, splat="projected")
    assert (~whole.hole).mean() > 0.1
    rows, columns = np.mgrid[:77, :101]
    masks = [rows < 0, rng.random((77, 101)) < 0.002, (rows > 40) & (columns < 30), rows >= 0]
    for wanted in masks:
        some = layered.warp(camera, splat="projected", where=wanted)
        for name in ("color", "depth", "hole", "exact"):
            np.testing.assert_array_equal(getattr(some, name)[wanted], getattr(whole, name)[wanted])
    # Nothing is wanted, nothing is drawn.
    assert layered.warp(camera, splat="projected", where=masks[0]).hole.all()
    with pytest.raises(ValueError, match="where has 6 pixels"):
        layered.warp(camera, splat="projected", where=np.ones((2, 3), np.bool_))
    with pytest.raises(ValueError, match="where= is for splat='projected'"):
        layered.warp(camera, splat=3, where=masks[0])
