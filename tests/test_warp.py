"""Forward warps, against a depth-buffered warp written to be read, OpenCV, and what can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import _core
from peers import need
from reference import forward_warp

SIZE = (48, 36)
HERE = cyc.Camera.look_at((0, 0, 0), (0, 0, -4), width=SIZE[0], height=SIZE[1], fov_y=60)


def spheres(camera: cyc.Camera, seed: int = 0, balls: int = 5) -> cyc.DepthImage:
    """Random balls before a bumpy wall, with random colours: a sample is told from any other by its colour."""
    rng = np.random.default_rng(seed)
    height, width = camera.height, camera.width
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(camera.K).T
    depth = 5 + 0.3 * np.sin(7 * rays[..., 0]) * np.cos(5 * rays[..., 1])
    for center, radius in zip(
        rng.uniform((-1, -1, 2), (1, 1, 4), (balls, 3)), rng.uniform(0.1, 0.6, balls), strict=True
    ):
        a, b, c = (rays**2).sum(-1), rays @ center, center @ center - radius**2
        hit = b**2 > a * c
        depth = np.where(hit, np.minimum(depth, (b - np.sqrt(np.where(hit, b**2 - a * c, 0))) / a), depth)
    return cyc.DepthImage(rng.integers(0, 256, (height, width, 3), np.uint8), depth, camera)


def moved(offset: tuple[float, float, float], turn: tuple[float, float] = (0.0, 0.0), **changes: int) -> cyc.Camera:
    """A camera beside `HERE`, in its axes (right, down, forward), looking `turn` radians aside and down."""
    a, b = turn
    ry = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    rx = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    pose = np.eye(4)
    pose[:3, :3] = rx @ ry
    pose[:3, 3] = -pose[:3, :3] @ offset
    return cyc.Camera(
        HERE.K, pose @ HERE.world_to_camera, changes.get("width", SIZE[0]), changes.get("height", SIZE[1])
    )


def widened(camera: cyc.Camera, pixels: int) -> cyc.Camera:
    """The camera with so many more pixels on each side."""
    shift = np.array([[0, 0, pixels], [0, 0, pixels], [0, 0, 0]])
    size = camera.width + 2 * pixels, camera.height + 2 * pixels
    return cyc.Camera(camera.K + shift, camera.world_to_camera, *size)


def arrays(warped: cyc.warp.Warped) -> list[np.ndarray]:
    return [warped.color, warped.depth, warped.hole, warped.exact, warped.source]


def same(a: cyc.warp.Warped, b: cyc.warp.Warped) -> bool:
    return all(x.tobytes() == y.tobytes() for x, y in zip(arrays(a), arrays(b), strict=True))


def doubtful(image: cyc.DepthImage, camera: cyc.Camera, within: float = 1e-3) -> np.ndarray:
    """Pixels beside whose edges a sample falls: rounding decides whose it is."""
    pixel, _ = forward_warp.positions(image, camera)
    at = np.full((camera.height + 2, camera.width + 2), False)
    near = (np.abs(pixel - np.round(pixel)) < within).any(-1)
    for x, y in np.round(pixel[near]).astype(int):
        if -1 <= x <= camera.width and -1 <= y <= camera.height:
            at[y : y + 3, x : x + 3] = True
    return at[1:-1, 1:-1]


moves = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 1.5))
turns = st.tuples(st.floats(-0.6, 0.6), st.floats(-0.4, 0.4))


@given(moves, turns, st.integers(0, 5))
def test_a_depth_buffered_warp_is_that_of_the_reference(offset, turn, seed):
    image, camera = spheres(HERE, seed), moved(offset, turn)
    ours = cyc.warp.forward(image, camera, splat=1, order="zbuffer")
    color, depth, hole = forward_warp.forward([image], camera)
    sure = ~doubtful(image, camera)
    np.testing.assert_array_equal(ours.hole[sure], hole[sure])
    np.testing.assert_array_equal(ours.exact, ~ours.hole)
    np.testing.assert_allclose(ours.depth[sure], depth[sure], rtol=2e-5)
    # Depths that differ by less than float32 tells may have either colour.
    assert (ours.color[sure] != color[sure]).any(-1).mean() < 2e-3


@given(moves, turns, st.sampled_from([3, 5, 9]))
def test_larger_splats_fill_only_pixels_that_no_centre_falls_on(offset, turn, splat):
    image, camera = spheres(HERE), moved(offset, turn)
    for order in ("zbuffer", "occlusion"):
        # What falls beside the image may cover some of it.
        radius = splat // 2
        one = cyc.warp.forward(image, widened(camera, radius), splat=1, order=order)
        ours = cyc.warp.forward(image, camera, splat=splat, order=order)
        inner = np.s_[radius:-radius, radius:-radius]
        color, depth, hole = forward_warp.square(one.color, one.depth, one.hole, radius)
        sure = ~doubtful(image, widened(camera, radius), 1e-4)
        sure = forward_warp.eroded(sure, radius)[inner]
        np.testing.assert_array_equal(ours.color[sure], color[inner][sure])
        np.testing.assert_allclose(ours.depth[sure], depth[inner][sure], rtol=1e-5)
        np.testing.assert_array_equal(ours.hole[sure], hole[inner][sure])
        np.testing.assert_array_equal(ours.exact[sure], one.exact[inner][sure])


@pytest.mark.parametrize("order", ["occlusion", "zbuffer"])
@pytest.mark.parametrize("splat", [1, 3, 7, "projected", "disparity"])
def test_the_identity_is_the_identity(order, splat):
    image = spheres(HERE)
    ours = cyc.warp.forward(image, HERE, splat=splat, order=order)
    np.testing.assert_array_equal(ours.color, image.color)
    np.testing.assert_allclose(ours.depth, image.depth, rtol=2**-22)
    assert ours.exact.all() and not ours.hole.any() and not ours.source.any()


@given(moves, turns, st.sampled_from([1, 3, 5, "projected", "disparity"]), st.sampled_from(["occlusion", "zbuffer"]))
def test_threads_and_instruction_sets_change_nothing(offset, turn, splat, order):
    images, camera = [spheres(HERE), spheres(moved((0.3, 0.1, -0.2)), 1)], moved(offset, turn, width=67, height=41)
    used, pictures = _core.instruction_set(), []
    try:
        for name in _core.instruction_sets():
            _core.use_instruction_set(name)
            for threads in (1, 2, 3):
                pictures.append(cyc.warp.forward(images, camera, splat=splat, order=order, threads=threads))
    finally:
        _core.use_instruction_set(used)
    assert all(same(pictures[0], other) for other in pictures)


@given(moves, turns)
def test_map_agrees_with_the_reference(offset, turn):
    image, camera = spheres(HERE), moved(offset, turn)
    # The numbers that the reference starts from: beside the eye's plane their rounding to float32 is many pixels.
    depth = 1.0 / image.disparity.astype(np.float64)
    np.testing.assert_allclose(
        cyc.warp.map(HERE, camera, depth), forward_warp.positions(image, camera)[0], rtol=1e-5, atol=1e-4
    )


@given(turns)
def test_map_of_a_pure_rotation_is_opencvs_homography(turn):
    cv2 = need("cv2")
    camera = moved((0, 0, 0), turn)
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    rotation = (camera.world_to_camera @ np.linalg.inv(HERE.world_to_camera))[:3, :3]
    homography = np.linalg.inv(half) @ camera.K @ rotation @ np.linalg.inv(HERE.K) @ half
    x, y = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1]))
    theirs = cv2.perspectiveTransform(np.stack([x, y], -1), homography) + 0.5
    for depth in (1.0, 7.0, np.inf):
        ours = cyc.warp.map(HERE, camera, depth)
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_one_pixel():
    camera = cyc.Camera.look_at((0, 0, 1), (0, 0, 0), width=1, height=1)
    image = cyc.DepthImage(np.full((1, 1, 3), 9, np.uint8), [[1.0]], camera)
    for splat in (1, 3):
        ours = cyc.warp.forward(image, camera, splat=splat)
        assert ours.color.tolist() == [[[9, 9, 9]]] and ours.depth.tolist() == [[1.0]] and ours.exact.all()


def test_no_image_is_all_hole():
    ours = cyc.warp.forward([], HERE)
    assert ours.hole.all() and not ours.color.any() and np.isinf(ours.depth).all() and (ours.source == 255).all()


def plane(depth: float, seed: int = 0, camera: cyc.Camera = HERE) -> cyc.DepthImage:
    """A wall across the view, of random colours."""
    shape = (camera.height, camera.width)
    color = np.random.default_rng(seed).integers(0, 256, (*shape, 3), np.uint8)
    return cyc.DepthImage(color, np.full(shape, depth), camera)


def wrong(a: cyc.warp.Warped, b: cyc.warp.Warped) -> float:
    """Share of pixels on which the two show surfaces whose depths differ by more than 5 %."""
    both = ~a.hole & ~b.hole
    return float((np.abs(a.depth[both] - b.depth[both]) > 0.05 * b.depth[both]).mean())


@given(st.floats(-1.5, 1.5), st.booleans(), st.integers(0, 5))
def test_both_orders_agree_on_every_pixel_when_the_eye_moves_along_rows_or_columns(step, upright, seed):
    """Rows then stay rows, and of two samples on a pixel the one drawn later has moved farther: it is the nearer."""
    image, camera = spheres(HERE, seed), moved((0, step, 0) if upright else (step, 0, 0))
    pictures = [cyc.warp.forward(image, camera, splat=1, order=order) for order in ("occlusion", "zbuffer")]
    sure = ~doubtful(image, camera, 1e-4)
    np.testing.assert_array_equal(pictures[0].color[sure], pictures[1].color[sure])


@given(moves, turns, st.integers(0, 5))
def test_the_orders_differ_on_few_pixels_and_on_fewer_show_another_surface(offset, turn, seed):
    """Samples of one surface that share a pixel are told apart by depth or by order, of two rows by order only.

    Where the target sees the source smaller, several samples share a pixel; so it has three times the resolution.
    """
    image = spheres(HERE, seed)
    camera = moved(offset, turn)
    fine = cyc.Camera(np.diag([3, 3, 1]) @ camera.K, camera.world_to_camera, 3 * SIZE[0], 3 * SIZE[1])
    drawn, nearest = (cyc.warp.forward(image, fine, splat=1, order=order) for order in ("occlusion", "zbuffer"))
    np.testing.assert_array_equal(drawn.hole, nearest.hole)
    assert (drawn.color != nearest.color).any(-1).mean() < 0.02
    assert wrong(drawn, nearest) < 0.01


@pytest.mark.parametrize(
    "offset", [(0.1, 0.05, 1.2), (0.1, 0.05, -1.5), (1.2, 0.2, 0.6), (1.2, 0.2, -0.6), (1.0, -0.7, 0)]
)
def test_sheets_are_drawn_the_right_way_round(offset):
    """Epipole inside, beside, at infinity, eye in front or behind: the reverse order would show what is hidden."""
    camera, faults, reversed_faults = moved(offset), 0.0, 0.0
    for seed in range(5):
        image = spheres(HERE, seed, balls=9)
        right, nearest = (cyc.warp.forward(image, camera, splat=1, order=order) for order in ("occlusion", "zbuffer"))
        faults += wrong(right, nearest)
        pixel, depth = forward_warp.positions(image, camera)
        at = np.argwhere(((pixel >= 0) & (pixel < SIZE)).all(-1))
        epipole = HERE.K @ (HERE.world_to_camera[:3] @ [*camera.eye, 1])
        ahead = np.sign(epipole[:2] - epipole[2] * (at[:, ::-1] + 0.5))[:, ::-1]
        backward = np.full(nearest.hole.shape, np.inf)
        for y, x in at[np.lexsort((-at * ahead).T[::-1])]:
            u, v = pixel[y, x].astype(int)
            backward[v, u] = depth[y, x]
        reversed_faults += (~nearest.hole & (backward > 1.05 * nearest.depth)).mean()
    assert faults < 0.4 * reversed_faults and reversed_faults > 0.02


@given(moves, turns, st.floats(-3, 3), st.tuples(*[st.floats(-100, 100)] * 3))
def test_moving_both_cameras_alike_changes_nothing(offset, turn, angle, away):
    image, camera = spheres(HERE), moved(offset, turn)
    rigid = np.eye(4)
    rigid[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    rigid[:3, 3] = away

    def elsewhere(c: cyc.Camera) -> cyc.Camera:
        return cyc.Camera(c.K, c.world_to_camera @ rigid, c.width, c.height)

    other = cyc.DepthImage(image.color, image.depth, elsewhere(HERE))
    sure = ~doubtful(image, camera, 2e-3)
    for order in ("occlusion", "zbuffer"):
        here = cyc.warp.forward(image, camera, splat=1, order=order)
        there = cyc.warp.forward(other, elsewhere(camera), splat=1, order=order)
        np.testing.assert_array_equal(here.exact[sure], there.exact[sure])
        seen = sure & here.exact
        if seen.any():
            # Of samples that share a pixel another one may be taken, beside it on the same surface.
            assert np.isclose(here.depth[seen], there.depth[seen], rtol=0.05).mean() > 0.98


@pytest.mark.parametrize("splat", [1, 3, "projected", "disparity"])
def test_a_turn_all_the_way_round_sees_nothing(splat):
    back = cyc.Camera(HERE.K, np.diag([-1.0, 1, -1, 1]) @ HERE.world_to_camera, *SIZE)
    assert cyc.warp.forward(spheres(HERE), back, splat=splat).hole.all()
    assert np.isnan(cyc.warp.map(HERE, back, 2.0)).all()


@pytest.mark.parametrize("splat", [1, 3, "projected", "disparity"])
def test_samples_in_the_plane_of_the_eye_and_behind_it_are_dropped(splat):
    """The depth 4 is exact in float32, and so is its disparity: the sample is in the plane, not nearly."""
    for step, seen in ((4.0, False), (4.5, False), (1000.0, False), (3.0, True)):
        picture = cyc.warp.forward(plane(4.0), moved((0, 0, step)), splat=splat)
        assert picture.hole.all() != seen
        assert np.isnan(cyc.warp.map(HERE, moved((0, 0, step)), 4.0)).all() != seen
    half = plane(4.0)
    depth = half.depth.copy()
    depth[:, : SIZE[0] // 2] = 8.0
    picture = cyc.warp.forward(cyc.DepthImage(half.color, depth, HERE), moved((0, 0, 4.0)), splat=splat)
    assert not picture.hole.all()
    np.testing.assert_allclose(picture.depth[~picture.hole], 4.0)


def test_what_is_before_the_near_plane_is_dropped():
    camera = moved((0, 0, 1))
    near = cyc.Camera(camera.K, camera.world_to_camera, *SIZE, near=2.5)
    picture = cyc.warp.forward(spheres(HERE), near, splat=1)
    assert picture.depth.min() >= 2.5 and cyc.warp.forward(spheres(HERE), camera, splat=1).depth.min() < 2.5


@given(st.tuples(*[st.floats(-1000, 1000)] * 3), turns)
def test_what_is_infinitely_far_turns_and_never_moves(offset, turn):
    shape = (SIZE[1], SIZE[0])
    color = plane(1.0).color
    sky = cyc.DepthImage(color, np.full(shape, np.inf), HERE, missing=np.zeros(shape, bool))
    here, there = (cyc.warp.forward(sky, moved(o, turn), order="zbuffer") for o in ((0, 0, 0), offset))
    assert same(here, there) and np.isinf(here.depth).all() and not here.hole.all()


@pytest.mark.parametrize("splat", [1, 3, "projected", "disparity"])
@pytest.mark.parametrize("order", ["occlusion", "zbuffer"])
def test_extreme_disparities_wrap_around_nothing(splat, order):
    rng = np.random.default_rng(0)
    depth = 10.0 ** rng.uniform(-29, 29, (SIZE[1], SIZE[0]))
    image = cyc.DepthImage(plane(1.0).color, depth, HERE)
    for offset in ((1e-3, 0, 0), (1e6, 0, 0), (0, 0, 1e-20), (0, 0, -1e20)):
        camera = moved(offset, (0.3, 0.2))
        picture = cyc.warp.forward(image, camera, splat=splat, order=order)
        pixel, _ = forward_warp.positions(image, camera)
        inside = ((pixel > -0.01) & (pixel < np.add(SIZE, 0.01))).all(-1)
        assert picture.exact.sum() <= inside.sum()
        assert (picture.depth > 0).all()


def test_a_pole_uncovers_a_hole_as_wide_as_the_parallax():
    depth = np.full((SIZE[1], SIZE[0]), 6.0)
    depth[:, 20:26] = 2.0
    image = cyc.DepthImage(plane(1.0).color, depth, HERE)
    picture = cyc.warp.forward(image, moved((0.5, 0, 0)), splat=1)
    shift = HERE.K[0, 0] * 0.5 * (1 / 2 - 1 / 6)
    behind = picture.hole[:, : SIZE[0] - int(HERE.K[0, 0] * 0.5 / 6) - 1].sum(1)
    assert np.all(np.abs(behind - shift) <= 1)
    # The eye went right, so the pole went left, and the hole opens on the side that it came from.
    pole = np.flatnonzero(picture.depth[5] < 3)
    assert picture.hole[5, pole[-1] + 1] and not picture.hole[5, pole[0] - 1]
    filled = cyc.warp.fill(picture)
    np.testing.assert_array_equal(filled.hole, picture.hole)
    assert (filled.depth[:, pole[-1] + 1 : pole[-1] + 4] > 5.9).all()
    nearest = cyc.warp.fill(picture, method="nearest")
    assert (nearest.depth[:, pole[-1] + 1] < 2.1).all()


def faded(image: cyc.DepthImage, camera: cyc.Camera, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Colours of a wall's splats averaged with weights that fade to half a pixel beyond their edges, by plain loops.

    And the pixels that several splats cover, none of which ends within rounding of their centres.
    """
    pixel, _ = forward_warp.positions(image, camera)
    shape = camera.height, camera.width
    sums, weights, count, sure = np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, int), np.ones(shape, bool)
    for y, x in np.ndindex(pixel.shape[:2]):
        u, v = pixel[y, x]
        for row in range(max(0, int(v - side)), min(camera.height, int(v + side) + 1)):
            for column in range(max(0, int(u - side)), min(camera.width, int(u + side) + 1)):
                away = np.abs((column + 0.5 - u, row + 0.5 - v))
                sure[row, column] &= abs(away.max() - side / 2) > 0.03
                if (away <= side / 2).all():
                    weight = np.prod(1 - away / (side / 2 + 0.5))
                    sums[row, column] += weight * image.color[y, x]
                    weights[row, column] += weight
                    count[row, column] += 1
    return sums / np.maximum(weights, 1e-9)[..., None], (count > 1) & sure


