"""Sweeps of the methods: what they say against the methods asked directly, and files of rows."""

import numpy as np
import pytest

import cyclorama as cyc
from cyclorama import lab, sweeps
from cyclorama.ldi import construction_cameras, quadrilateral
from cyclorama.portals import Building
from failures.scenes import fence
from peers import need


def looking(x, size=(64, 48)):
    return cyc.Camera.look_at((x, 0, 0), (x, 0, -1), fov_y=40, width=size[0], height=size[1])


def test_warps_are_compared_with_the_scene_drawn_again():
    rows = sweeps.warps(fence(), looking(0), [looking(0.1)], splats=[1, 3], orders=["zbuffer"], rounds=1, grain=0.5)
    assert [row["splat"] for row in rows] == [1, 3] and all(row["time"] > 0 for row in rows)
    assert rows[0]["holes"] > rows[1]["holes"] > 0.02
    here = sweeps.warps(fence(), looking(0), [looking(0)], splats=[1], orders=["zbuffer"], rounds=1)
    assert here[0]["rms"] == here[0]["holes"] == here[0]["cracks"] == 0


def test_construction_images_fill_holes_and_take_room():
    camera = looking(0)
    cameras = construction_cameras(camera.eye, quadrilateral(camera, 0.9), 0.5, (64, 48))
    rows = sweeps.construction(fence(), cameras, [looking(0.12)], merged=[0, 8], rounds=1)
    assert rows[0]["holes"] > 0.03 > rows[1]["holes"]
    assert rows[0]["bytes"] < rows[1]["bytes"] and rows[0]["samples"] < rows[1]["samples"]


def test_budgets_say_what_is_drawn_and_what_is_refused_with_any_option_varied():
    options = {"targets": [0.7], "vary": {"shell": [0, 1]}, "leaf_depth": 3, "frames": 10}
    rows = sweeps.budgets(cyc.scenes.pipes(2000), [0.2, 0.9], **options, progress=False)
    assert "too small" in rows[0]["error"]
    assert [(row["share"], row["target"], row["shell"]) for row in rows[2:]] == [(0.9, 0.7, 0), (0.9, 0.7, 1)]
    for row in rows[2:]:
        assert 0 < row["drawn"] <= row["budget"] and row["wrong"] == row["not_proved"] == 0
    assert rows[3]["images"] - rows[2]["images"] == 6, "one before each side of the scene"


def test_searches_are_judged_by_what_no_image_exceeds():
    scene = cyc.scenes.pipes(5000)
    searches = [{"search": "paper", "lookahead": 0}, {"search": "windows"}, {"search": "windows", "gap": 0.3}]
    rows = sweeps.optimisers(scene, [0.2, 2.0], searches=searches, leaf_depth=3, rounds=1, progress=False)
    paper, best, loose = rows[:3]
    assert paper["views"] == best["views"] > 3
    assert 0 <= best["short"] <= 0.001 < paper["short"]
    assert best["short"] < loose["short"] <= 0.3
    assert [row["views"] for row in rows[3:]] == [0, 0, 0], "no view has more than twice the scene"


def test_star_shapes_stand_beside_eyes_that_were_sampled():
    rows = sweeps.star_shapes([60, 110], levels=["even"], eyes=3000, progress=False)
    for row in rows:
        assert row["low"] <= row["radius"] <= 1.02 * row["low"]
        assert 0.8 * row["low"] < row["farthest"] <= row["radius"]
    narrow, wide = rows
    assert narrow["outside"] > 0 == wide["outside"], "the dissertation's sphere is too small for narrow frames"
    beyond = sweeps.star_shapes([60], levels=["even"], yaws=[(0, 0)], eyes=500, progress=False)[0]
    assert beyond["radius"] <= narrow["radius"]


def test_walks_take_more_room_for_more_slabs_and_references():
    track = [(0.0, 0, 0), (0.8, 0, 0)]
    rows = sweeps.panoramas(
        fence(),
        track,
        slabs=[1, 2],
        spacing=[0.8, 0.4],
        size=(256, 64),
        ahead=[(0, 0, -1)],
        grain=1.0,
        allow_outside=True,
        progress=False,
    )
    found = {(row["slabs"], row["spacing"]): row for row in rows}
    assert [found[1, 0.8]["references"], found[1, 0.4]["references"]] == [2, 3]
    assert found[1, 0.8]["holes"] > found[2, 0.8]["holes"]
    assert found[1, 0.4]["bytes"] > found[1, 0.8]["bytes"]


