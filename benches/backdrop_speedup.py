"""Table 5-1 of the 1998 dissertation: how much less is drawn, how much faster, with a flat picture of all that is far.

    python benches/backdrop_speedup.py [--quick] [--frames 20] [--width 510] [--height 480]

A path has two or three pictures, each of all beyond a distance, taken where its part of the path begins: the rest of it
is walked with the geometry around bent to the picture. `faces` are those in the frustum, with and without; the
dissertation's graphics drew these and had 9.2, 3.3 and 6.5 times the frame rate. Ours doesn't draw what is hidden, so
it gains less time than faces.
"""

from __future__ import annotations

from functools import partial

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab
from cyclorama.backdrop import Backdrop
from cyclorama.portals.cones import Cone
from cyclorama.warp import backdrop

# Scene, the table's name and speed-up, pictures on the path, where it begins and ends, the target, and the distance of
# pictures, the last four in radii from the centre.
PATHS = {
    "pipes": ("Pipes", 9.2, 3, (0.0, 0.0, 0.9), (0.1, 0.05, 0.6), (0.0, 0.0, -1.0), 0.3),
    "sibenik": ("Church", 3.3, 3, (-0.6, -0.2, 0.02), (0.0, -0.2, -0.02), (1.0, -0.2, 0.0), 0.5),
    "engine_2cylinder": ("AMR", 6.5, 2, (0.2, 0.2, 1.1), (-0.1, 0.1, 0.8), (0.0, 0.0, 0.0), 0.8),
}


def pictured(scene: cyc.Scene, camera: cyc.Camera, distance: float) -> Backdrop:
    """A picture of all beyond a distance, seen once."""
    drop = backdrop(scene, camera, distance)
    drop.draw(camera)
    return drop


def colored(scene: cyc.Scene, camera: cyc.Camera) -> np.ndarray:
    """All of the scene, drawn."""
    return scene.render(camera).color


def main() -> None:
    options = bench.options(__doc__, frames=20, width=510, height=480, rounds=1)
    rows = []
    for name, (model, paper, pictures, begin, end, target, share) in PATHS.items():
        if options.quick and name != "sibenik":
            continue
        scene = cyc.scenes.pipes(205_000) if name == "pipes" else bench.scene(options.meshes, name)
        corners = scene.vertices[scene.faces].astype(np.float64)
        eyes = scene.center + scene.radius * np.linspace(begin, end, pictures * options.frames)
        aim = scene.center + scene.radius * np.array(target)
        cameras = [cyc.Camera.look_at(eye, aim, fov_y=60, width=options.width, height=options.height) for eye in eyes]
        whole, drawn, slow, fast, made = [], [], [], [], []
        for start in range(0, len(cameras), options.frames):
            drop, seconds = lab.elapsed(partial(pictured, scene, cameras[start], share * scene.radius))
            made.append(seconds)
            for camera in cameras[start : start + options.frames]:
                inside = np.flatnonzero(~Cone.of(camera).misses(corners))
                ways = {"whole": partial(colored, scene, camera), "with pictures": partial(drop.draw, camera)}
                ms = lab.medians(ways, options.rounds, warm_up=0)
                slow.append(ms["whole"])
                fast.append(ms["with pictures"])
                whole.append(len(inside))
                kept = np.union1d(drop.near, drop.surrounding)
                drawn.append(len(np.intersect1d(kept, inside)))
        rows.append(
            {
                "model": f"{model} ({name})",
                "pictures": pictures,
                "faces": f"{len(scene):,}",
                "in frustum": f"{np.mean(whole):,.0f}",
                "with pictures": f"{np.mean(drawn):,.0f}",
                "times less": f"{np.mean(whole) / np.mean(drawn):.1f}",
                "ms": f"{np.median(slow):.1f}",
                "ms with": f"{np.median(fast):.1f}",
                "times as fast": f"{np.median(slow) / np.median(fast):.2f}",
                "ms a picture": f"{1e3 * np.mean(made):.0f}",
                "dissertation": paper,
            }
        )
    bench.show("Geometry warping: speed-ups (table 5-1)", rows)


if __name__ == "__main__":
    main()
