"""Where images for a budget fail: star-shapes, the model of complexity, cells and budgets."""

import re

import numpy as np

import cyclorama as cyc
from cyclorama import placement

from . import Shown, failure


@failure(
    "The paper's star-shapes are too small",
    method="Star-shapes",
    source="1998, section 3.4.1: 2 r at 54 degrees or more",
    remedy='`star_shape="certified"`, the default, computes the radius for the field of view, to a proven bound.',
)
def star_shapes():
    """Eyes whose closest viewpoint in the reverse frustum is a given one are said to lie within 2 r of it. At the
    paper's own 60 x 46.8 degrees some are farther; a wider field of view mends it."""
    low, high = {}, {}
    for fov in (50.0, 60.0, 75.0, 95.0):
        found = placement.star_radius("even", fov_x=fov, tolerance=0.02)
        low[fov], high[fov] = found.low, found.high
        assert found.low <= found.high <= 1.02 * found.low
        assert np.linalg.norm(found.eye) >= found.low * (1 - 1e-12)
    assert low[60.0] > 2.2 and high[95.0] < 2
    return Shown(
        "field of view across, degrees, 4:3",
        "distance in r (said to be 2 at most)",
        {"an eye was found at": low, "proved bound": high},
        f"At 60 degrees an eye is {low[60.0]:.2f} r away; none is farther than {high[60.0]:.2f} r.",
    )


@failure(
    "The model of complexity forgets the margin",
    method="Placement and budgets",
    source="1998, section 3.5",
    remedy='`placement.predict` gives the printed form beside the "corrected" one.',
)
def margin_of_the_grid():
    """Viewpoints also stand around the model, two rings of them: a grid of 3 x 3 x 3 becomes 7 x 7 x 7. With small
    budgets, and so many viewpoints, the rings matter less."""
    curve = {}
    for share in (0.5, 0.2, 0.05, 0.01, 0.001):
        found = placement.predict(1_000_000, int(share * 1e6), aspect=1)
        curve[share] = found.case("best").viewpoints / found.case("best", "printed").viewpoints
        # (n + 4)^3 against n^3; a grid has at least 3 viewpoints a side.
        n = found.case("best", "printed").viewpoints ** (1 / 3)
        assert abs(curve[share] - ((max(n, 3) + 4) / n) ** 3) < 0.02 * curve[share], (curve, n)
    assert curve[0.5] > 5 and curve[0.001] < 2
    return Shown(
        "budget, of all primitives",
        "viewpoints, times those of the printed form",
        {"with the margin": curve},
        f"At half of all primitives {curve[0.5]:.0f} times the printed viewpoints are there, at a thousandth "
        f"{curve[0.001]:.1f}.",
    )


@failure(
    "A budget smaller than its cells",
    method="Placement and budgets",
    source="found here; 1998 takes cells of the octree as they are",
    remedy="It says which part of the domain is not served, and to raise `leaf_depth` or the budget.",
)
def budget_and_cells():
    """An image replaces whole cells, and the faces in those around an eye are drawn with every image. A budget below
    that number cannot be promised, however many images there are."""
    scene = cyc.scenes.pipes(3000)
    curve = {}
    for share in (0.3, 0.5, 0.8):
        budget = int(share * len(scene))
        try:
            plan = cyc.place_images(scene, budget, progress=False)
        except ValueError as error:
            needed = re.search(r"needs (?:at least )?([\d,]+) faces with any image", str(error))
            assert needed, error
            curve[share] = int(needed[1].replace(",", "")) / budget - 1
        else:
            curve[share] = 0.0
            assert len(plan.frame([0, 0, -0.5], [0, 0, 1]).faces) <= budget
    assert curve[0.3] > curve[0.5] > curve[0.8] == 0
    return Shown(
        "budget, of all faces",
        "faces needed with any image, beyond the budget, share of it",
        {"refused by": curve},
        f"At 30 % of 3,000 faces an eye needs {curve[0.3]:.0%} more than the budget with any image, at 80 % none does.",
    )


@failure(
    "Long faces stay near the root",
    method="Hierarchical culling",
    source="1998, chapter 7: efficient against conventional culling",
    remedy='The "efficient" kind, the default, has such a face in each cell that it intersects, and draws it once.',
)
def long_faces():
    """A face stored once lies in the smallest cell that holds it whole: long ones in the root, which every view
    draws."""
    rng = np.random.default_rng(0)
    centers = rng.uniform(-1, 1, (3000, 3))
    camera = cyc.Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=40, width=64, height=48)
    curves = {"conventional": {}, "efficient": {}}
    for size in (1.0, 0.3, 0.1, 0.01):
        vertices = (centers[:, None] + size * rng.uniform(-0.5, 0.5, (3000, 3, 3))).reshape(-1, 3)
        scene = cyc.Scene(vertices, np.arange(9000).reshape(-1, 3))
        for kind, curve in curves.items():
            curve[size] = len(cyc.octree.Octree(scene, kind, progress=False).cull(camera).faces) / 3000
    assert curves["conventional"][1.0] > curves["efficient"][1.0] + 0.1
    assert curves["conventional"][0.01] < curves["efficient"][0.01] + 0.02
    return Shown(
        "size of the faces, model 2 wide",
        "share of the faces drawn",
        curves,
        f"Faces half as long as the model: {curves['conventional'][1.0]:.0%} drawn by the conventional tree, "
        f"{curves['efficient'][1.0]:.0%} by the efficient one; short ones {curves['conventional'][0.01]:.0%} and "
        f"{curves['efficient'][0.01]:.0%}.",
    )
