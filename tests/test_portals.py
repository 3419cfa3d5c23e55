"""Buildings: what is seen through their doors against rays, and what cannot be one."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.portals import Building
from cyclorama.portals.cones import Cone
from peers import need
from reference import portals as reference


@pytest.fixture(scope="module")
def home() -> Building:
    house = cyc.scenes.house(rooms=8, seed=0)
    return Building(house, house.cells, house.portals)


@pytest.fixture(scope="module")
def two_rooms() -> Building:
    """x from 0 to 1 and from 1 to 2, a door between them, a window of the second one outdoors; a post in each."""
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    post = np.array([[0.0, 0.2, 0.4], [0.0, 0.8, 0.4], [0.0, 0.8, 0.6], [0.0, 0.2, 0.6]])
    places = [(0.5, 0, 0), (1.9, 0, 0), (1.5, 0, 0.35), (4.0, 0, 0), (4.0, 0, 0.7)]
    vertices = np.concatenate([post + place for place in places])
    scene = cyc.Scene(vertices, np.concatenate([faces + 4 * k for k in range(len(places))]))
    cells = [{"name": "a", "min": [0, 0, 0], "max": [1, 1, 1]}, {"name": "b", "min": [1, 0, 0], "max": [2, 1, 1]}]
    door = [[1, 0.2, 0.4], [1, 0.8, 0.4], [1, 0.8, 0.6], [1, 0.2, 0.6]]
    window = [[2, 0.4, 0.4], [2, 0.6, 0.4], [2, 0.6, 0.6], [2, 0.4, 0.6]]
    return Building(scene, cells, [{"polygon": door, "cells": [0, 1]}, {"polygon": window, "cells": [1, None]}])


def looking(eye: list[float], target: list[float], fov_y: float = 60.0) -> cyc.Camera:
    return cyc.Camera.look_at(eye, target, fov_y=fov_y, width=64, height=48)


def test_a_door_shows_what_lies_behind_it(two_rooms: Building) -> None:
    through = two_rooms.visible(looking([0.6, 0.5, 0.5], [2, 0.5, 0.5]))
    # Not the post behind the eye, nor the one beside the door; the first post outdoors through door and window.
    assert set(through // 2) == {1, 3}
    assert two_rooms.cells_seen(looking([0.6, 0.5, 0.5], [2, 0.5, 0.5])) == [0, 1, None]
    assert two_rooms.cells_seen(looking([0.6, 0.5, 0.5], [0, 0.5, 0.5])) == [0]
    assert set(two_rooms.visible(looking([1.1, 0.5, 0.5], [2, 0.5, 0.6])) // 2) == {1, 2, 3}


def test_what_is_shut_ends_views_that_come_in(two_rooms: Building) -> None:
    cells = [two_rooms.cells[0], replace(two_rooms.cells[1], shut=True)]
    shut = Building(two_rooms.scene, cells, two_rooms.portals)
    assert shut.cells_seen(looking([0.6, 0.5, 0.5], [2, 0.5, 0.5])) == [0, 1]
    assert shut.cells_seen(looking([3, 0.5, 0.5], [0, 0.5, 0.5])) == [None, 1]
    assert shut.cells_seen(looking([1.1, 0.5, 0.5], [2, 0.5, 0.5])) == [1, None]
    with pytest.raises(ValueError, match=r"shut must be true or false, got 1"):
        Building(two_rooms.scene, [{"min": [0, 0, 0], "max": [1, 1, 1], "shut": 1}], [])


def test_an_eye_in_a_door_sees_both_rooms(two_rooms: Building) -> None:
    for offset in (0.0, 1e-12, -1e-12):
        wide = looking([1.0 + offset, 0.5, 0.5], [1.0 + offset, 0.5, 9], fov_y=150.0)
        assert {0, 1} <= set(two_rooms.cells_seen(wide))
    assert set(two_rooms.visible(looking([1.0, 0.5, 0.5], [0.5, 0.5, 0.5])) // 2) == {0}


def test_where_an_eye_is(two_rooms: Building) -> None:
    assert [two_rooms.cell(eye) for eye in ([0.2, 0.5, 0.5], [1.5, 0.5, 0.5], [3, 0.5, 0.5])] == [0, 1, None]
    with pytest.raises(ValueError, match="three finite numbers"):
        two_rooms.cell([0, np.nan, 0])
    assert two_rooms.cells_seen(looking([3, 0.5, 0.5], [0, 0.5, 0.5])) == [None, 1, 0]


def lost(building: Building, eyes: np.ndarray, up: tuple[int, int, int], seed: int) -> tuple[int, int]:
    """Faces that rays find and `visible` leaves out, and the views that have some."""
    open3d = need("open3d")
    scene = building.scene
    caster = open3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices.astype(np.float32), scene.faces)
    rng = np.random.default_rng(seed)
    faces = views = 0
    for eye in eyes:
        gaze = rng.normal(size=3) * (1 - 0.7 * np.array(up))
        camera = cyc.Camera.look_at(eye, eye + gaze, up, fov_y=50, width=96, height=72)
        rays = np.concatenate(camera.rays(), axis=-1).astype(np.float32)
        ids = np.unique(caster.cast_rays(open3d.core.Tensor(rays))["primitive_ids"].numpy())
        found = ids[ids != caster.INVALID_ID]
        missing = (~np.isin(found, building.visible(camera))).sum()
        faces, views = faces + int(missing), views + bool(missing)
    return faces, views


def inside(building: Building, count: int, seed: int, names: str = "") -> np.ndarray:
    """Points in cells whose name begins so."""
    rng = np.random.default_rng(seed)
    cells = [cell for cell in building.cells if cell.name.startswith(names)]
    eyes: list[np.ndarray] = []
    while len(eyes) < count:
        cell = cells[rng.integers(len(cells))]
        eye = cell.low + rng.uniform(0.05, 0.95, 3) * (cell.high - cell.low)
        if cell.holds(eye) and building.cell(eye) is not None:
            eyes.append(eye)
    return np.array(eyes)


def test_no_visible_face_is_lost_in_a_house(home: Building) -> None:
    assert lost(home, inside(home, 200, 0), (0, 1, 0), 0) == (0, 0)


def test_a_door_that_nobody_told_of_is_looked_through(home: Building) -> None:
    """Many eyes lose what it shows; once it was looked at, none does, and the other doors hide what they did."""
    inner = [index for index, portal in enumerate(home.portals) if portal.cells[1] is not None]
    without = Building(home.scene, home.cells, [p for index, p in enumerate(home.portals) if index != inner[0]])
    completed = without.completed(1500, progress=False)
    eyes = inside(home, 200, 7)
    assert lost(without, eyes, (0, 1, 0), 3)[1] >= 5
    assert lost(completed, eyes, (0, 1, 0), 3)[1] <= 1
    for before, after in zip(without.faces, completed.faces, strict=True):
        assert np.isin(before, after).all()
    camera = looking(eyes[0], eyes[0] + (1, 0, 0))
    assert len(home.visible(camera)) <= len(completed.visible(camera)) < 0.7 * len(home.scene)


def test_probes_look_through_glass_and_do_not_take_it_for_a_leak(two_rooms: Building) -> None:
    """Of no walls at all: what is solid is seen from everywhere, a pane only where portals lead."""
    scene = two_rooms.scene
    pane = np.arange(len(scene)) // 2 == 3
    glass = cyc.Scene(scene.vertices, scene.faces, transparent=pane)
    completed = Building(glass, two_rooms.cells, two_rooms.portals).completed(300, progress=False)
    assert completed.leaks.lost.any() and not completed.leaks.lost[-50:].any()
    for before, after in zip(two_rooms.faces, completed.faces, strict=True):
        assert np.isin(before, after).all()
        assert set(after // 2) - set(before // 2) <= {0, 1, 2, 4}
    assert {0, 1, 2} <= set(completed.faces[0] // 2)


def test_none_is_lost_in_its_doors_and_from_outdoors(home: Building) -> None:
    rng = np.random.default_rng(1)
    doors = np.array([rng.dirichlet(np.ones(4)) @ portal.polygon for portal in home.portals])
    assert lost(home, doors, (0, 1, 0), 1) == (0, 0)
    low, high = home.scene.bounds
    turns = rng.uniform(0, 2 * np.pi, 20)
    around = home.scene.center + np.column_stack([np.cos(turns), 0.05 * turns, np.sin(turns)]) * home.scene.radius * 1.2
    assert ((around < low) | (around > high)).any(axis=1).all()
    assert lost(home, around, (0, 1, 0), 2) == (0, 0)


def test_no_visible_face_is_lost_in_a_real_house(data, real_scene) -> None:
    scene = real_scene("fzk_haus")
    house = Building.load(data / "fzk_haus_cells.json", scene)
    names = {cell.name for cell in house.cells}
    assert {"Flur", "Wohnen", "Galerie", "passage Innentuer-1"} <= names
    rooms = inside(house, 120, 0)
    assert lost(house, rooms, (0, 0, 1), 0) == (0, 0)
    # On both sides of the panes of its windows.
    assert lost(house, inside(house, 40, 1, "window"), (0, 0, 1), 1) == (0, 0)
    drawn = [len(house.visible(looking(list(eye), list(eye + (1, 0, 0))))) for eye in rooms[:20]]
    assert np.mean(drawn) < 0.1 * len(scene)


def test_what_is_answered_lies_in_the_frustum(home: Building) -> None:
    for eye in inside(home, 10, 3):
        camera = looking(list(eye), list(eye + (1, 0, 0.3)))
        seen = home.visible(camera)
        assert (np.diff(seen.astype(int)) > 0).all()
        corners = np.asarray(home.scene.vertices, np.float64)[home.scene.faces[seen]]
        local = corners @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
        assert (local[..., 2] > -1e-6).any(axis=1).all()


def test_rooms_around_a_courtyard_end() -> None:
    """A ring of cells, each with a wide door to the next: sequences of portals end though the cells go round."""
    boxes = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    cells = [{"name": str(k), "min": [x, 0, z], "max": [x + 1, 1, z + 1]} for k, (x, z) in enumerate(boxes)]
    portals = []
    for a, b in pairwise([*range(8), 0]):
        (x, z), (p, q) = boxes[a], boxes[b]
        flat = [(x + p + 1) / 2, (z + q + 1) / 2]
        polygon = np.array([[flat[0], 0, flat[1]]] * 4, dtype=float)
        polygon[[2, 3], 1] = 1
        axis = 2 if x != p else 0
        polygon[:, axis] += [-0.5, 0.5, 0.5, -0.5]
        portals.append({"polygon": polygon, "cells": [a, b]})
    scene = cyc.Scene([[0.5, 0.5, 0.5], [0.5, 0.6, 0.5], [0.5, 0.5, 0.6]], [[0, 1, 2]])
    ring = Building(scene, cells, portals)
    views = list(ring.views(looking([0.1, 0.5, 0.1], [3, 0.5, 0.2], fov_y=120)))
    assert 3 <= len(views) <= 20 and {place for place, _ in views} >= {0, 1, 2}


def test_portals_that_overlap_do_not_double_the_views() -> None:
    """A row of rooms with three portals, all the same, from each to the next: 3^12 sequences show the last one."""
    cells = [{"name": str(k), "min": [k, 0, 0], "max": [k + 1, 1, 1]} for k in range(13)]
    door = np.array([[0, 0.2, 0.2], [0, 0.8, 0.2], [0, 0.8, 0.8], [0, 0.2, 0.8]])
    portals = [{"polygon": door + (k + 1, 0, 0), "cells": [k, k + 1]} for k in range(12) for _ in range(3)]
    row = Building(cyc.Scene([[12.5, 0.5, 0.5], [12.5, 0.6, 0.5], [12.5, 0.5, 0.6]], [[0, 1, 2]]), cells, portals)
    camera = looking([0.5, 0.5, 0.5], [13, 0.5, 0.5])
    # Rounding lets some of them through twice.
    assert 13 <= len(list(row.views(camera))) < 100
    assert row.visible(camera).tolist() == [0]


@pytest.mark.parametrize("seed", range(4))
def test_the_kernel_sees_what_plain_numpy_does(seed: int) -> None:
    house = cyc.scenes.house(rooms=3 + seed, seed=seed)
    home = Building(house, house.cells, house.portals)
    for eye in inside(home, 12, seed):
        camera = looking(list(eye), list(eye + np.random.default_rng(seed).normal(size=3)), fov_y=75.0)
        np.testing.assert_array_equal(home.visible(camera), reference.visible(home, camera))


def test_it_sees_the_same_through_portals_of_any_shape() -> None:
    """Random triangles and pentagons as portals between cells that are only names, a face in each of random places."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        cells = [{"min": [3 * k, 0, 0], "max": [3 * k + 3, 3, 3]} for k in range(4)]
        portals = []
        for k in [0, 0, 1, 1, 2]:
            turns = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 6))))
            flat = 1.5 + np.column_stack([np.cos(turns), np.sin(turns)]) * rng.uniform(0.5, 1.5)
            portals.append({"polygon": np.column_stack([np.full(len(flat), 3.0 * k + 3), flat]), "cells": [k, k + 1]})
        corners = rng.uniform((0, 0, 0), (12, 3, 3), (120, 1, 3)) + rng.normal(size=(120, 3, 3)) * 0.3
        scene = cyc.Scene(corners.reshape(-1, 3), np.arange(360).reshape(-1, 3))
        # Random faces wind around anything: whoever knows the faces of each cell says so.
        row = Building(scene, cells, portals, faces=[np.arange(120, dtype=np.uint32)] * 5)
        camera = looking([0.3, *rng.uniform(0.5, 2.5, 2)], [12, *rng.uniform(0.5, 2.5, 2)], fov_y=40.0)
        cone = Cone.of(camera)
        expected = np.zeros(120, bool)
        for _, part in reference.views(row, 0, cone, frozenset()):
            expected |= ~part.misses(corners)
        planes = np.column_stack([cone.normals, cone.offsets])
        np.testing.assert_array_equal(row.kernel.walk(cone.eye.tolist(), planes, [0], [])[0], np.flatnonzero(expected))


