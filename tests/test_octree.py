"""Octrees against a brute-force one, linear programs, and what cameras really see."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import cyclorama as cyc
from cyclorama import _core, octree
from cyclorama.octree import Octree, planes, tiles
from reference import octree as brute_force

# Rounding of the linear programs: HiGHS takes constraints as met within 1e-7.
FEASIBLE = 1e-6


def soup(count, seed, size=0.3):
    """Triangles of very different sizes in a cube."""
    rng = np.random.default_rng(seed)
    sizes = size * rng.random((count, 1, 1)) ** 3
    triangles = rng.uniform(-1, 1, (count, 1, 3)) + sizes * rng.uniform(-1, 1, (count, 3, 3))
    return cyc.Scene(triangles.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def triangles_of(scene):
    return np.asarray(scene.vertices, dtype=float)[scene.faces]


def depth_inside(triangle, region):
    """How far some point of the triangle is inside of all planes; negative where none is: by a linear program."""
    unit = region / np.linalg.norm(region[:, :3], axis=1, keepdims=True)
    distances = unit[:, :3] @ triangle.T + unit[:, 3:]
    rows = np.column_stack([-distances, np.ones(len(region))])
    found = linprog(
        [0, 0, 0, -1],
        A_ub=rows,
        b_ub=np.zeros(len(rows)),
        A_eq=[[1, 1, 1, 0]],
        b_eq=[1],
        bounds=[(0, 1)] * 3 + [(None, 10)],
    )
    assert found.status == 0
    return -found.fun


def overlap(triangles, low, high):
    flat = (np.ascontiguousarray(np.reshape(a, (len(triangles), -1)), dtype=float) for a in (triangles, low, high))
    return _core.triangles_overlap_boxes(*flat)


def pairs(count, seed):
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(-0.5, 0.5, (count, 1, 3)) + rng.random((count, 1, 1)) * rng.uniform(-1, 1, (count, 3, 3))
    low = rng.uniform(-0.7, 0.1, (count, 3))
    return triangles, low, low + rng.uniform(0, 0.6, (count, 3))


def test_overlap_is_what_the_thirteen_axes_say():
    given_ = pairs(50_000, 0)
    expected = brute_force.overlaps(*given_)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(overlap(*given_), expected)


def test_overlap_is_what_linear_programs_say():
    for triangle, low, high in zip(*pairs(150, 1), strict=True):
        box = np.vstack([np.column_stack([np.eye(3), -low]), np.column_stack([-np.eye(3), high])])
        inside = depth_inside(triangle, box)
        if abs(inside) > FEASIBLE:
            assert overlap([triangle], [low], [high])[0] == (inside > 0)


coordinate = st.integers(-4, 4)


@given(st.lists(coordinate, min_size=9, max_size=9), st.lists(coordinate, min_size=3, max_size=3), st.integers(0, 3))
@settings(max_examples=300)
def test_on_a_lattice_touching_is_overlap_exactly(corners, low, size):
    """Whole numbers over 4: no step rounds, so triangles that only touch, segments and points are told exactly."""
    triangle, low = np.array([corners]).reshape(1, 3, 3) / 4, np.array([low]) / 4
    high = low + size / 4
    assert overlap(triangle, low, high)[0] == brute_force.overlaps(triangle, low, high)[0]


@pytest.mark.parametrize("stop", [0, 1, 2, None])
@pytest.mark.parametrize("seed", [0, 1])
def test_cells_keep_what_the_brute_force_tree_keeps(stop, seed):
    scene = soup(200, seed)
    kind = {"kind": "conventional"} if stop == 0 else {"stop": stop}
    cells = Octree(scene, leaf_faces=6, depth=5, **kind).cells()
    own = zip(cells["level"], cells["first"], cells["own_end"], strict=True)
    found = Counter((int(l), frozenset(cells["references"][a:b].tolist())) for l, a, b in own if b > a)
    assert found == Counter(brute_force.leaves(triangles_of(scene), 6, 5, stop))


def test_stop_0_keeps_what_the_conventional_tree_keeps():
    scene = soup(2000, 2)
    a, b = Octree(scene, "conventional").cells(), Octree(scene, stop=0).cells()
    assert all(np.array_equal(a[name], b[name]) for name in a)


def views(scene, count, seed):
    """Cameras in and around a scene, with a quadrilateral before each."""
    rng = np.random.default_rng(seed)
    low, high = scene.bounds
    for _ in range(count):
        eye, target = low + (high - low) * rng.uniform(-0.3, 1.3, 3), low + (high - low) * rng.uniform(0.2, 0.8, 3)
        camera = cyc.Camera.look_at(eye, target, fov_y=rng.uniform(20, 90), width=80, height=60)
        corners = np.array([[20, 15], [60, 15], [60, 45], [20, 45]]) + rng.uniform(-12, 12, (4, 2))
        rays = np.column_stack([corners, np.ones(4)]) @ np.linalg.inv(camera.K).T @ camera.world_to_camera[:3, :3]
        # In the plane a x = 1 of the camera, a little tilted.
        tilt = camera.forward + rng.uniform(-0.3, 0.3, 3)
        reach = scene.radius * rng.uniform(0.2, 1) / (rays @ tilt)
        yield camera, eye + rays * reach[:, None]


@pytest.mark.parametrize("kind", ["conventional", "efficient"])
@pytest.mark.parametrize("shift", [0.0, 3e4])
def test_what_linear_programs_find_in_a_region_is_drawn(kind, shift):
    scene = soup(40, 3)
    scene = cyc.Scene(scene.vertices + shift, scene.faces)
    tree = Octree(scene, kind, leaf_faces=4)
    checked = 0
    for camera, corners in views(scene, 3, 4):
        regions = tiles(camera, corners)
        culled = tree.cull(regions)
        local = [np.column_stack([r[:, :3], r[:, :3] @ scene.center + r[:, 3]]) for r in regions]
        for k, region in enumerate(local):
            drawn = set(culled.faces[: culled.ends[k]].tolist())
            for face, triangle in enumerate(triangles_of(scene) - scene.center):
                if face not in drawn:
                    assert depth_inside(triangle, region) < FEASIBLE
                    checked += 1
    assert checked > 100


@pytest.mark.parametrize("name", ["engine_2cylinder", "sibenik"])
def test_what_cameras_see_is_never_culled(name, real_scene):
    """The faces that own pixels, before a quadrilateral and beside it, are drawn: found by the rasteriser."""
    scene = real_scene(name)
    trees = [Octree(scene, "conventional"), Octree(scene), Octree(scene, stop=2)]
    seen_behind = 0
    for camera, corners in views(scene, 4, 5):
        view = scene.render(camera)
        points = cyc.DepthImage.from_view(view).points()
        regions = tiles(camera, corners)
        homogeneous = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=-1)
        shown = view.ids != cyc.BACKGROUND
        # Depths are float32: a point as near to a plane as that rounds may be on its other side.
        near = 1e-5 * (scene.radius + np.abs(view.depth[shown]).max())
        inside = [(homogeneous @ region.T >= near).all(axis=-1) & shown for region in regions]
        seen_behind += (shown & ~np.any(inside, axis=0)).sum()
        for tree in trees:
            assert set(view.ids[shown].tolist()) <= set(tree.cull(camera).faces.tolist())
            assert set(view.ids[np.any(inside, axis=0)].tolist()) <= set(tree.cull(regions).faces.tolist())
    assert seen_behind > 100


@given(st.integers(0, 2**32 - 1))
def test_tiles_are_all_that_is_seen_but_what_is_behind(seed):
    scene = soup(10, 0)
    ((camera, corners),) = views(scene, 1, seed)
    rng = np.random.default_rng(seed)
    points = np.column_stack([scene.center + 3 * rng.uniform(-1, 1, (300, 3)), np.ones(300)])
    seen = (planes(camera) @ points.T >= 0).all(axis=0)
    tile = np.array([(region @ points.T >= 0).all(axis=0) for region in tiles(camera, corners)])
    assert tile.sum(axis=0).max() <= 1
    behind = (tiles(camera, corners)[4] * np.r_[np.ones(9), -1][:, None] @ points.T >= 0).all(axis=0)
    np.testing.assert_array_equal(seen, tile.any(axis=0) | behind)
    assert not (tile.any(axis=0) & behind).any()


@pytest.mark.parametrize("orthographic", [False, True])
def test_planes_hold_what_projects_into_the_picture(orthographic, rng):
    make = cyc.Camera.orthographic_look_at if orthographic else cyc.Camera.look_at
    camera = make((1, 2, 3), (0.2, 0, 0), width=64, height=48, near=0.5, **({"extent": 4} if orthographic else {}))
    camera = camera.replace(K=camera.K + [[0, 0.3, 2], [0, 0, -3], [0, 0, 0]])
    points = rng.uniform(-3, 6, (3000, 3))
    pixels, depth = camera.project(points)
    inside = ((pixels >= 0) & (pixels <= (64, 48))).all(axis=1) & (depth >= 0.5) & (depth <= 4)
    found = (planes(camera, far=4) @ np.column_stack([points, np.ones(3000)]).T >= 0).all(axis=0)
    assert 50 < inside.sum() < 2900
    np.testing.assert_array_equal(found, inside)


def test_the_efficient_tree_draws_each_face_once_and_fewer(real_scene):
    scene = real_scene("engine_2cylinder")
    conventional, efficient = Octree(scene, "conventional"), Octree(scene)
    for camera, corners in views(scene, 8, 6):
        for regions in (camera, tiles(camera, corners)):
            few, many = efficient.cull(regions), conventional.cull(regions)
            assert len(np.unique(few.faces)) == few.drawn <= many.drawn
            assert np.isin(few.faces, many.faces).mean() > 0.9


def test_every_region_has_its_faces():
    scene = soup(3000, 7)
    tree = Octree(scene)
    low, high = [[1, 0, 0, 0]], [[-1, 0, 0, 0]]
    x = triangles_of(scene)[..., 0]
    culled = tree.cull([low, high, low])
    assert set(np.flatnonzero(x.max(axis=1) >= 0)) <= set(culled.of(0))
    assert culled.drawn == 3000
    assert len(culled.of(2)) == 0
    both = Octree(scene, "conventional").cull([low, high])
    assert both.drawn > 3000
    assert both.ends[1] == both.drawn


def test_everything_and_nothing():
    scene = soup(500, 8)
    for kind in ("conventional", "efficient"):
        tree = Octree(scene, kind, leaf_faces=5)
        assert tree.cull([]).drawn == 0
        np.testing.assert_array_equal(np.sort(tree.cull(np.empty((0, 4))).faces), np.arange(500))
        assert tree.cull([[1, 0, 0, -50]]).drawn == 0
        assert tree.cull([[1, 0, 0, 50]]).drawn == 500


def test_threads_change_nothing():
    scene = soup(30_000, 9)
    a, b = Octree(scene, threads=1).cells(), Octree(scene, threads=3).cells()
    assert all(np.array_equal(a[name], b[name]) for name in a)


def test_storage_grows_with_the_level_at_which_passing_down_stops(real_scene):
    scene = real_scene("engine_2cylinder")
    rows = octree.storage(scene, [0, 1, 2, 3, None], progress=False)
    copies = [row["copies"] for row in rows]
    assert copies[0] == 0 < copies[1] < copies[2] < copies[3] < copies[4]
    assert all(row["by_level"] >= row["copies"] for row in rows)
    # A face that doesn't stop is in one cell more on each level at least, as far as there are levels.
    assert rows[4]["per_crossing"] > rows[3]["per_crossing"] > 3


def test_faces_in_one_place_end_the_dividing():
    corners = np.tile([[0, 0.1, 0.2], [1, 0, 0.1], [0, 1, 0.9]], (1000, 1))
    tree = Octree(cyc.Scene(corners, np.arange(3000).reshape(-1, 3)), leaf_faces=8)
    assert tree.nodes == 1
    assert tree.cull([[1, 0, 0, 0]]).drawn == 1000


def test_answers_go_into_memory_that_is_there():
    scene = soup(100, 10)
    tree, room = Octree(scene), np.empty(100, np.uint32)
    faces = tree.cull([[1, 0, 0, 0]], out=room).faces
    assert faces.base is room
    np.testing.assert_array_equal(faces, tree.cull([[1, 0, 0, 0]]).faces)
    with pytest.raises(ValueError, match="out has room for 2 faces, the answer has 100"):
        tree.cull([[1, 0, 0, 50]], out=room[:2])
    with pytest.raises(ValueError, match="out must be a one-dimensional array of uint32"):
        tree.cull([[1, 0, 0, 50]], out=np.empty(100))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "octree"}, "kind must be"),
        ({"leaf_faces": 0}, "leaf_faces must be an integer of at least 1, got 0"),
        ({"depth": 21}, "depth must be an integer from 0 to 20, got 21"),
        ({"depth": 1.5}, "depth must be an integer"),
        ({"stop": -1}, "stop must be an integer from 0 to 20"),
        ({"kind": "conventional", "stop": 2}, "a conventional tree passes nothing down"),
    ],
)
def test_bad_trees_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Octree(soup(10, 0), **arguments)


@pytest.mark.parametrize(
    ("regions", "message"),
    [
        ([[[1, 0, 0]]], r"regions\[0\] must be a camera or \(P, 4\) planes, got shape"),
        ([[[1, 0, 0, 0]], [[0, 0, 0, 1]]], r"plane 0 of a region is \(0, 0, 0, .*normal that is not zero"),
        ([[[1, 0, 0, np.nan]]], "must be finite"),
        ([np.ones((33, 4))], "a region has 33 planes, at most 32"),
        ("camera", "must be a camera"),
    ],
)
def test_bad_regions_are_refused(regions, message):
    with pytest.raises(ValueError, match=message):
        Octree(soup(10, 0)).cull(regions)


def test_bad_quadrilaterals_are_refused():
    camera = cyc.Camera.look_at((0, 0, 5), (0, 0, 0))
    quad = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
    with pytest.raises(ValueError, match="in front of the camera"):
        tiles(camera, quad + [0, 0, 5])
    with pytest.raises(ValueError, match="clockwise"):
        tiles(camera, quad[::-1])
    with pytest.raises(ValueError, match="convex"):
        tiles(camera, quad[[0, 2, 1, 3]])
    with pytest.raises(ValueError, match="no eye"):
        tiles(cyc.Camera.orthographic_look_at((0, 0, 5), (0, 0, 0)), quad)
    with pytest.raises(ValueError, match="four finite points"):
        tiles(camera, quad[:3])