@pytest.mark.parametrize("factor", [1.7, 2.0, 2.6])
def test_the_colours_of_splats_by_disparity_are_averaged_with_weights_that_fade(factor):
    image, camera = plane(6.0), moved((0.05, 0.03, 6.0 - 6.0 / factor))
    # Rolled, the target's rectangles overlap: upright they would touch, each pixel under one of them.
    roll = np.eye(4)
    roll[:2, :2] = [[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]]
    camera = camera.replace(world_to_camera=roll @ camera.world_to_camera)
    picture = cyc.warp.forward(image, camera, splat="disparity")
    expected, several = faded(image, camera, factor)
    between = several & ~picture.exact & ~doubtful(image, camera, 0.02)
    assert between.sum() > 50
    # Half a level of rounding, and up to one of 256 of each weight, of few splats.
    assert np.abs(picture.color[between] - expected[between]).max() < 2


@pytest.mark.parametrize("factor", [1.3, 2.0, 3.0, 4.5])
def test_a_closer_view_has_cracks_where_splats_are_too_small(factor):
    """A wall seen `factor` times as large: so many pixels a sample, and a fixed splat covers only as many as it has."""
    image, camera = plane(6.0), moved((0, 0, 6.0 - 6.0 / factor))
    holes = {splat: cyc.warp.forward(image, camera, splat=splat).hole.mean() for splat in (1, 3, 5)}
    assert abs(holes[1] - (1 - 1 / factor**2)) < 0.05
    assert (holes[3] == 0) == (factor <= 3) and holes[5] == 0
    for splat in ("projected", "disparity"):
        assert not cyc.warp.forward(image, camera, splat=splat).hole.any()


