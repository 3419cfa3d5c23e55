"""A bake as a page, looked at in a browser."""

import base64
import io
from types import SimpleNamespace

import numpy as np
import pytest

import cyclorama as cyc
from browser import browser, page_of
from cyclorama import pages, viewer
from cyclorama.pages.packing import pack
from cyclorama.placement.plan import Images
from peers import need

STATE = "window.cyclorama.state()"


@pytest.fixture(scope="module")
def gear():
    scene = cyc.scenes.gear()
    return scene, cyc.bake(scene, views=18, patches=60, resolution=(96, 90), progress=False)


@pytest.fixture(scope="module")
def scripts():
    try:
        pages.script("visibility")
    except FileNotFoundError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def running(scripts):
    with browser() as opened:
        yield opened


def test_the_page_says_what_the_bake_says(gear, running, tmp_path):
    scene, vis = gear
    viewer.write_page(vis, scene, tmp_path / "gear.html", title="<gear> & co")
    with page_of(running, (tmp_path / "gear.html").as_uri()) as page:
        page.wait_for_function(f"window.cyclorama && {STATE}.missed", timeout=60_000)
        assert page.text_content("h1") == "<gear> & co"
        for direction in ([1, 0.2, 0.1], [-0.3, 0.8, 0.4], [0.2, -0.4, -1]):
            page.evaluate("direction => window.cyclorama.look(direction)", direction)
            page.wait_for_timeout(300)
            state = page.evaluate(STATE)
            eye = vis.sphere.center + np.array(state["eye"]) * vis.model_radius
            answer = vis.visible_faces(eye)
            assert state["drawn"] == len(answer)
            assert page.text_content("[data-figure=drawn]") == f"{len(answer):,}"
            camera = vis.framing.with_resolution((510, 480)).cameras([direction])[0]
            ids = scene.render(camera).ids
            seen = ids != cyc.BACKGROUND
            # Two rasterisers may differ along silhouettes: in at most the pixels that have the background beside them.
            edge = seen[1:] ^ seen[:-1]
            assert abs(state["missed"]["covered"] - seen.sum()) <= edge.sum()
            lost = ~np.isin(ids[seen], answer)
            assert abs(state["missed"]["missed"] - lost.sum()) <= edge.sum()


def covered_in_page(page):
    page.wait_for_function(f"window.cyclorama && {STATE}.missed", timeout=60_000)
    return page.evaluate(STATE)["missed"]


@pytest.mark.parametrize("options", [{"distances": [50.0]}, {"distances": [1000.0]}, {"fov_y": 5.0}, {"fov_y": 120.0}])
def test_the_model_is_shown_however_far_the_samples_are(running, tmp_path, options):
    scene = cyc.scenes.gear(3000)
    vis = cyc.bake(scene, views=18, resolution=(96, 90), progress=False, **options)
    viewer.write_page(vis, scene, tmp_path / "gear.html")
    with page_of(running, (tmp_path / "gear.html").as_uri()) as page:
        missed = covered_in_page(page)
        assert missed["missed"] <= 0.001 * missed["covered"]
        page.uncheck("[name=sphere]")
        assert 0.03 < share_shown(page) < 0.7


def share_shown(page):
    """Of the page's pixels those that show the model, which is of a brownish yellow."""
    need("PIL")
    from PIL import Image

    page.wait_for_timeout(300)
    picture = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
    return (picture[..., 0] > picture[..., 2] + 30).mean()


#: Until what has moved is drawn, however busy the machine is.
TWO_FRAMES = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 2), (0, -1, 0), (1, 1, 0)])
def test_what_is_up_is_up_and_stays_so_while_one_turns(gear, running, tmp_path, up):
    scene, vis = gear
    viewer.write_page(vis, scene, tmp_path / "gear.html", up=up)
    with page_of(running, (tmp_path / "gear.html").as_uri()) as page:
        covered_in_page(page)
        page.focus("canvas")
        eyes = []
        for key in ("ArrowRight", "ArrowUp", "ArrowLeft", "ArrowDown"):
            before = page.evaluate(STATE)["eye"]
            page.keyboard.press(key)
            page.wait_for_function(f"before => String({STATE}.eye) !== String(before)", arg=before)
            page.evaluate(TWO_FRAMES)
            state = page.evaluate(STATE)
            eye, axis = np.array(state["eye"]), np.array(up) / np.linalg.norm(up)
            upward = axis - (axis @ eye) * eye / (eye @ eye)
            assert np.array(state["up"]) @ upward / np.linalg.norm(upward) > 0.999
            eyes.append(eye)
        assert eyes[0] @ axis == pytest.approx(eyes[3] @ axis, abs=1e-6)
        assert eyes[1] @ axis > eyes[0] @ axis + 0.1, "the arrow up goes up"


