"""Walkthroughs on a rail: tracks, slabs, the store and what is seen from it."""

from __future__ import annotations

import errno
import gzip
import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.panorama import (
    BuiltIn,
    Layer,
    PanoramaFolder,
    PovRay,
    Projection,
    Pyrender,
    Store,
    Survey,
    Track,
    find_slabs,
    kept_tiles,
    places_by_error,
)
from cyclorama.panorama.culling import eyes_around
from cyclorama.panorama.slicing import OVERLAP, closed_step
from cyclorama.panorama.viewing import resample, seen_between
from failures.scenes import fence
from peers import need

CAMERA = cyc.Camera.look_at((0, 0, 0), (1, 0, 0), width=16, height=12)


@pytest.fixture(scope="module")
def house():
    return cyc.scenes.house(rooms=4)


@pytest.fixture(scope="module")
def eye(house):
    return (house.cells[0]["min"] + house.cells[0]["max"]) / 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("walk")


@pytest.fixture(scope="module")
def walk(house, eye, folder):
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


def test_slips_are_told_before_anything_is_drawn(house, eye, tmp_path):
    track = [eye, eye + [0.4, 0.0, 0.0]]
    for slip, said in (
        ({"spacing": 1e-9}, "makes 4e"),
        ({"size": (256.5, 64)}, "whole numbers"),
        ({"slabs": "3"}, "slabs must be a number"),
        ({"background": (1, 2, 300)}, "background must be an integer from 0 to 255, got 300"),
    ):
        with pytest.raises(ValueError, match=said):
            cyc.panorama.bake(
                house, track, **{"slabs": 2, "size": (256, 64), "out": tmp_path, "progress": False} | slip
            )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "name", "right"),
    [
        (lambda walk, eye, v: cyc.panorama.view(walk, v, CAMERA), "t must be", []),
        (lambda walk, eye, v: cyc.panorama.view(walk, 0.3, v), "camera must be", []),
        (lambda walk, eye, v: cyc.panorama.view(walk, 0.3, CAMERA, threads=v), "threads must be", []),
        (lambda walk, eye, v: cyc.panorama.serve(walk, port=v), "port must be", []),
        (lambda walk, eye, v: cyc.panorama.serve(walk, port=0, host=v), "host must be", ["x"]),
        (lambda walk, eye, v: cyc.panorama.application(walk, cache=v), "cache must be", []),
        (lambda walk, eye, v: Store(v), "named by a folder or an address", ["x"]),
        (lambda walk, eye, v: Track(v), "points must", []),
        (lambda walk, eye, v: walk.track.spaced(v), "spacing must be", []),
        (lambda walk, eye, v: Projection(v), "projection must be", []),
        (lambda walk, eye, v: Projection(size=v), "size must be", []),
        (lambda walk, eye, v: Projection(up=v), "up must be", []),
        (lambda walk, eye, v: find_slabs([1.0, 2.0, 5.0], v), "slabs must be", []),
        (lambda walk, eye, v: find_slabs(v, 2), "ranges must be|range", [[1, 2]]),
        (lambda walk, eye, v: bake_of(eye, slabs=v), "slabs must be", [[1, 2]]),
        (lambda walk, eye, v: bake_of(eye, tile=v), "tile must be", []),
        (lambda walk, eye, v: bake_of(eye, alpha=v), "alpha must be", []),
        (lambda walk, eye, v: bake_of(eye, method=v), "method must be", []),
        (lambda walk, eye, v: bake_of(eye, spacing=v), "spacing must be", []),
        (lambda walk, eye, v: bake_of(eye, places=v), "places must", []),
        (lambda walk, eye, v: bake_of(eye, max_error=v), "max_error must be", []),
        (lambda walk, eye, v: bake_of(eye, mesh_pixels=v), "mesh_pixels must be", []),
        (lambda walk, eye, v: bake_of(eye, codec=v), "codec must be", []),
        (lambda walk, eye, v: bake_of(eye, background=v), "background", []),
    ],
)
def test_what_is_of_the_wrong_kind_is_refused_by_name(walk, eye, call, name, right):
    need("starlette")
    for value in ("x", object(), [1, 2], np.nan, -1, {}):
        if value not in right:
            with pytest.raises(ValueError, match=name):
                call(walk, eye, value)


def bake_of(eye, **options):
    house = cyc.scenes.house(rooms=2)
    return cyc.panorama.bake(house, [eye, eye + [0.2, 0, 0]], size=(64, 32), out="none", **options, progress=False)


