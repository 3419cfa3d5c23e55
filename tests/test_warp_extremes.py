"""Numbers far out of range, and eyes on surfaces: warps lose nothing more than geometry says, and no time."""

import time

import numpy as np
import pytest

from cyclorama import DepthImage, warp
from failures.warps import SPLATS, looking, plain


@pytest.mark.parametrize("splat", SPLATS)
def test_extreme_disparity(splat):
    """Depths sixty powers of ten apart: what is drawn is drawn where float64 says, and no time is lost."""
    here = looking((0, 0, 0), size=(60, 40))
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (40, 60, 3), dtype=np.uint8)
    image = DepthImage(color, 10.0 ** rng.uniform(-30, 30, (40, 60)), here)
    for distance in (0.0, 1e-25, 1e-3, 1.0, 1e25):
        there = looking((distance, 0.3 * distance, -0.1 * distance), size=(60, 40))
        start = time.perf_counter()
        out = warp.forward(image, there, splat=splat)
        assert time.perf_counter() - start < 2
        known = ~out.hole
        assert (out.depth[known] > 0).all() and not np.isnan(out.depth).any()
        at = warp.map(here, there, image.depth)
        inside = np.isfinite(at).all(axis=-1) & (at >= 0).all(axis=-1) & (at < (60, 40)).all(axis=-1)
        if distance == 0 and splat in (1, "mesh"):
            assert (out.color == color).all()
        # Samples that stay in the picture are in it, or behind others.
        x, y = np.floor(at[inside]).astype(int).T
        assert known[y, x].mean() > 0.98


@pytest.mark.parametrize("seed", range(20))
def test_smooth_surfaces_of_extreme_depths(seed):
    """Whole blocks whose numbers leave the range of float32 are left out; nothing else is lost, and nothing breaks."""
    rng = np.random.default_rng(seed)
    here = looking((0, 0, 0), size=(40, 30))
    x, y = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 30))
    scale = 10.0 ** rng.uniform(-29, 29)
    image = DepthImage(np.full((30, 40, 3), 5, np.uint8), scale * (1 + x + y * rng.uniform(0, 1)), here)
    for away in 10.0 ** rng.uniform(-40, 40, 20):
        there = looking(away * rng.standard_normal(3), (*rng.uniform(-0.5, 0.5, 2), -1), size=(40, 30))
        out = warp.forward(image, there, splat="mesh")
        assert (out.depth[~out.hole] > 0).all() and (out.color[~out.hole] == 5).all()
        if away < 1e-4 * scale:
            assert not out.hole.all()


def test_an_eye_on_the_surface_takes_no_time():
    """A mesh whose triangles fill the whole picture, each: the largest are drawn, and those behind the eye are not."""
    here = looking((0, 0, 0), size=(320, 240))
    x = np.linspace(0, 40, 320)
    image = plain(here, 2 + 0.01 * np.sin(x))
    for eye in ((0, 0, -1.9899), (0.3, 0, -1.995), (0, 0, -2.0)):
        for forward in ((0, 0, -1), (1, 0, 0), (1, 0, -0.01)):
            start = time.perf_counter()
            out = warp.forward(image, looking(eye, forward, size=(320, 240)), splat="mesh")
            assert time.perf_counter() - start < 2
            assert (out.depth[~out.hole] > 0).all()
