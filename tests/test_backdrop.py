"""Scenes with a flat picture in them against rays, one by one, and against the scene itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cyclorama as cyc
from cyclorama import _core
from cyclorama.backdrop import (
    FRAMES,
    IMAGE,
    NEAR,
    NOTHING,
    SURROUNDING,
    Backdrop,
    Backdrops,
    BackdropWalk,
    backdrop,
    check_together,
)
from cyclorama.geometry_warp import bend
from peers import need


@pytest.fixture(scope="module")
def scene() -> cyc.Scene:
    return cyc.scenes.pipes(6_000)


def taken(scene: cyc.Scene, size: tuple[int, int] = (96, 72)) -> cyc.Camera:
    eye = scene.center + scene.radius * np.array([0.1, 0.05, 1.6])
    return cyc.Camera.look_at(eye, scene.center, fov_y=45, width=size[0], height=size[1])


def smaller(camera: cyc.Camera, distance: float) -> np.ndarray:
    """The corners of a quadrilateral over the middle of a camera's image."""
    w, h = camera.width, camera.height
    corners = np.array([(0.3 * w, 0.3 * h), (0.7 * w, 0.3 * h), (0.7 * w, 0.8 * h), (0.3 * w, 0.8 * h)])
    return camera.unproject(corners, np.full(4, distance))


def aside(scene: cyc.Scene, camera: cyc.Camera, share: float) -> cyc.Camera:
    eye = camera.eye + share * scene.radius * np.array([1.0, 0.4, -0.3])
    return cyc.Camera.look_at(eye, scene.center, fov_y=50, width=camera.width, height=camera.height)


def test_the_three_parts_are_the_scene(scene: cyc.Scene) -> None:
    camera = taken(scene)
    drop = Backdrop(scene, smaller(camera, 1.6 * scene.radius), camera)
    parts = [drop.near, drop.image, drop.surrounding]
    assert all(0 < len(part) < len(scene) for part in parts)
    assert len(np.unique(np.concatenate(parts))) == len(scene)


def test_from_the_picture_s_own_eye_the_scene_looks_as_without(scene: cyc.Scene) -> None:
    camera = taken(scene)
    drop = Backdrop(scene, smaller(camera, 1.6 * scene.radius), camera)
    plain, drawn = scene.render(camera), drop.draw(camera)
    assert {NOTHING, NEAR, SURROUNDING, IMAGE} == set(np.unique(drawn.layer))
    # Cut faces have other edges; a pixel centre may lie within rounding of one.
    assert (drawn.color != plain.color).any(-1).mean() < 2e-3
    shown = drawn.ids != cyc.BACKGROUND
    assert (drawn.ids[shown] != plain.ids[shown]).mean() < 2e-3
    # Shading depends on the face and the eye alone, so the image can be told from its geometry only by its depth.
    beside = shown & (drawn.ids == plain.ids)
    np.testing.assert_allclose(drawn.depth[beside], plain.depth[beside], rtol=1e-5)


