"""The page of a walk in Chromium, drawn in software: first complete picture and rate, by slabs.

    python benches/walk_page.py [--columns 2048] [--picture docs/figures/walk.png]

The first picture is complete when every tile in sight is there: milliseconds since the page was asked for, server and
browser on one machine. Rates are those of whole pictures of 1280 x 720 at a reference and beside one, each of them
waited for; and those of a walk, while which the page takes fewer pixels where pictures come late. With --picture it
also writes what the page shows.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import cyclorama as cyc
from cyclorama.panorama import Track, bake

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from browser import browser, page_of
from test_walk_server import serving

# Draws pictures while the eye moves, and waits for each: reading a pixel ends it.
RATE = """
async (count) => {
  const canvas = document.getElementById("picture");
  const gl = canvas.getContext("webgl2");
  const { draw } = window.cyclorama;
  const pixel = new Uint8Array(4);
  const start = performance.now();
  for (let k = 0; k < count; k++) {
    draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  }
  return (1000 * count) / (performance.now() - start);
}
"""
# Walks and turns as fast as pictures come: pictures a second, and the share of a row's pixels in them.
WALK = """
async (seconds) => {
  const { go, state } = window.cyclorama;
  const [start, before] = [performance.now(), state().frames];
  await new Promise((done) => {
    const step = () => {
      const since = (performance.now() - start) / 1000;
      if (since > seconds) return done();
      go(0.25 + 0.1 * Math.sin(since), 0.3 * Math.sin(since));
      requestAnimationFrame(step);
    };
    step();
  });
  return [(1000 * (state().frames - before)) / (performance.now() - start), state().sharp];
}
"""
COMPLETE = "window.cyclorama && window.cyclorama.state().complete"


def castle_walk(out, slabs, columns):
    """Three references on the lane, a quarter of a metre apart."""
    scene = cyc.scenes.castle()
    track = Track([scene.lane[0] + [0, 0, -8], scene.lane[0] + [0, 0, -8.5]])
    return bake(scene, track, slabs, (columns, columns // 4), places=[0, 0.5, 1], out=out, progress=False)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--columns", type=int, default=2048, help="of the panoramas; rows are a quarter")
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--slabs", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    print(f"castle, {given.columns} x {given.columns // 4}, three references; 1280 x 720, Chromium, SwiftShader")
    print(
        "slabs  store MB   first picture ms  received MB  quads in sight  at a reference /s  between /s  moving /s  "
        "of a row's pixels"
    )
    with browser() as running, tempfile.TemporaryDirectory() as folder:
        for slabs in given.slabs:
            out = Path(folder) / str(slabs)
            store = castle_walk(out, slabs, given.columns)
            with serving(out) as url:
                with page_of(running, f"{url}?t=0.25", 1280, 720) as page:
                    page.wait_for_function(COMPLETE, timeout=120_000)
                    page.wait_for_function("window.cyclorama.state().first !== null", timeout=300_000)
                    first = page.evaluate("window.cyclorama.state()")
                    quads = page.evaluate("window.cyclorama.state().quads")
                    between = page.evaluate(RATE, given.frames)
                    page.evaluate(WALK, 4)  # until the page knows how many pixels it can draw
                    moving, sharp = page.evaluate(WALK, 4)
                    page.evaluate("window.cyclorama.go(0.5)")
                    page.wait_for_function(COMPLETE, timeout=120_000)
                    exact = page.evaluate(RATE, given.frames)
                    if given.picture and slabs == given.slabs[-1]:
                        page.evaluate("window.cyclorama.go(0.25, 0.25, 0.12)")
                        page.wait_for_function(COMPLETE, timeout=120_000)
                        page.wait_for_timeout(2500)
                        page.screenshot(path=str(given.picture))
                print(
                    f"{slabs:5d}  {store.bytes / 1e6:8.2f} {first['first']:18.0f} {first['received'] / 1e6:12.2f} "
                    f"{quads:15,} {exact:18.1f} {between:11.1f} {moving:10.1f} {sharp:18.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
