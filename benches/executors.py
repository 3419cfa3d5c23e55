"""Memory of workers, the most that a process of a pool holds while it bakes; and what of a placement can be spread.

    python benches/executors.py [--quick] [--workers 2] [--views 18]

Each row is a pool of its own, of processes that begin from nothing. *At rest* is a worker that has the library and no
scene; *scene* the arrays of vertices and faces; *most* the peak of the worker that had the most, over a whole bake;
*scenes* how many times the scene that is more than at rest. The rows of a task are 16 views of one bit a face, in and
out. Beside it, what the whole bake takes on the pool and on threads of one process, which have the same bits.

Of `place_images` what its boxes see can be spread, the cover and its proof not: the second table has the seconds of
both, in one process with all its threads, with a budget of 15 % of the faces.
"""

from __future__ import annotations

import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import bitfield, lab
from cyclorama.lab import Row


def peak(_: object = None) -> int:
    """Bytes that this process held at most: not of `getrusage`, which keeps what its parent held when it began it."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return 1024 * int(re.search(r"VmHWM:\s+(\d+) kB", status)[1])


def pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def baked(scene: cyc.Scene, workers: int, views: int) -> Row:
    """A row: memory and time of a bake on processes."""
    with pool(1) as one:
        rest = one.submit(peak).result()
    options = {"views": views, "resolution": (255, 240), "probes": 4, "progress": False}
    alone, seconds = lab.elapsed(partial(cyc.bake, scene, **options))
    with pool(workers) as some:
        there, spread = lab.elapsed(partial(cyc.bake, scene, **options, executor=some))
        most = max(some.map(peak, range(4 * workers)))
    assert there.bitfields == alone.bitfields and there.cells == alone.cells
    size = scene.vertices.nbytes + scene.faces.nbytes
    return {
        "faces": len(scene),
        "at rest, MB": rest / 1e6,
        "scene, MB": size / 1e6,
        "most, MB": most / 1e6,
        "scenes": (most - rest) / size,
        "rows of a task, MB": 16 * len(scene) / 8e6,
        "s, pool": spread,
        "s, threads": seconds,
    }


def placed(scene: cyc.Scene, along: int) -> Row:
    """A row: seconds of a placement with so many boxes along each axis, and of the same with what they see given."""
    place = partial(cyc.place_images, scene, int(0.15 * len(scene)), progress=False)
    plan, whole = lab.elapsed(partial(place, visibility=along))
    sight = plan.sight
    seen = [np.flatnonzero(row) for row in bitfield.unpack(sight.visible, len(scene))]
    given = [(low, high, faces) for (low, high), faces in zip(sight.regions, seen, strict=True)]
    again, rest = lab.elapsed(partial(place, visibility=given, domain=plan.domain))
    assert len(again.images) == len(plan.images)
    return {
        "faces": len(scene),
        "boxes": along**3,
        "s, whole": whole,
        "s, cover and proof": rest,
        "share that can be spread": f"{1 - rest / whole:.0%}",
    }


def main() -> None:
    options = bench.options(__doc__, workers=2, views=18)
    sizes = (20_000, 100_000) if options.quick else (100_000, 500_000, 2_000_000)
    rows = [baked(cyc.scenes.pipes(size), options.workers, options.views) for size in sizes]
    bench.show(f"A bake of {options.views} views on {options.workers} processes", rows)
    settings = [(100_000, 2)] if options.quick else [(100_000, 2), (100_000, 4), (1_000_000, 2)]
    bench.show("A placement, by boxes", [placed(cyc.scenes.pipes(size), along) for size, along in settings])


if __name__ == "__main__":
    main()