def test_what_is_no_direction_is_not_up(gear, tmp_path):
    scene, vis = gear
    for up in ((0, 0, 0), "x", (1, 2), (np.nan, 0, 1)):
        with pytest.raises(ValueError, match="up must be"):
            viewer.write_page(vis, scene, tmp_path / "page.html", up=up)
    assert not list(tmp_path.iterdir())


def test_transparent_faces_hide_nothing(running, tmp_path):
    ball, gear = cyc.scenes.sphere(faces=320), cyc.scenes.gear(3000)
    scene = cyc.Scene(
        np.concatenate([ball.vertices, 0.5 * gear.vertices / gear.radius]),
        np.concatenate([ball.faces, gear.faces + len(ball.vertices)]),
        transparent=np.arange(len(ball) + len(gear)) < len(ball),
    )
    vis = cyc.bake(scene, views=18, resolution=(96, 90), progress=False)
    viewer.write_page(vis, scene, tmp_path / "glass.html")
    with page_of(running, (tmp_path / "glass.html").as_uri()) as page:
        missed, eye = covered_in_page(page), page.evaluate(STATE)["eye"]
        camera = vis.framing.with_resolution((510, 480)).cameras([eye])[0]
        seen = scene.render(camera).ids != cyc.BACKGROUND
        assert abs(missed["covered"] - seen.sum()) <= (seen[1:] ^ seen[:-1]).sum()
        assert missed["missed"] <= 0.01 * missed["covered"]


