"""Several flat pictures around one viewpoint against one of them alone, the scene itself, and each other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.backdrop import IMAGE, NEAR, SURROUNDING, Backdrop, Composed
from cyclorama.geometry_warp import ImagePlane
from cyclorama.placing import camera_through
from cyclorama.strip import Strip, _between


@pytest.fixture(scope="module")
def scene() -> cyc.Scene:
    return cyc.scenes.pipes(6_000)


def viewpoint(scene: cyc.Scene) -> np.ndarray:
    return scene.center + scene.radius * np.array([0.0, 0.0, 1.5])


def panels(
    scene: cyc.Scene, edges: list[tuple[float, float]], low: float = -0.25, high: float = 0.3
) -> list[np.ndarray]:
    """Upright quadrilaterals between edges (x, z), in radii from the centre."""
    quads = []
    for (x0, z0), (x1, z1) in pairwise(edges):
        quad = np.array([[x0, high, z0], [x1, high, z1], [x1, low, z1], [x0, low, z0]])
        quads.append(scene.center + scene.radius * quad)
    return quads


BENT = [(-0.5, 0.3), (-0.1, 0.1), (0.2, 0.15), (0.45, 0.35)]


def looking(scene: cyc.Scene, move: tuple[float, float, float] = (0, 0, 0)) -> cyc.Camera:
    eye = viewpoint(scene) + scene.radius * np.array(move)
    return cyc.Camera.look_at(eye, scene.center, fov_y=55, width=160, height=120)


def test_one_image_is_a_backdrop(scene: cyc.Scene) -> None:
    quad = panels(scene, BENT[1:3])[0]
    camera = camera_through(viewpoint(scene), quad, (96, 96))
    strip, drop = Strip(scene, viewpoint(scene), [quad], size=(96, 96)), Backdrop(scene, quad, camera)
    # Of faces at the border, the parts that the seams cut off tell more exactly whether they reach behind the image.
    assert np.isin(strip.faces(0), drop.image).all() and len(strip.faces(0)) > 0.95 * len(drop.image)
    for move in ((0, 0, 0), (0.2, 0.1, -0.1)):
        # Here the cuts add more faces than the image hides: a backdrop alone would show the scene as it is.
        one, other = strip.draw(looking(scene, move)), Composed.empty(looking(scene, move))
        drop.part.draw(other, drop.plane.eye, image=True)
        # The strip cuts faces behind the viewpoint too, and in other places.
        assert (one.layer != other.layer).mean() < 2e-3
        assert (one.ids != other.ids).mean() < 2e-3


def test_from_the_viewpoint_the_scene_looks_as_without(scene: cyc.Scene) -> None:
    strip = Strip(scene, viewpoint(scene), panels(scene, BENT), size=(400, 300))
    camera = looking(scene)
    plain, drawn = scene.render(camera), strip.draw(camera)
    assert {NEAR, SURROUNDING, IMAGE} <= set(np.unique(drawn.layer))
    geometry = drawn.layer != IMAGE
    assert (drawn.ids != plain.ids)[geometry].mean() < 3e-3
    # Pictures have pixels of their own: edges in them are a blend of both sides.
    close = np.abs(drawn.color.astype(int) - plain.color).max(-1) < 40
    assert close[drawn.layer == IMAGE].mean() > 0.9


def test_neighbouring_planes_bend_their_seam_alike(scene: cyc.Scene) -> None:
    strip = Strip(scene, viewpoint(scene), panels(scene, BENT))
    eye = looking(scene, (0.3, 0.1, -0.2)).eye
    rng = np.random.default_rng(0)
    for left, right in pairwise(strip.planes):
        share, reach = rng.uniform(0, 1, (40, 1)), rng.uniform(1.0, 9.0, (40, 1))
        seam = left.corners[1] * (1 - share) + left.corners[2] * share
        points = np.column_stack([left.eye + (seam - left.eye) * reach, np.ones(40)])
        np.testing.assert_allclose(points @ left.shear(eye).T, points @ right.shear(eye).T, atol=1e-9 * scene.radius)


def test_an_image_in_the_middle_comes_and_goes_without_a_step(scene: cyc.Scene) -> None:
    strip = Strip(scene, viewpoint(scene), panels(scene, BENT), size=(400, 300))
    camera = looking(scene, (0.25, 0.05, -0.1))
    with_image = strip.draw(camera)
    strip.hide(1)
    assert strip.shown == [True, False, True]
    without = strip.draw(camera)
    strip.show(1)
    np.testing.assert_array_equal(strip.draw(camera).color, with_image.color)
    swapped = (with_image.layer == IMAGE) & (without.layer == SURROUNDING)
    assert swapped.sum() > 100
    # What the geometry shows there is what the picture shows, at the picture's pixels.
    close = np.abs(with_image.color.astype(int) - without.color).max(-1) < 40
    assert close[swapped].mean() > 0.9
    elsewhere = (with_image.layer != IMAGE) & (without.layer == with_image.layer)
    assert (with_image.ids == without.ids)[elsewhere].all()
    with pytest.raises(ValueError, match="image 0 is at the strip's end: drop it"):
        strip.hide(0)


def test_a_gap_is_spanned_by_geometry(scene: cyc.Scene) -> None:
    quads = panels(scene, BENT)
    whole, gap = Strip(scene, viewpoint(scene), quads, size=(200, 150)), Strip(scene, viewpoint(scene), quads[::2])
    assert (gap.virtual, whole.virtual) == ([False, True, False], [False] * 3)
    assert len(gap.shown) == 2
    camera = looking(scene, (0.2, 0.0, -0.1))
    whole.hide(1)
    one, other = whole.draw(camera), gap.draw(camera)
    assert (one.ids != other.ids).mean() < 3e-3


@pytest.mark.parametrize("end", [0, 2])
def test_dropping_an_end_ends_where_the_rest_begins(scene: cyc.Scene, end: int) -> None:
    strip = Strip(scene, viewpoint(scene), panels(scene, BENT), size=(64, 48))
    camera = looking(scene, (0.2, 0.05, -0.1))
    pictures, rest = strip.drop(end, [camera] * 4)
    assert rest is not None and len(pictures) == 4 and len(rest.shown) == 2
    last = rest.draw(camera)
    # The wedge beyond the new end is cut in two by the seam of the image that left.
    assert (pictures[-1].ids != last.ids).mean() < 4e-3
    with pytest.raises(ValueError, match="image 1 of 3 is not at the strip's end"):
        strip.drop(1, [camera])


def test_dropping_the_last_one_leaves_the_scene(scene: cyc.Scene) -> None:
    strip = Strip(scene, viewpoint(scene), panels(scene, BENT[1:3]), size=(64, 48))
    camera = looking(scene, (0.2, 0.05, -0.1))
    pictures, rest = strip.drop(0, [camera] * 3)
    assert rest is None
    assert (pictures[-1].ids != scene.render(camera).ids).mean() < 3e-3


def test_a_turning_plane_moves_points_straight_and_keeps_the_seam(scene: cyc.Scene) -> None:
    first, second = (ImagePlane.of(quad, viewpoint(scene)) for quad in panels(scene, BENT[:3]))
    eye = looking(scene, (0.2, 0.1, -0.1)).eye
    rng = np.random.default_rng(0)
    points = np.column_stack([scene.center + scene.radius * rng.uniform(-1, 1, (30, 3)), np.ones(30)])
    start, end = points @ first.shear(eye).T, points @ second.shear(eye).T
    for share in (0.0, 0.3, 1.0):
        plane = _between(first, second, share)
        np.testing.assert_allclose(points @ plane.shear(eye).T, (1 - share) * start + share * end, atol=1e-9)
        np.testing.assert_allclose(plane.behind(first.corners[1:3]), 0, atol=1e-12 * scene.radius)


def test_what_cannot_be_a_strip_is_refused(scene: cyc.Scene) -> None:
    eye, quads = viewpoint(scene), panels(scene, BENT)
    nearer = eye + 0.8 * (quads[1] - eye)
    leaning = quads[1].copy()
    leaning[1] += (quads[1][1] - quads[1][0]) * 0.1
    wide = [
        eye + np.array([[x, 1, -z], [a, 1, -c], [a, -1, -c], [x, -1, -z]])
        for x, z, a, c in ((-3, -1, 0, 1), (0, 1, 3, -1))
    ]
    for given, match in (
        ([], "corners is empty"),
        ([quads[0], nearer], r"corners\[0\] and corners\[1\] meet in one direction at different depths"),
        ([quads[1], quads[0]], "overlap, or are not from left to right"),
        ([quads[0], leaning], r"the right edge of corners\[1\] leans by"),
        ([quads[0], quads[1][::-1]], r"corners\[1\]: corners must be top-left"),
        (wide, "degrees around the viewpoint"),
    ):
        with pytest.raises(ValueError, match=match):
            Strip(scene, eye, given)
    strip = Strip(scene, eye, quads)
    with pytest.raises(ValueError, match="image must be 0 to 2, got 3"):
        strip.faces(3)
    with pytest.raises(ValueError, match="cameras is empty"):
        strip.drop(0, [])
    with pytest.raises(ValueError, match="behind the image's plane"):
        strip.draw(looking(scene, (0, 0, -1.6)))
