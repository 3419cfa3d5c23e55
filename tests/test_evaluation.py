"""Evaluations of bakes: missed pixels against another renderer, and figures that add up."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.bakes.evaluation import random_directions
from cyclorama.bakes.visibility import Shell


@functools.cache
def scene() -> cyc.Scene:
    return cyc.scenes.gear(faces=3000)


@functools.cache
def bake() -> cyc.Visibility:
    return cyc.bake(scene(), 18, resolution=(96, 90), join="samples", progress=False)


def forgetful(vis: cyc.Visibility, faces: np.ndarray) -> cyc.Visibility:
    """The same bake without some faces in any row."""
    flags = vis.bitfields.unpack()
    flags[:, faces] = False
    shell = Shell(1.0, cyc.Bitfields.pack(flags), None)
    return cyc.Visibility(
        vis.sphere,
        [shell],
        model_radius=vis.model_radius,
        size=vis.size,
        labels=None,
        settings=vis.settings,
        mesh=vis.mesh,
        probes=vis.probes,
    )


def test_missed_pixels_are_those_whose_nearest_face_is_not_answered():
    o3d = pytest.importorskip("open3d", reason="needs Open3D to draw a second opinion")
    rays = o3d.t.geometry.RaycastingScene()
    rays.add_triangles(scene().vertices.astype(np.float32), scene().faces)
    vis = forgetful(bake(), np.arange(0, len(scene()), 3))
    report = cyc.evaluate(vis, scene(), views=6, seed=4, progress=False, confirm=False)
    for k, eye in enumerate(report.eyes):
        camera = vis.framing.cameras((eye - scene().center)[None])[0]
        cast = rays.create_rays_pinhole(
            o3d.core.Tensor(camera.K), o3d.core.Tensor(camera.world_to_camera), camera.width, camera.height
        )
        ids = rays.cast_rays(cast)["primitive_ids"].numpy()
        covered = ids[ids != cyc.BACKGROUND]
        missed = 1 - np.isin(covered, vis.visible_faces(eye)).mean()
        assert report.covered_pixels[k] == pytest.approx(len(covered), abs=20)
        assert report.missed[k] == pytest.approx(missed, abs=0.01) and missed > 0.1


def test_a_whole_model_misses_nothing_and_changes_nothing():
    report = cyc.evaluate(bake(), scene(), views=4, distance=0.3, progress=False)
    assert not report.missed.any() and not report.changed_pixels.any() and not report.histogram.any()
    assert not report.culled.any()
    assert (report.false > 0.3).all()
    assert report.bound > 0.4


def test_figures_add_up():
    vis = forgetful(bake(), np.arange(0, len(scene()), 2))
    report = cyc.evaluate(vis, scene(), views=8, distance=[1, 2], resolution=(255, 255), progress=False)
    np.testing.assert_allclose(report.culled, report.backfacing + report.occluded)
    np.testing.assert_allclose(report.missed, report.missed_pixels / report.covered_pixels)
    assert report.histogram.sum() == report.changed_pixels.sum() > 0
    assert (report.changed_pixels <= report.missed_pixels).all()
    assert report.interval[0] <= report.mean_missed <= report.interval[1] <= 1
    assert report.mean_missed <= report.bound
    np.testing.assert_array_equal(report.distances, [1, 2] * 4)
    away = np.linalg.norm(report.eyes - scene().center, axis=1) / vis.sphere.radius
    np.testing.assert_allclose(away, report.distances)
    kept = [len(vis.visible_faces(eye)) for eye in report.eyes]
    np.testing.assert_allclose(report.culled, 1 - np.array(kept) / len(scene()))


def test_faces_that_turn_away_are_counted_whatever_the_winding():
    flipped = cyc.Scene(scene().vertices, scene().faces[:, ::-1])
    a = cyc.evaluate(bake(), scene(), views=3, progress=False, confirm=False)
    b = cyc.evaluate(
        cyc.bake(flipped, 18, resolution=(96, 90), join="samples", progress=False),
        flipped,
        views=3,
        progress=False,
        confirm=False,
    )
    np.testing.assert_allclose(a.backfacing, b.backfacing, atol=0.02)
    assert 0.2 < a.backfacing.mean() < 0.6


def test_a_true_answer_is_not_called_false():
    ball = cyc.scenes.sphere(faces=320)
    vis = cyc.bake(ball, 258, resolution=(96, 90), probes=0, progress=False)
    report = cyc.evaluate(vis, ball, views=6, progress=False)
    # Cells of 7 degrees answer for a cap a little larger than what one eye sees.
    assert (report.false < 0.25).all()


def test_an_evaluation_shows_itself(tmp_path):
    report = cyc.evaluate(bake(), scene(), views=3, progress=False)
    row = report.to_dict()
    assert row["views"] == 3 and all(isinstance(value, (int, float)) for value in row.values())
    assert "3 held-out views" in report.summary() and "Evaluation" in repr(report) and "<pre>" in report._repr_html_()
    pytest.importorskip("matplotlib", reason="needs Matplotlib to draw")
    report.plot(str(tmp_path / "chart.png"))
    assert (tmp_path / "chart.png").stat().st_size > 1000


def test_seeds_choose_the_views_and_threads_do_not():
    def missed(**options: int) -> np.ndarray:
        return cyc.evaluate(bake(), scene(), views=4, progress=False, confirm=False, **options).missed_pixels

    np.testing.assert_array_equal(missed(seed=1, threads=1), missed(seed=1, threads=3))
    assert (missed(seed=1) != missed(seed=2)).any()


def test_directions_are_uniform():
    directions = random_directions(40000, 5)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    # Archimedes: each coordinate of a uniform direction is uniform.
    for axis in range(3):
        counts = np.histogram(directions[:, axis], 10, (-1, 1))[0]
        assert (np.abs(counts - 4000) < 5 * np.sqrt(4000)).all()


def test_bad_input_is_refused():
    for options, message in (
        ({"views": 0}, "views"),
        ({"views": 2.5}, "views"),
        ({"distance": 0}, "distance"),
        ({"distance": [1, np.nan]}, "distance"),
        ({"confidence": 1.0}, "confidence"),
        ({"resolution": (0, 9)}, "resolution"),
    ):
        with pytest.raises(ValueError, match=message):
            cyc.evaluate(bake(), scene(), progress=False, **options)
    with pytest.raises(ValueError, match="another mesh"):
        moved = cyc.Scene(scene().vertices + np.float32(1), scene().faces)
        cyc.evaluate(bake(), moved, progress=False)


def test_reports_are_values():
    report = cyc.evaluate(bake(), scene(), views=2, progress=False, confirm=False)
    assert replace(report, confidence=0.5).bound < report.bound
    assert np.isnan(report.false).all()