def test_tracks_of_one_point_through_walls_and_outside_are_refused(house, eye):
    with pytest.raises(ValueError, match="two different points"):
        Track([eye, eye])
    with pytest.raises(ValueError, match=r"points\[1\] is"):
        Track([eye, [np.nan, 0, 0]])
    with pytest.raises(ValueError, match="through a wall at"):
        Track([eye, eye + [0, 0, 100]]).check(house, allow_outside=True)
    with pytest.raises(ValueError, match="outside the scene"):
        Track([eye, eye + [0, 0, 100]]).check(house)


@pytest.mark.parametrize("t", [0.0, 0.5, 1.0])
def test_views_at_references_are_resamplings_of_the_unsplit_panorama(walk, house, t):
    entry = walk.references[int(t * 2)]
    assert entry.t == pytest.approx(t)
    camera = cyc.Camera.look_at(entry.eye, entry.eye + [1.0, -0.1, 0.6], fov_y=50, width=160, height=120)
    seen = cyc.panorama.view(walk, entry.t, camera)
    layer = BuiltIn(house).render(entry.eye, walk.projection, 0.0, np.inf)
    whole = np.dstack([layer.color, np.where(layer.opacity, 255, 0).astype(np.uint8)])
    expected, known = resample(whole, walk.projection, camera)
    assert seen.exact and cyc.quality.psnr(seen.color, expected, where=known) >= 45
    assert not seen.hole.any()


def test_between_references_views_are_close_to_the_truth(house, eye, tmp_path):
    """Spacing a twentieth of the median range, the default: 30 dB are asked for where anything is seen."""
    paint = partial(cyc.quality.paint, grain=house.radius / 20)
    renderer = BuiltIn(house, texture=paint)
    store = cyc.panorama.bake(renderer, [eye, eye + [0.3, 0, 0]], 3, (1024, 256), out=tmp_path, progress=False)
    assert len(store) >= 3
    middle = float((store.references[0].t + store.references[1].t) / 2)
    here = store.track.at(middle)
    for ahead in ([1, 0, 0.2], [-0.3, 0, -1], [-1, 0, 0.5]):
        camera = cyc.Camera.look_at(here, here + ahead, fov_y=50, width=160, height=120)
        seen, again = (cyc.panorama.view(store, middle, camera, threads=n) for n in (1, 2))
        np.testing.assert_array_equal(seen.color, again.color)
        points = cyc.DepthImage.from_view(house.render(camera)).points()
        known = np.isfinite(points).all(axis=-1)
        assert cyc.quality.psnr(seen.color, paint(points), where=known) >= 30
        assert seen.hole.mean() < 0.002
        depth = house.render(camera).depth
        assert np.median(np.abs(seen.depth[known] / depth[known] - 1)) < 2e-3


def test_pictures_lie_on_slanted_quads_where_their_pixels_were():
    """A wall whose colour is how far along it one is: no point may be off by more than a pixel of the panorama.

    Its quads reach from range 2 to 6; stretched evenly between their corners, pictures were off by six pixels.
    """
    start, along = np.array([-1.0, 0, -2]), np.array([0.8, 0, -0.6])
    corners = [start + along * s + [0, h, 0] for s, h in ((0, -2), (8, -2), (8, 2), (0, 2))]
    wall = cyc.Scene(np.array(corners), np.array([(0, 1, 2), (0, 2, 3)]))

    def grey(points):
        return np.repeat(np.clip((points - start) @ along / 8 * 255, 0, 255)[:, None], 3, axis=1).astype(np.uint8)

    columns = 512
    survey = Survey(
        BuiltIn(wall, texture=grey),
        [(0, 0, 0), (0.4, 0, 0)],
        1,
        (columns, 128),
        places=[0, 1],
        allow_outside=True,
        progress=False,
    )
    here = survey.track.at(1.0)
    camera = cyc.Camera.look_at(here, here + [0.5, 0, -1], fov_y=30, width=160, height=120)
    seen = seen_between(survey.references[:1], 0.0, survey.projection, camera, (0, 0, 0))
    points = cyc.DepthImage.from_view(wall.render(camera)).points()
    known = np.isfinite(points).all(axis=-1) & ~seen.hole
    assert known.mean() > 0.5
    truth = points[known]
    # How long a pixel of the panorama is on the wall: the reference is as far from the wall's line as `aside`.
    aside = abs(along[0] * start[2] - along[2] * start[0])
    pixel = 2 * np.pi / columns * (truth**2).sum(axis=1) / aside
    off = (seen.color[known][:, 0].astype(float) - grey(truth)[:, 0]) / 255 * 8
    assert np.abs(off / pixel).max() < 1 + 8 / 255 / pixel.min()


