"""Bakes and their answers, against brute force, against the scenes in which the papers' way fails, and under moves."""

from __future__ import annotations

import functools
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import bitfield, sphere
from cyclorama.bakes.evaluation import random_directions
from cyclorama.bakes.visibility import everything, fold

SMALL = (96, 90)


def baked(scene: cyc.Scene, views: object = 18, **options: object) -> cyc.Visibility:
    """A bake that is quick enough for tests."""
    return cyc.bake(scene, views, **({"resolution": SMALL, "progress": False} | options))  # type: ignore[arg-type]


@functools.cache
def ball() -> cyc.Scene:
    return cyc.scenes.sphere(faces=720)


@functools.cache
def gear() -> cyc.Scene:
    return cyc.scenes.gear(faces=3000)


@functools.cache
def gear_bake() -> cyc.Visibility:
    return baked(gear(), 66)


def seen_from(scene: cyc.Scene, eye: np.ndarray, vis: cyc.Visibility) -> set[int]:
    """Faces visible from an eye that looks at the scene's centre, by a picture of its own."""
    camera = cyc.Camera.look_at(eye, vis.sphere.center, fov_y=120, width=256, height=256)
    return set(scene.visible(camera, progress=False).ids(0).tolist())


# What it answers ----------------------------------------------------------------------------------------------------


