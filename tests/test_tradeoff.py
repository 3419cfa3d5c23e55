"""Cost against error: rows, their meaning, the chart."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import tradeoff as make
from cyclorama.framing import Framing
from cyclorama.tradeoff import COSTS, Tradeoff

SMALL = {"resolution": (96, 90), "progress": False}


@pytest.fixture(scope="module")
def gear():
    return cyc.scenes.gear(faces=3000)


@pytest.fixture(scope="module")
def chart(gear):
    return make(gear, [6, 18, 66], [None, 60, 20], join="samples", eval_views=12, seed=5, **SMALL)


def column(chart, name, patches):
    return [row[name] for row in chart.rows if row["patches"] == patches]


def test_rows_come_in_order_with_every_figure(chart):
    assert [(row["views"], row["patches"]) for row in chart.rows] == [
        (v, p) for v in (6, 18, 66) for p in (None, 60, 20)
    ]
    for row in chart.rows:
        assert {"time", "bytes", "query", "missed", "culled", "backfacing", "occluded", "false"} <= set(row)
        assert row["time"] > 0 and row["bytes"] > 0 and row["query"] > 0
        assert row["missed_low"] <= row["missed"] <= row["missed_high"]
        assert row["missed"] <= row["missed_worst"] <= 1 and row["missed"] <= row["missed_bound"]
        assert row["culled"] == pytest.approx(row["backfacing"] + row["occluded"])
        assert row["culled"] == pytest.approx(1 - row["drawn"])
        assert 0 <= row["false"] < 1


def test_more_views_cull_more_and_fewer_patches_cull_less(chart):
    assert np.diff(column(chart, "culled", None)).min() > 0
    for patches in (60, 20):
        culled = column(chart, "culled", patches)
        assert np.diff(culled).min() >= 0 and culled[-1] > culled[0]
    for views in range(3):
        assert column(chart, "culled", None)[views] > column(chart, "culled", 60)[views]
        assert column(chart, "missed", None)[views] >= column(chart, "missed", 60)[views]


def test_a_row_says_what_a_bake_of_its_own_says(gear, chart):
    row = next(row for row in chart.rows if (row["views"], row["patches"]) == (18, 60))
    vis = cyc.bake(gear, 18, 60, (96, 90), join="samples", progress=False)
    directions = np.random.default_rng(5).normal(size=(12, 3))
    cameras = Framing.of(gear, (96, 90)).cameras(directions)
    missed, drawn = [], []
    for camera in cameras:
        faces = vis.visible_faces(camera.eye)
        ids = gear.render(camera).ids
        covered = ids[ids != cyc.BACKGROUND]
        missed.append(1 - np.isin(covered, faces).mean())
        drawn.append(len(faces) / len(gear))
    assert row["missed"] == pytest.approx(np.mean(missed))
    assert row["drawn"] == pytest.approx(np.mean(drawn))


def test_half_of_a_closed_convex_mesh_faces_away_and_none_of_it_is_hidden():
    scene = cyc.scenes.sphere(faces=320)
    chart = make(scene, [258], [None], join="samples", eval_views=8, **SMALL)
    row = chart.rows[0]
    assert row["occluded"] == pytest.approx(0, abs=1e-3)
    assert 0.4 < row["backfacing"] < 0.7
    turned = cyc.Scene(scene.vertices, scene.faces[:, ::-1])
    assert make(turned, [258], [None], join="samples", eval_views=8, **SMALL).rows[0]["backfacing"] == row["backfacing"]


def test_a_mesh_wound_both_ways_has_no_back_faces_to_tell():
    scene = cyc.scenes.sphere(faces=320)
    faces = scene.faces.copy()
    faces[::2] = faces[::2, ::-1]
    row = make(cyc.Scene(scene.vertices, faces), [6], [None], join="samples", eval_views=4, **SMALL).rows[0]
    assert row["backfacing"] is None and row["occluded"] is None and row["culled"] > 0


def test_a_refused_combination_is_a_row_with_its_error(gear):
    chart = make(gear, [3, 6], [None], join="samples", eval_views=2, **SMALL)
    assert "views" in chart.rows[0]["error"]
    assert "missed" in chart.rows[1]
    assert "error" in chart.table()


def test_fill_join_and_resolution_can_be_varied(gear):
    chart = make(
        gear, [6], [None], resolution=[(48, 48), (96, 96)], fill=["rays", None], join=["samples"], eval_views=3,
        progress=False,
    )  # fmt: skip
    assert len(chart.rows) == 4 and len(chart.series) == 4
    by_fill = {(row["resolution"], row["fill"]): row for row in chart.rows}
    assert by_fill[(48, 48), None]["culled"] > by_fill[(48, 48), "rays"]["culled"]


def test_the_table_says_how_many_patches_were_made_where_they_are_not_as_asked():
    scene = cyc.scenes.nested_boxes(3)
    small = {"resolution": (32, 30), "eval_views": 3, "progress": False}
    made = cyc.tradeoff(scene, views=[6], patches=[None, 2], **small).table()
    assert "made_patches" in made and "|            3 |" in made
    assert "made_patches" not in cyc.tradeoff(scene, views=[6], patches=[None, 4], **small).table()


def test_best_is_the_cheapest_that_meets_the_error_and_says_how_near_it_came(chart):
    by_hand = [row for row in chart.rows if row["missed_high"] <= 0.02]
    assert chart.best(max_missed=0.02) == min(by_hand, key=lambda row: row["bytes"])
    assert chart.best(0.02, minimise="drawn") == min(by_hand, key=lambda row: row["drawn"])
    with pytest.raises(ValueError, match="the least is"):
        chart.best(max_missed=-1)


def test_seeds_repeat(gear, chart):
    again = make(gear, [6], [None, 60], join="samples", eval_views=12, seed=5, **SMALL)
    timed = ("time", "query")
    for row, twin in zip(again.rows, chart.rows, strict=False):
        assert {k: v for k, v in row.items() if k not in timed} == {k: v for k, v in twin.items() if k not in timed}


def test_the_chart_is_drawn_with_every_series_and_zero_in_a_band_of_its_own(chart, tmp_path):
    pytest.importorskip("matplotlib", reason="draws the chart")
    perfect = [dict(row) for row in chart.rows]
    perfect[-1] |= {"missed": 0.0, "missed_low": 0.0, "missed_high": 0.0}
    figure = Tradeoff(perfect, chart.eval_views, chart.faces).plot(tmp_path / "chart.png", costs=list(COSTS))
    assert (tmp_path / "chart.png").read_bytes().startswith(b"\x89PNG")
    assert [panel.get_xlabel() for panel in figure.axes] == list(COSTS.values())
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend[1:] == ["a bit per face", "60 patches", "20 patches"]
    bottom = figure.axes[0].get_ylim()[0]
    dots = np.concatenate([line.get_ydata() for line in figure.axes[0].lines])
    assert (dots > bottom).all()
    assert any("none missed in 12 views" in text.get_text() for text in figure.axes[0].texts)


def test_a_chart_of_nothing_and_an_unknown_cost_are_refused(gear, chart):
    pytest.importorskip("matplotlib", reason="draws the chart")
    with pytest.raises(ValueError, match="money"):
        chart.plot(costs=["money"])
    with pytest.raises(ValueError, match="failed"):
        make(gear, [3], [None], eval_views=2, **SMALL).plot()


def test_notebooks_get_a_table_and_pandas_the_rows(chart, monkeypatch):
    assert chart._repr_html_().count("<tr>") == 1 + len(chart.rows)
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=lambda rows: ("frame of", rows)))
    assert chart.to_dataframe() == ("frame of", chart.rows)


def test_bad_input_is_refused_before_any_work(gear):
    with pytest.raises(ValueError, match="eval_views"):
        make(gear, [6], eval_views=0)
    with pytest.raises(ValueError, match="resolution"):
        make(gear, [6], resolution=(0, 480))
    with pytest.raises(ValueError, match="patches"):
        make(gear, [6], patches=[])
