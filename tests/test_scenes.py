"""Procedural scenes: closed as trimesh sees it, of the asked size, and as their answers say by Open3D's rays."""

import time

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import scenes

SOLIDS = {
    "sphere": lambda: scenes.sphere(2_000),
    "gear": lambda: scenes.gear(12_346),
    "pipes": lambda: scenes.pipes(8_000, seed=2),
    "nested_boxes": lambda: scenes.nested_boxes(4),
    "window_box": scenes.window_box,
    "notch": lambda: scenes.notch(1),
    "tubes": lambda: scenes.tubes(5),
    "grating": lambda: scenes.grating(6, panel=10),
}


def _solid(scene):
    return trimesh.Trimesh(scene.vertices, scene.faces, process=False)


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_wound_outward(name):
    scene = SOLIDS[name]()
    mesh = _solid(scene)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert not cyc.describe(scene)["degenerate"]
    assert not cyc.describe(scene)["duplicate"]
    if name != "window_box":  # its hollow belongs to the outside: the window joins them, so it is one solid as well
        for part in mesh.split(only_watertight=False, repair=False):
            assert part.volume > 0.0


def test_a_castle_is_closed_pieces_and_its_lane_is_free():
    town = scenes.castle(houses=30)
    mesh = _solid(town)
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert min(part.volume for part in mesh.split(only_watertight=False, repair=False)) > 0.0
    cyc.panorama.Track(town.lane).check(town)
    with pytest.raises(ValueError, match="houses must be from 1 to 400"):
        scenes.castle(houses=0)


def test_volumes_worked_out_by_hand():
    sizes = [1.0, 0.75, 0.5, 0.25]
    assert _solid(scenes.nested_boxes(4)).volume == pytest.approx(sum((2 * size) ** 3 for size in sizes))
    # outer box, less the hollow, less the hole of the window, plus the cube within
    assert _solid(scenes.window_box()).volume == pytest.approx(8 - 1.8**3 - 0.6 * 0.6 * 0.1 + 0.2**3)
    assert _solid(scenes.sphere(20_000)).volume == pytest.approx(4 / 3 * np.pi, rel=1e-3)
    pitch = 2 / 5.3
    assert _solid(scenes.tubes(5)).volume == pytest.approx(4 * 2.2 - 25 * (0.7 * pitch) ** 2 * 2.0)


@settings(max_examples=40, deadline=None)
@given(st.integers(4, 3_000), st.integers(0, 5), st.integers(3, 8), st.integers(1, 30))
def test_pipes_are_exactly_as_many_as_asked_and_closed(count, seed, sides, bends):
    scene = scenes.pipes(count, seed=seed, sides=sides, bends=bends)
    assert len(scene) == count
    assert np.abs(scene.vertices).max() <= 1.0
    assert cyc.describe(scene)["watertight"] == (count % 2 == 0)


def test_a_pipe_keeps_its_width_around_its_bends():
    scene = scenes.pipes(2 * 6 * 12 + 8, seed=3, sides=6, bends=12)
    rings = scene.vertices.reshape(13, 6, 3)
    path = rings.mean(axis=1)
    stretches = np.diff(path, axis=0)
    assert (np.count_nonzero(np.abs(stretches) > 1e-9, axis=1) == 1).all(), "along the axes"
    assert np.abs(np.einsum("nk,nk->n", stretches[1:], stretches[:-1])).max() < 1e-12, "turning by right angles"
    radius = np.linalg.norm(rings[0] - path[0], axis=1)
    area = 1.5 * 3**0.5 * radius[0] ** 2
    assert _solid(scene).volume == pytest.approx(area * np.linalg.norm(stretches, axis=1).sum())


def test_a_million_pipes_fill_the_cube_evenly_and_quickly():
    start = time.perf_counter()
    scene = scenes.pipes(1_000_000)
    assert time.perf_counter() - start < 3.0
    assert len(scene) == 1_000_000
    centers = scene.vertices[scene.faces].mean(axis=1)
    counts, _ = np.histogramdd(centers, bins=4, range=[(-1, 1)] * 3)
    assert 0.75 < counts.min() / counts.mean() and counts.max() / counts.mean() < 1.25


