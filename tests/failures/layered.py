"""Where layered depth images fail, and their culling by an octree."""

import numpy as np

import cyclorama as cyc
from cyclorama import Camera, LayeredDepthImage
from cyclorama.ldi import construction_cameras, quadrilateral
from test_ldi import camera_at, random_layers

from . import Shown, failure
from .scenes import fence

MAGENTA = (255, 0, 255)


def shown(warped):
    picture = warped.color.copy()
    picture[warped.hole] = MAGENTA
    return picture


@failure(
    "What no construction image saw",
    method="Layered depth images",
    source="found here: construction images are samples",
    remedy="`build(max_error=..., held_out=...)` adds images until what is held out has few enough holes.",
)
def few_construction_images():
    """Behind the posts of a fence is a wall. A single image knows nothing of what the posts hide from it, and each
    image merged into it knows what its own eye sees."""
    scene = fence()
    eye = np.zeros(3)
    camera = Camera.look_at(eye, (0, 0, -1), fov_y=40, width=160, height=120)
    cameras = construction_cameras(eye, quadrilateral(camera, 0.9), 0.5, (160, 120))
    images = [scene.depth_image(c) for c in cameras]
    target = Camera.look_at(eye + [0.12, 0, 0], (0.12, 0, -1), fov_y=36, width=160, height=120)
    covered = scene.render(target).ids != cyc.BACKGROUND
    curve, pictures = {}, {"truth": scene.render(target).color}
    for merged in (0, 1, 4, 8):
        warped = LayeredDepthImage.build(images[0], images[1 : 1 + merged]).warp(target)
        curve[merged] = float((warped.hole & covered).sum() / covered.sum())
        pictures[f"{merged} merged"] = shown(warped)
    assert curve[0] > 0.03 and curve[8] < 0.2 * curve[0], curve
    return Shown(
        "construction images",
        "share of covered pixels that are holes",
        {"holes": curve},
        f"Alone {curve[0]:.1%} of what is covered is hole, with eight images {curve[8]:.2%}.",
        pictures,
    )


@failure(
    "Half the way to a far picture's edge leaves the star-shape",
    method="Layered depth images",
    source="1998, section 4.3.2, as printed",
    remedy="The steps are clamped to the star-shape's radius.",
)
def construction_outside_the_star_shape():
    """Construction images are to be taken half the way to the middles of the picture's edges, within the star-shape.
    That way grows with the picture's distance: beyond about twice the radius the rule leaves it."""
    camera = Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=45, width=64, height=48)
    printed, clamped = {}, {}
    for distance in (8.0, 4.0, 2.0, 1.2):
        corners = quadrilateral(camera, distance)
        middles = (corners + np.roll(corners, -1, axis=0)) / 2
        printed[distance] = float(np.linalg.norm(middles, axis=1).max() / 2)
        cameras = construction_cameras(camera.eye, corners, 1.0, (64, 48))
        clamped[distance] = float(max(np.linalg.norm(c.eye) for c in cameras))
    # To the middle of the nearer side it is distance / cos(angle), half of that is the step.
    half = np.arctan(np.tan(np.radians(22.5)) * 64 / 48)
    assert abs(printed[8.0] - 4 / np.cos(half)) < 1e-9
    assert printed[8.0] > printed[4.0] > 1 > printed[1.2] and max(clamped.values()) <= 1 + 1e-9
    return Shown(
        "distance of the picture, star radii",
        "distance of construction images, star radii",
        {"as printed": printed, "clamped": clamped},
        f"With the picture at 8 radii construction images would be {printed[8.0]:.1f} radii away; here at most 1.",
    )


@failure(
    "More surfaces than layers",
    method="Layered depth images",
    source="found here",
    remedy="`layers=None` keeps all; `samples` and `nbytes` say what that takes.",
)
def too_few_layers():
    """Posts before a wall: one layer has either a post or the wall in a pixel, and an eye aside looks at the wall where
    a post was."""
    scene = fence()
    here = Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=45, width=160, height=120)
    there = Camera.look_at((0.15, 0, 0), (0.15, 0, -1), fov_y=40, width=160, height=120)
    covered = scene.render(there).ids != cyc.BACKGROUND
    curve, pictures = {}, {"truth": scene.render(there).color}
    for layers in (1, 2, 3):
        warped = LayeredDepthImage.cast(scene, here, layers).warp(there)
        curve[layers] = float((warped.hole & covered).sum() / covered.sum())
        pictures[f"layers: {layers}"] = shown(warped)
    assert curve[1] > 0.03 and curve[2] < 0.2 * curve[1] and curve[3] == curve[2], curve
    return Shown(
        "layers",
        "share of covered pixels that are holes",
        {"holes": curve},
        f"One layer leaves {curve[1]:.1%} of what is covered open, two {curve[2]:.1%}.",
        pictures,
    )


