"""A walkthrough over HTTP: what the server answers and refuses, a client that reconstructs, the page in a browser."""

import asyncio
import io
import json
import shutil
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager

import numpy as np
import pytest

import cyclorama as cyc
from browser import browser, page_of
from cyclorama import pages, panorama
from cyclorama.panorama import server
from cyclorama.panorama.sources import Server
from peers import need

SIZE = (512, 128)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    need("PIL")
    folder = tmp_path_factory.mktemp("walk") / "house"
    house = cyc.scenes.house(rooms=2)
    eye = (house.cells[0]["min"] + house.cells[0]["max"]) / 2
    panorama.bake(house, [eye, eye + [0.3, 0, 0.1]], 2, SIZE, spacing=0.16, out=folder, progress=False)
    return folder


@contextmanager
def serving(folder, **options):
    """The address of a server that runs until the block is left."""
    uvicorn = need("uvicorn")
    need("starlette")
    running = uvicorn.Server(uvicorn.Config(server.application(folder, **options), log_level="error"))
    with server._listen("127.0.0.1", 0) as listening:
        thread = threading.Thread(target=running.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}/"
        finally:
            running.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def url(walk):
    with serving(walk) as address:
        yield address


def get(url, headers=None):
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers or {}), timeout=30) as answer:
            return answer.status, dict(answer.headers), answer.read()
    except urllib.error.HTTPError as error:
        return error.code, dict(error.headers), error.read()


def files_of(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_every_file_is_there_as_it_lies_in_the_folder(walk, url):
    names = files_of(walk)
    assert len(names) > 8
    for name in names:
        status, headers, content = get(url + name)
        assert status == 200 and content == (walk / name).read_bytes()
        again, _, nothing = get(url + name, {"If-None-Match": headers["etag"]})
        assert (again, nothing) == (304, b"")
        other, _, _ = get(url + name, {"If-None-Match": '"something else"'})
        assert other == 200


def test_the_manifest_has_the_corners_of_the_track(walk, url):
    _, _, content = get(url + "walk.json")
    told, written = json.loads(content), json.loads((walk / "manifest.json").read_bytes())
    store = panorama.Store(walk)
    assert written.items() <= told.items()
    np.testing.assert_allclose(told["knots"], store.track.knots)


def test_many_files_come_in_one_answer(walk, url):
    folder = panorama.Store(walk).references[0].folder
    names = [name for name in files_of(walk) if name.startswith(f"{folder}/")]
    asked = ",".join(name.rpartition("/")[2] for name in names)
    status, headers, _ = get(f"{url}batch/{folder}?names={asked}")
    assert status == 200
    source = Server(url)
    source.coming(names)
    before = source.received
    assert {name: source.read(name) for name in names} == {name: (walk / name).read_bytes() for name in names}
    assert source.received == before, "all of them were kept"
    assert get(f"{url}batch/{folder}?names={asked}", {"If-None-Match": headers["etag"]})[0] == 304


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("../../etc/passwd", 404, "is not here"),
        ("%2e%2e/%2e%2e/etc/passwd", 404, ""),
        ("..%2f..%2fetc%2fpasswd", 404, ""),
        ("0000/..%2fmanifest.json", 404, ""),
        ("0000/none.png", 404, "0000/none.png is no file of this walkthrough"),
        ("batch/0000?names=view.json,../manifest.json", 404, "is no file"),
        ("batch/0000", 404, "is no file"),
        ("batch/..?names=manifest.json", 404, ""),
        ("batch/0000?names=" + ",".join(["a"] * 257), 400, "257 files, at most 256"),
        ("manifest.json.part", 404, "is not here"),
    ],
)
def test_what_is_not_of_the_walkthrough_is_refused(url, path, status, said):
    found, headers, content = get(url + path)
    assert found == status and headers["content-type"].startswith("text/plain")
    assert said in content.decode() and "Traceback" not in content.decode()


def test_other_methods_are_refused(url):
    request = urllib.request.Request(url + "walk.json", data=b"x", method="POST")
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request)
    assert refused.value.code == 405
    refused.value.close()


def test_a_client_reconstructs_what_the_folder_gives(walk, url):
    here, there = panorama.Store(walk), panorama.Store(url)
    camera = cyc.Camera.look_at([0, 0, 0], [1, 0.1, 0.3], width=120, height=90)
    for t in (0.0, 0.37, 1.0):
        local, remote = panorama.view(here, t, camera), panorama.view(there, t, camera)
        np.testing.assert_array_equal(local.color, remote.color)
        np.testing.assert_array_equal(local.hole, remote.hole)


def test_a_clients_cache_keeps_to_its_bytes(walk, url):
    names = [name for name in files_of(walk) if name.endswith((".png", ".webp"))]
    limit = max((walk / name).stat().st_size for name in names) * 2
    source = Server(url, cache=limit)
    for name in names * 2:
        assert source.read(name) == (walk / name).read_bytes()
        assert source.bytes <= limit