@pytest.mark.parametrize("count", [4, 5, 8, 330, 331, 10_000])
def test_spheres_have_the_asked_faces_and_are_convex(count):
    scene = scenes.sphere(count)
    assert len(scene) == count + count % 2
    mesh = _solid(scene)
    assert mesh.is_watertight and mesh.volume == pytest.approx(mesh.convex_hull.volume)
    # no vertex lies before any face
    if count < 1_000:
        offsets = np.einsum("fvk,fk->fv", scene.vertices[None] - mesh.triangles[:, :1], mesh.face_normals)
        assert offsets.max() < 1e-12


@pytest.mark.parametrize("count", [2_304, 5_000, 5_001, 74_634, 300_000])
def test_gears_have_the_asked_faces(count):
    scene = scenes.gear(count)
    assert len(scene) == count + count % 2
    assert cyc.describe(scene)["watertight"]


def test_a_gear_has_deep_teeth():
    radius = np.linalg.norm(scenes.gear(teeth=20, depth=0.4).vertices[:, :2], axis=1)
    assert radius.max() == pytest.approx(1.0)
    line = trimesh.Trimesh(*_arrays(scenes.gear(teeth=20, depth=0.4)), process=False).section([0, 0, 1], [0, 0, 0.01])
    angle = np.arctan2(*line.vertices[:, 1::-1].T) % (2 * np.pi)
    turns = np.linalg.norm(line.vertices[:, :2], axis=1)[np.argsort(angle)]
    outside = turns[turns > 0.55]
    assert np.count_nonzero(np.diff((outside > 0.8).astype(int), append=outside[0] > 0.8) == 1) == 20


def _arrays(scene):
    return scene.vertices, scene.faces


@pytest.mark.parametrize("make", [scenes.plant, scenes.tree])
@pytest.mark.parametrize("count", [1_000, 1_001, 30_000])
def test_plants_have_the_asked_faces(make, count):
    scene = make(count, seed=1)
    assert len(scene) == count
    assert scene.colors.shape == (count, 3)
    assert not cyc.describe(scene)["degenerate"]


def test_the_clusters_of_a_plant_differ_in_density_by_orders_of_magnitude():
    from scipy.spatial import cKDTree

    scene = scenes.plant(40_000)
    centers = scene.vertices[scene.faces].mean(axis=1)[scene.colors[:, 1] > scene.colors[:, 0]]
    tenth = cKDTree(centers).query(centers, k=10)[0][:, -1]
    low, high = np.percentile(tenth, [2, 98])
    assert (high / low) ** 3 > 500


def test_layers_share_their_faces_evenly():
    scene = scenes.layers(1_002, layers=4)
    assert len(scene) == 1_002
    height = scene.vertices[scene.faces][:, :, 2]
    assert (height == height[:, :1]).all()
    counts = np.unique(height[:, 0], return_counts=True)[1]
    assert counts.max() - counts.min() <= 2
    areas = trimesh.triangles.area(scene.vertices[scene.faces])
    for level in np.unique(height):
        assert areas[height[:, 0] == level].sum() == pytest.approx(4.0)


@pytest.mark.parametrize("name", ["pipes", "plant", "tree", "house", "castle"])
def test_the_same_seed_makes_the_same_scene(name):
    def make(seed):
        sizes = {"house": 3, "castle": 5}
        return getattr(scenes, name)(sizes.get(name, 2_000), seed=seed)

    a, b, c = make(5), make(5), make(6)
    np.testing.assert_array_equal(a.vertices, b.vertices)
    np.testing.assert_array_equal(a.faces, b.faces)
    np.testing.assert_array_equal(a.colors, b.colors)
    assert a.vertices.shape != c.vertices.shape or (a.vertices != c.vertices).any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: scenes.sphere(3), "4 faces"),
        (lambda: scenes.gear(100), "2304"),
        (lambda: scenes.gear(teeth=2), "3 teeth"),
        (lambda: scenes.gear(depth=0.7), "depth"),
        (lambda: scenes.pipes(3), "at least 4"),
        (lambda: scenes.pipes(100, sides=2), "3 sides"),
        (lambda: scenes.plant(10), "1000"),
        (lambda: scenes.tree(-1), "200"),
        (lambda: scenes.house(0), "rooms"),
        (lambda: scenes.notch(-1), "level"),
        (lambda: scenes.notch(opening=1.0), "opening"),
        (lambda: scenes.notch(distance=0.5), "distance"),
        (lambda: scenes.tubes(4), "odd"),
        (lambda: scenes.grating(1), "bars"),
        (lambda: scenes.layers(10, layers=6), "6 layers"),
        (lambda: scenes.nested_boxes(0), "count"),
    ],
)
def test_sizes_out_of_range_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# What is seen ---------------------------------------------------------------------------------------------------------