def test_a_sample_of_a_convex_scene_sees_its_front_and_nothing_else():
    scene, vis = ball(), baked(ball(), 18, fill="rays", probes=0)
    corners = scene.vertices[scene.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for sample, eye in enumerate(vis.sphere.viewpoints):
        facing = np.einsum("ij,ij->i", normals, eye - corners[:, 0])
        seen = vis.bitfields.unpack()[sample]
        np.testing.assert_array_equal(seen[np.abs(facing) > 1e-6], facing[np.abs(facing) > 1e-6] > 0)


@pytest.mark.parametrize("join", ["samples", "cells"])
@pytest.mark.parametrize("views", [6, 18, 20])
def test_an_eye_at_a_sample_is_answered_all_that_the_sample_sees(views: int, join: str):
    vis = baked(gear(), views, join=join, probes=4)
    for sample, eye in enumerate(vis.sphere.viewpoints):
        assert set(vis.bitfields.ids(sample).tolist()) <= set(vis.visible_faces(eye).tolist())


def test_corner_samples_are_joined_as_the_papers_say():
    three, six = (baked(gear(), 18, join="samples", join_count=count) for count in (3, 6))
    assert three.cells is None
    for direction in random_directions(20, 3):
        eye = three.sphere.center + three.sphere.radius * direction
        for vis, count in ((three, 3), (six, 6)):
            samples = vis.samples(eye)
            assert len(samples) == count
            union = vis.bitfields.unpack()[samples].any(axis=0)
            np.testing.assert_array_equal(np.flatnonzero(union), vis.visible_faces(eye))
        assert set(three.visible_faces(eye)) <= set(six.visible_faces(eye))


def test_cells_hold_their_corners_and_what_probes_add():
    vis = gear_bake()
    corners = np.bitwise_or.reduce(vis.bitfields.words[vis.sphere.faces], axis=1)
    assert vis.cells is not None
    assert not bitfield.difference(corners, vis.cells.words).any()
    assert bitfield.difference(vis.cells.words, corners).any()


def test_the_apex_of_the_notch_is_lost_between_samples_and_found_by_cells():
    scene = cyc.scenes.notch(level=1)
    direction = np.ones(3) / np.sqrt(3)
    by_samples, by_cells = (baked(scene, 18, join=join) for join in ("samples", "cells"))
    eye = by_cells.sphere.center + by_cells.sphere.radius * direction
    apex = set(scene.apex_faces.tolist())
    assert apex <= seen_from(scene, eye, by_cells)
    assert not apex & set(by_samples.visible_faces(eye).tolist())
    assert apex <= set(by_cells.visible_faces(eye).tolist())


def test_a_far_eye_sees_into_tubes_that_its_nearest_samples_do_not():
    scene = cyc.scenes.tubes(7, length=2.0)
    vis = baked(scene, 258)
    bottoms = set(range(2 * 7**2))
    far = vis.sphere.center + 1e4 * vis.sphere.radius * np.array([0.0, 0.0, 1.0])
    nearest = vis.sphere.locate(far - vis.sphere.center)
    assert vis.cells is not None
    lost = bottoms - set(bitfield.ids(vis.cells.union(nearest)).tolist())
    assert len(lost) > len(bottoms) / 4
    assert bottoms <= set(vis.visible_faces(far).tolist())
    assert bottoms <= set(vis.visible_along([0, 0, 2.0]).tolist())


@pytest.mark.parametrize("share", [0.45, 0.6, 0.9, 1.0, 1.5, 4.0, 50.0])
def test_an_eye_outside_the_bounding_sphere_is_answered_what_it_sees(share: float):
    scene, vis = gear(), gear_bake()
    for direction in random_directions(6, 5):
        eye = vis.sphere.center + share * vis.sphere.radius * direction
        camera = cyc.Camera.look_at(eye, vis.sphere.center, fov_y=min(140, 50 / share), width=128, height=128)
        ids = scene.render(camera).ids
        covered = ids[ids != cyc.BACKGROUND]
        kept = np.isin(covered, vis.visible_faces(eye))
        assert 1 - kept.mean() < 2e-3


def test_an_eye_inside_the_bounding_sphere_is_answered_the_whole_model():
    vis = gear_bake()
    everyone = np.arange(vis.size)
    for share in (0.0, 0.2, 0.999):
        eye = vis.sphere.center + [0, 0, share * vis.model_radius]
        np.testing.assert_array_equal(vis.visible_faces(eye), everyone)


def test_nearer_and_farther_eyes_join_ever_more_cells():
    vis = gear_bake()
    direction = random_directions(1, 8)[0]

    def answer(share: float) -> set[int]:
        return set(vis.visible_faces(vis.sphere.center + share * vis.sphere.radius * direction).tolist())

    for path in ([1.0, 0.9, 0.7, 0.5], [1.0, 1.2, 2.0, 10.0]):
        answers = [answer(share) for share in path]
        assert all(a <= b for a, b in pairwise(answers))


def test_shells_answer_at_and_between_their_distances():
    scene = gear()
    vis = baked(scene, 18, distances=[float("inf"), 1, 2], probes=4)
    assert vis.distances == (1.0, 2.0, float("inf"))
    direction = random_directions(1, 2)[0]

    def at(share: float) -> set[int]:
        return set(vis.visible_faces(vis.sphere.center + share * vis.sphere.radius * direction).tolist())

    cell = vis.sphere.locate(direction)
    for shell in vis.shells:
        assert shell.cells is not None
        row = set(bitfield.ids(shell.cells.union(cell)).tolist())
        if np.isfinite(shell.distance):
            assert at(shell.distance) == row
        else:
            assert set(vis.visible_along(direction).tolist()) == row
            assert at(1e6) >= row
    for shell in vis.shells[:2]:
        assert shell.cells is not None
        assert at(1.5) >= set(bitfield.ids(shell.cells.union(cell)).tolist())


def test_transparent_faces_hide_nothing_and_are_always_answered():
    inner = cyc.scenes.sphere(faces=80)
    vertices = np.concatenate([2 * inner.vertices, inner.vertices])
    faces = np.concatenate([inner.faces, inner.faces + len(inner.vertices)])
    glass = np.arange(len(faces)) < len(inner)
    vis = baked(cyc.Scene(vertices, faces, transparent=glass), 6)
    alone = baked(cyc.Scene(inner.vertices, inner.faces), 6)
    for shell in vis.shells:
        assert shell.bitfields.unpack()[:, glass].all() and shell.cells is not None
        assert shell.cells.unpack()[:, glass].all()
    assert alone.culling_rate() > 0.1
    eye = vis.sphere.center + vis.sphere.radius * np.array([0.3, 0.5, 0.6]) / np.linalg.norm([0.3, 0.5, 0.6])
    hidden = ~np.isin(np.arange(len(faces)), vis.visible_faces(eye))
    assert hidden[~glass].mean() > 0.1


# Patches ------------------------------------------------------------------------------------------------------------


def test_a_patch_is_visible_if_any_of_its_faces_is():
    scene = gear()
    labels = cyc.patches.tile(scene.vertices, scene.faces, 60)
    whole, tiled = gear_bake(), baked(scene, 66, patches=labels)
    assert tiled.patches == 60
    flags, patches = whole.bitfields.unpack(), tiled.bitfields.unpack()
    for patch in range(60):
        np.testing.assert_array_equal(patches[:, patch], flags[:, labels == patch].any(axis=1))
    for eye in tiled.sphere.viewpoints[:10]:
        answer = tiled.visible_faces(eye)
        np.testing.assert_array_equal(answer, np.flatnonzero(np.isin(labels, tiled.visible_patches(eye))))
        assert set(whole.visible_faces(eye).tolist()) <= set(answer.tolist())
    assert tiled.culling_rate() <= whole.culling_rate()
    assert baked(scene, 6, patches=60, probes=0).patches == 60


def test_rows_fold_to_patches_with_gaps_in_their_numbers():
    rng = np.random.default_rng(0)
    flags = rng.random((7, 90)) < 0.1
    labels = rng.choice([0, 2, 3, 70], 90).astype(np.uint32)
    folded = fold(bitfield.pack(flags), labels).unpack()
    assert folded.shape == (7, 71)
    for label in range(71):
        np.testing.assert_array_equal(folded[:, label], flags[:, labels == label].any(axis=1))


def test_patches_are_asked_of_bakes_that_have_them():
    with pytest.raises(ValueError, match="no patches"):
        gear_bake().visible_patches([9, 9, 9])


def test_a_bake_is_put_into_patches_afterwards():
    scene = gear()
    labels = cyc.patches.tile(scene.vertices, scene.faces, 60)
    at_once, later = baked(scene, 66, patches=labels), gear_bake().in_patches(labels)
    assert at_once.bitfields == later.bitfields and at_once.cells == later.cells
    with pytest.raises(ValueError, match="already"):
        later.in_patches(labels)
    with pytest.raises(ValueError, match="labels"):
        gear_bake().in_patches(labels[1:])


# Figures ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("join", ["samples", "cells"])
def test_culling_rates_are_averages_of_what_is_answered(join: str):
    vis = baked(gear(), 18, join=join, probes=2)
    middles = vis.sphere.points[vis.sphere.faces].mean(axis=1)
    eyes = vis.sphere.center + vis.sphere.radius * middles / np.linalg.norm(middles, axis=1, keepdims=True)
    culled = [1 - len(vis.visible_faces(eye)) / vis.size for eye in eyes]
    assert vis.culling_rate("faces") == pytest.approx(np.mean(culled))
    directions = random_directions(20000, 1)
    assert vis.culling_rate() == pytest.approx(np.take(culled, vis.sphere.locate(directions)).mean(), abs=5e-3)
    with pytest.raises(ValueError, match="weight"):
        vis.culling_rate("views")


def test_culling_is_shared_out_to_faces_that_turn_away_and_hidden_ones():
    for turn in (slice(None), slice(None, None, -1)):
        convex = cyc.Scene(ball().vertices, ball().faces[:, turn])
        away, hidden = baked(convex, 18).culling_shares(convex)
        assert away > 0.3 and hidden < 1e-3
    boxes = cyc.scenes.nested_boxes(3)
    vis = baked(boxes, 66)
    away, hidden = vis.culling_shares(boxes)
    assert away + hidden == pytest.approx(vis.culling_rate())
    # Both inner boxes are never seen: their faces toward the eye are hidden, the others turn away.
    corners = boxes.vertices[boxes.faces[12:]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    eyes = vis.sphere.radius * random_directions(2000, 0)
    toward = (eyes @ normals.T > np.einsum("ij,ij->i", normals, corners[:, 0])).mean()
    assert hidden == pytest.approx(toward * 2 / 3, abs=0.01)


def test_a_bake_tells_what_it_is():
    vis = gear_bake()
    info = vis.info()
    assert info["views"] == 66 and info["faces"] == len(gear()) and info["patches"] is None
    assert info["probes"] == vis.probes.sum() > 0
    assert f"{vis.size:,} faces" in repr(vis) and "<table>" in vis._repr_html_()
    assert vis.found[0, 0] > vis.found[-1, 0]


# What changes nothing, and what changes alike -----------------------------------------------------------------------


def rows_of(vis: cyc.Visibility) -> tuple[np.ndarray, np.ndarray]:
    assert vis.cells is not None
    return vis.bitfields.unpack(), vis.cells.unpack()


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_threads_change_nothing(threads: int):
    scene = cyc.scenes.tree(seed=0)
    one, other = (baked(scene, 6, probes=6, threads=n) for n in (1, threads))
    assert one.bitfields == other.bitfields and one.cells == other.cells


@pytest.mark.parametrize("factor", [2.0**-40, 0.5, 2.0**30])
def test_a_power_of_two_changes_nothing(factor: float):
    scene = gear()
    scaled = cyc.Scene(scene.vertices.astype(np.float64) * factor, scene.faces)
    for a, b in zip(rows_of(baked(scene, 6, probes=4)), rows_of(baked(scaled, 6, probes=4)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_moving_the_scene_far_away_changes_next_to_nothing():
    scene = cyc.Scene(gear().vertices.astype(np.float64), gear().faces)
    moved = cyc.Scene(scene.vertices + 1e4 * scene.radius, scene.faces)
    here, there = baked(scene, 6, probes=4), baked(moved, 6, probes=4)
    for a, b in zip(rows_of(here), rows_of(there), strict=True):
        assert (a != b).mean() < 2e-3


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_permuting_the_faces_permutes_the_answers(seed: int):
    scene = gear()
    order = np.random.default_rng(seed).permutation(len(scene))
    permuted = cyc.Scene(scene.vertices, scene.faces[order])
    for a, b in zip(rows_of(baked(scene, 6, probes=2)), rows_of(baked(permuted, 6, probes=2)), strict=True):
        np.testing.assert_array_equal(a[:, order], b)


def test_more_probes_never_answer_less():
    few, many = (baked(gear(), 18, probes=n) for n in (4, 12))
    assert few.cells is not None and many.cells is not None
    assert not bitfield.difference(few.cells.words, many.cells.words).any()


# Where views are ----------------------------------------------------------------------------------------------------


def test_views_may_be_directions_or_the_authors_own_shots():
    scene = gear()
    directions = random_directions(12, 4)
    by_directions = baked(scene, 3 * directions, probes=2)
    np.testing.assert_allclose(by_directions.sphere.points, directions)
    eyes = scene.center + 4 * scene.radius * directions
    shots = [cyc.Camera.look_at(eye, scene.center, width=200, height=200) for eye in eyes]
    by_shots = baked(scene, shots, probes=2)
    assert by_shots.bitfields == scene.visible(shots, progress=False)
    np.testing.assert_array_equal(by_shots.sphere.faces, sphere.hull(directions))
    for eye in by_shots.sphere.viewpoints:
        assert 0 < len(by_shots.visible_faces(eye)) < len(scene)


def test_any_count_of_views_is_a_sphere():
    for count, points in ((6, sphere.octahedron(0)[0]), (66, sphere.octahedron(2)[0]), (33, sphere.fibonacci(33))):
        vis = baked(ball(), count, probes=0, fill=None, resolution=(16, 16))
        np.testing.assert_array_equal(vis.sphere.points, points)


def around(scene: cyc.Scene, *eyes: tuple[float, float, float]) -> list[cyc.Camera]:
    return [cyc.Camera.look_at(eye, (0.1, 0.2, 0.3), width=32, height=32) for eye in eyes]


BAD = {
    "views must be at least 4": lambda s: baked(s, 3),
    "views must be a count": lambda s: baked(s, 18.5),
    r"directions\[1\]": lambda s: baked(s, [[1, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "surround": lambda s: baked(s, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]),
    "same direction": lambda s: baked(s, [[1, 0, 0], [2, 0, 0], [-1, 1, 0], [0, -1, 1], [0, -1, -1]]),
    "centre": lambda s: baked(s, around(s, (9, 0, 0), tuple(s.center), (0, 9, 0), (-9, -9, 9))),
    r"views\[1\] is no camera": lambda s: baked(s, [*around(s, (9, 0, 0)), "shot"]),
    "coplanar|surround": lambda s: baked(s, around(s, (9, 0, 0), (0, 9, 0), (-9, 0, 0), (0, -9, 0))),
    "patches must be a count": lambda s: baked(s, patches=0),
    r"patches\[3\]": lambda s: baked(s, patches=np.where(np.arange(len(s)) == 3, -1, 0)),
    r"patches must be \(3000,\)": lambda s: baked(s, patches=np.zeros(7, dtype=int)),
    "resolution": lambda s: baked(s, resolution=(0, 5)),
    "fov_y must be between 0 and 180": lambda s: baked(s, fov_y=180),
    "fill": lambda s: baked(s, fill="paint"),
    "fill must be 'rays', 'neighbours' or None, got 0": lambda s: baked(s, fill=0),
    "directions must be numbers": lambda s: baked(s, (camera for camera in around(s, (9, 0, 0)))),
    "join must be": lambda s: baked(s, join="both"),
    "join_count must be 3 or 6": lambda s: baked(s, join_count=4),
    "probes must be a count": lambda s: baked(s, probes=-1),
    "strategy must be one of": lambda s: baked(s, strategy="hope"),
    "threads must be 1 to 1024, got 0": lambda s: baked(s, threads=0),
    "threads must be 1 to 1024, got -1": lambda s: baked(s, threads=-1),
    "threads must be 1 to 1024, got 1000000000000": lambda s: baked(s, threads=10**12),
    "distance must be above": lambda s: baked(s, distances=[1, 0.3]),
    "distances must be": lambda s: baked(s, distances=[]),
    "max_missed must lie in": lambda s: baked(s, max_missed=0.0),
    "max_missed= needs": lambda s: baked(s, max_missed=0.1, join="samples"),
    "part must be": lambda s: baked(s, part=(2, 2)),
    r"part must be .* got \(0.5, 2\)": lambda s: baked(s, part=(0.5, 2)),
    "seed must be an integer of at least 0, got 1.5": lambda s: baked(s, seed=1.5),
    "seed must be an integer of at least 0, got -1": lambda s: baked(s, seed=-1),
    "fov_y must be between 0 and 180 degrees, got x": lambda s: baked(s, fov_y="x"),
    "progress must be": lambda s: baked(s, progress="loud"),
}


def test_a_scene_does_not_follow_the_arrays_it_was_made_from():
    vertices, faces = gear().vertices.copy(), gear().faces.copy()
    scene = cyc.Scene(vertices, faces)
    vertices += 9
    faces[:] = 0
    np.testing.assert_array_equal(scene.vertices, gear().vertices)
    np.testing.assert_array_equal(scene.faces, gear().faces)
    with pytest.raises(ValueError, match="read-only"):
        scene.vertices[0] = 1


@pytest.mark.parametrize("face", [-1, 3000, 2**32 + 1])
def test_faces_to_draw_are_faces_of_the_scene(face: int):
    (camera,) = around(gear(), (9, 0, 0))
    with pytest.raises(ValueError, match=rf"faces\[1\] is {face}, the scene has 3000 faces"):
        gear().render(camera, faces=[0, face])


def test_shots_may_stand_in_an_array():
    shots = around(gear(), (9, 0, 0), (0, 9, 0), (0, 0, 9), (-9, -9, -9))
    array = np.empty(len(shots), dtype=object)
    array[:] = shots
    assert baked(gear(), array, probes=0).bitfields == baked(gear(), shots, probes=0).bitfields


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_scenes_whose_areas_float64_cannot_hold_are_refused(size: float):
    with pytest.raises(ValueError, match="span"):
        cyc.Scene(gear().vertices.astype(np.float64) * size, gear().faces)


@pytest.mark.parametrize("size", [1e-60, 1e60])
def test_scenes_of_any_other_size_are_baked_alike(size: float):
    scaled = cyc.Scene(gear().vertices.astype(np.float64) * size, gear().faces)
    vis = baked(scaled, probes=2)
    assert vis.culling_rate() == pytest.approx(baked(gear(), probes=2).culling_rate(), abs=1e-3)
    assert 0 < len(vis.visible_faces(scaled.center + [0, 0, 4 * scaled.radius])) < len(scaled)
    assert vis.culling_shares(scaled) == pytest.approx(baked(gear(), probes=2).culling_shares(gear()), abs=1e-3)
    cyc.evaluate(vis, scaled, views=2, progress=False)


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_refused_by_name(message: str):
    call: Callable[[cyc.Scene], object] = BAD[message]
    with pytest.raises(ValueError, match=message):
        call(gear())


def test_bad_eyes_are_refused():
    vis = gear_bake()
    for eye in ([0, 0, np.nan], [np.inf, 0, 0], [1, 2], "eye"):
        with pytest.raises(ValueError, match=r"eye|float"):
            vis.visible_faces(eye)
    with pytest.raises(ValueError, match="centre"):
        vis.samples(vis.sphere.center)
    with pytest.raises(ValueError, match="direction"):
        vis.visible_along([0, 0, 0])
    with pytest.raises(ValueError, match="out"):
        vis.visible_faces(vis.sphere.viewpoints[0], out=np.empty(3, dtype=np.uint32))


def test_an_answer_fits_into_given_room():
    for vis in (gear_bake(), baked(gear(), 6, patches=50, probes=0)):
        room = np.empty(vis.size, dtype=np.uint32)
        answer = vis.visible_faces(vis.sphere.viewpoints[3], out=room)
        np.testing.assert_array_equal(answer, vis.visible_faces(vis.sphere.viewpoints[3]))
        assert np.shares_memory(answer, room)


@pytest.mark.parametrize("size", [1, 63, 64, 65, 200])
def test_everything_is_every_bit_and_no_more(size: int):
    assert bitfield.unpack(everything(size), size).all()
    assert bitfield.count(everything(size))[0] == size


# Interruption -------------------------------------------------------------------------------------------------------


def test_an_interrupted_bake_ends_at_once(tmp_path: Path):
    def stop(done: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        baked(cyc.scenes.gear(), 66, progress=stop).save(tmp_path / "bake.npz")
    assert not list(tmp_path.iterdir())


def test_progress_counts_views_up_to_the_end():
    seen: list[int] = []
    baked(ball(), 6, probes=8, progress=seen.append)
    assert seen == sorted(seen) and seen[-1] == 6 + 8 * 8