def test_what_lies_ahead_is_fetched_before_it_is_asked_for(walk, url):
    store = panorama.Store(url)
    assert len(store) > 2
    camera = cyc.Camera.look_at([0, 0, 0], [1, 0, 0], width=16, height=12)
    panorama.view(store, 0.0, camera)
    panorama.view(store, store.references[1].t * 0.5, camera)
    store.wait()
    before = store.source.received
    panorama.view(store, (store.references[1].t + store.references[2].t) / 2, camera)
    assert store.source.received == before


def test_damaged_and_missing_files_are_said_and_the_rest_is_served(walk, tmp_path):
    copy = tmp_path / "walk"
    shutil.copytree(walk, copy)
    pictures = [name for name in files_of(copy) if name.endswith((".png", ".webp"))]
    cut, gone, whole = pictures[:3]
    (copy / cut).write_bytes((copy / cut).read_bytes()[:-7])
    (copy / gone).unlink()
    with serving(copy) as address:
        for name, said in ((cut, "is not the file that was written"), (gone, "can't be read")):
            status, _, content = get(address + name)
            assert status == 500 and said in content.decode()
        assert get(address + whole)[0] == 200
        camera = cyc.Camera.look_at([0, 0, 0], [1, 0, 0], width=16, height=12)
        with pytest.raises(ValueError, match=r"can't be read: .* was refused \(500\)"):
            panorama.view(panorama.Store(address), 0.0, camera)


def test_sixty_four_clients_at_once_get_what_one_gets(walk, url):
    httpx = need("httpx")
    names = [name for name in files_of(walk) if name != "manifest.json"]

    async def walk_through(client, turn):
        for k in range(6):
            name = names[(turn * 7 + k) % len(names)]
            answer = await client.get(url + name)
            assert answer.status_code == 200 and answer.content == (walk / name).read_bytes()

    async def crowd():
        limits = httpx.Limits(max_connections=64)
        async with httpx.AsyncClient(limits=limits, timeout=60) as client:
            await asyncio.gather(*(walk_through(client, turn) for turn in range(64)))

    asyncio.run(crowd())