def test_on_a_phone_the_model_is_free(gear, running, tmp_path):
    scene, vis = gear
    viewer.write_page(vis, scene, tmp_path / "gear.html")
    context = running.new_context(viewport={"width": 360, "height": 640}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto((tmp_path / "gear.html").as_uri())
    covered_in_page(page)
    panel = page.locator("details").bounding_box()
    assert panel["width"] * panel["height"] < 0.1 * 360 * 640, "figures are folded away"
    page.tap("summary")
    page.uncheck("[name=sphere]")
    page.tap("summary")
    assert 0.05 < share_shown(page) < 0.5
    context.close()


def test_the_eye_stays_while_the_view_turns(gear, running, tmp_path):
    scene, vis = gear
    viewer.write_page(vis, scene, tmp_path / "gear.html")
    with page_of(running, (tmp_path / "gear.html").as_uri()) as page:
        page.wait_for_function(f"window.cyclorama && {STATE}.missed", timeout=60_000)
        before = page.evaluate(STATE)
        page.uncheck("[name=follow]")
        picture = page.screenshot()
        page.focus("canvas")
        for _ in range(10):
            page.keyboard.press("ArrowRight")
        page.wait_for_timeout(300)
        assert page.evaluate(STATE) | {"up": None} == before | {"up": None}
        assert page.screenshot() != picture
        page.check("[name=follow]")
        page.wait_for_timeout(300)
        assert page.evaluate(STATE)["eye"] != before["eye"]


def test_backdrops_of_a_plan_are_shown(running, tmp_path):
    scene = cyc.scenes.pipes(2_000)
    corners = np.array([[[-0.5, 0.5, 0], [0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, -0.5, 0]]])
    plan = SimpleNamespace(images=Images(np.array([0]), corners, np.array([[0, 0, 1.0]]), np.array([[0, 360.0]])))
    vis = cyc.bake(scene, views=6, resolution=(64, 60), progress=False)
    viewer.write_page(vis, scene, tmp_path / "pipes.html", plan=plan)
    with page_of(running, (tmp_path / "pipes.html").as_uri()) as page:
        page.wait_for_function(f"window.cyclorama && {STATE}.missed", timeout=60_000)
        assert page.is_visible("[name=backdrops]")
        shown = page.screenshot()
        page.uncheck("[name=backdrops]")
        page.wait_for_timeout(300)
        assert page.screenshot() != shown
        assert not page.is_visible("[name=patches]")


def test_a_widget_has_the_same_content(gear, scripts):
    need("anywidget")
    scene, vis = gear
    shown = viewer.widget(vis, scene, height=300)
    assert shown.height == 300 and "export" in shown._esm and shown.data.startswith(b'{"values"')


#: What a notebook does with a widget: it gives `render` a model and an element, and tells of changes.
NOTEBOOK = """<!doctype html><div id="here"></div><script type="module">
const bytes = Uint8Array.from(atob("{data}"), (c) => c.charCodeAt(0));
const values = {{ data: new DataView(bytes.buffer), height: 300, direction: [0, 0, 1] }};
const heard = {{}};
const model = {{
  get: (name) => values[name],
  on: (what, call) => (heard[what] = call),
  off: (what) => delete heard[what],
}};
const {{ default: widget }} = await import("data:text/javascript;base64,{script}");
const end = widget.render({{ model, el: document.getElementById("here") }});
window.notebook = {{ end, heard, turn(way) {{ values.direction = way; heard["change:direction"](); }} }};
</script>"""


def test_a_notebook_shows_the_widget_turns_it_and_takes_it_away(gear, running, tmp_path):
    need("anywidget")
    scene, vis = gear
    shown = viewer.widget(vis, scene, height=300)
    data, script = (base64.b64encode(part).decode() for part in (shown.data, shown._esm.encode()))
    (tmp_path / "notebook.html").write_text(NOTEBOOK.format(data=data, script=script))
    with page_of(running, (tmp_path / "notebook.html").as_uri()) as page:
        page.wait_for_function("window.notebook", timeout=60_000)
        assert page.locator("#here").bounding_box()["height"] == 300
        assert page.text_content("[data-figure=faces]") == f"{len(scene):,}"
        for way in ([1, 0.2, 0.1], [0.2, -0.4, -1]):
            page.evaluate("way => window.notebook.turn(way)", way)
            eye = vis.sphere.center + vis.sphere.radius * vis.distances[0] * np.array(way) / np.linalg.norm(way)
            answer = vis.visible_faces(eye)
            assert page.text_content("[data-figure=drawn]") == f"{len(answer):,}"
        page.evaluate("window.notebook.end()")
        assert page.locator("canvas").count() == 0
        assert page.evaluate("Object.keys(window.notebook.heard)") == []


@pytest.mark.parametrize("sizes", [(0,), (1, 7, 8), (9, 100, 3)])
def test_packed_arrays_can_be_found_again(sizes):
    import json

    rng = np.random.default_rng(0)
    kinds = [np.uint8, np.uint32, np.float32]
    arrays = {f"a{i}": rng.integers(0, 200, size).astype(kinds[i % 3]) for i, size in enumerate(sizes)}
    packed = pack({"title": "é"}, arrays)
    head = json.loads(packed[: packed.index(b"\n")])
    assert head["values"] == {"title": "é"}
    for entry in head["arrays"]:
        assert entry["start"] % 8 == 0
        found = np.frombuffer(packed, entry["dtype"], entry["length"], entry["start"])
        np.testing.assert_array_equal(found, arrays[entry["name"]])
    with pytest.raises(ValueError, match="x is float64"):
        pack({}, {"x": np.zeros(1)})


def test_another_scene_is_refused(gear, tmp_path):
    _, vis = gear
    with pytest.raises(ValueError, match="baked from a mesh of"):
        viewer.write_page(vis, cyc.scenes.sphere(faces=80), tmp_path / "page.html")
    assert not list(tmp_path.iterdir())


def test_the_command_finds_the_mesh_beside_the_file(gear, scripts, tmp_path, monkeypatch, capsys):
    from cyclorama.cli import main

    need("trimesh").creation.icosphere(subdivisions=1).export(tmp_path / "ball.ply")
    scene = cyc.load(tmp_path / "ball.ply")
    cyc.bake(scene, views=6, resolution=(64, 60), progress=False).save(tmp_path / "ball.npz")
    monkeypatch.chdir(tmp_path)
    assert main(["view", "ball.npz"]) == 0
    assert (tmp_path / "ball.html").stat().st_size > 100_000
    (tmp_path / "ball.ply").rename(tmp_path / "other.ply")
    assert main(["view", "ball.npz"]) == 2
    assert "give it with --mesh" in capsys.readouterr().err
