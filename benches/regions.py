"""What is seen from boxes in a compiled level: against its potentially visible sets, Embree's rays, and long runs.

    python benches/regions.py [--quick] [--boxes 50] [--first 0] [--rays 10000000] [--long 1080] [--seed 33] [--out DIR]
        [--picture FILE]

Boxes lie in the open, anywhere in the level, with half sides of 16 to 64 units (a player is 56 high); sky and what is
not drawn stop rays. *Witnesses* are confirmed where no face is nearer than the point for Embree, up to 1e-4 of the
distance, in coordinates around the box: in the level's own, float32 moves eyes by a part of how far they are from the
planes of faces that they see edge-on. *Outside* are faces reported though no cluster that the box touches may see
them. The level's compiler took faces away that nobody can come near to, so that some solid walls have none and rays
go through them; *through walls* are the faces outside whose witness looks through such a solid part, for more than a
thousandth of the way: not the sets are wrong there, but the walls are missing. *Rays* start anywhere in the box, in
random directions; *found* is the share of the faces they hit that the set has. All this is asked of the set with close
looks (`guided=True`), which contains the one without. The truth for the estimates is all that is found by the rays and
by a run of even eyes that is five times as long as most. An estimate is good within a factor of 2, or within 2 faces.
The estimate was made on boxes of the seeds 0, 7, 21 and 33; `unseen.py` asks about others.

With `--out` each box is kept in a file, and one that is there is not done again.
"""

from __future__ import annotations

import json
import tempfile
import time
from argparse import Namespace as Options
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import open3d as o3d

import bench
import cyclorama as cyc
from cyclorama import charts, lab
from cyclorama.lab import Row
from reference.level import Level

Box = tuple[np.ndarray, np.ndarray]

#: What is charted: even eyes alone, and so many of them followed by close looks.
LINES = ("even eyes", "and then close looks")
AFTER = (16, 32, 64, 128)

#: Eyes that most boxes get: the corners and 208.
MOST = 216

#: Rays that Embree casts at once.
CHUNK = 1_000_000