def test_geometry_alone_is_the_scene(scene: cyc.Scene) -> None:
    camera = taken(scene)
    drop = backdrop(scene, camera, 1.6 * scene.radius)
    for share in (0.1, 0.5):
        other = aside(scene, camera, share)
        plain, drawn = scene.render(other), drop.draw(other, share=0.0)
        assert (drawn.ids != plain.ids).mean() < 2e-3
        assert IMAGE not in drawn.layer


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_each_pixel_shows_what_rays_find(scene: cyc.Scene, share: float) -> None:
    """Near geometry on the eye's own ray; else the image; else what the image's eye sees at that place of the plane."""
    open3d = need("open3d")
    camera = taken(scene)
    drop = Backdrop(scene, smaller(camera, 1.6 * scene.radius), camera)
    other = aside(scene, camera, 0.3)
    drawn = drop.draw(other, share=share)
    caster = open3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices.astype(np.float32), scene.faces)

    def cast(origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
        hit = caster.cast_rays(open3d.core.Tensor(rays))
        return hit["t_hit"].numpy(), hit["primitive_ids"].numpy()

    origins, rays = other.rays()
    plane = drop.plane
    depth = plane.distance(other.eye) / (rays @ plane.normal)
    depth = np.where(depth > 0, depth, np.inf)
    t, ids = cast(origins, rays)
    near = t < depth
    place = origins + rays * np.where(np.isfinite(depth), depth, 1.0)[..., None]
    inside = ((place - plane.eye) @ plane.sides().T >= 0).all(-1) & np.isfinite(depth)
    viewer = other.eye + share * (plane.eye - other.eye)
    # From the place on the plane on, so that nothing before it counts.
    _, beyond = cast(place, place - viewer)
    image = inside & ~near & (share == 1.0)
    expected = np.where(near, ids, np.where(image | ~np.isfinite(depth), cyc.BACKGROUND, beyond))
    layer = np.where(near, NEAR, np.where(image, IMAGE, np.where(expected == cyc.BACKGROUND, NOTHING, SURROUNDING)))
    # Embree works in float32: rays that graze an edge or the plane may go either way.
    unclear = image & (drawn.layer == NOTHING)
    assert (drawn.ids != expected).mean() < 4e-3
    assert ((drawn.layer != layer) & ~unclear).mean() < 4e-3
    if share == 1.0:
        found = cast(np.broadcast_to(plane.eye, place[image].shape).copy(), place[image] - plane.eye)[0]
        assert np.isfinite(found).mean() == pytest.approx((drawn.layer[image] == IMAGE).mean(), abs=0.05)


def test_a_backdrop_before_everything_and_one_behind_everything(scene: cyc.Scene) -> None:
    camera = taken(scene)
    before, behind = backdrop(scene, camera, 0.2 * scene.radius), backdrop(scene, camera, 9 * scene.radius)
    assert len(before.near) == 0 and len(behind.near) == len(scene)
    assert len(behind.image) == len(behind.surrounding) == 0
    plain = scene.render(camera)
    np.testing.assert_array_equal(behind.draw(camera).ids, plain.ids)
    np.testing.assert_array_equal(before.draw(camera).color, plain.color)
    assert before.draw(camera).faces < len(scene)


def test_an_image_that_hides_less_than_the_cuts_add_is_not_used() -> None:
    house = cyc.scenes.house(rooms=2)
    eye = (house.cells[0]["min"] + house.cells[0]["max"]) / 2
    here, there = (cyc.Camera.look_at(eye + [x, 0, 0], eye + [x + 1, 0, 1], width=160, height=120) for x in (0.0, 0.1))
    drop = backdrop(house, here, 2.0)
    assert drop.saved < 0 and len(drop.near) < len(house)
    drawn, plain = drop.draw(there), house.render(there)
    assert drawn.faces == len(house)
    np.testing.assert_array_equal(drawn.ids, plain.ids)
    assert set(np.unique(drawn.layer)) <= {NOTHING, NEAR}


@pytest.mark.parametrize("by", ["faces", "vertices"])
def test_colors_stay_with_what_is_cut(by: str) -> None:
    plain = cyc.scenes.pipes(3_000)
    rng = np.random.default_rng(0)
    colors = rng.integers(0, 256, (len(plain) if by == "faces" else len(plain.vertices), 3), dtype=np.uint8)
    painted = cyc.Scene(plain.vertices, plain.faces, colors)
    camera = taken(painted)
    drop = backdrop(painted, camera, 1.6 * painted.radius)
    other = aside(painted, camera, 0.2)
    same = drop.draw(other, share=0.0).color.astype(int) - painted.render(other).color
    # A cut face's new corners take the colour between, rounded; how it is lit is rounded too.
    assert (np.abs(same) > 2).any(-1).mean() < (2e-3 if by == "faces" else 0.05)


def test_the_image_s_border_meets_the_bent_geometry(scene: cyc.Scene) -> None:
    """Face by face: where the border cuts a face, the part that is geometry ends where the image's part begins."""
    camera = taken(scene, (400, 300))
    drop = Backdrop(scene, smaller(camera, 1.6 * scene.radius), camera)
    both = np.intersect1d(drop.image, drop.surrounding)
    assert len(both) > 20
    other = aside(scene, camera, 0.5)
    plane = drop.plane
    corners = scene.vertices[scene.faces[both]].astype(np.float64)
    inside = (corners - plane.eye) @ plane.sides().T
    checked = 0
    for a, b, p, q in ((0, 1, 0, 1), (1, 2, 1, 2), (2, 0, 2, 0)):
        for side in range(4):
            u, v = inside[:, p, side], inside[:, q, side]
            crosses = (u * v < 0) & (plane.behind(corners[:, a]) > 0) & (plane.behind(corners[:, b]) > 0)
            share = (u / np.where(crosses, u - v, 1.0))[crosses, None]
            point = corners[crosses, a] + share * (corners[crosses, b] - corners[crosses, a])
            bent = other.project(bend(point, plane.corners, plane.eye, other.eye))[0]
            rays = point - plane.eye
            place = plane.eye + rays * (plane.height / (rays @ plane.normal))[:, None]
            ahead = ~np.isnan(bent).any(1)
            checked += ahead.sum()
            assert np.abs(bent - other.project(place)[0])[ahead].max(initial=0) < 1e-3
    assert checked > 20


def test_a_transition_takes_its_frames_and_none_where_nobody_looks(scene: cyc.Scene) -> None:
    camera = taken(scene, (32, 24))
    drop = backdrop(scene, camera, 1.6 * scene.radius)
    walk = BackdropWalk(drop)
    away = cyc.Camera.look_at(camera.eye, 2 * camera.eye - scene.center, width=32, height=24)
    assert not drop.in_view(away) and drop.in_view(camera)

    def shares(camera: cyc.Camera, count: int) -> list[float]:
        return [(walk.frame(camera), walk.share)[1] for _ in range(count)]

    assert shares(camera, 1) == [0.0]
    walk.show()
    assert shares(camera, FRAMES + 1) == [*(k / FRAMES for k in range(1, FRAMES + 1)), 1.0]
    walk.hide()
    assert shares(camera, FRAMES) == [k / FRAMES for k in reversed(range(FRAMES))]
    walk.show()
    assert shares(away, 1) == [1.0]
    walk.hide()
    assert shares(away, 1) == [0.0]


def test_a_step_past_the_image_turns_it_to_geometry_first(scene: cyc.Scene) -> None:
    camera = taken(scene, (32, 24))
    drop = backdrop(scene, camera, 1.6 * scene.radius)
    walk = BackdropWalk(drop, frames=2)
    walk.show()
    for _ in range(2):
        walk.frame(camera)
    assert walk.share == 1.0

    def at(distance: float) -> cyc.Camera:
        eye = camera.eye + (drop.plane.height - distance) * drop.plane.normal
        return cyc.Camera.look_at(eye, eye + drop.plane.normal, width=32, height=24)

    walk.frame(at(0.19 * drop.plane.height))
    assert (walk.share, walk.shown) == (0.5, False)
    past = at(-0.1 * drop.plane.height)
    np.testing.assert_array_equal(walk.frame(past).ids, scene.render(past).ids)
    assert walk.share == 0.0


def test_what_cannot_be_a_backdrop_is_refused(scene: cyc.Scene) -> None:
    camera = taken(scene, (32, 24))
    for distance in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="distance must be positive and finite"):
            backdrop(scene, camera, distance)
    with pytest.raises(ValueError, match="camera is orthographic"):
        backdrop(scene, cyc.Camera.orthographic_look_at((0, 0, 1), (0, 0, 0)), 1.0)
    wide = camera.unproject([(-9, 0), (32, 0), (32, 24), (-9, 24)], np.ones(4))
    with pytest.raises(ValueError, match=r"corners\[0\] is at pixel \[-9.0, -?0.0\], outside"):
        Backdrop(scene, wide, camera)
    drop = backdrop(scene, camera, 1.6 * scene.radius)
    with pytest.raises(ValueError, match="lies behind the image's plane"):
        drop.draw(cyc.Camera.look_at(2 * scene.center - camera.eye, scene.center))
    with pytest.raises(ValueError, match=r"share must lie in \[0, 1\], got 1.5"):
        drop.draw(camera, share=1.5)
    with pytest.raises(ValueError, match="frames must be at least 1"):
        BackdropWalk(drop, frames=0)
    with pytest.raises(ValueError, match="clearance must lie in"):
        BackdropWalk(drop, clearance=1.0)