def test_what_lies_just_behind_a_slabs_last_surface_does_not_break_through():
    """A dark sheet on a light wall: the farther slab begins with the wall behind the nearer one's last dark pixels."""
    wall = [(x, y, -2.0) for x, y in ((-2, -3), (20, -3), (20, 3), (-2, 3))]
    sheet = [(x, y, -1.98) for x, y in ((-1, -1.5), (10, -1.5), (10, 1.5), (-1, 1.5))]
    corners = np.array(wall + sheet)
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    colors = np.array([(230, 220, 200)] * 2 + [(40, 30, 20)] * 2, np.uint8)
    scene = cyc.Scene(corners, faces, colors)
    track = Track([(0, 0, 0), (0.5, 0, 0)])
    survey = Survey(scene, track, [6.0], (1024, 256), places=[0.0, 1.0], allow_outside=True, progress=False)
    told = survey.references
    untold = [replace(ref, slabs=tuple(replace(slab, error=0.0) for slab in ref.slabs)) for ref in told]
    broken = []
    for between in (0.25, 0.5, 0.75):
        eye = track.at(between)
        camera = cyc.Camera.look_at(eye, (5.7, 0, -2), fov_y=30, width=320, height=240)
        inside = np.pad(np.isin(scene.render(camera).ids, (2, 3))[1:-1, 1:-1], 1)
        for _ in range(3):
            inside[1:-1, 1:-1] &= inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
        assert np.count_nonzero(inside) > 10_000
        for references in (told, untold):
            seen = seen_between(references, between, survey.projection, camera, (255, 0, 255))
            broken.append(np.count_nonzero(seen.color[inside].max(axis=1) > 100))
    assert not any(broken[::2])
    assert any(broken[1::2]), "the scene tests nothing: nothing breaks through where no slab says its error"


@pytest.fixture(scope="module")
def survey(house, eye):
    track = [eye, eye + [0.4, 0.0, 0.1]]
    return Survey(house, track, 3, (512, 128), tile=8, spacing=0.2, progress=False)


def test_exact_culling_loses_no_pixel_and_the_papers_drops_tiles_that_are_seen(survey):
    """The paper's method drops more, and some of that is seen: occluders are not at their slab's far end."""
    exact = survey.losses("exact", views=60, size=(96, 72))
    assert exact.tiles_dropped > 200
    assert exact.lost == 0
    assert exact.changed < 5e-4 * exact.pixels
    paper = survey.losses("paper", views=60, size=(96, 72), counts_tiles=True)
    assert paper.tiles_dropped > exact.tiles_dropped
    assert paper.tiles_wrong > 0


def seen_points(survey, scene, kept, steps=5):
    """How many of Open3D's rays from the ways to the neighbours reach points of dropped tiles, and of how many."""
    o3d = pytest.importorskip("open3d", reason="needs Open3D")
    rays = o3d.t.geometry.RaycastingScene()
    rays.add_triangles(scene.vertices.astype(np.float32), scene.faces.astype(np.uint32))
    seen = count = 0
    for index, masks in enumerate(kept):
        here = survey.references[index].eye
        ways = [survey.references[i].eye for i in (index - 1, index + 1) if 0 <= i < len(survey.references)]
        eyes = np.concatenate([np.linspace(here, way, steps) for way in ways])
        for (near, far), keep in zip(survey.cuts, masks, strict=True):
            # What is nearer than that is in the slab before, too.
            layer = BuiltIn(scene).render(here, survey.projection, near * (1 + OVERLAP), far)
            dropped = layer.opacity & ~np.repeat(np.repeat(keep, survey.tile, axis=0), survey.tile, axis=1)
            points = here + survey.projection.directions()[dropped] * layer.range[dropped][:, None]
            for eye in eyes:
                way = np.concatenate([np.broadcast_to(eye, points.shape), points - eye], axis=1)
                hit = rays.cast_rays(way.astype(np.float32))["t_hit"].numpy()
                seen += int(np.count_nonzero(hit > 1 - 1e-3))
            count += len(points) * len(eyes)
    return seen, count


def test_no_ray_from_the_track_reaches_what_exact_culling_dropped(survey, house):
    """As they are drawn, surfaces are one across a gap of up to a pixel; of a quarter of one, no ray passes any."""
    quarter = [
        kept_tiles(
            survey.projection,
            disparities,
            survey.cuts,
            eyes_around(survey.track, survey.places, index),
            tile=survey.tile,
            closed=0.25 * closed_step(survey.projection, 0.4 / 3),
        )
        for index, disparities in enumerate(survey._disparities)
    ]
    seen, count = seen_points(survey, house, quarter)
    assert count > 100_000 and seen == 0
    seen, count = seen_points(survey, house, survey.kept("exact"))
    assert seen <= 3e-5 * count
    wrong, _ = seen_points(survey, house, survey.kept("paper"))
    assert wrong > 3e-4 * count


