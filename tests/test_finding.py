"""Rooms and doors found in meshes, against those that are known."""

from __future__ import annotations

import json

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.portals import Building
from cyclorama.portals.finding import _height, _narrowest
from cyclorama.portals.voxels import FILLED, Grid, pairs_of
from peers import need
from test_portals import lost


def boxes(*parts) -> cyc.Scene:
    """The sides of boxes (low, high), without those whose axis and end are listed after them."""
    vertices, faces = [], []
    for low, high, *without in parts:
        for axis in range(3):
            for end in range(2):
                if (axis, end) in without:
                    continue
                u, v = (axis + 1) % 3, (axis + 2) % 3
                corners = np.empty((4, 3))
                corners[:, axis] = (low, high)[end][axis]
                corners[:, u] = np.array([low[u], high[u]])[[0, 1, 1, 0]]
                corners[:, v] = np.array([low[v], high[v]])[[0, 0, 1, 1]]
                faces += [[len(vertices), len(vertices) + 1, len(vertices) + 2]]
                faces += [[len(vertices), len(vertices) + 2, len(vertices) + 3]]
                vertices += corners.tolist()
    return cyc.Scene(vertices, faces)


def matched(building: Building, doors: list[tuple[np.ndarray, np.ndarray]]) -> tuple[list[int], list[float]]:
    """For each portal the door box that it lies in, or -1; for each door, how much of it its portals cover."""
    step = building.cells[0].rooms.grid.step
    owners, covered = [], [0.0] * len(doors)
    for portal in building.portals:
        low, high = portal.polygon.min(0), portal.polygon.max(0)
        owner = -1
        for index, (least, most) in enumerate(doors):
            size = np.maximum(most - least, 1e-9)
            overlap = np.minimum(high, most + 4 * step) - np.maximum(low, least - 4 * step)
            if (overlap >= 0).all() and np.argmin(size) == np.argmin(high - low):
                owner, flat = index, np.argmin(size)
                share = np.delete((np.minimum(high, most) - np.maximum(low, least)) / size, flat)
                covered[index] += float(np.clip(share, 0, 1).prod())
        owners.append(owner)
    return owners, covered


@pytest.fixture(scope="module")
def home() -> Building:
    need("scipy")
    return Building.find(cyc.scenes.house(rooms=8, seed=0), voxel=0.08, progress=False)


def test_all_rooms_and_openings_of_a_house_are_found(home: Building) -> None:
    house = home.scene
    assert len(home.cells) == 8
    where = [home.cell((room["min"] + room["max"]) * (0.5, 0.9, 0.5)) for room in house.cells]
    assert sorted(where) == list(range(8))
    doors = [(portal["polygon"].min(0), portal["polygon"].max(0)) for portal in house.portals]
    owners, covered = matched(home, doors)
    # Precision, recall, and the share of each true door that lies in what was found.
    assert sorted(owners) == list(range(len(doors)))
    assert min(covered) > 0.999
    for portal, owner in zip(home.portals, owners, strict=True):
        a, b = house.portals[owner]["cells"]
        assert set(portal.cells) == {where[a], None if b is None else where[b]}


def test_no_visible_face_is_lost_by_doors_that_were_found(home: Building) -> None:
    rooms = home.cells[0].rooms
    rng = np.random.default_rng(0)
    free = np.argwhere(rooms.labels != FILLED)
    indoors = free[rooms.labels[tuple(free.T)] >= 0]
    chosen = np.concatenate([rng.choice(indoors, 100), rng.choice(free, 20)])
    eyes = rooms.grid.low + (chosen + rng.random(chosen.shape)) * rooms.grid.step
    assert lost(home, eyes, (0, 1, 0), 0) == (0, 0)