def test_backdrops_that_cannot_be_shown_together_are_refused() -> None:
    """Two walls back to back: pictures of each bend nothing of the other."""
    wall = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=float)
    vertices = np.concatenate([wall - (0, 0, 5), wall + (0, 0, 5)])
    walls = cyc.Scene(vertices, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])

    def at(eye: tuple[float, float, float], target: tuple[float, float, float], distance: float) -> Backdrop:
        return backdrop(walls, cyc.Camera.look_at(eye, target, fov_y=20, width=16, height=16), distance)

    ahead, behind = at((0, 0, 0), (0, 0, -1), 3.0), at((0, 0, 1), (0, 0, 2), 3.0)
    check_together([ahead, behind])
    check_together([ahead, at((0, 0, 0), (0, 0, -1), 4.0)])
    with pytest.raises(ValueError, match=r"backdrops\[0\] and backdrops\[1\] have different viewpoints .* 2 faces"):
        check_together([ahead, at((0.5, 0, 0), (0.5, 0, -1), 3.5)])
    with pytest.raises(ValueError, match=r"backdrops\[0\] and backdrops\[2\] cut each other"):
        check_together([ahead, behind, at((-1, 0, -3), (0, 0, -3), 1.0)])


def test_two_backdrops_back_to_back_show_what_each_shows_alone() -> None:
    """A wall ahead, one behind, and a post before each; every pixel that one picture stands for is that picture's."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    wall = np.column_stack([x, y, np.zeros(81)])
    low = (np.arange(8) + 9 * np.arange(8)[:, None]).ravel()
    faces = np.concatenate([np.column_stack([low, low + 1, low + 10]), np.column_stack([low, low + 10, low + 9])])
    parts = [wall - (0, 0, 5), wall + (0, 0, 5), 0.1 * wall - (0, 0, 2), 0.1 * wall + (0, 0, 2)]
    colors = np.repeat([[200, 0, 0], [0, 200, 0], [0, 0, 200], [200, 200, 0]], 128, axis=0).astype(np.uint8)
    walls = cyc.Scene(np.concatenate(parts), np.concatenate([faces + 81 * k for k in range(4)]), colors)

    def looking(z: float) -> cyc.Camera:
        return cyc.Camera.look_at((0.05, 0, 0.3), (0, 0, z), fov_y=30, width=48, height=48)

    drops = [
        backdrop(walls, cyc.Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=20, width=64, height=64), 3.0),
        backdrop(walls, cyc.Camera.look_at((0, 0, 1), (0, 0, 2), fov_y=20, width=64, height=64), 3.0),
    ]
    together = Backdrops(drops)
    for drop, z in zip(drops, (-5.0, 5.0), strict=True):
        alone, both = drop.draw(looking(z)), together.draw(looking(z))
        assert {1, 3} <= set(np.unique(alone.layer))
        for name in ("color", "depth", "ids", "layer"):
            np.testing.assert_array_equal(getattr(both, name), getattr(alone, name))
    with pytest.raises(ValueError, match="both bend"):
        Backdrops([drops[0], backdrop(walls, cyc.Camera.look_at((0.5, 0, 0), (0.5, 0, -1), fov_y=20), 3.5)])
    with pytest.raises(ValueError, match=r"have one viewpoint and both stand for face 0: make a Strip"):
        Backdrops([drops[0], backdrop(walls, drops[0].camera, 4.0)])
    with pytest.raises(ValueError, match="backdrops is empty"):
        Backdrops([])


def sampled(picture: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """What the kernel does, by whole arrays."""
    height, width = picture.shape[:2]
    at = np.clip(pixels - 0.5, 0, (width - 1, height - 1))
    low = np.minimum(at.astype(np.intp), (max(width - 2, 0), max(height - 2, 0)))
    part = at - low
    total, weight = np.zeros((len(pixels), 3)), np.zeros(len(pixels))
    for right in range(min(2, width)):
        for down in range(min(2, height)):
            sample = picture[low[:, 1] + down, low[:, 0] + right]
            share = (part[:, 0] if right else 1 - part[:, 0]) * (part[:, 1] if down else 1 - part[:, 1])
            share = share * (sample[:, 3] > 0)
            total += share[:, None] * sample[:, :3]
            weight += share
    opaque = weight >= 0.5
    out = np.zeros((len(pixels), 4), np.uint8)
    out[opaque, :3] = (total[opaque] / weight[opaque, None]).round()
    out[opaque, 3] = 255
    return out


@given(seed=st.integers(0, 2**32 - 1), width=st.integers(1, 5), height=st.integers(1, 5))
def test_pictures_are_sampled_as_by_whole_arrays(seed: int, width: int, height: int) -> None:
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 256, (height, width, 4), dtype=np.uint8)
    picture[rng.random((height, width)) < 0.3, 3] = 0
    at = rng.uniform(-1, 6, (50, 2))
    at[::5] = np.floor(at[::5]) + 0.5
    np.testing.assert_array_equal(_core.sample(picture, at), sampled(picture, at))


def test_opaque_pictures_are_sampled_as_by_opencv() -> None:
    """`remap` has positions to the 32nd of a pixel: so much of the steepest step is off, and a level of rounding."""
    cv2 = need("cv2")
    rng = np.random.default_rng(3)
    picture = cv2.GaussianBlur(rng.integers(0, 256, (40, 50, 4), dtype=np.uint8), (0, 0), 2.0)
    picture[..., 3] = 255
    at = rng.uniform((1, 1), (49, 39), (1000, 2))
    columns, rows = (at - 0.5).astype(np.float32).T
    theirs = cv2.remap(picture, columns[None], rows[None], cv2.INTER_LINEAR)[0]
    step = max(np.abs(np.diff(picture.astype(int), axis=axis)).max() for axis in (0, 1))
    ours = _core.sample(picture, at)
    assert np.abs(ours.astype(int) - theirs).max() <= 1 + 2 * step / 64


def test_what_cannot_be_sampled_is_refused() -> None:
    for picture, match in (
        (np.zeros((0, 3, 4), np.uint8), "picture has no pixel"),
        (np.zeros((4, 1, 3), np.uint8), r"picture must be \(H, W, 4\) and at \(N, 2\), got \[4, 1, 3\]"),
    ):
        with pytest.raises(ValueError, match=match):
            _core.sample(picture, np.zeros((1, 2)))