def test_a_wall_three_times_as_large_is_each_pixel_three_times_each_way():
    image, camera = plane(6.0), moved((0, 0, 4.0))
    left, top = SIZE[0] // 3, SIZE[1] // 3
    expected = image.color[top : 2 * top, left : 2 * left].repeat(3, 0).repeat(3, 1)
    for splat in (3, "projected", "disparity"):
        np.testing.assert_array_equal(cyc.warp.forward(image, camera, splat=splat).color, expected, str(splat))


def test_a_grazing_floor_opens_cracks_that_projected_splats_cover():
    """Samples of a floor far ahead are many pixels apart for an eye that looks down on them."""
    y = np.arange(SIZE[1])[:, None] + 0.5 - SIZE[1] / 2
    depth = np.where(y > 0, 1.0 * HERE.K[1, 1] / np.maximum(y, 0.5), np.inf) + np.zeros(SIZE[0])
    floor = cyc.DepthImage(plane(1.0).color, depth, HERE)
    camera = moved((0, -2.0, 2.5), (0.0, 0.75))
    covered = ~cyc.warp.forward(floor, camera, splat=15, order="zbuffer").hole
    inner = np.zeros_like(covered)
    inner[9:-9, 9:-9] = covered[18:, 9:-9] & covered[:-18, 9:-9] & covered[9:-9, 18:] & covered[9:-9, :-18]
    holes = {s: cyc.warp.forward(floor, camera, splat=s).hole[inner].mean() for s in (1, 3, "projected")}
    assert holes[1] > 0.3 > holes["projected"] and holes["projected"] < 0.5 * holes[3]


