"""All instruction sets that this processor has draw the same bits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import _core


@pytest.fixture(autouse=True)
def best() -> Iterator[None]:
    """The process goes on with what it used before."""
    used = _core.instruction_set()
    yield
    _core.use_instruction_set(used)


def answers(scene: cyc.Scene, cameras: list[cyc.Camera]) -> list[np.ndarray]:
    """All that is drawn, by the rasteriser."""
    views = [scene.render(camera, engine="raster") for camera in cameras]
    drawn = [array for view in views for array in (view.ids, view.depth, view.color)]
    return drawn + [scene.visible(cameras, fill=fill, engine="raster").words for fill in ("rays", "neighbours", None)]


def alike(scene: cyc.Scene, cameras: list[cyc.Camera]) -> list[np.ndarray]:
    """The answers, which are the same whatever draws."""
    answer = {}
    for name in _core.instruction_sets():
        _core.use_instruction_set(name)
        answer[name] = answers(scene, cameras)
    first = answer["portable"]
    for name, other in answer.items():
        for a, b in zip(first, other, strict=True):
            assert a.tobytes() == b.tobytes(), name
    return first


@pytest.mark.parametrize("name", ["bunny", "kitchen", "engine_2cylinder"])
def test_real_meshes(real_scene, name):
    scene = real_scene(name)
    far = scene.center + 3.0 * scene.radius * np.array([0.48, 0.31, 0.82])
    near = scene.center + 0.4 * scene.radius * np.array([0.82, 0.31, 0.48])
    cameras = [
        cyc.Camera.look_at(far, scene.center),
        cyc.Camera.look_at(near, scene.center, fov_y=90.0, width=333, height=201),
        cyc.Camera.orthographic_look_at(far, scene.center, extent=2.0 * scene.radius),
    ]
    for words in alike(scene, cameras)[-3:]:
        assert all(row.any() for row in words), "a view shows nothing"


@given(
    balls=st.lists(
        st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1.0)), min_size=1, max_size=5
    ),
    eye=st.floats(0.5, 6.0),
    size=st.tuples(st.integers(1, 200), st.integers(1, 150)),
    orthographic=st.booleans(),
)
def test_balls(balls, eye, size, orthographic):
    one = cyc.scenes.sphere(500)
    vertices = [np.array([x, y, z]) + r * np.asarray(one.vertices) for x, y, z, r in balls]
    faces = [one.faces + k * len(one.vertices) for k in range(len(balls))]
    scene = cyc.Scene(np.concatenate(vertices), np.concatenate(faces))
    width, height = size
    at = np.array([0.0, 0.0, eye])
    target = np.asarray(balls[0][:3]) - [0.0, 0.0, 2.0 * balls[0][3]]
    assume(np.linalg.norm(target - at) > 1e-3)
    if orthographic:
        camera = cyc.Camera.orthographic_look_at(at, target, extent=3.0, width=width, height=height)
    else:
        camera = cyc.Camera.look_at(at, target, fov_y=60.0, width=width, height=height)
    alike(scene, [camera])


@pytest.mark.parametrize("name", ["tree", "horse"])
def test_rows_are_the_same_for_all_sets_engines_and_threads(real_scene, name):
    """Of a cluttered scene and of one that is not."""
    scene = real_scene(name)
    eyes = [scene.center + scene.radius * away * d for away in (0.3, 3.0) for d in cyc.sphere.fibonacci(3)]
    cameras = [
        cyc.Camera.look_at(eye, scene.center, up=(0.1, 1.0, 0.2), fov_y=60.0, width=160, height=120) for eye in eyes
    ]
    cameras.append(cyc.Camera.orthographic_look_at(eyes[-1], scene.center, extent=scene.radius, width=99, height=70))
    first = scene.visible(cameras).words
    assert all(row.any() for row in first)
    for instructions in _core.instruction_sets():
        _core.use_instruction_set(instructions)
        for engine in ("raster", "raycast", "auto"):
            for threads in (1, 3):
                words = scene.visible(cameras, engine=engine, threads=threads).words
                np.testing.assert_array_equal(words, first, f"{instructions}, {engine}, {threads} threads")


def test_the_best_set_is_used_unless_another_is_asked_for():
    available = _core.instruction_sets()
    assert available[0] == "portable"
    for name in available:
        _core.use_instruction_set(name)
        assert _core.instruction_set() == name


@pytest.mark.parametrize("name", ["", "avx2", "NEON"])
def test_a_set_that_is_not_there_is_refused(name):
    used = _core.instruction_set()
    with pytest.raises(ValueError, match=f"must be one of .*portable.*got {name!r}".replace("'", '"')):
        _core.use_instruction_set(name)
    assert _core.instruction_set() == used