@pytest.mark.parametrize(("kind", "rows"), [("cylinder", 64), ("equirect", 128)])
def test_a_far_wall_goes_on_hiding_where_the_near_one_ends(kind, rows):
    """A wall at 2 over half of the panorama, a closed one at 4, something at 8: the shadows of both join."""
    panorama = Projection(kind, (256, rows))
    near, far, behind = (np.full((rows, 256), 1 / r, np.float32) for r in (2, 4, 8))
    near[:, 128:] = 0
    slabs = [(0.0, 3.0), (3.0, 6.0), (6.0, np.inf)]
    eyes = np.array([[0.3, 0, 0], [-0.3, 0, 0]])
    keep = kept_tiles(panorama, [near, far, behind], slabs, eyes, tile=8)
    assert not keep[2][3:-3].any()
    # A slit in the far one, hidden by the near one from the viewpoint, shows what is behind.
    far[:, 64] = 0
    keep = kept_tiles(panorama, [near, far, behind], slabs, eyes, tile=8)
    assert not keep[2][3:-3].any(), "the near wall is wide enough"
    near[:, 60:] = 0
    keep = kept_tiles(panorama, [near, far, behind], slabs, eyes, tile=8)
    assert keep[2][rows // 16, 8] and not keep[2][rows // 16, 20]


def test_tables_count_tiles_and_bytes(survey):
    rows = survey.table("exact", (1.0, 0.8)) + survey.table("paper")
    assert [row.slab for row in rows] == [1, 2, 3] * 3
    assert rows[0].kept == rows[0].tiles and rows[0].kept_bytes == rows[0].bytes
    assert all(row.kept <= row.tiles <= row.all == 16 * 64 * len(survey.references) for row in rows)
    for strict, loose, paper in zip(rows[1:3], rows[4:6], rows[7:9], strict=True):
        assert paper.kept < loose.kept < strict.kept < strict.tiles
        assert paper.kept_bytes < loose.kept_bytes < strict.kept_bytes < strict.bytes
        assert strict.kept_raw < strict.raw


def test_occluders_before_their_slabs_end_hide_less_than_the_paper_says():
    """An occluder at 100 of a slab that ends at 1000, something at 5000 behind it, an eye 50 to the side.

    The view moves by 0.49 rad, the paper's window by 0.04.
    """
    panorama = Projection(size=(1024, 64))
    wall = np.zeros((64, 1024), np.float32)
    wall[:, 412:612] = 1 / 100
    behind = np.full_like(wall, 1 / 5000)
    eyes = np.array([[50.0, 0, 0], [-50.0, 0, 0]])
    slabs = [(0.0, 1000.0), (1000.0, np.inf)]
    found = {
        method: kept_tiles(panorama, [wall, behind], slabs, eyes, tile=8, method=method)[1]
        for method in ("exact", "paper")
    }
    # Columns that the wall hides from all eyes: its 200 pixels less twice the extent, a radian being 163 pixels.
    row = {method: int((~keep[4]).sum()) for method, keep in found.items()}
    assert 20 <= row["paper"] <= (200 - 2 * 0.04 * 163) // 8
    assert 1 <= row["exact"] <= (200 - 2 * 0.49 * 163) // 8


def test_the_papers_figure_extends_tiles_by_their_farthest_point_its_text_by_their_nearest():
    panorama = Projection(size=(256, 64))
    near, behind = np.zeros((2, 64, 256), np.float32)
    near[:, 64:192] = 0.5
    behind[:] = np.where(np.arange(64) % 2, 0.1, 0.24)[:, None]
    eyes = np.array([[0, 0, 2.0], [0, 0, -2.0]])
    kept = [
        kept_tiles(panorama, [near, behind], [(0, 4), (4, 12)], eyes, tile=8, method="paper", smallest=smallest)[1]
        for smallest in (False, True)
    ]
    # To the left, where the wall begins, far rows move by 2 f (1 / 4 - 1 / 10) = 12 pixels, near ones by less than one.
    assert kept[0][4, 9] and not kept[1][4, 9]
    assert (kept[0] | ~kept[1]).all()


def test_what_the_papers_method_dropped_hides_nothing():
    """Five of a tile's eight columns are covered: at alpha 0.6 the middle slab's is dropped, and the far one's, which
    moves by a column to each side and so is covered to a half, is not."""
    panorama = Projection(size=(256, 64))
    near, middle, far = np.zeros((3, 64, 256), np.float32)
    near[:, 64:69], middle[:, 64:72], far[:] = 0.5, 0.25, 0.05
    eyes = np.array([[0, 0, 0.3], [0, 0, -0.3]])
    slabs = [(0, 4), (4, 8), (8, 30)]
    _, second, third = kept_tiles(panorama, [near, middle, far], slabs, eyes, tile=8, method="paper", alpha=0.6)
    assert not second.any() and third.all()


def test_what_exact_culling_dropped_below_alpha_1_hides_nothing():
    """The middle slab's tile is hidden by half, and dropped at alpha 0.4: through the gap one sees the far one's."""
    panorama = Projection(size=(256, 64))
    near, middle, far = np.zeros((3, 64, 256), np.float32)
    near[:, 64:72], middle[:, 48:88], far[:] = 0.5, 0.45, 0.05
    eyes, slabs = np.array([[0, 0, 0.1], [0, 0, -0.1]]), [(0, 2.1), (2.1, 8), (8, 30)]
    kept = {a: kept_tiles(panorama, [near, middle, far], slabs, eyes, tile=8, alpha=a) for a in (0.4, 1.0)}
    assert not kept[0.4][1][1:-1, 8].any() and kept[0.4][2][1:-1, 8].all()
    assert kept[1.0][1][1:-1, 8].all() and not kept[1.0][2][1:-1, 8].any()


class Shades:
    """A sphere around the eye, black as seen from the track's start and light from its end."""

    def __init__(self, start, end):
        self.start, self.end = start, end

    def render(self, eye, projection, near, far):
        shape = projection.shape
        away = self.end if eye[0] > 0.5 else self.start
        color = np.full((*shape, 3), 200 * eye[0], np.uint8)
        return Layer(color, np.ones(shape, np.bool_), np.full(shape, away, np.float32))


@pytest.mark.parametrize(
    ("spheres", "between", "expected"),
    [
        # Weights are the squares of nearness: 200 / (1 + 9), 200 / 2, 200 * 9 / 10.
        ((1000.0, 1000.0), 0.25, 20),
        ((1000.0, 1000.0), 0.5, 100),
        ((1000.0, 1000.0), 0.75, 180),
        # Of what lies behind, a fiftieth stays: 200 / 51, and 200 * 50 / 51.
        ((100.0, 1000.0), 0.5, 4),
        ((1000.0, 100.0), 0.5, 196),
    ],
)
def test_pictures_are_mixed_by_the_square_of_nearness_and_what_is_in_front_wins(spheres, between, expected):
    survey = Survey(Shades(*spheres), [(0, 0, 0), (1, 0, 0)], 1, (256, 64), places=[0.0, 1.0], progress=False)
    camera = cyc.Camera.look_at([between, 0, 0], [between, 0, -1], fov_y=30, width=40, height=30)
    seen = seen_between(survey.references, between, survey.projection, camera, (255, 0, 255))
    assert (seen.color == expected).all()


def test_slabs_are_cut_in_valleys_and_out_of_order_is_refused(house, eye, tmp_path):
    rng = np.random.default_rng(1)
    groups = [rng.normal(m, s, 4000) for m, s in ((1.0, 0.05), (10.0, 1.0), (200.0, 20.0))]
    cuts = find_slabs(np.concatenate(groups), 3)
    for cut, near, far in zip(cuts, groups[:-1], groups[1:], strict=True):
        assert near.max() < cut < far.min()
    assert len(find_slabs(groups[0], 4)) == 3
    with pytest.raises(ValueError, match="ascending order"):
        cyc.panorama.bake(house, [eye, eye + [0.1, 0, 0]], [2.0, 1.0], (64, 32), out=tmp_path / "a", progress=False)
    with pytest.raises(ValueError, match="one slab"):
        find_slabs([2.0, 2.0], 2)


def bake_small(house, eye, folder, scene=None, **options):
    track = [eye, eye + [0.4, 0.0, 0.0]]
    options = {"spacing": 0.1, "progress": False, **options}
    return cyc.panorama.bake(scene or house, track, 2, (128, 64), out=folder, **options)


class Fails:
    """A renderer that gives up after some layers."""

    def __init__(self, scene, layers, error):
        self.inner, self.left, self.error = BuiltIn(scene), layers, error

    def render(self, eye, projection, near, far):
        self.left -= 1
        if self.left < 0:
            raise self.error
        return self.inner.render(eye, projection, near, far)


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_a_bake_that_was_stopped_goes_on_where_it_ended(house, eye, tmp_path):
    # Three layers of the coarse panoramas of slabs, five references of two slabs.
    with pytest.raises(KeyboardInterrupt):
        bake_small(house, eye, tmp_path / "a", Fails(house, 5 + 5, KeyboardInterrupt()))
    with pytest.raises(ValueError, match="2 of 5 references are drawn"):
        Store(tmp_path / "a")
    before = contents(tmp_path / "a")
    again = bake_small(house, eye, tmp_path / "a", Fails(house, 5 + 6, KeyboardInterrupt()))
    fresh = bake_small(house, eye, tmp_path / "b", Fails(house, 99, KeyboardInterrupt()))
    assert len(again) == 5 and contents(tmp_path / "a") == contents(tmp_path / "b")
    assert again.bytes == fresh.bytes
    after = contents(tmp_path / "a")
    assert all(after[name] == content for name, content in before.items() if name.name != "manifest.json")
    assert not list((tmp_path / "a").glob("*.part"))


def test_a_full_disk_leaves_what_was_whole(house, eye, tmp_path, monkeypatch):
    written = []

    def full(path, content):
        written.append(path)
        if len(written) > 12:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        return real(path, content)

    real = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left"):
        bake_small(house, eye, tmp_path / "a")
    monkeypatch.undo()
    assert not list((tmp_path / "a").glob("*.part"))
    assert len(bake_small(house, eye, tmp_path / "a")) == 5


def test_another_walk_in_the_folder_is_refused_and_stays(house, eye, tmp_path):
    bake_small(house, eye, tmp_path)
    before = contents(tmp_path)
    with pytest.raises(ValueError, match=r"another (slabs|references)"):
        bake_small(house, eye, tmp_path, spacing=0.2)
    with pytest.raises(ValueError, match="another culling"):
        bake_small(house, eye, tmp_path, method="paper")
    with pytest.raises(ValueError, match="through a wall"):
        cyc.panorama.bake(house, [eye, eye + [0, 0, 100]], out=tmp_path, allow_outside=True)
    assert contents(tmp_path) == before
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "letter").write_text("dear")
    with pytest.raises(ValueError, match="other files in it"):
        bake_small(house, eye, tmp_path / "other")