def test_what_lies_behind_shows_through_the_cracks_of_fixed_splats_only():
    """A sample's own pixel counts more than the rest of a nearer splat: else the picture from here wasn't itself."""
    far, near = plane(12.0, 1, moved((0, 0, -1))), plane(3.0, 2)
    camera = moved((0, 0, 1.5))
    shows = {
        splat: (cyc.warp.forward([far, near], camera, splat=splat, order="zbuffer").source == 0).mean()
        for splat in (3, "projected", "disparity")
    }
    assert shows[3] > 0.05 and shows["projected"] == 0


def test_later_images_are_drawn_over_earlier_ones_and_the_depth_buffer_asks_which_is_nearer():
    far, near = plane(8.0, 1), plane(4.0, 2)
    for order, sources in (("occlusion", {(0, 1): 1, (1, 0): 0}), ("zbuffer", {(0, 1): 1, (1, 0): 1})):
        for indices, source in sources.items():
            picture = cyc.warp.forward([(far, near)[i] for i in indices], HERE, order=order)
            expected = far if (source == 0 and order == "occlusion") else near
            np.testing.assert_array_equal(picture.color, expected.color)
            assert (picture.source == indices.index(1 if expected is near else 0)).all()


def test_two_references_leave_smaller_holes_than_one():
    camera = moved((0.3, 0, 0))
    one = cyc.warp.forward(spheres(HERE, 4), camera)
    images = [spheres(HERE, 4), spheres(moved((0.6, 0, 0)), 4)]
    assert cyc.warp.forward([images[0]] * 2, camera).hole.sum() == one.hole.sum()
    assert cyc.warp.forward(images, camera).hole.sum() < 0.6 * one.hole.sum()