def test_the_doors_of_a_real_house_are_found(data, real_scene) -> None:
    """Of its 7 rooms those that join without a wall are one; its 5 doors are the portals, and there are no others."""
    need("scipy")
    building = Building.find(real_scene("fzk_haus"), progress=False)
    truth = json.loads((data / "fzk_haus_cells.json").read_text())
    doors = [(np.array(door["aabb_min"]), np.array(door["aabb_max"])) for door in truth["doors"]]
    owners, covered = matched(building, doors)
    assert sorted(owners) == list(range(5))
    assert min(covered) > 0.8
    where = {}
    for space in truth["spaces"]:
        corners = np.array(space["vertices"])
        middle = (corners.min(0) + corners.max(0)) / 2
        where[space["long_name"]] = building.cell(middle)
    assert len(set(where.values()) - {None}) == 4
    assert where["Flur"] == where["Wohnen"] == where["Küche"] == where["Galerie"]
    rooms = building.cells[0].rooms
    rng = np.random.default_rng(1)
    chosen = rng.choice(np.argwhere(rooms.labels >= 0), 60)
    eyes = rooms.grid.low + (chosen + rng.random(chosen.shape)) * rooms.grid.step
    assert lost(building, eyes, (0, 0, 1), 1) == (0, 0)


def eyes_in(building: Building, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points in open cubes, three of four of them indoors."""
    rooms = building.cells[0].rooms
    indoors, outdoors = np.argwhere(rooms.labels >= 0), np.argwhere(rooms.labels == -1)
    chosen = np.concatenate([rng.choice(indoors, count - count // 4), rng.choice(outdoors, count // 4)])
    return rooms.grid.low + (chosen + rng.random(chosen.shape)) * rooms.grid.step


def test_what_is_seen_through_gaps_that_cubes_close_is_drawn(real_scene) -> None:
    """A castle, whose walls have some: without probes some of 400 eyes lose faces, with them at most one does."""
    need("scipy")
    scene = real_scene("q3_20kdm2")
    bare = Building.find(scene, probes=0, progress=False)
    whole = bare.completed(progress=False)
    eyes = eyes_in(bare, 400, np.random.default_rng(5))
    assert lost(bare, eyes, (0, 0, 1), 2)[1] >= 4
    assert lost(whole, eyes, (0, 0, 1), 2)[1] <= 1
    # It is no way out to draw all there is.
    drawn = [sum(len(building.faces[place]) for place in range(len(bare.cells))) for building in (bare, whole)]
    assert drawn[0] < drawn[1] < 0.2 * len(scene) * len(bare.cells)


def test_a_slit_that_cubes_close_is_looked_through() -> None:
    """Beyond it stands a box; one behind the other wall is never drawn with the room."""
    need("scipy")
    room = ([0, 0, 0], [4, 4, 3], (0, 1))
    sides = ([4, 0, 0], [4, 1.95, 3]), ([4, 2.05, 0], [4, 4, 3])
    scene = boxes(room, ([7, 1.5, 1], [7.4, 2.5, 2]), ([-7.4, 1.5, 1], [-7, 2.5, 2]), *sides)
    ahead, behind = np.arange(10, 22), np.arange(22, 34)
    bare, whole = (Building.find(scene, voxel=0.2, door=1.0, probes=n, progress=False) for n in (0, 500))
    assert len(bare.cells) == 1 and not bare.portals
    assert not np.isin(ahead, bare.faces[0]).any()
    # Its nearest side is all that is seen of it.
    near = [face for face in ahead if (scene.vertices[scene.faces[face], 0] == 7).all()]
    assert np.isin(near, whole.faces[0]).all()
    assert not np.isin(behind, whole.faces[0]).any()
    assert whole.leaks.lost.any() and not bare.leaks.lost.any()
    again = bare.completed(500, threads=1, progress=False)
    assert all(np.array_equal(*pair) for pair in zip(again.faces, whole.faces, strict=True))


def test_cubes_are_those_that_faces_touch() -> None:
    """Against Open3D's distance of a cube's middle from the mesh: a sphere in it touches, one around it must."""
    open3d = need("open3d")
    scene = cyc.scenes.sphere(faces=80)
    grid = Grid.around(scene.bounds, 0.15, 2)
    pairs = pairs_of(grid, np.asarray(scene.vertices, np.float64)[scene.faces], lambda _: None)
    touched = np.zeros(grid.shape, bool)
    touched.reshape(-1)[pairs.voxels] = True
    caster = open3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices.astype(np.float32), scene.faces)
    middles = grid.low + (np.argwhere(np.ones(grid.shape, bool)) + 0.5) * grid.step
    distance = caster.compute_distance(open3d.core.Tensor(middles.astype(np.float32))).numpy().reshape(grid.shape)
    assert touched[distance < 0.4999 * grid.step].all()
    assert not touched[distance > 0.8662 * grid.step].any()
    assert 0 < touched.sum() < touched.size / 2


def test_a_gate_is_the_smallest_section_across_the_way() -> None:
    need("scipy")
    solid = np.zeros((20, 12, 12), bool)
    solid[9:12] = True
    solid[9:12, 3:8, 2:9] = False
    solid[10, 3, 2:9] = True
    meeting = np.argwhere(np.ones((1, 5, 7), bool)) + (9, 3, 2)
    gate = _narrowest(solid, meeting, 8.0)
    assert gate is not None and (gate.axis, gate.layer, int(gate.open.sum())) == (0, 10, 28)
    assert _narrowest(solid, meeting, 5.0) is None


def test_where_no_room_is_found_it_says_what_to_set() -> None:
    need("scipy")
    with pytest.raises(ValueError, match="no closed space found: all free space is connected to outdoors"):
        Building.find(boxes(([0, 0, 0], [4, 4, 3], (2, 1))), voxel=0.2, door=1.0, progress=False)
    with pytest.raises(ValueError, match=r"hollows with \d+ voxels .* give a larger door="):
        Building.find(boxes(([0, 0, 0], [4, 4, 0.5])), voxel=0.1, door=2.0, progress=False)
    two = boxes(([0, 0, 0], [4, 4, 3]), ([4.4, 0, 0], [8, 4, 3]))
    assert len(Building.find(two, voxel=0.1, door=1.0, progress=False).cells) == 2
    for options, match in (
        ({"door": -1.0}, "door must be a positive number, got -1.0"),
        ({"voxel": np.nan}, "voxel must be a positive number, got nan"),
        ({"door": 0.5, "voxel": 0.2}, "a door of 0.5 is less than three voxels of 0.2 wide"),
        ({"voxel": 0.001, "door": 1.0}, r"would take \d+.\d GB: give a voxel= of .* or a larger max_bytes="),
        ({"max_bytes": 0}, "max_bytes must be a positive number, got 0"),
        ({"probes": -1}, "probes must be an integer of at least 0, got -1"),
        ({"probes": 10, "seed": -1}, "seed must be an integer of at least 0, got -1"),
    ):
        with pytest.raises(ValueError, match=match):
            Building.find(two, progress=False, **options)


def test_how_wide_doors_are_is_taken_from_the_rooms_whatever_the_unit() -> None:
    """A small house, whose doors are a third as wide as it is deep, in metres and in inches."""
    need("scipy")
    house = cyc.scenes.house(rooms=2, seed=0)
    assert _height(house) == pytest.approx(2.5, abs=0.15)
    inches = cyc.Scene(np.asarray(house.vertices) * 39.37, house.faces)
    assert _height(inches) == pytest.approx(39.37 * _height(house), rel=1e-6)
    for scene, options in ((house, {"voxel": 0.08}), (inches, {"voxel": 3.2, "eye_height": 63.0})):
        found = Building.find(scene, progress=False, **options)
        assert (len(found.cells), len(found.portals)) == (2, len(house.portals))
    flat = cyc.Scene([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    with pytest.raises(ValueError, match=r"no place in the scene has faces all around it.* give door="):
        Building.find(flat, progress=False)
    with pytest.raises(ValueError, match="eye_height must be a positive number, got 0"):
        Building.find(house, eye_height=0, progress=False)


def test_progress_counts_faces_and_an_eye_in_a_wall_is_nowhere(home: Building) -> None:
    need("scipy")
    seen: list[int] = []
    two = boxes(([0, 0, 0], [4, 4, 3]), ([6, 0, 0], [10, 4, 3]))
    building = Building.find(two, voxel=0.2, door=1.0, probes=50, progress=seen.append)
    assert seen == sorted(seen) and seen[-1] == len(two) + 50
    assert building.cell([2, 2, 1.5]) is not None and building.cell([5, 2, 1.5]) is None
    assert building.cell([0.05, 2, 1.5]) is None
    shown = building.visible(cyc.Camera.look_at([0.05, 2, 1.5], [9, 2, 1.5]))
    assert 0 < len(shown) < len(two)
