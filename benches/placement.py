"""Images that hold a walk to a budget: how many, how far away, how long it takes to place them (table 3-1).

For each scene and budget: images, viewpoints, seconds, frames checked one by one with what was wrong in them, the
distance from eye to viewpoint over those frames in edges of the scene, and milliseconds of a frame. Then the same
budget optimized to less and to more, and pipes from 10^5 to 5 x 10^6 faces. The dissertation's pipes (893, 331 and 282
images in 4.6, 2.8 and 2.4 hours) are another scene on another machine: beside these, not their measure.
"""

from __future__ import annotations

import resource
import time

import numpy as np

import bench
import cyclorama as cyc

SHARES = (0.15, 0.20, 0.25)
#: Which way is up, and the share of the faces that a frame may have: what their density allows.
REAL = {
    "sibenik": ((0, 1, 0), 0.40),
    "kitchen": ((0, 1, 0), 0.40),
    "engine_2cylinder": ((0, 1, 0), 0.50),
    "fzk_haus": ((0, 0, 1), 0.40),
    "q3_20kdm2": ((0, 0, 1), 0.40),
}


def placed(name: str, scene: cyc.Scene, share: float, frames: int, **options: object) -> dict[str, object]:
    """A row: a plan, and what was seen of it."""
    budget = int(share * len(scene))
    row: dict[str, object] = {"scene": name, "faces": len(scene), "budget": budget}
    start = time.perf_counter()
    try:
        plan = cyc.place_images(scene, budget, progress=False, **options)
    except ValueError as error:
        return row | {"s": time.perf_counter() - start, "why not": str(error)[:100]}
    row |= {"s": time.perf_counter() - start, "images": len(plan.images), "viewpoints": len(plan.viewpoints)}
    found = plan.check(frames, progress=False)
    eyes = np.random.default_rng(0).uniform(*plan.domain, (200, 3))
    out = np.empty(plan.budget, np.uint32)
    times = []
    for eye, yaw in zip(eyes, np.linspace(0, 2 * np.pi, 200), strict=True):
        gaze = np.cos(yaw) * plan.axes[0] + np.sin(yaw) * plan.axes[1]
        start = time.perf_counter()
        plan.frame(eye, gaze, out=out)
        times.append(time.perf_counter() - start)
    return row | {
        "sound": found.is_sound,
        "most": found.most,
        "distance, median": found.median_distance,
        "greatest": found.greatest_distance,
        "ms a frame": 1e3 * float(np.median(times)),
        "MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def main() -> None:
    options = bench.options(__doc__, frames=200, faces=1_000_000)
    pipes = cyc.scenes.pipes(100_000 if options.quick else options.faces)
    bench.show("Pipes", [placed("pipes", pipes, share, options.frames) for share in SHARES])
    targets = [(share, int(share * 0.20 * len(pipes))) for share in (0.8, 0.9, 0.95)]
    rows = [
        {"optimized to": f"{share} P"} | placed("pipes", pipes, 0.20, options.frames, optimize_to=target)
        for share, target in targets
    ]
    bench.show("Pipes, 20 %, by what is optimized to", rows)
    rows = [
        placed(name, bench.scene(options.meshes, name), share, options.frames, up=up)
        for name, (up, share) in list(REAL.items())[: 2 if options.quick else None]
    ]
    bench.show("Real scenes, and a plant", [*rows, placed("tree", cyc.scenes.tree(), 0.5, options.frames)])
    sizes = (30_000, 100_000) if options.quick else (100_000, 1_000_000, 5_000_000)
    rows = [placed("pipes", cyc.scenes.pipes(size), 0.20, options.frames // 4) for size in sizes]
    bench.show("Pipes, 20 %, by size", rows)


if __name__ == "__main__":
    main()