def test_damaged_stores_are_refused_by_name(house, eye, tmp_path):
    store = bake_small(house, eye, tmp_path)
    manifest = json.loads((tmp_path / "manifest.json").read_text())

    def rewritten(**changes):
        (tmp_path / "manifest.json").write_text(json.dumps({**manifest, **changes}))

    rewritten(format="cyclorama walk 0")
    with pytest.raises(ValueError, match="its format is 'cyclorama walk 0'"):
        Store(tmp_path)
    rewritten(slabs=manifest["slabs"][::-1])
    with pytest.raises(ValueError, match="out of order"):
        Store(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps(manifest)[:-40])
    with pytest.raises(ValueError, match="not a whole manifest"):
        Store(tmp_path)
    for changes, said in (
        ({"tile": 0}, "tiles of 0 don't divide"),
        ({"references": [manifest["references"][0] | {"eye": [0, 0]}]}, "has its eye at"),
    ):
        rewritten(**changes)
        with pytest.raises(ValueError, match=said):
            Store(tmp_path)
    rewritten(references=[manifest["references"][0] | {"folder": "../secret"}])
    with pytest.raises(ValueError, match="outside the walkthrough"):
        Store(tmp_path).reference(0)
    rewritten()
    sector = store.describe(1)["slabs"][1]["sectors"][0]
    for name in ("image", "quads"):
        path = tmp_path / "0001" / sector[name]
        content = path.read_bytes()
        path.write_bytes(content[:-7])
        with pytest.raises(ValueError, match=f"{sector[name]} is not the file that was written"):
            Store(tmp_path).reference(1)
        path.unlink()
        with pytest.raises(ValueError, match="can't be read"):
            Store(tmp_path).reference(1)
        path.write_bytes(content)
    Store(tmp_path).reference(1)
    with pytest.raises(FileNotFoundError, match="bake"):
        Store(tmp_path / "nowhere")


