"""Walks: each segment is answered what its cameras and the views between them see."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

import cyclorama as cyc
from cyclorama.bakes.paths import _between


@functools.cache
def scene() -> cyc.Scene:
    return cyc.scenes.gear(faces=1500, teeth=20)


@functools.cache
def walk(count: int = 7) -> tuple[cyc.Camera, ...]:
    angles = np.linspace(0, 1.5, count)
    eyes = scene().center + 2.5 * scene().radius * np.column_stack([np.sin(angles), 0.2 * angles, np.cos(angles)])
    return tuple(cyc.Camera.look_at(eye, scene().center, fov_y=50, width=96, height=90) for eye in eyes)


def test_a_segment_holds_what_each_of_its_cameras_sees():
    path = cyc.bake_path(scene(), walk(), segments=[0, 2, 6], progress=False)
    seen = scene().visible(walk(), progress=False)
    assert len(path) == 2
    for camera, segments in ((0, [0]), (1, [0]), (2, [0, 1]), (5, [1]), (6, [1])):
        for segment in segments:
            assert set(seen.ids(camera).tolist()) <= set(path.bitfields.ids(segment).tolist())


def test_what_is_seen_between_cameras_is_answered():
    few, scene = walk(4), cyc.scenes.grating(10, panel=20)
    path, bare = (cyc.bake_path(scene, few, probes=probes, progress=False) for probes in (24, 0))
    missed = {path: 0.0, bare: 0.0}
    for position in (0.3, 0.77, 1.21, 1.9, 2.5):
        camera = _between(few[int(position)], few[int(position) + 1], position % 1)
        ids = scene.render(camera).ids
        covered = ids[ids != cyc.BACKGROUND]
        for each in missed:
            missed[each] += 1 - np.isin(covered, each.visible_faces(position)).mean()
    assert missed[bare] / 5 > 1e-3 > missed[path] / 5
    assert (path.probes > 0).all() and not bare.probes.any()


@given(st.integers(0, 10**6), st.floats(0, 1))
def test_the_turn_between_cameras_is_scipys(seed: int, t: float):
    rng = np.random.default_rng(seed)
    a, b = (cyc.Camera.look_at(3 * rng.normal(size=3), rng.normal(size=3)) for _ in range(2))
    middle = _between(a, b, t)
    turns = Rotation.from_matrix([a.camera_to_world[:3, :3], b.camera_to_world[:3, :3]])
    expected = Slerp([0, 1], turns)(t).as_matrix()
    np.testing.assert_allclose(middle.camera_to_world[:3, :3], expected, atol=1e-6)
    np.testing.assert_allclose(middle.eye, (1 - t) * a.eye + t * b.eye, atol=1e-9)


def test_positions_fall_into_segments():
    path = cyc.bake_path(scene(), walk(), segments=3, probes=0, fill=None, progress=False)
    np.testing.assert_array_equal(path.starts, [0, 2, 4, 6])
    assert [path.segment(p) for p in (0, 1.9, 2, 5.99, 6)] == [0, 0, 1, 2, 2]
    for position in (-0.1, 6.1, np.nan):
        with pytest.raises(ValueError, match="position"):
            path.visible_faces(position)
    assert 0 < path.culling_rate() < 1 and "3 segments" in repr(path)


def test_one_camera_is_a_walk():
    path = cyc.bake_path(scene(), walk()[:1], progress=False)
    assert len(path) == 1
    np.testing.assert_array_equal(path.visible_faces(0), scene().visible(walk()[0], progress=False).ids(0))


def test_no_walk_is_refused():
    cameras = list(walk())
    for call, message in (
        (lambda: cyc.bake_path(scene(), []), "empty"),
        (lambda: cyc.bake_path(scene(), cameras, segments=0), "segments"),
        (lambda: cyc.bake_path(scene(), cameras, segments=[0, 3]), "segments"),
        (lambda: cyc.bake_path(scene(), cameras, segments=[0, 3, 3, 6]), "segments"),
        (lambda: cyc.bake_path(scene(), cameras, segments=1.5), "segments"),
        (lambda: cyc.bake_path(scene(), cameras, probes=-1), "probes"),
        (lambda: cyc.bake_path(scene(), [cameras[0], cameras[1].with_size(8, 8)]), r"cameras\[0\] and cameras\[1\]"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