@failure(
    "Nodes of different sizes break the octree's order",
    method="Octree culling of layered images",
    source="LDI culling, section 5: a bigger node behind a smaller one",
    remedy='`cull="exact"` compares depths: not a pixel differs from the picture without culling.',
)
def order_of_nodes():
    """Nodes are visited as if all were of one size. A larger one that reaches behind smaller ones may be visited
    before what hides it, or hide what is before it. With nodes of one size the order holds."""
    rng = np.random.default_rng(3)
    images = [random_layers(rng, camera_at(width=64, height=48, focal=60.0), most=8) for _ in range(6)]
    targets = [camera_at(rng.uniform(-0.6, 0.6, 3), width=64, height=48, focal=60.0) for _ in images]
    curve, differ = {}, {}
    for count in (32, 128, 100_000):
        pairs = list(zip(images, targets, strict=True))
        curve[count] = float(np.mean([i.cull_faults(t, thresholds=(count, 4)).visible_culled for i, t in pairs]))
        exact = [(i.warp(t, cull="exact", thresholds=(count, 4)).color != i.warp(t).color).any() for i, t in pairs]
        differ[count] = float(np.mean(exact))
    assert curve[32] > 0 and curve[100_000] == 0 and max(differ.values()) == 0
    return Shown(
        "samples below which a node is not divided",
        "share of samples visible and culled",
        {'cull="paper"': curve, 'cull="exact"': differ},
        f"With nodes of 32 samples {curve[32]:.2%} of the samples are visible and culled; one node, which "
        "culls nothing, "
        "loses none.",
    )


@failure(
    "Culling finds little where nothing is hidden",
    method="Octree culling of layered images",
    source="found here: culling is made for densely occluded scenes",
    remedy="Culling is off by default; ARCHITECTURE.md has its times. It pays from about four sheets on.",
)
def little_is_hidden():
    """One surface hides nothing of itself: asking costs and saves nothing. Sheets behind each other are what it is
    for."""
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), width=128, height=96)
    moved = Camera.look_at((0.2, 0, 5), (0.2, 0, 0), width=128, height=96)
    curve = {}
    for sheets in (1, 2, 4, 8):
        layered = LayeredDepthImage.cast(cyc.scenes.layers(max(200, 100 * sheets), sheets), camera)
        stats = layered.warp(moved, cull="exact", thresholds=(16, 2)).stats
        curve[sheets] = stats.drawn / (stats.drawn + stats.hidden)
    assert curve[1] == 1 and curve[8] < 0.6
    return Shown(
        "sheets behind each other",
        "share of the samples in the picture that is drawn",
        {"drawn": curve},
        f"Of one sheet all is drawn, of eight {curve[8]:.0%}.",
    )


@failure(
    "Coarse nodes hide nothing",
    method="Octree culling of layered images",
    source="found here: the thresholds are a choice",
    remedy="`thresholds=(64, 4)` is the default; smaller nodes find more and take longer to ask.",
)
def coarse_nodes():
    """A node goes when all pixels of its box are covered. Large boxes reach past the edges of what is before them."""
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), width=128, height=96)
    layered = LayeredDepthImage.cast(cyc.scenes.layers(2000, 8), camera)
    moved = Camera.look_at((0.2, 0, 5), (0.2, 0, 0), width=128, height=96)
    curve = {}
    for side in (64, 32, 8):
        curve[side] = 1 - layered.warp(moved, cull="paper", thresholds=(64, side)).stats.eliminated
    assert curve[64] > curve[32] > curve[8] and curve[64] - curve[8] > 0.2, curve
    return Shown(
        "pixels across below which a node is not divided",
        "share of the samples drawn",
        {"drawn": curve},
        f"Nodes of 64 pixels leave {curve[64]:.0%} of eight sheets to draw, nodes of 8 {curve[8]:.0%}.",
    )