def test_previous_pixels_persist_and_stay_holes():
    image, camera = plane(4.0), moved((1.0, 0, 0))
    bare = cyc.warp.forward(image, camera)
    previous = cyc.warp.forward(image, HERE)
    for background in (previous, previous.color, previous.color[::1]):
        picture = cyc.warp.forward(image, camera, background=background)
        np.testing.assert_array_equal(picture.color[bare.hole], previous.color[bare.hole])
        np.testing.assert_array_equal(picture.color[~bare.hole], bare.color[~bare.hole])
        np.testing.assert_array_equal(picture.hole, bare.hole)
    # Into the same memory.
    picture = cyc.warp.forward(image, camera, background=previous, out=previous)
    assert picture.color is previous.color and bare.hole.any()
    np.testing.assert_array_equal(picture.hole, bare.hole)
    np.testing.assert_array_equal(picture.color[~bare.hole], bare.color[~bare.hole])


def test_out_is_written_to_the_last_pixel_and_nothing_is_left_from_before():
    image, camera = spheres(HERE), moved((0.4, 0.2, -0.5), (0.1, 0.2))
    out = cyc.warp.Warped.empty(camera)
    for splat in (1, 3, "projected", "disparity"):
        for array in arrays(out):
            array.view(np.uint8)[:] = 1
        again = cyc.warp.forward(image, camera, splat=splat, out=out)
        assert all(a is b for a, b in zip(arrays(again), arrays(out), strict=True))
        assert same(again, cyc.warp.forward(image, camera, splat=splat))


