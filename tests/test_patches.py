"""Patches against a brute-force greedy, adjacency against trimesh, components against SciPy."""

import signal
import threading
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cyclorama import patches
from reference.patches import tile as brute_force

DATA = Path(__file__).parents[1].parent / "shared" / "data"


def real_mesh(name):
    if not (DATA / name).exists():
        pytest.skip(f"{name} is not on this machine")
    mesh = trimesh.load(DATA / name, process=False, force="mesh")
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def grid(n, m, seed=None):
    """A plane of 2 n m triangles; with a seed, a rough one."""
    x, y = np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij")
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(float)
    if seed is not None:
        vertices += np.random.default_rng(seed).normal(0, 0.2, vertices.shape)
    at = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    return vertices, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def quietly(vertices, faces, count):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return patches.tile(vertices, faces, count)


def components(vertices, faces, labels=None):
    """Components of faces along edges; with labels, along those between faces of the same label only."""
    offsets, neighbors = patches.adjacency(vertices, faces)
    source = np.repeat(np.arange(len(faces)), np.diff(offsets.astype(np.int64)))
    keep = np.ones(len(source), bool) if labels is None else labels[source] == labels[neighbors]
    graph = coo_array((np.ones(keep.sum()), (source[keep], neighbors[keep])), shape=(len(faces), len(faces)))
    return connected_components(graph, directed=False)[0]


@pytest.mark.parametrize("count", [1, 2, 7, 40])
@pytest.mark.parametrize("seed", [None, 3])
def test_labels_are_the_brute_force_greedys(seed, count):
    vertices, faces = grid(6, 5, seed)
    np.testing.assert_array_equal(patches.tile(vertices, faces, count), brute_force(vertices, faces, count))


@pytest.mark.parametrize("mesh", [trimesh.creation.icosphere(2), trimesh.creation.torus(1, 0.4, 12, 8)])
def test_symmetric_meshes_full_of_ties_have_the_brute_force_labels(mesh):
    for count in (5, 60):
        expected = brute_force(mesh.vertices, mesh.faces, count)
        np.testing.assert_array_equal(patches.tile(mesh.vertices, mesh.faces, count), expected)


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_soups_of_few_points_have_the_brute_force_labels(data):
    """Few points on a lattice: duplicate, degenerate, non-manifold and separate faces, and ties, all at once."""
    points = data.draw(st.integers(3, 14))
    coordinates = st.lists(st.integers(-2, 2), min_size=3 * points, max_size=3 * points)
    vertices = np.array(data.draw(coordinates), dtype=float).reshape(-1, 3)
    corners = st.tuples(*[st.integers(0, points - 1)] * 3)
    faces = np.array(data.draw(st.lists(corners, min_size=1, max_size=40)))
    triangles = vertices[faces]
    if not np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]).any():
        return
    count = data.draw(st.integers(1, 10))
    labels = quietly(vertices, faces, count)
    np.testing.assert_array_equal(labels, brute_force(vertices, faces, count))
    found = labels.max() + 1
    assert components(vertices, faces, labels) == found
    assert found == min(max(count, components(vertices, faces)), len(faces))


@pytest.mark.parametrize("name", ["legocar.obj", "x_wing.ply", "chair_duplicated_faces.obj", "tray_plate.stl"])
def test_patches_of_real_meshes_are_connected_and_as_many_as_asked(name):
    vertices, faces = real_mesh(name)
    parts = components(vertices, faces)
    labels = patches.tile(vertices, faces, parts + 50)
    assert labels.max() + 1 == parts + 50
    assert components(vertices, faces, labels) == parts + 50
    first = np.unique(labels, return_index=True)[1]
    assert (np.diff(first) > 0).all()


def test_every_face_is_its_own_patch_or_all_are_one():
    vertices, faces = grid(4, 4, 0)
    np.testing.assert_array_equal(patches.tile(vertices, faces, len(faces)), np.arange(len(faces)))
    assert not patches.tile(vertices, faces, 1).any()


def test_more_components_than_patches_are_kept_apart_and_said():
    vertices, faces = grid(3, 3)
    two = np.concatenate([vertices, vertices + 10]), np.concatenate([faces, faces + len(vertices)])
    with pytest.warns(UserWarning, match="asked for 1 patches, made 2: the mesh has 2 components"):
        labels = patches.tile(*two, 1)
    np.testing.assert_array_equal(labels, np.repeat([0, 1], len(faces)))
    with pytest.warns(UserWarning, match="asked for 99 patches, made 18"):
        patches.tile(vertices, faces, 99)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(np.unique(patches.tile(*two, 2))) == 2


def test_unwelded_vertices_tile_like_welded_ones():
    vertices, faces = grid(8, 8, 1)
    soup = vertices[faces].reshape(-1, 3)
    labels = patches.tile(soup, np.arange(len(soup)).reshape(-1, 3), 9)
    np.testing.assert_array_equal(labels, patches.tile(vertices, faces, 9))


def test_patches_are_compact():
    """On a plane the greedy's patches stretch no farther than a few of the squares they could be."""
    vertices, faces = grid(40, 40, 2)
    labels = patches.tile(vertices, faces, 100)
    for label in range(100):
        box = np.ptp(vertices[faces[labels == label]].reshape(-1, 3), axis=0)
        assert np.linalg.norm(box) < 3 * np.sqrt(2) * np.sqrt(1600 / 100)


def test_bad_counts_and_meshes_are_named():
    vertices, faces = grid(2, 2)
    for count in (0, -3, 2.5, True):
        with pytest.raises(ValueError, match="count must be an integer of at least 1"):
            patches.tile(vertices, faces, count)
    with pytest.raises(ValueError, match=r"vertices\[1\] is \[NaN"):
        patches.tile([[0, 0, 0], [np.nan, 0, 0], [0, 1, 0]], [[0, 1, 2]], 1)
    with pytest.raises(ValueError, match=r"faces\[0\]"):
        patches.adjacency(vertices, [[0, 1, 99]])
    with pytest.raises(ValueError, match="the mesh is empty"):
        patches.tile(vertices, np.empty((0, 3), int), 1)


@pytest.mark.parametrize("name", ["bunny.ply", "horse.ply"])
def test_adjacency_is_trimeshs(name):
    vertices, faces = real_mesh(name)
    offsets, neighbors = patches.adjacency(vertices, faces)
    source = np.repeat(np.arange(len(faces)), np.diff(offsets.astype(np.int64)))
    pairs = np.stack([source, neighbors], axis=1)
    theirs = trimesh.Trimesh(vertices, faces, process=False).face_adjacency
    both_ways = np.concatenate([theirs, theirs[:, ::-1]])
    np.testing.assert_array_equal(pairs, both_ways[np.lexsort(both_ways.T[::-1])])


def test_ctrl_c_stops_the_fusing():
    vertices, faces = grid(700, 700, 0)
    interrupt = threading.Timer(1.0, signal.raise_signal, [signal.SIGINT])
    started = time.perf_counter()
    interrupt.start()
    with pytest.raises(KeyboardInterrupt):
        for count in range(1, 100):
            patches.tile(vertices, faces, count, progress=False)
    assert time.perf_counter() - started < 10
