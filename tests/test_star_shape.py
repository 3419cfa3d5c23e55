"""Radii of star-shapes against eyes that were found without them."""

import numpy as np
import pytest

from cyclorama import placement

# Field of view, then the largest distances that hill climbing from random eyes reached on endless grids: even level and
# level gazes, even level and all gazes, odd level and level gazes.
CLIMBED = [
    (60.0, 60.0, 2.00, 2.33, 2.64),
    (60.0, 46.8, 2.27, 2.34, 2.74),
    (54.0, 54.0, 2.15, 2.47, 2.82),
    (45.0, 45.0, 2.46, 2.78, 3.20),
    (90.0, 90.0, 1.66, 1.85, None),
    (40.0, 30.0, 2.95, 3.03, None),
]


def aspect_of(fov_x, fov_y):
    return np.tan(np.radians(fov_x / 2)) / np.tan(np.radians(fov_y / 2))


def closest(others, eye, forward, fov_x, aspect):
    """Whether the viewpoint at zero is the closest in an eye's reverse frustum: asks every viewpoint."""
    right = np.cross(forward, (0, 1, 0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    across = np.tan(np.radians(fov_x / 2))

    def behind(viewpoints):
        offsets = eye - viewpoints
        x, y, z = (offsets @ axis for axis in (right, up, forward))
        return (np.abs(x) <= z * across) & (np.abs(y) <= z * across / aspect)

    nearer = np.linalg.norm(eye - others, axis=1) < np.linalg.norm(eye)
    return behind(np.zeros((1, 3)))[0] and not (behind(others) & nearer).any()


@pytest.mark.parametrize(("fov_x", "fov_y", "even", "every", "odd"), CLIMBED)
def test_radii_reach_the_eyes_that_were_climbed_to(fov_x, fov_y, even, every, odd):
    aspect = aspect_of(fov_x, fov_y)
    wanted = [("even", (0, 360), 0.01, even), ("even", None, 0.03, every), ("odd", (0, 360), 0.01, odd)]
    for level, yaws, tolerance, least in wanted:
        if least is None:
            continue
        found = placement.star_radius(level, fov_x=fov_x, aspect=aspect, yaws=yaws, tolerance=tolerance)
        # The distances have two digits after the point.
        assert found.high >= least - 0.005
        assert found.low * (1 - 1e-12) <= np.linalg.norm(found.eye) and found.high <= found.low * (1 + tolerance)
        # Above what the climbing missed by at most: it is a bound, and not just any.
        assert found.low <= least * 1.03


def test_the_paper_s_spheres_are_broken_at_its_own_frames():
    even, odd = (placement.star_radius(level) for level in ("even", "odd"))
    assert even.low > 2 and odd.high < 3
    grid = placement.lattice("even", 7)
    assert closest(grid, even.eye * (1 - 1e-9), even.forward, 60, 4 / 3)
    assert not closest(grid, even.eye * (1 + 1e-6), even.forward, 60, 4 / 3)


@pytest.mark.parametrize("seed", range(4))
def test_no_random_eye_is_farther(seed):
    rng = np.random.default_rng(seed)
    grid = placement.lattice("even", 5)
    others = grid + rng.uniform(-0.25, 0.25, grid.shape)
    yaws = (30.0, 200.0)
    found = placement.star_radius(others, fov_x=80, aspect=1.2, yaws=yaws, tolerance=0.02)
    reached = 0.0
    for _ in range(3000):
        angle = np.radians(rng.uniform(*yaws))
        forward = np.array([np.sin(angle), 0, np.cos(angle)])
        eye = rng.uniform(0, found.high * 1.5) * (forward + rng.uniform(-0.6, 0.6, 3))
        if closest(others, eye, forward, 80, 1.2):
            reached = max(reached, np.linalg.norm(eye))
    assert reached <= found.high * (1 + 1e-12)
    # The search above finds something: else this says nothing.
    assert reached > 0.5 * found.low


def test_a_domain_and_a_range_of_yaws_shrink_it():
    grid = placement.lattice("even", 6)
    whole = placement.star_radius(grid)
    box = [[-1, -1, -1], [1, 1, 1]]
    assert placement.star_radius(grid, domain=box).high <= min(whole.high, 3**0.5)
    # All eyes are on the far side of where the viewpoint's frusta go.
    ahead = [[-1, -1, 1], [1, 1, 2]]
    assert placement.star_radius(grid, yaws=(150, 210), domain=ahead).high == 0
    assert placement.star_radius(grid, yaws=(-30, 30), domain=ahead).low > 1
    parts = [placement.star_radius(grid, yaws=(a, a + 90), tolerance=0.01) for a in range(0, 360, 90)]
    assert max(p.high for p in parts) >= whole.low and max(p.low for p in parts) <= whole.high


def test_wider_fields_and_more_viewpoints_shrink_it():
    radii = [placement.star_radius("even", fov_x=fov).high for fov in (50, 60, 75, 95)]
    assert radii == sorted(radii, reverse=True)
    grid = placement.lattice("even", 6)
    denser = np.concatenate([grid, placement.lattice("even", 12) / 2])
    assert placement.star_radius(denser).high < placement.star_radius(grid).high
    alone = placement.star_radius(np.zeros((0, 3)))
    assert alone.low == alone.high == np.inf


def test_lattices_are_those_of_figure_3_11():
    assert len(placement.lattice("even", 1.8)) == 26
    assert len(placement.lattice("odd", 1.8)) == 14
    # Around the middle of an edge: its ends and four centres; 12 more edges touch the block.
    assert len(placement.lattice("odd", 1.8, place=(1, 0, 0))) == 2 + 4 + 8
    with pytest.raises(ValueError, match="two odd coordinates"):
        placement.lattice("odd", 1, place=(1, 1, 0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"viewpoints": "odder"}, "viewpoints must be"),
        ({"viewpoints": [[0, 0, 0]]}, "one of them is at zero"),
        ({"viewpoints": [[0, np.inf, 0]]}, "finite"),
        ({"fov_x": 0}, "fov_x"),
        ({"fov_x": 1}, "too narrow"),
        ({"tolerance": 0}, "tolerance"),
        ({"yaws": (10, 5)}, "yaws"),
        ({"domain": [[0, 0, 0]]}, "domain"),
        ({"most": 0}, "most"),
    ],
)
def test_bad_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        placement.star_radius(**({"viewpoints": "even"} | change))