def test_a_surface_winds_around_what_is_in_it_as_often_as_the_sum_of_its_solid_angles() -> None:
    scene = cyc.scenes.house(rooms=2, seed=2)
    corners = np.asarray(scene.vertices, np.float64)[scene.faces]
    surface = cyc._core.Solid(corners.reshape(-1, 9))
    rng = np.random.default_rng(0)
    for point in rng.uniform(scene.bounds[0], scene.bounds[1], (200, 3)):
        expected = reference.winding(corners.transpose(1, 2, 0), point)
        assert surface.winding(point.tolist()) == pytest.approx(expected, abs=1e-9)


def test_what_cannot_be_a_building_is_refused(two_rooms: Building, tmp_path) -> None:
    scene, cells = two_rooms.scene, [{"name": "a", "min": [0, 0, 0], "max": [1, 1, 1]}]
    door = np.array([[1, 0.2, 0.4], [1, 0.8, 0.4], [1, 0.8, 0.6], [1, 0.2, 0.6]])

    def refused(match: str, cells) -> None:
        with pytest.raises(ValueError, match=match):
            Building(scene, cells, [])

    refused("cells is empty", cells=[])
    refused(r"cells\[0\] \(a\) is empty: min\[1\] is 1", cells=[{"name": "a", "min": [0, 1, 0], "max": [1, 1, 1]}])
    refused(r"cells\[1\] \(1\) and cells\[0\] \(a\) overlap", cells=[*cells, {"min": [0.5, 0, 0], "max": [2, 1, 1]}])
    refused(r"needs min and max, or vertices and faces; it has \['name'\]", cells=[{"name": "a"}])
    refused("is not closed: 3 of its edges", cells=[{"vertices": np.eye(3), "faces": [[0, 1, 2]]}])
    for sides, match in (
        ([None, None], "belongs to no cell"),
        ([0, 3], "names cell 3, there are 1"),
        ([0, 0], "from cell 0 to itself"),
        ([0], "two sides"),
    ):
        with pytest.raises(ValueError, match=match):
            Building(scene, cells, [{"polygon": door, "cells": sides}])
    bent, dented = door.copy(), door.copy()
    bent[2, 0] += 0.1
    dented[2] = [1, 0.3, 0.45]
    for polygon, match in (
        (bent, "is not flat"),
        (dented, "is not convex at corner 2"),
        (door[:2], "at least 3 corners"),
        (door + (5, 0, 0), r"lies 5 away from cells\[0\] \(a\)"),
        (door * np.nan, "must be finite"),
    ):
        with pytest.raises(ValueError, match=match):
            Building(scene, cells, [{"polygon": polygon, "cells": [0, None]}])
    path = tmp_path / "building.json"
    for text, match in (("{", "is not JSON"), ("[]", "has neither cells and portals"), ("{}", "has neither")):
        path.write_text(text)
        with pytest.raises(ValueError, match=match):
            Building.load(path, scene)
    path.write_text(json.dumps({"cells": cells, "portals": [{"polygon": door.tolist(), "cells": [0, None]}]}))
    assert len(Building.load(path, scene).portals) == 1


def test_an_eye_in_a_wall_sees_nothing_and_says_so(home: Building) -> None:
    corner = np.array([home.cells[0].low[0], 1.3, home.cells[0].low[2]])
    for wall in (corner + (0.02, 0, 0.02), corner - (0.05, 0, 0.07)):
        assert home.cell(wall) is None
        with pytest.raises(ValueError, match="inside something solid"):
            home.visible(looking(list(wall), [5, 1, 5]))
    assert home.cell(home.portals[0].polygon.mean(0)) is None