def _seen(scene, eye, faces, points=400, seed=0):
    """Faces of which one of `points` random points sees the eye, by Open3D's rays (Embree)."""
    open3d = pytest.importorskip("open3d")
    caster = open3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices.astype(np.float32), scene.faces.astype(np.uint32))
    share = np.random.default_rng(seed).dirichlet([1.0, 1.0, 1.0], size=points)
    triangles = scene.vertices[scene.faces[faces]]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    target = (share @ triangles).reshape(len(faces), points, 3)
    away = eye - target
    front = np.einsum("fpk,fk->fp", away, normals) > 0
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    rays = np.concatenate([target + 1e-5 * scene.radius * away, away], axis=-1).astype(np.float32)
    blocked = caster.test_occlusions(open3d.core.Tensor(rays)).numpy()
    return faces[(front & ~blocked).any(axis=1)]


@pytest.mark.parametrize("name", ["nested_boxes", "window_box", "notch", "tubes", "layers"])
def test_what_is_known_by_hand_is_what_rays_see(name):
    scene = scenes.layers(400, layers=4) if name == "layers" else getattr(scenes, name)()
    for sight in scene.sights:
        assert not np.intersect1d(sight.seen, sight.hidden).size
        if name in ("nested_boxes", "window_box", "layers"):
            assert len(sight.seen) + len(sight.hidden) == len(scene)
        both = np.union1d(sight.seen, sight.hidden)
        np.testing.assert_array_equal(_seen(scene, sight.eye, both), sight.seen)


@pytest.mark.parametrize(
    ("count", "length", "wall", "distance"),
    [(7, 1.2, 0.3, 2.0), (11, 1.0, 0.2, 1.5), (5, 3.0, 0.6, 4.0), (9, 0.9, 0.4, 3.0)],
)
def test_the_shade_in_tubes_is_what_rays_see(count, length, wall, distance):
    scene = scenes.tubes(count, length=length, wall=wall, distance=distance)
    bottoms = np.arange(2 * count**2)
    for sight in scene.sights:
        np.testing.assert_array_equal(_seen(scene, sight.eye, bottoms, points=4000), sight.seen)


