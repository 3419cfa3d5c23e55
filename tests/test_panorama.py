"""Walkthroughs on a rail: tracks, slabs, the store and what is seen from it."""

from __future__ import annotations

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.panorama import BuiltIn, Projection, Track


@pytest.fixture(scope="module")
def house():
    return cyc.scenes.house(rooms=4)


@pytest.fixture(scope="module")
def eye(house):
    return (house.cells[0]["min"] + house.cells[0]["max"]) / 2


@pytest.fixture(scope="module")
def walk(house, eye, tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    track = [eye, eye + [0.4, 0.0, 0.0]]
    return cyc.panorama.bake(house, track, 3, (512, 128), spacing=0.2, out=folder, progress=False)


@pytest.mark.parametrize("kind", ["cylinder", "equirect"])
def test_a_panorama_sees_what_pinhole_cameras_see(house, eye, kind):
    panorama = Projection(kind, (512, 256))
    layer = BuiltIn(house).render(eye, panorama, 0.0, np.inf)
    camera = cyc.Camera.look_at(eye, eye + [0.3, 0.1, -1.0], fov_y=50, width=200, height=150)
    truth = house.render(camera)
    points = (panorama.directions() * layer.range[..., None] + eye).reshape(-1, 3)
    pixels, depth = camera.project(points)
    inside = (depth > 0) & ((pixels > 0) & (pixels < (200, 150))).all(axis=1)
    at = pixels[inside].astype(int)
    drawn = truth.depth[at[:, 1], at[:, 0]]
    # A pixel's own depth is that of its centre: edges, and surfaces seen slantwise, differ.
    assert np.mean(np.abs(drawn - depth[inside]) < 0.02 * depth[inside]) > 0.97


def test_composed_slabs_are_the_panorama_that_was_never_split(walk, house):
    for index, entry in enumerate(walk.references):
        whole = BuiltIn(house).render(entry.eye, walk.projection, 0.0, np.inf)
        composed = walk.panorama(index)
        np.testing.assert_array_equal(composed[..., 3] > 0, whole.opacity)
        np.testing.assert_array_equal(composed[whole.opacity, :3], whole.color[whole.opacity])


def test_tracks_of_one_point_through_walls_and_outside_are_refused(house, eye):
    with pytest.raises(ValueError, match="two different points"):
        Track([eye, eye])
    with pytest.raises(ValueError, match=r"points\[1\] is"):
        Track([eye, [np.nan, 0, 0]])
    with pytest.raises(ValueError, match="through a wall at"):
        Track([eye, eye + [0, 0, 100]]).check(house, allow_outside=True)
    with pytest.raises(ValueError, match="outside the scene"):
        Track([eye, eye + [0, 0, 100]]).check(house)