def quads_as_documented(packed, cells, tile, across):
    """The quads of a file, from the words of `cyclorama.panorama.tiles` alone."""
    count = int.from_bytes(packed[:4], "little")
    low, high = np.frombuffer(packed[4 : 4 + 8 * count], "u1").reshape(2, 4, count).astype(int)
    folded = low + 256 * high
    differences = np.where(folded % 2, -(folded + 1) // 2, folded // 2).T.tolist()
    bits = iter(np.unpackbits(np.frombuffer(packed[4 + 8 * count :], "u1"), bitorder="little").tolist())
    known, quads = {}, []

    def walk(opaque, x, y):
        side = len(opaque)
        if not opaque.any():
            return
        if side == 1 or next(bits):
            places = [(x, y), (x + side, y), (x, y + side), (x + side, y + side)]
            before = quads[-1][3] if quads else 0
            corners = []
            for k, difference in enumerate(differences[len(quads)]):
                if k == 0:
                    guess = next((known[place] for place in places if place in known), before)
                else:
                    guess = corners[0] if k < 3 else (corners[1] + corners[2] - corners[0]) % 65536
                    there = known.get(places[k])
                    if there is not None and min((there - guess) % 65536, (guess - there) % 65536) <= 32:
                        guess = there
                corners.append((guess + difference) % 65536)
            known.update(zip(places, corners, strict=True))
            quads.append([x, y, side, *corners])
            return
        half = side // 2
        for down in (0, half):
            for right in (0, half):
                walk(opaque[down : down + half, right : right + half], x + right, y + down)

    for number, opaque in cells.items():
        walk(opaque, number % across * tile, number // across * tile)
    assert len(quads) == count
    return np.array(quads)


def test_plain_tools_open_the_store(walk, folder):
    """Pillow, gzip and json, as the module's text says, and nothing of ours."""
    image = pytest.importorskip("PIL.Image", reason="needs Pillow to read tiles")
    manifest = json.loads((folder / "manifest.json").read_text())
    where = folder / manifest["references"][0]["folder"]
    slab = json.loads((where / "view.json").read_text())["slabs"][1]
    reference = walk.reference(0)
    tile, across = manifest["tile"], manifest["size"][0] // manifest["tile"]
    total = 0
    for sector in slab["sectors"]:
        picture = np.asarray(image.open(where / sector["image"]).convert("RGBA"))
        packed = gzip.decompress((where / sector["quads"]).read_bytes())
        cells = {}
        for index, number in enumerate(sector["tiles"]):
            top, left = index // 8 * (tile + 2) + 1, index % 8 * (tile + 2) + 1
            cells[number] = picture[top : top + tile, left : left + tile, 3] > 0
        found = quads_as_documented(packed, cells, tile, across)
        np.testing.assert_array_equal(found, reference.slabs[1].quads[total : total + len(found)])
        total += len(found)
        for index, number in enumerate(sector["tiles"]):
            top, left = index // 8 * (tile + 2) + 1, index % 8 * (tile + 2) + 1
            y, x = number // across * tile, number % across * tile
            cell = picture[top : top + tile, left : left + tile]
            np.testing.assert_array_equal(cell, reference.slabs[1].pixels[y : y + tile, x : x + tile])
    assert total == len(reference.slabs[1].quads)


CODECS = ("smallest", "png", "webp")


def test_codecs_are_lossless(house, eye, tmp_path):
    stores = [bake_small(house, eye, tmp_path / codec, codec=codec, spacing=0.4) for codec in CODECS]
    for store in stores[1:]:
        np.testing.assert_array_equal(store.panorama(1), stores[0].panorama(1))
        for own, other in zip(store.reference(1).slabs, stores[0].reference(1).slabs, strict=True):
            np.testing.assert_array_equal(own.quads, other.quads)
    assert stores[0].bytes <= min(store.bytes for store in stores[1:])
    with pytest.raises(ValueError, match="codec must be"):
        bake_small(house, eye, tmp_path / "jpg", codec="jpg")


def test_references_stand_where_errors_want_them():
    renderer = BuiltIn(fence(), texture=partial(cyc.quality.paint, grain=1.0))
    track, grid = Track([(0, 0, 0), (2, 0, 0)]), Projection(size=(512, 128))
    few, many = (places_by_error(renderer, track, error, slabs=1, panorama=grid) for error in (80.0, 45.0))
    assert few.tolist() == [0, 1]
    assert len(many) > 2 and many[0] == 0 and many[-1] == 1 and (np.diff(many) > 0).all()
    with pytest.raises(ValueError, match="max_error"):
        places_by_error(renderer, track, 0.0)
    with pytest.raises(ValueError, match="only one of them"):
        cyc.panorama.bake(renderer, track, spacing=1.0, max_error=45.0, allow_outside=True)


def test_one_reference_serves_all_of_a_track(house, eye, tmp_path):
    store = bake_small(house, eye, tmp_path, spacing=None, places=[0.5])
    camera = cyc.Camera.look_at(eye, eye + [0, 0, -1], width=32, height=24)
    assert cyc.panorama.view(store, 0.5, camera).exact
    assert not cyc.panorama.view(store, 0.1, camera).exact


@pytest.mark.parametrize("kind", ["cylinder", "equirect"])
def test_pyrender_sees_what_the_built_in_renderer_sees(house, eye, kind):
    pytest.importorskip("pyrender", reason="needs pyrender")
    panorama = Projection(kind, (256, 64))
    theirs = Pyrender(house)
    try:
        whole = theirs.render(eye, panorama, 0.0, np.inf)
    except (ImportError, OSError, AttributeError, RuntimeError) as error:
        pytest.skip(f"needs an OpenGL that pyrender can use: {error}")
    ours = BuiltIn(house).render(eye, panorama, 0.0, np.inf)
    assert np.mean(whole.opacity == ours.opacity) > 0.99
    both = whole.opacity & ours.opacity
    # The pixel beside is taken: a quarter of a pixel, of surfaces seen slantwise, is up to some percent.
    assert np.mean(np.abs(whole.range[both] / ours.range[both] - 1) < 0.02) > 0.95
    # Slabs end at planes, up to 1 / cos(17 degrees) from the sphere that was asked for; neighbours meet there.
    near, far = (theirs.render(eye, panorama, *ends) for ends in ((0.0, 2.0), (2.0, np.inf)))
    assert near.range[near.opacity].max() < 2.0 * 1.06 and far.range[far.opacity].min() > 1.99
    covered = near.opacity | far.opacity
    assert np.mean(covered == whole.opacity) > 0.999


@pytest.mark.parametrize("kind", ["cylinder", "equirect"])
def test_pov_ray_sees_what_the_built_in_renderer_sees(house, eye, kind):
    if shutil.which("povray") is None:
        pytest.skip("needs povray")
    theirs, ours = (r.render(eye, Projection(kind, (256, 64)), 1.5, 4.0) for r in (PovRay(house), BuiltIn(house)))
    assert np.mean(theirs.opacity == ours.opacity) > 0.99
    both = theirs.opacity & ours.opacity
    # 16 bits of the logarithm, and pixels that show an edge.
    assert np.mean(np.abs(theirs.range[both] / ours.range[both] - 1) < 1e-3) > 0.98
    off = np.abs(theirs.color[both].astype(int) - ours.color[both])
    assert np.mean(off.max(axis=1) <= 3) > 0.97


def test_a_finished_panorama_becomes_a_walk(data, tmp_path):
    folder = data / "pano_bedroom"
    pictures = [path.name for path in sorted(folder.iterdir()) if path.suffix in (".png", ".jpg")]
    color = next(name for name in pictures if "depth" not in name)
    for name in (color, "depth_estimated.png"):
        shutil.copy(folder / name, tmp_path / name)
    entry = {"eye": [0, 0, 0], "color": color, "depth": "depth_estimated.png", "unit": 0.001, "projection": "equirect"}
    (tmp_path / "panoramas.json").write_text(json.dumps([entry]))
    renderer = PanoramaFolder(tmp_path)
    track = Track([(-0.1, 0, 0), (0.1, 0, 0)])
    walk = cyc.panorama.bake(
        renderer, track, 3, (1024, 512), "equirect", out=tmp_path / "walk", places=[0.5], progress=False
    )
    camera = cyc.Camera.look_at((0, 0, 0), (1, 0, -0.5), fov_y=60, width=160, height=120)
    here, aside = cyc.panorama.view(walk, 0.5, camera), cyc.panorama.view(walk, 1.0, camera)
    assert here.exact and not here.hole.any()
    assert aside.hole.mean() < 0.1
    with pytest.raises(ValueError, match="no panorama is at"):
        renderer.render((1, 0, 0), walk.projection, 0.0, np.inf)
    (tmp_path / "panoramas.json").write_text("[]")
    with pytest.raises(ValueError, match="lists no panorama"):
        PanoramaFolder(tmp_path)


def test_a_renderer_that_lies_is_told(house, eye, tmp_path):
    class Wrong(BuiltIn):
        def render(self, eye, projection, near, far):
            layer = super().render(eye, projection, near, far)
            return Layer(layer.color, layer.opacity, layer.range * np.float32(3))

    with pytest.raises(ValueError, match="the renderer gave a range of"):
        cyc.panorama.bake(Wrong(house), [eye, eye + [0.1, 0, 0]], [2.0], (64, 32), out=tmp_path, progress=False)


def test_a_spline_passes_its_points_and_a_ring_closes():
    points = np.array([(0, 0, 0), (1, 0, 1), (2, 0, 0), (3, 0, 1)], float)
    spline = Track(points, spline=True)
    assert all(np.linalg.norm(spline.knots - point, axis=1).min() < 1e-12 for point in points)
    assert spline.length > Track(points).length
    ring = Track(points, closed=True)
    np.testing.assert_allclose(ring.at(0.0), ring.at(1.0))
    steps = np.linalg.norm(np.diff(ring.at(np.linspace(0, 1, 101)), axis=0), axis=1)
    assert steps.max() <= ring.length / 100 * (1 + 1e-9)
