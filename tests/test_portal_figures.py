"""Paths through buildings: free of walls, and the figures found along them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama.portals import Building, PortalImages, figures


@pytest.fixture(scope="module")
def home() -> Building:
    house = cyc.scenes.house(rooms=4, seed=2)
    return Building(house, house.cells, house.portals)


def test_a_route_goes_through_all_rooms_and_no_wall(home: Building) -> None:
    eyes, gazes = figures.route(home, 60, start=1, seed=3)
    assert eyes.shape == gazes.shape == (60, 3) and (eyes[:, 1] == 1.6).all()
    np.testing.assert_allclose(np.linalg.norm(gazes, axis=1), 1.0)
    assert not any(home.is_solid(eye) for eye in eyes[::5])
    assert {home._holding(eye) for eye in eyes} >= set(range(4))
    assert home._holding(eyes[0]) == 1
    np.testing.assert_array_equal(eyes, figures.route(home, 60, start=1, seed=3)[0])
    with pytest.raises(ValueError, match="is as high as 9"):
        figures.route(home, 10, height=9.0)


def test_figures_of_a_path(home: Building, tmp_path: Path) -> None:
    cameras = figures.cameras_of(*figures.route(home, 24, start=0), (0, 1, 0), (64, 48))
    frustum, portals = (figures.culling(home, cameras, how) for how in ("frustum", "portals"))  # type: ignore[arg-type]
    assert all(a["faces"] >= b["faces"] for a, b in zip(frustum, portals, strict=True))
    popping: dict[str, list[tuple[float, float]]] = {"static": []}
    for step in (60.0, 10.0):
        images = PortalImages(home, step=step, size=(64, 64))
        cold = figures.walk(images, cameras, truth=False, progress=False)
        warm = figures.walk(images, cameras, progress=False)
        assert sum(row["painted"] for row in cold) > 0 == sum(row["painted"] for row in warm)
        found = figures.summary(warm)
        assert found["psnr"] <= np.nanmean([row["psnr"] for row in warm]) and found["holes"] == 0.0
        popping["static"].append((len(images) / len(images.sides), found["popping"]))
    # Of transitions the faces behind the doors are drawn, too, for some frames.
    assert figures.summary(warm)["faces"] <= figures.summary(frustum)["faces"]
    assert popping["static"][0][1] > popping["static"][1][1] > 0
    paths = {"frustum": frustum, "portals": portals, "images": warm}
    figure = figures.chart_path(paths, "faces", path=tmp_path / "path.png")
    assert [line.get_label() for line in figure.axes[0].get_lines()] == list(paths)
    assert (tmp_path / "path.png").stat().st_size > 5000
    figures.chart_cache({"cold": cold, "warm": warm})
    assert figures.chart_popping(popping).axes[0].get_xscale() == "log"