def test_a_client_that_leaves_in_the_middle_disturbs_nobody(walk, url):
    host, port = url.removeprefix("http://").rstrip("/").split(":")
    name = max(files_of(walk), key=lambda name: (walk / name).stat().st_size)
    for _ in range(8):
        with socket.create_connection((host, int(port))) as leaving:
            leaving.sendall(f"GET /{name} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
            leaving.recv(10)
    assert get(url + name)[2] == (walk / name).read_bytes()


def test_a_port_in_use_is_said(walk):
    need("starlette")
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        port = busy.getsockname()[1]
        with pytest.raises(OSError, match=rf"127\.0\.0\.1:{port} can't be served from: .*; give another port"):
            panorama.serve(walk, port=port)
    with pytest.raises(OSError, match=r"can't be served from|is not an address"):
        panorama.serve(walk, host="203.0.113.1", port=0)
    with pytest.raises(ValueError, match="port must be an integer from 0 to 65535, got 70000"):
        panorama.serve(walk, port=70000)


def test_a_server_that_is_not_there_is_said():
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{nobody.getsockname()[1]}/"
        with pytest.raises(OSError, match="can't be reached"):
            panorama.Store(address)


def test_the_command_bakes_and_says_what_it_wrote(tmp_path, monkeypatch, capsys):
    from cyclorama.cli import main

    need("trimesh").creation.box((4, 4, 4)).export(tmp_path / "box.ply")
    (tmp_path / "track.json").write_text("[[0, 0, 0], [0.2, 0, 0]]")
    monkeypatch.chdir(tmp_path)
    asked = ["--bake-only", "--size", "128x64", "--slabs", "1", "--spacing", "0.2", "--quiet"]
    assert main(["walk", "box.ply", "--track", "track.json", *asked]) == 0
    assert "2 along 0.2" in capsys.readouterr().out
    assert main(["walk", "walk", "--bake-only"]) == 0
    for port in ("x", "65536", "-1"):
        assert main(["walk", "walk", f"--port={port}"]) == 2
        assert f"argument --port: '{port}' is no port: a whole number from 0 to 65535" in capsys.readouterr().err
    assert main(["walk", "box.ply", *asked]) == 2
    assert "--track FILE says where to go" in capsys.readouterr().err
    (tmp_path / "track.json").write_text('{"spline": true}')
    assert main(["walk", "box.ply", "--track", "track.json", *asked]) == 2
    assert "it has no 'points'" in capsys.readouterr().err


RAIL = """
const { beside, directions, placeAt } = await import(process.argv[1]);
const { walk, ts, corners } = JSON.parse(process.argv[2]);
const direction = directions(walk);
console.log(JSON.stringify({
  sides: ts.map((t) => beside(walk, t)),
  eyes: ts.map((t) => placeAt(walk, t)),
  ways: corners.map((c) => direction(...c)),
}));
"""


@pytest.mark.parametrize("kind", ["cylinder", "equirect"])
def test_the_page_goes_by_the_same_rail_as_the_library(kind, tmp_path):
    """The page's own functions in Node.js, before the first and after the last reference as well."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node, which bundles the page")
    house = cyc.scenes.house(rooms=2)
    eye = (house.cells[0]["min"] + house.cells[0]["max"]) / 2
    track = panorama.Track([eye, eye + [0.2, 0, 0], eye + [0.2, 0, 0.2]])
    store = panorama.bake(
        house, track, 2, (64, 32), kind, tile=8, places=[0.25, 0.5, 0.75], out=tmp_path / "walk", progress=False
    )
    ts = [0.0, 0.1, 0.25, 0.3, 0.5, 0.7499, 0.75, 0.9, 1.0]
    walk = {
        **json.loads((tmp_path / "walk" / "manifest.json").read_bytes()),
        "knots": track.knots.tolist(),
        "at_knots": track.at_knots.tolist(),
    }
    corners = [(0, 0), (-0.5, -0.5), (64.5, 32.5), (63.5, 31.5), (20, 7.5), (64, 32)]
    asked = json.dumps({"walk": walk, "ts": ts, "corners": corners})
    script = pages.__path__[0] + "/../../../web/src/walk/rail.js"
    said = subprocess.run([node, "--input-type=module", "-e", RAIL, script, asked], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    found = json.loads(said.stdout)
    for t, side in zip(ts, found["sides"], strict=True):
        first, second, between = store.beside(t)
        assert (side["first"], side["second"]) == (first, second)
        assert side["between"] == pytest.approx(between)
        assert side["exact"] == (t in (0.25, 0.5, 0.75))
    np.testing.assert_allclose(found["eyes"], store.track.at(ts), atol=1e-12)
    grid = store.projection
    for (x, y), way in zip(corners, found["ways"], strict=True):
        at = grid.places(np.array([way]))[0]
        assert (at[0] - x + 1e-9) % 64 < 2e-9 and at[1] == pytest.approx(min(max(y, 0), 32), abs=1e-9)


# The page -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def running():
    try:
        pages.script("walk")
    except FileNotFoundError as error:
        pytest.skip(str(error))
    with browser() as opened:
        yield opened


def picture(page):
    need("PIL")
    from PIL import Image

    page.wait_for_function("window.cyclorama && window.cyclorama.state().complete", timeout=60_000)
    page.evaluate("window.cyclorama.draw()")
    data = page.evaluate("document.getElementById('picture').toDataURL('image/png')")
    with urllib.request.urlopen(data) as raw:
        return np.asarray(Image.open(io.BytesIO(raw.read())).convert("RGB"))


def test_the_canvas_shows_what_the_library_reconstructs(walk, url, running):
    store = panorama.Store(walk)
    with page_of(running, url, 480, 360) as page:
        page.wait_for_function("window.cyclorama")
        for t, yaw, pitch in ((0.0, 0.4, 0.0), (0.3, 1.9, 0.15), (0.5, -2.8, -0.1), (0.8, 3.1, 0.0)):
            page.evaluate("([t, yaw, pitch]) => window.cyclorama.go(t, yaw, pitch)", [t, yaw, pitch])
            shown = picture(page)
            right, up, back = store.projection.axes
            flat = np.cos(pitch)
            gaze = np.sin(yaw) * flat * right + np.sin(pitch) * up - np.cos(yaw) * flat * back
            camera = cyc.Camera.look_at([0, 0, 0], gaze, up, 60.0, shown.shape[1], shown.shape[0])
            ours = panorama.view(store, t, camera)
            # Where two surfaces of equal depth meet or silhouettes fall between pixels, rasterisers may differ.
            assert cyc.quality.psnr(shown, ours.color) >= 30
            exact = page.evaluate("document.querySelector('[data-figure=exact]').textContent")
            assert (exact == "exact") == ours.exact


def test_one_walks_and_looks_with_keys_slider_and_drag(url, running):
    with page_of(running, url, 480, 360) as page:
        picture(page)
        state = "window.cyclorama.state()"
        start = page.evaluate(state)
        page.keyboard.press("ArrowUp")
        page.keyboard.press("ArrowRight")
        moved = page.evaluate(state)
        assert moved["t"] > start["t"] and moved["yaw"] > start["yaw"]
        page.mouse.move(300, 200)
        page.mouse.down()
        page.mouse.move(200, 200, steps=4)
        page.mouse.up()
        assert page.evaluate(state)["yaw"] > moved["yaw"], "dragged to the left, one looks to the right"
        page.focus("#place")
        page.keyboard.press("End")
        assert page.evaluate(state)["t"] == 1
        # Of a move that is slow to draw pictures are smaller, until it rests.
        page.wait_for_function("document.getElementById('picture').width === 480", timeout=60_000)
        before = picture(page)
        page.uncheck("[name=slab0]")
        assert (picture(page) != before).any()
        assert "MB" in page.text_content("[data-figure=received]") or "kB" in page.text_content(
            "[data-figure=received]"
        )


def test_the_page_says_when_the_server_is_gone(walk, running):
    with serving(walk) as address:
        page = running.new_page(viewport={"width": 300, "height": 200})
        page.goto(address)
        picture(page)
    page.evaluate("window.cyclorama.go(1, 2, 0)")
    page.wait_for_function(
        "document.getElementById('status').textContent.includes('could not be fetched')", timeout=20_000
    )
    page.close()


def test_a_package_without_pages_says_so_in_the_page(walk, running, monkeypatch):
    def script(name):
        raise FileNotFoundError(f"{name}.js is not in this package")

    monkeypatch.setattr(panorama.server, "script", script)
    with serving(walk) as address:
        assert get(address + "walk.js")[::2] == (404, b"walk.js is not in this package\n")
        assert get(address + "manifest.json")[0] == 200, "clients need no page"
        page = running.new_page(viewport={"width": 300, "height": 200})
        page.goto(address)
        said = "document.getElementById('status').textContent"
        page.wait_for_function(f"{said}.includes('walk.js is not in this package')", timeout=20_000)
        page.close()


@pytest.mark.parametrize("odd", ["t=a&yaw=b&pitch=&fov=c&cache=d", "t=7&fov=0", "t=-1&fov=400", "cache=-5"])
def test_an_address_with_odd_numbers_shows_a_picture(url, running, odd):
    with page_of(running, f"{url}?{odd}", 240, 180) as page:
        shown = picture(page)
        state = page.evaluate("window.cyclorama.state()")
        assert 0 <= state["t"] <= 1 and 5 <= state["fov"] <= 150
        assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 1


def test_a_cache_in_the_page_keeps_to_its_bytes(url, running):
    limit = 3_000_000
    with page_of(running, f"{url}?cache={limit}", 240, 180) as page:
        picture(page)
        for turn in range(6):
            page.evaluate("yaw => window.cyclorama.go(0.5, yaw, 0)", turn)
            picture(page)
            time.sleep(0.05)
        assert page.evaluate("window.cyclorama.state().kept") <= limit


def test_the_page_asks_nobody_but_its_server(url, running):
    page = running.new_page(viewport={"width": 300, "height": 200})
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(url)
    picture(page)
    assert len(asked) > 3 and all(address.startswith((url, "data:", "blob:")) for address in asked)
    page.close()


def test_on_a_phone_the_picture_is_free_and_fingers_look(url, running):
    context = running.new_context(viewport={"width": 360, "height": 640}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(url)
    picture(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    panel, slider = (page.locator(name).bounding_box() for name in ("details", "#place"))
    assert panel["width"] * panel["height"] < 0.1 * 360 * 640, "figures are folded away"
    assert 0 <= slider["x"] and slider["x"] + slider["width"] <= 360 and slider["y"] + slider["height"] <= 640
    page.tap("summary")
    assert page.locator("[data-figure=received]").is_visible()
    before = page.evaluate("window.cyclorama.state().yaw")
    touch = page.context.new_cdp_session(page)
    for kind, x in (("touchStart", 300), ("touchMove", 250), ("touchMove", 180), ("touchEnd", None)):
        points = [] if x is None else [{"x": x, "y": 400}]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert page.evaluate("window.cyclorama.state().yaw") > before
    page.set_viewport_size({"width": 640, "height": 320})
    panel, slider = (page.locator(name).bounding_box() for name in ("details", "footer label"))
    assert panel["y"] + panel["height"] <= slider["y"], "lying on its side, the slider stays free"
    context.close()


def test_everything_is_reached_by_the_keyboard_alone(url, running):
    with page_of(running, url, 480, 360) as page:
        picture(page)
        reached = []
        for _ in range(6):
            page.keyboard.press("Tab")
            reached.append(page.evaluate("document.activeElement.id || document.activeElement.name || 'summary'"))
        assert {"picture", "summary", "slab0", "slab1", "place"} <= set(reached)
        page.focus("[name=slab0]")
        page.keyboard.press("Space")
        assert page.evaluate("window.cyclorama.state().slabs")[0] is False
        page.focus("#picture")
        page.keyboard.press("PageUp")
        assert page.evaluate("window.cyclorama.state().pitch") > 0
