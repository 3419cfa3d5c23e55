"""Bakes that keep a promise about what they miss, and say how surely."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import bitfield, sphere
from cyclorama.bakes import adaptive
from cyclorama.bakes.adaptive import _fewest_patches, _Refinement, _without
from cyclorama.bakes.evaluation import random_directions
from cyclorama.bakes.learning import Looker
from cyclorama.bakes.probing import STRATEGIES, Prober, neighbours
from cyclorama.framing import Framing


@functools.cache
def scene() -> cyc.Scene:
    return cyc.scenes.gear(faces=3000)


def refinement(max_missed: float, views: int = 6, probes: int = 8) -> _Refinement:
    """Of a fence, through which each view sees other tiles."""
    fence = cyc.scenes.grating(6, panel=12)
    looker = Looker(fence, Framing.of(fence, (96, 90)))
    points, faces = sphere.octahedron((views - 2).bit_length() // 2 - 1)
    return _Refinement(looker, looker, points, faces, max_missed, probes, "edges", 0)


def fresh_missed(vis: cyc.Visibility, distance: float, views: int = 60) -> np.ndarray:
    """Shares that views which nothing was learned from find missing, by the other engine."""
    shares = []
    for camera in vis.framing.with_resolution((204, 192)).cameras(random_directions(views, 77), distance):
        ids = scene().render(camera, engine="raycast").ids
        covered = ids[ids != cyc.BACKGROUND]
        shares.append(1 - np.isin(covered, vis.visible_faces(camera.eye)).mean())
    return np.array(shares)


@functools.cache
def promised() -> cyc.Visibility:
    return cyc.bake(scene(), max_missed=3e-3, resolution=(204, 192), probes=12, progress=False)


@pytest.mark.parametrize("distance", [1.0, 1.5, 4.0])
def test_the_promise_holds_for_fresh_views(distance: float):
    assert cyc.bakes.confidence.bootstrap_interval(fresh_missed(promised(), distance))[1] <= 3e-3


def test_the_promise_is_stated_with_its_bound_and_its_confidence():
    statement = promised().statement
    assert statement.startswith("max_missed=0.003 reached")
    assert "95% confidence" in statement and "before it was learned from" in statement
    assert promised().info()["statement"] == statement


def test_a_promise_takes_fewer_views_where_less_is_asked(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(adaptive, "MOST_VIEWS", 100)
    lax, strict = (refinement(max_missed) for max_missed in (0.5, 1e-3))
    for refined in (lax, strict):
        refined.run()
    assert len(lax.points) == 6 < len(strict.points)
    assert len(promised()) < 1026


def test_progress_only_rises():
    seen: list[int] = []
    cyc.bake(scene(), 6, max_missed=0.1, resolution=(64, 60), probes=4, progress=seen.append)
    assert len(seen) > 3 and seen == sorted(seen)


def test_what_cannot_be_shown_is_said(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(adaptive, "MOST_PROOFS", 300)
    monkeypatch.setattr(adaptive, "MOST_VIEWS", 20)
    vis = cyc.bake(scene(), 6, max_missed=1e-4, patches=100, resolution=(96, 90), probes=4, progress=False)
    assert vis.statement.startswith("max_missed=0.0001 not reached")
    assert "from 300 random views" in vis.statement
    assert vis.patches == 100


def test_only_faces_whose_corners_disagree_are_split():
    refined = refinement(1e-3)
    before = refined.faces.copy()
    refined.cells.rows[:] |= np.uint64(0)
    apart = refined._disagreement(np.arange(len(before)))
    assert ((apart > 0) & (apart < 1)).all()
    refined.samples[:] = refined.samples[0]
    assert (refined._disagreement(np.arange(len(before))) == 0).all()
    refined.run()
    np.testing.assert_array_equal(refined.faces, before)


def test_splitting_keeps_the_sphere_closed_and_its_probes(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(adaptive, "MOST_VIEWS", 100)
    refined = refinement(1e-3)
    refined.run()
    assert 6 < len(refined.points) <= 100
    assert len(refined.samples) == len(refined.points) and len(refined.cells.rows) == len(refined.faces)
    located = sphere.locate(refined.points, refined.faces, random_directions(500, 1))
    archive = refined.cells.archive
    assert archive is not None
    for directions, seen in archive:
        home = sphere.locate(refined.points, refined.faces, directions)
        assert not bitfield.difference(seen, refined.cells.rows[home]).any()
    assert len(np.unique(located)) > len(refined.faces) / 2
    for corner in range(3):
        assert not bitfield.difference(refined.samples[refined.faces[:, corner]], refined.cells.rows).any()


def test_dropping_spare_viewpoints_answers_no_less(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(adaptive, "MOST_VIEWS", 100)
    refined = refinement(1e-3)
    refined.run()
    directions = random_directions(300, 2)
    before = refined.cells.rows[sphere.locate(refined.points, refined.faces, directions)]
    count = len(refined.points)
    monkeypatch.setattr(adaptive, "SPARE", 0.05)
    refined.drop_spare()
    assert 6 <= len(refined.points) < count
    assert len(refined.samples) == len(refined.points) and len(refined.cells.rows) == len(refined.faces)
    assert len(refined.cells.probes) == len(refined.faces) == 2 * len(refined.points) - 4
    after = refined.cells.rows[sphere.locate(refined.points, refined.faces, directions)]
    assert not bitfield.difference(before, after).any()


def test_a_star_is_filled_by_triangles_of_the_same_cover():
    points, faces = sphere.octahedron(2)
    for vertex in (0, 7, 20, 40):
        star = (faces == vertex).any(axis=1)
        filled = _without(points, faces[star], vertex)
        assert filled is not None and len(filled) == star.sum() - 2
        without = np.concatenate([faces[~star], filled])
        kept = np.delete(points, vertex, axis=0)
        sphere.Locator(kept, np.where(without > vertex, without - 1, without))
        a, b, c = (points[filled[:, k]] for k in range(3))
        assert (np.einsum("ij,ij->i", a, np.cross(b, c)) > 0).all()


def test_the_fewest_patches_keep_their_share_of_the_culling():
    big = cyc.scenes.sphere(faces=5120)
    vis = cyc.bake(big, 66, resolution=(96, 90), probes=0, progress=False)
    assert vis.cells is not None
    labels = _fewest_patches(big, vis.cells.words, vis.sphere.solid_angles)
    assert labels is not None
    tiled = cyc.bake(big, 66, labels, resolution=(96, 90), probes=0, progress=False)
    assert 0.9 * vis.culling_rate() <= tiled.culling_rate() <= vis.culling_rate()


# Probes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_probes_lie_in_their_homes_and_follow_from_the_seed(strategy: str):
    points, faces = sphere.octahedron(2)
    cells = np.array([3, 17, 80])
    first, again = (Prober(points, faces, 5, strategy).place(cells, 4, 8) for _ in range(2))
    np.testing.assert_array_equal(first.directions, again.directions)
    np.testing.assert_array_equal(first.home, np.repeat(cells, 8))
    weights = Prober(points, faces, 5, strategy).weights(first.home, first.directions)
    assert (weights > -1e-12).all()
    on_edges = np.isclose(weights, 0).any(axis=1)
    assert on_edges.sum() == (12 if strategy == "edges" else 0)
    alone = Prober(points, faces, 5, strategy).place(cells[1:2], 4, 8)
    np.testing.assert_array_equal(alone.directions, first.directions[8:16])


def test_a_probe_near_an_edge_teaches_the_face_behind_it():
    points, faces = sphere.octahedron(2)
    prober = Prober(points, faces, 0, "spread", margin=0.1)
    probes = prober.place(np.arange(len(faces)), 0, 8)
    weights = prober.weights(probes.home, probes.directions)
    across = neighbours(faces)
    for probe in range(len(probes)):
        expected = {across[probes.home[probe], k] for k in range(3) if weights[probe, k] < 0.1}
        assert set(probes.learners[probe][1:].tolist()) - {-1} == expected
        assert probes.learners[probe, 0] == probes.home[probe]


def test_neighbours_share_an_edge():
    for points, faces in (sphere.octahedron(1), (sphere.fibonacci(40), sphere.hull(sphere.fibonacci(40)))):
        across = neighbours(faces)
        for face, triangle in enumerate(faces.tolist()):
            for k in range(3):
                edge = set(triangle) - {triangle[k]}
                assert edge <= set(faces[across[face, k]].tolist()) and across[face, k] != face
        assert len(points) == len(np.unique(faces))


def test_guided_probes_go_where_most_was_found():
    points, faces = sphere.octahedron(1)
    prober = Prober(points, faces, 0, "guided")
    probes = prober.place(np.array([0]), 0, 4)
    prober.tell(probes, np.array([0.0, 0.0, 0.5, 0.1]))
    second = prober.place(np.array([0]), 4, 2).directions[1]
    angles = np.arccos(np.clip(probes.directions @ second, -1, 1))
    assert angles.argmin() == 2