def test_missing_pixels_and_four_channels():
    image = spheres(HERE)
    missing = np.random.default_rng(0).random(image.missing.shape) < 0.3
    rgba = np.concatenate([image.color, np.full((*missing.shape, 1), 7, np.uint8)], -1)
    holed = cyc.DepthImage(rgba, image.depth, HERE, missing=missing)
    for splat in (1, "projected", "disparity"):
        picture = cyc.warp.forward(holed, HERE, splat=splat)
        np.testing.assert_array_equal(picture.exact, ~missing)
        np.testing.assert_array_equal(picture.color[~missing], image.color[~missing])
    assert cyc.warp.forward(cyc.DepthImage(rgba, image.depth, HERE, missing=missing | True), HERE).hole.all()


def ramp(camera: cyc.Camera, depth: float) -> cyc.DepthImage:
    """Colours that change by two levels a pixel, across and down."""
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    color = np.stack([2 * x, 2 * y, x + y], -1).astype(np.uint8)
    return cyc.DepthImage(color, np.full(x.shape, depth), camera)


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.4, -0.2, -0.3)])
def test_a_turned_plane_is_opencvs_perspective_warp(offset):
    """The plane's homography, drawn backward by OpenCV: colours agree within what half a pixel each way changes."""
    cv2 = need("cv2")
    image, camera = ramp(HERE, 5.0), moved(offset, (0.15, -0.1))
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    pose = camera.world_to_camera @ np.linalg.inv(HERE.world_to_camera)
    plane_map = pose[:3, :3] + np.outer(pose[:3, 3], [0, 0, 1 / 5.0])
    homography = np.linalg.inv(half) @ camera.K @ plane_map @ np.linalg.inv(HERE.K) @ half
    theirs = cv2.warpPerspective(image.color, homography, SIZE, flags=cv2.INTER_LINEAR)
    inside = cv2.warpPerspective(np.full(image.color.shape[:2], 255, np.uint8), homography, SIZE) == 255
    ours = cyc.warp.forward(image, camera)
    seen = inside & ~ours.hole
    assert seen.mean() > 0.5
    assert np.abs(ours.color[seen].astype(int) - theirs[seen]).max() <= 4
    exact = inside & ours.exact
    assert np.abs(ours.color[exact].astype(int) - theirs[exact]).max() <= 3


