"""Frames of plans with a shell, with levels of detail and with what can be seen, against the whole scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import BACKGROUND
from cyclorama.placement import Plan, painting
from cyclorama.placement.backdrops import Backdrops
from cyclorama.placement.drawing import GEOMETRY, Drawn

BUDGET, FEWER, SIZE = 13_000, 10_400, (96, 72)


@pytest.fixture(scope="module")
def scene():
    plain = cyc.scenes.pipes(20_000)
    colors = np.random.default_rng(0).integers(60, 255, (len(plain), 3), np.uint8)
    return cyc.Scene(plain.vertices, plain.faces, colors)


@pytest.fixture(scope="module")
def plan(scene):
    return cyc.place_images(scene, BUDGET, progress=False)


def made(plan: Plan, folder, **options) -> Backdrops:
    return Backdrops(plan, plan.scene, folder, size=SIZE, construction=3, spread=9.0, **options)


def truth_of(backdrops: Backdrops, drawn: Drawn):
    """The whole scene from the same eye, and the pixels that show what the image stands for and is not drawn."""
    view = backdrops.scene.render(drawn.camera)
    faces = backdrops.plan.culled(drawn.stats.image)
    own = np.isin(view.ids, faces) & ~np.isin(view.ids, drawn.nearer)
    return view, own


def test_an_eye_beyond_the_domain_sees_an_image_of_the_shell(plan, tmp_path):
    eye, gaze = np.array([0.2, 0.1, 3.2]), np.array([0.0, 0.0, -1.0])
    backdrops = made(plan, tmp_path)
    drawn = backdrops.draw(eye, gaze, SIZE, prefetch=False)
    assert drawn.stats.image >= len(plan.images) - plan.shell
    # No face is left to draw but those that the budget has room for.
    assert 0 < drawn.stats.faces == drawn.stats.nearer <= BUDGET
    view, _ = truth_of(backdrops, drawn)
    geometry = np.isin(view.ids, drawn.nearer) & ~drawn.backdrop
    assert geometry.mean() > 0.2
    np.testing.assert_array_equal(drawn.color[geometry], backdrops.color(view)[geometry])
    # Without the rest of the budget all of it is an image.
    bare = made(plan, tmp_path / "bare", spend=False).draw(eye, gaze, SIZE, prefetch=False)
    assert bare.stats.faces == 0 and (bare.ids == BACKGROUND).all()
    view, own = truth_of(backdrops, bare)
    assert own.mean() > 0.2 and bare.hole[own].mean() < 0.02
    # Pipes are few pixels wide here: the rest is at their silhouettes.
    assert (np.abs(bare.depth[own] - view.depth[own]) < 0.05).mean() > 0.66


def with_image(plan: Plan):
    """An eye and a gaze whose frame has an image."""
    found = painting.uses(plan, 400)
    return found.eyes[0], found.gazes[0]


def coarser(scene: cyc.Scene, size: float) -> cyc.Scene:
    """Vertices rounded to a grid, without the faces that this leaves flat; red all over."""
    cells, vertices = np.unique(np.round(scene.vertices / size), axis=0, return_inverse=True)
    faces = vertices.reshape(-1)[scene.faces]
    faces = faces[~(faces == np.roll(faces, 1, axis=1)).any(axis=1)]
    return cyc.Scene(cells * size, faces, np.tile(np.array([[255, 0, 0]], np.uint8), (len(faces), 1)))


def test_frames_draw_levels_of_detail_and_images_show_the_finest(scene, tmp_path):
    level = coarser(scene, 0.15)
    plan = cyc.place_images(scene, BUDGET, lod=[(level, 1.3)], progress=False)
    backdrops = made(plan, tmp_path)
    eye, gaze = with_image(plan)
    frame = plan.frame(eye, gaze)
    assert frame.image is not None and len(frame.levels[0]) > 0
    drawn = backdrops.draw(eye, gaze, SIZE, prefetch=False)
    assert drawn.stats.faces == len(frame.faces) + len(frame.levels[0]) + drawn.stats.nearer <= BUDGET
    fine = (drawn.ids < len(scene)) & (drawn.ids != BACKGROUND)
    coarse = (drawn.ids >= len(scene)) & (drawn.ids != BACKGROUND)
    assert fine.mean() > 0.2
    # Each level has its own colours: red ones are of the coarser, and never in an image.
    reds = (drawn.color[..., 1] == 0) & (drawn.color[..., 2] == 0)
    np.testing.assert_array_equal(reds, coarse)
    # What is drawn of the finest level is the nearest of all that the frame asks for.
    alone = plan.whole.render(
        drawn.camera, np.concatenate([frame.faces, frame.levels[0] + np.uint32(len(scene)), drawn.nearer])
    )
    geometry = drawn.layer == GEOMETRY
    np.testing.assert_array_equal(drawn.ids[geometry], alone.ids[geometry])
    assert (plan.culled(drawn.stats.image) >= len(scene)).any()
    assert (drawn.nearer < len(scene)).all() and drawn.stats.culled < len(plan.culled(drawn.stats.image))


def test_what_cannot_be_seen_is_not_drawn(scene, plan, tmp_path):
    low, high = plan.domain
    hidden = np.random.default_rng(1).random(len(scene)) < 0.2
    sight = [(low, high, np.flatnonzero(~hidden))]
    less = cyc.place_images(scene, FEWER, visibility=sight, progress=False)
    backdrops = made(less, tmp_path, spend=False)
    eye, gaze = with_image(less)
    drawn = backdrops.draw(eye, gaze, SIZE, prefetch=False)
    frame = less.frame(eye, gaze)
    assert frame.image is not None and not hidden[frame.faces].any()
    assert drawn.stats.faces == len(frame.faces) <= FEWER
    geometry = drawn.ids != BACKGROUND
    assert geometry.mean() > 0.2 and not hidden[drawn.ids[geometry]].any()
    np.testing.assert_array_equal(drawn.ids[geometry], scene.render(drawn.camera, frame.faces).ids[geometry])


def test_a_frame_uses_the_memory_of_another_one(plan, tmp_path):
    backdrops = made(plan, tmp_path)
    eye, gaze = np.array([0.0, 0.0, 0.95]), np.array([0.0, 0.0, -1.0])
    fresh = backdrops.draw(eye, gaze, SIZE, prefetch=False)
    old = backdrops.draw(-eye, -gaze, SIZE, prefetch=False)
    again = backdrops.draw(eye, gaze, SIZE, prefetch=False, out=old)
    assert fresh.backdrop.any() and fresh.stats.image == again.stats.image
    for name in ("color", "depth", "ids", "layer", "hole"):
        assert getattr(again, name) is getattr(old, name)
        np.testing.assert_array_equal(getattr(again, name), getattr(fresh, name))
    with pytest.raises(ValueError, match="out is a picture of 96 x 72, the frame has 48 x 36"):
        backdrops.draw(eye, gaze, (48, 36), prefetch=False, out=old)


def test_several_images_show_what_one_would(plan, tmp_path):
    one = made(plan, tmp_path / "1", spend=False)
    three = made(replace(plan, images_per_frame=3), tmp_path / "3", spend=False)
    known = painting.uses(three.plan, 2000)
    # A frame that three images stand for.
    places = np.column_stack([known.eyes, known.gazes])
    _, first, counts = np.unique(places, axis=0, return_index=True, return_counts=True)
    at = first[counts.argmax()]
    eye, gaze = known.eyes[at], known.gazes[at]
    single, several = (made.draw(eye, gaze, SIZE, prefetch=False) for made in (one, three))
    assert len(several.stats.images) == 3 and single.stats.images == several.stats.images[:1]
    assert several.stats.faces < single.stats.faces
    # They share the pixels of one.
    assert three._size == (55, 42)
    view = plan.scene.render(single.camera)
    shown = set(np.unique(several.layer).tolist()) - {GEOMETRY}
    assert shown <= set(several.stats.images) and len(shown) > 1
    behind = np.isin(view.ids, np.concatenate([plan.culled(i) for i in several.stats.images]))
    assert several.hole[behind].mean() < 0.05
    assert (np.abs(several.depth - view.depth) < 0.05)[behind].mean() > 0.6
    # A flat image is alone: what the others stand for is drawn.
    flat = three.draw(eye, gaze, SIZE, display="quad", prefetch=False)
    assert len(flat.stats.images) == 1 and flat.stats.faces == single.stats.faces
