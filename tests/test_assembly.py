"""Objects placed in one world, and bakes that are joined."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama.bakes.evaluation import random_directions


@functools.cache
def scene() -> cyc.Scene:
    return cyc.scenes.gear(faces=1500, teeth=20)


@functools.cache
def bake(seed: int = 0, patches: int | None = None, views: int = 18, probes: int = 4) -> cyc.Visibility:
    return cyc.bake(scene(), views, patches, (64, 60), seed=seed, probes=probes, progress=False)


def affine(seed: int) -> np.ndarray:
    """A random map that turns, scales, shears and moves."""
    rng = np.random.default_rng(seed)
    transform = np.eye(4)
    transform[:3, :3] = np.eye(3) + 0.4 * rng.normal(size=(3, 3))
    transform[:3, 3] = 5 * rng.normal(size=3)
    return transform


@given(st.integers(0, 10**6))
def test_each_object_is_asked_in_its_own_frame(seed: int):
    transform, direction = affine(seed), random_directions(1, seed)[0]
    vis = bake()
    own = vis.sphere.center + 1.3 * vis.sphere.radius * direction
    eye = transform[:3, :3] @ own + transform[:3, 3]
    middle = transform[:3, :3] @ vis.sphere.center + transform[:3, 3]
    camera = cyc.Camera.look_at(eye, middle, fov_y=90)
    (answer,) = cyc.Assembly([(vis, transform)]).visible(camera)
    np.testing.assert_array_equal(answer, vis.visible_faces(np.linalg.solve(transform, np.append(eye, 1))[:3]))


def test_placed_objects_show_what_the_joined_scene_shows():
    first, second = affine(1), affine(2)
    first[:3, 3], second[:3, 3] = (-6, 0, 0), (6, 0, 0)
    vertices = [scene().vertices @ t[:3, :3].T + t[:3, 3] for t in (first, second)]
    count = len(scene().vertices)
    joined = cyc.Scene(np.concatenate(vertices), np.concatenate([scene().faces, scene().faces + count]))
    assembly = cyc.Assembly([(bake(), first), (bake(), second)])
    for eye in ((0, 3, 30), (5, 20, 10), (-20, -9, 14)):
        camera = cyc.Camera.look_at(eye, (0, 0, 0), fov_y=60, width=200, height=200)
        a, b = assembly.visible(camera)
        ids = joined.render(camera).ids
        covered = ids[ids != cyc.BACKGROUND]
        drawn = np.concatenate([a, b + np.uint32(len(scene()))])
        assert np.isin(covered, drawn).mean() > 0.995


def test_instances_share_a_bake_and_those_out_of_view_are_skipped():
    vis = bake()
    places = []
    for x in range(-40, 41, 8):
        place = np.eye(4)
        place[0, 3] = x
        places.append(place)
    assembly = cyc.Assembly([(vis, place) for place in places])
    assert "11 objects, 1 bakes" in repr(assembly)
    for camera in (
        cyc.Camera.look_at((0, 0, 30), (0, 0, 0), fov_y=20, width=300, height=300),
        cyc.Camera.orthographic_look_at((0, 0, 30), (0, 0, 0), extent=20, width=300, height=300),
    ):
        seen = assembly.in_view(camera)
        assert 0 < seen.sum() < len(seen)
        for answer, place, inside in zip(assembly.visible(camera), places, seen, strict=True):
            vertices = scene().vertices + place[:3, 3]
            pixels, depth = camera.project(vertices)
            within = (pixels > 0).all(axis=1) & (pixels < 300).all(axis=1) & (depth > 0)
            assert inside or not within.any()
            assert (len(answer) > 0) == inside


def test_parallel_rays_are_answered_by_their_direction():
    vis = bake()
    direction = np.array([0.3, 0.4, 0.5])
    camera = cyc.Camera.orthographic_look_at(vis.sphere.center + direction, vis.sphere.center, extent=9)
    (answer,) = cyc.Assembly([(vis, np.eye(4))]).visible(camera)
    np.testing.assert_array_equal(answer, vis.visible_along(direction))


def test_no_place_is_refused():
    flat, perspective, nan = np.diag([1.0, 1, 0, 1]), np.eye(4), np.eye(4)
    perspective[3, 0] = 1
    nan[0, 0] = np.nan
    for transform, message in ((flat, "flattens"), (perspective, "last row"), (nan, "finite"), (np.eye(3), "shape")):
        with pytest.raises(ValueError, match=message):
            cyc.Assembly([(bake(), np.eye(4)), (bake(), transform)])
    assert cyc.Assembly([]).visible(cyc.Camera.look_at((0, 0, 1), (0, 0, 0))) == []


# Merging ------------------------------------------------------------------------------------------------------------


def test_merged_bakes_answer_what_any_of_them_does():
    a, b = bake(0), bake(1)
    merged = cyc.merge(a, b)
    assert a.cells != b.cells
    np.testing.assert_array_equal(merged.cells.unpack(), a.cells.unpack() | b.cells.unpack())  # type: ignore[union-attr]
    assert merged.bitfields == a.bitfields
    np.testing.assert_array_equal(merged.probes, a.probes + b.probes)
    assert merged.found[0, 1] == a.found[0, 1] + b.found[0, 1]
    np.testing.assert_allclose(merged.found[0, 0], (a.found[0, 0] + b.found[0, 0]) / 2)


def test_merging_is_idempotent_and_takes_any_order():
    a, b, c = bake(0), bake(1), bake(2)
    assert cyc.merge(a).cells == cyc.merge(a, a).cells == a.cells
    assert cyc.merge(a, b, c).cells == cyc.merge(cyc.merge(c, a), b).cells


def test_parts_of_a_bake_are_joined_to_what_all_their_probes_found():
    parts = [cyc.bake(scene(), 18, resolution=(64, 60), probes=4, part=(k, 3), progress=False) for k in range(3)]
    merged = cyc.merge(*parts)
    np.testing.assert_array_equal(merged.probes, bake().probes)
    assert [(part.probes > 0).sum() for part in parts] == [11, 11, 10]
    # Four probes are one round: nothing that the parts did not tell each other could have changed it.
    assert merged.cells == bake().cells


def test_bakes_of_other_things_are_not_merged():
    other = cyc.bake(cyc.scenes.gear(faces=1600, teeth=20), 18, resolution=(64, 60), probes=0, progress=False)
    samples = cyc.bake(scene(), 18, resolution=(64, 60), join="samples", progress=False)
    for bad, message in (
        (other, "another mesh"),
        (bake(views=6), "viewpoints"),
        (bake(patches=30), "patches"),
        (samples, "joins"),
        (cyc.bake(scene(), 18, resolution=(64, 60), fov_y=30, probes=0, progress=False), "radius"),
    ):
        with pytest.raises(ValueError, match=rf"bakes\[1\].*{message}"):
            cyc.merge(bake(), bad)
    with pytest.raises(ValueError, match="at least one"):
        cyc.merge()