def test_map_takes_opencvs_remap_back():
    cv2 = need("cv2")
    image, camera = ramp(HERE, 5.0), moved((0.3, 0.2, 0))
    back = (cyc.warp.map(camera, HERE, 5.0) - 0.5).astype(np.float32)
    theirs = cv2.remap(image.color, back, None, cv2.INTER_LINEAR)
    ours = cyc.warp.forward(image, camera)
    inside = ((back >= 0) & (back <= np.subtract(SIZE, 1))).all(-1) & ours.exact
    assert inside.mean() > 0.7 and np.abs(ours.color[inside].astype(int) - theirs[inside]).max() <= 3


def test_opencvs_depth_frame_warp_truncates_what_ours_rounds():
    """Coordinates of centres are truncated there: half a pixel up and left of ours, so we move the image by that."""
    cv2 = need("cv2")
    warp_frame = getattr(cv2, "warpFrame", None) or getattr(getattr(cv2, "rgbd", None), "warpFrame", None)
    if warp_frame is None:
        pytest.skip("this OpenCV has no warpFrame")
    image = spheres(HERE, 2)
    camera = moved((0.3, 0.1, -0.2), (0.05, 0.03))
    pose = camera.world_to_camera @ np.linalg.inv(HERE.world_to_camera)
    intrinsics = HERE.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    theirs = np.asarray(warp_frame(image.depth, None, None, pose, intrinsics)[0], np.float32)
    up_left = cyc.Camera(intrinsics, camera.world_to_camera, *SIZE)
    ours = cyc.warp.forward(image, up_left, splat=1, order="zbuffer")
    both = np.isfinite(theirs) & (theirs > 0) & ~ours.hole
    assert both.mean() > 0.7
    assert np.isclose(theirs[both], ours.depth[both], rtol=1e-4).mean() > 0.995
    # As they are, half of the picture is another sample's.
    rounded = cyc.warp.forward(image, camera, splat=1, order="zbuffer")
    assert np.isclose(theirs, rounded.depth, rtol=1e-6).mean() < 0.9