def rays_hit(
    caster: o3d.t.geometry.RaycastingScene, low: np.ndarray, high: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """The faces that random rays from a box meet first."""
    rng = np.random.default_rng(seed)
    found = [np.empty(0, np.uint32)]
    for begin in range(0, count, CHUNK):
        eyes = rng.uniform(low, high, (min(CHUNK, count - begin), 3))
        rays = np.hstack([eyes, rng.normal(size=eyes.shape)]).astype(np.float32)
        found.append(np.unique(caster.cast_rays(o3d.core.Tensor(rays))["primitive_ids"].numpy()))
    ids = np.unique(np.concatenate(found))
    return ids[ids != cyc.BACKGROUND]


def caster_of(scene: cyc.Scene, origin: np.ndarray) -> o3d.t.geometry.RaycastingScene:
    """Embree's scene with zero at a place, where float32 is finest."""
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles((scene.vertices - origin).astype(np.float32), scene.faces)
    return caster


def confirmed(scene: cyc.Scene, middle: np.ndarray, eyes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which witnesses Embree agrees to."""
    rays = np.hstack([eyes - middle, np.nan_to_num(points) - eyes]).astype(np.float32)
    reached = caster_of(scene, middle).cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    return np.isfinite(points).all(axis=1) & (reached > 1 - 1e-4)


def is_good(estimate: float, truth: int) -> bool:
    """Within a factor of 2, or within 2 faces."""
    return truth / 2 <= estimate <= 2 * truth or abs(truth - estimate) <= 2


def long_runs(look: Callable[..., cyc.Region], eyes: int) -> list[cyc.Region]:
    """What so many even eyes see: where a run ends because its first eyes saw nothing new, others follow."""
    runs: list[cyc.Region] = []
    while (spent := sum(len(run.eyes) for run in runs)) < eyes:
        runs.append(look(max_eyes=eyes - spent, patience=eyes, seed=1 + len(runs)))
    return runs


def measured(level: Level, caster: o3d.t.geometry.RaycastingScene, box: Box, number: int, options: Options) -> Row:
    """All that is asked of one box."""
    (low, high), scene = box, level.scene
    look = partial(cyc.visible_from, scene, low, high, resolution=128, progress=False)
    even, seconds = lab.elapsed(look, clock=time.process_time)
    region, in_all = lab.elapsed(partial(look, guided=True), clock=time.process_time)
    runs = long_runs(look, options.long)
    shorter = [look(max_eyes=eyes, patience=eyes, guided=True) for eyes in AFTER]
    hit = rays_hit(caster, low, high, options.rays, number)
    truth = np.unique(np.concatenate([hit, *(run.faces for run in runs)]))
    known = len(np.unique(np.concatenate([truth, *(found.faces for found in (*shorter, region))])))
    starts, points = region.witnesses(scene)
    allowed = np.ones(len(scene), bool)
    allowed[: len(level.faces)] = level.bound(level.clusters(low, high))
    outside = np.flatnonzero(~allowed[region.faces])
    unseen, left = (len(np.setdiff1d(truth, found.faces)) for found in (even, region))
    return {
        "box": number,
        "eyes": len(even.eyes),
        "seconds": round(seconds, 2),
        "with close looks": round(in_all, 2),
        "faces": len(region.faces),
        "outside": len(outside),
        "through walls": sum(level.crosses_solid(starts[k], points[k]) for k in outside),
        "confirmed": int(confirmed(scene, (low + high) / 2, starts, points).sum()),
        "found of rays": round(float(np.isin(hit, region.faces).mean()), 4),
        "rays found of set": round(float(np.isin(region.faces, hit).mean()), 3),
        "unseen": unseen,
        "estimated": round(even.unseen, 1),
        "good": is_good(even.unseen, unseen),
        "left by close looks": left,
        "estimated then": round(region.unseen, 1),
        "good then": is_good(region.unseen, left),
        "even eyes": (runs[0].growth / known).round(5).tolist(),
        "and then close looks": [round(len(found.faces) / known, 5) for found in (*shorter, region)],
    }


def left(runs: list[list[float]]) -> np.ndarray:
    """The share of faces not found yet, mean over runs: one that has ended finds no more."""
    length = max(map(len, runs))
    found = [[*run, *(run[-1:] * (length - len(run)))] for run in runs]
    return np.maximum(1 - np.mean(found, axis=0), 1e-6)


def main() -> None:
    options = bench.options(__doc__, boxes=50, first=0, rays=10_000_000, long=1080, seed=33, out="", picture="")
    if options.quick:
        options.boxes, options.rays, options.long = 3, 300_000, 96
    level = Level(options.meshes)
    scene = level.scene
    caster = caster_of(scene, np.zeros(3))
    folder = Path(options.out or tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for number, box in enumerate(level.boxes(options.boxes, options.seed)):
        path = folder / f"{options.seed}-{number}-{options.rays}-{options.long}.json"
        if number >= options.first and not path.exists():
            path.write_text(json.dumps(measured(level, caster, box, number, options)))
        if path.exists():
            rows.append(json.loads(path.read_text()))
    kept = [name for name in rows[0] if name not in LINES]
    bench.show("From-region sets of a compiled level", rows, kept)
    total = sum(row["faces"] for row in rows)
    outside, walls, sure = (sum(row[name] for row in rows) for name in ("outside", "through walls", "confirmed"))
    print(f"faces outside of the compiled sets: {outside} of {total}, {walls} of them through walls that are not drawn")
    print(f"witnesses confirmed: {sure / total:.5f} of {total}")
    shares = [row["found of rays"] for row in rows]
    print(f"found of what {options.rays:,} rays find: median {np.median(shares):.4f}, least {min(shares):.4f}")
    for unseen, good in (("unseen", "good"), ("left by close looks", "good then")):
        middle, share = np.median([row[unseen] for row in rows]), np.mean([row[good] for row in rows])
        print(f"{unseen}: median {middle:g}; estimates that are good: {share:.0%} of {len(rows)} boxes")
    even, closely = (left([row[line] for row in rows]) for line in LINES)
    lines = {LINES[0]: (np.arange(1, len(even) + 1), even), LINES[1]: (np.array([*AFTER, MOST]), closely)}
    path = Path(options.picture) if options.picture else bench.picture_folder() / "regions.png"
    charts.lines(
        lines,
        x="eyes, 8 of them at the corners",
        y="share of faces not found yet, mean over boxes",
        path=path,
        log="xy",
    )
    print(path)


if __name__ == "__main__":
    main()