def test_pictures_in_doors_save_faces():
    house = cyc.scenes.house(rooms=2, seed=0)
    building = Building(house, house.cells, house.portals)
    eye = (house.cells[0]["min"] + house.cells[0]["max"]) / 2
    cameras = [
        cyc.Camera.look_at(eye, eye + gaze, width=48, height=36) for gaze in ([1, 0, 0.1], [-1, 0, 0.1], [0.1, 0, 1])
    ]
    rows = sweeps.portal_images(building, cameras, kinds=["static"], steps=[30, 10], size=(48, 48), progress=False)
    assert rows[0]["images"] < rows[1]["images"]
    assert all(row["faces"] <= row["portals"] for row in rows)


ROWS = [
    {"views": 6, "size": (510, 480), "fill": "rays", "missed": 0.25, "exact": True},
    {"views": np.int64(18), "size": (96, 90), "fill": None, "missed": np.float64(1e-300), "exact": False},
    {"views": 66, "size": (1, 1), "fill": "18", "error": 'ValueError: a, b\n"c"'},
]


def test_sweeps_without_a_camera_are_refused_and_where_nothing_is_seen_there_is_no_error():
    ball = cyc.scenes.sphere(80)
    here, away = (cyc.Camera.look_at((0, 0, 5), (0, 0, z), width=32, height=24) for z in (0, 9))
    house = cyc.scenes.house(rooms=2)
    building = cyc.portals.Building(house, house.cells, house.portals)
    for sweep, name in (
        (lambda: sweeps.warps(ball, here, []), "targets"),
        (lambda: sweeps.construction(ball, [], [here]), "cameras"),
        (lambda: sweeps.construction(ball, [here], []), "targets"),
        (lambda: sweeps.portal_images(building, []), "cameras"),
    ):
        with pytest.raises(ValueError, match=f"{name} is empty"):
            sweep()
    [row] = sweeps.warps(ball, here, [away], splats=[1], orders=["zbuffer"], rounds=1, progress=False)
    assert row["rms"] is None and row["holes"] == 0
    [row] = sweeps.budgets(ball, ["x"], progress=False)
    assert row["error"] == "ValueError: share must be finite and at least 0, got 'x'"


def test_rows_come_back_from_csv_as_they_were(tmp_path):
    lab.save(ROWS, tmp_path / "rows.csv")
    expected = [{k: list(v) if isinstance(v, tuple) else v for k, v in row.items()} for row in ROWS]
    assert lab.load(tmp_path / "rows.csv") == expected


def test_rows_come_back_from_parquet_and_pandas_would_read_them(tmp_path):
    parquet = need("pyarrow.parquet")
    lab.save(ROWS, tmp_path / "rows.parquet")
    assert parquet.read_table(tmp_path / "rows.parquet").column("views").to_pylist() == [6, 18, 66]
    got = lab.load(tmp_path / "rows.parquet")
    assert got[0] == {**ROWS[0], "size": [510, 480]} and got[2]["error"] == ROWS[2]["error"]
    assert got[2]["missed"] is None and "error" not in got[1]
    assert lab.best(got, minimise="missed")["views"] == 18


def test_other_files_and_no_rows_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"\.csv or \.parquet, got 'rows\.xls'"):
        lab.save(ROWS, "rows.xls")
    with pytest.raises(ValueError, match="no rows"):
        lab.save([], tmp_path / "rows.csv")


def test_a_chart_has_all_points_and_the_front(tmp_path):
    need("matplotlib")
    rows = [{"kind": k, "time": t, "missed": m} for k, t, m in (("a", 1, 9), ("a", 2, 3), ("b", 3, 5), ("b", 4, 1))]
    figure = lab.draw(rows, cost="time", error="missed", by="kind", path=tmp_path / "chart.png")
    lines = figure.axes[0].get_lines()
    assert lines[1].get_xdata().tolist() == [1, 2, 4]
    assert [line.get_label() for line in lines[2:]] == ["kind = a", "kind = b"]
    assert (tmp_path / "chart.png").stat().st_size > 1000
    with pytest.raises(ValueError, match="no row has both 'cost' and 'missed'"):
        lab.draw(rows, cost="cost", error="missed")


def test_medians_take_turns():
    order = []
    lab.medians({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, rounds=2)
    assert order == ["a", "b"] * 3