@pytest.mark.parametrize("level", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("distance", [1.5, 4.0, 1e4])
def test_no_sample_of_its_level_sees_the_apex_of_the_notch_and_the_next_level_does(level, distance):
    scene = scenes.notch(level)
    points, faces = cyc.sphere.octahedron(level)
    apex = scene.apex_faces
    corner = points @ (scene.viewpoints / np.linalg.norm(scene.viewpoints, axis=1, keepdims=True)).T
    assert (corner.max(axis=0) > 1 - 1e-12).all(), "the named viewpoints are samples"
    assert sorted(corner.argmax(axis=0)) in np.sort(faces, axis=1).tolist(), "and the corners of one face"
    far = distance * scene.radius
    near_the_axis = np.argsort(-(points @ [1, 1, 1]))[:60]
    for sample in points[near_the_axis]:
        assert not _seen(scene, far * sample, apex, points=60).size
    np.testing.assert_array_equal(_seen(scene, far * np.ones(3) / 3**0.5, apex), apex)
    finer = cyc.sphere.octahedron(level + 1)[0]
    middles = finer[np.argsort(-(finer @ [1, 1, 1]))[:3]]
    for sample in middles:
        assert _seen(scene, far * sample, apex, points=2000).size
    for sample in middles:
        assert not _seen(scenes.notch(level, opening=0.35), far * sample, apex, points=60).size


def test_between_the_samples_sees_what_their_union_misses():
    """The 2001 paper's figure 4 with the library's own eyes: the union of A, B and the third misses C."""
    scene = scenes.notch(2)
    eyes = [*scene.viewpoints, scene.between]
    cameras = [cyc.Camera.look_at(eye, scene.center, fov_y=30.0, width=400, height=400) for eye in eyes]
    bits = scene.visible(cameras)
    for row in range(3):
        assert not np.isin(scene.apex_faces, bits.ids(row)).any()
    assert np.isin(scene.apex_faces, bits.ids(3)).all()


def test_a_far_eye_sees_bottoms_that_the_near_one_does_not():
    near, far = scenes.tubes().sights
    assert len(far.seen) == 2 * 81
    assert 2 <= len(near.seen) < len(far.seen)


def test_the_grating_shows_other_tiles_to_every_eye():
    scene = scenes.grating(8, panel=12)
    tiles = np.arange(len(scene) - 4 * 144 - 8 * 12, len(scene))
    seen = [set(_seen(scene, np.array([x, 0.2, 4.0]), tiles)) for x in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    assert len(set.union(*seen)) > 1.1 * max(map(len, seen))


# The house ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("rooms", "seed"), [(1, 0), (2, 3), (5, 1), (8, 0), (8, 7), (30, 2)])
def test_a_house_has_its_rooms_doors_and_a_closed_shell(rooms, seed):
    house = scenes.house(rooms, seed=seed)
    assert len(house.cells) == rooms
    assert len({cell["name"] for cell in house.cells}) == rooms
    assert house.colors.shape == (len(house), 3)
    assert cyc.describe(house)["boundary"] == 0
    assert cyc.describe(house)["degenerate"] == 0
    low, high = (np.array([cell[end] for cell in house.cells]) for end in ("min", "max"))
    footprint = np.prod((high.max(axis=0) - low.min(axis=0))[[0, 2]])
    assert np.prod((high - low)[:, [0, 2]], axis=1).sum() == pytest.approx(footprint), "the cells fill the plan"
    reached, before = {0}, set()
    while reached != before:
        before = set(reached)
        for portal in house.portals:
            a, b = portal["cells"]
            if b is not None and reached & {a, b}:
                reached |= {a, b}
    assert len(reached) == rooms
    doors_out = [p for p in house.portals if p["cells"][1] is None and p["polygon"][:, 1].min() == 0.0]
    assert len(doors_out) == 1


@pytest.mark.parametrize("seed", [0, 4])
def test_portals_are_open_and_lie_between_their_cells(seed):
    house = scenes.house(8, seed=seed)
    open3d = pytest.importorskip("open3d")
    caster = open3d.t.geometry.RaycastingScene()
    caster.add_triangles(house.vertices.astype(np.float32), house.faces.astype(np.uint32))
    for portal in house.portals:
        polygon = portal["polygon"]
        assert polygon.shape == (4, 3)
        across = np.cross(polygon[1] - polygon[0], polygon[3] - polygon[0])
        across /= np.linalg.norm(across)
        assert np.abs((polygon - polygon[0]) @ across).max() < 1e-12, "flat"
        middle = polygon.mean(axis=0)
        inside = [
            index
            for side in (-0.15, 0.15)
            for index, cell in enumerate(house.cells)
            if ((middle + side * across > cell["min"]) & (middle + side * across < cell["max"])).all()
        ]
        assert sorted(inside) == sorted(cell for cell in portal["cells"] if cell is not None)
        grid = np.array([[s, t] for s in (0.02, 0.3, 0.7, 0.98) for t in (0.02, 0.3, 0.7, 0.98)])
        start = polygon[0] + grid @ np.stack([polygon[1] - polygon[0], polygon[3] - polygon[0]]) - 0.15 * across
        rays = np.concatenate([start, np.tile(0.3 * across, (len(start), 1))], axis=1).astype(np.float32)
        assert not caster.test_occlusions(open3d.core.Tensor(rays), 0.0, 1.0).numpy().any()


def test_every_room_is_furnished_and_has_air_to_stand_in():
    house = scenes.house(8, seed=0)
    centers = house.vertices[house.faces].mean(axis=1)
    for cell in house.cells:
        low, high = cell["min"] + [0.1, 0.0, 0.1], cell["max"] - [0.1, 0.0, 0.1]
        within = ((centers > low + 0.01) & (centers < high - 0.01)).all(axis=1)
        assert np.count_nonzero(within) > 100


def test_walls_have_a_thickness():
    house = scenes.house(2, seed=0)
    mesh = _solid(house)
    wall = next(p for p in house.portals if p["cells"][1] is not None)["polygon"][0]
    axis = 0 if np.ptp(next(p for p in house.portals if p["cells"][1] is not None)["polygon"][:, 0]) == 0 else 2
    start = wall + np.array([0.0, 2.3, 0.0])
    start[axis] -= 0.5
    ray = np.eye(3)[axis]
    hits = mesh.ray.intersects_location([start], [ray])[0][:, axis]
    np.testing.assert_allclose(np.sort(hits)[:2], [wall[axis] - 0.1, wall[axis] + 0.1], atol=1e-6)