def test_a_real_stereo_pair(data):
    """Left to right by the true disparity: 8 grey levels off on average, where the pictures as they are are 40 off."""
    import json

    cv2 = need("cv2")
    folder = data / "stereo_motorcycle"
    left, right = (cv2.imread(str(folder / f"{side}.png"))[..., ::-1].copy() for side in ("left", "right"))
    calibration = json.loads((folder / "calib.json").read_text())
    height, width = left.shape[:2]
    focal, shift = calibration["focal_px"], calibration["cx_right_minus_left"]
    K = np.array([[focal, 0, calibration["cx_left"]], [0, focal, calibration["cy"]], [0, 0, 1]])
    here = cyc.Camera.from_opencv(K, np.eye(4), width, height, pixel_center=0)
    disparity = np.load(folder / "disp.npz")["arr_0"]
    image = cyc.DepthImage.from_stereo(left, disparity, here, calibration["baseline_m"], offset=shift)
    pose = np.eye(4)
    pose[0, 3] = -calibration["baseline_m"]
    there = cyc.Camera(here.K + [[0, 0, shift], [0, 0, 0], [0, 0, 0]], pose, width, height)
    x = np.arange(width) + 0.5
    known = ~image.missing
    places = cyc.warp.map(here, there, image.depth)
    np.testing.assert_allclose(places[..., 0][known], (x - disparity)[known], atol=1e-3)
    for splat in (1, 3, "projected", "disparity"):
        ours = cyc.warp.forward(image, there, splat=splat, order="zbuffer")
        seen = ~ours.hole
        error = np.abs(ours.color[seen].astype(float) - right[seen]).mean()
        assert seen.mean() > 0.75 and error < 9 < 30 < np.abs(left[seen].astype(float) - right[seen]).mean()
    orders = [cyc.warp.forward(image, there, splat=1, order=order) for order in ("occlusion", "zbuffer")]
    assert (orders[0].color != orders[1].color).any(-1).mean() < 1e-3


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"splat": 2}, "odd number"),
        ({"splat": 0}, "odd number"),
        ({"splat": 65}, "1 to 63"),
        ({"splat": "round"}, "projected"),
        ({"splat": 1.0}, "odd number"),
        ({"order": "depth"}, "order must be"),
        ({"threads": 0}, "threads must be"),
        ({"background": np.zeros((2, 2, 3), np.uint8)}, "background must be"),
        ({"background": np.zeros((SIZE[1], SIZE[0], 3))}, "background must be"),
        ({"out": "here"}, "out must be"),
        (
            {"out": cyc.warp.Warped.empty(cyc.Camera.look_at((0, 0, 1), (0, 0, 0), width=3, height=2))},
            "out.color must be",
        ),
        ({"camera": cyc.Camera.orthographic_look_at((0, 0, 1), (0, 0, 0))}, "camera is orthographic"),
        ({"camera": 3}, "camera must be"),
        ({"images": [3]}, r"images\[0\] must be"),
        ({"images": [plane(1.0)] * 256}, "255 at most"),
    ],
)
def test_bad_input_is_said_to_be(change, match):
    arguments = {"images": plane(4.0), "camera": HERE} | change
    with pytest.raises(ValueError, match=match):
        cyc.warp.forward(arguments.pop("images"), arguments.pop("camera"), **arguments)


def test_memory_that_may_not_be_written_is_refused():
    out = cyc.warp.Warped.empty(HERE)
    out.depth.flags.writeable = False
    with pytest.raises(ValueError, match=r"out\.depth must be writeable"):
        cyc.warp.forward(plane(4.0), HERE, out=out)


@pytest.mark.parametrize("depth", [0.0, -1.0, np.nan, np.ones((2, 2))])
def test_map_refuses_depths_that_are_none(depth):
    with pytest.raises(ValueError, match="depth"):
        cyc.warp.map(HERE, HERE, depth)


def test_map_names_the_first_bad_depth():
    depth = np.ones((SIZE[1], SIZE[0]))
    depth[2, 3] = -4
    with pytest.raises(ValueError, match=r"depth\[2, 3\] is -4"):
        cyc.warp.map(HERE, HERE, depth)


def test_fill_refuses_what_it_does_not_know():
    with pytest.raises(ValueError, match="method"):
        cyc.warp.fill(cyc.warp.forward([], HERE), method="magic")
    assert not cyc.warp.fill(cyc.warp.forward([], HERE)).color.any()
