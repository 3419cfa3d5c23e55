"""What is seen from boxes in a compiled level: against its potentially visible sets, Embree's rays, and long runs.

    python benches/regions.py [--quick] [--boxes 50] [--rays 10000000] [--seed 0]

Boxes lie in the open, anywhere in the level, with half sides of 16 to 64 units (a player is 56 high); sky and what is
not drawn stop rays. *Outside* are faces reported though no cluster that the box touches may see them, *through walls*
those of them whose witness looks through something solid that the level's faces leave out. *Witnesses* are confirmed
where no face is nearer than the point for Embree, up to 1e-4 of the distance. *Rays* start anywhere in the
box, in random directions; *found* is the share of the faces they hit that the set has. The truth for the estimate is
all that is found by the rays, by a run of ten times as many eyes, and by another one that is not guided. An estimate is
good within a factor of 2, or within 2 faces.
"""

from __future__ import annotations

import time

import numpy as np
import open3d as o3d

import bench
import cyclorama as cyc
from cyclorama import charts
from reference.level import Level

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


def confirmed(caster: o3d.t.geometry.RaycastingScene, eyes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which witnesses Embree agrees to."""
    rays = np.hstack([eyes, np.nan_to_num(points) - eyes]).astype(np.float32)
    reached = caster.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    return np.isfinite(points).all(axis=1) & (reached > 1 - 1e-4)


def main() -> None:
    options = bench.options(__doc__, boxes=50, rays=10_000_000, seed=0)
    count, rays = (3, 300_000) if options.quick else (options.boxes, options.rays)
    level = Level(options.meshes)
    scene = level.scene
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices.astype(np.float32), scene.faces)
    rows, witnesses, curves = [], [], {}
    for number, (low, high) in enumerate(level.boxes(count, options.seed)):
        start = time.perf_counter()
        region = cyc.visible_from(scene, low, high, resolution=128, progress=False)
        seconds = time.perf_counter() - start
        eyes = len(region.eyes)
        many = 10 * eyes
        long = cyc.visible_from(scene, low, high, resolution=128, max_eyes=many, patience=many, seed=1, progress=False)
        even = cyc.visible_from(
            scene, low, high, resolution=128, max_eyes=many // 2, patience=many, guided=False, seed=2, progress=False
        )
        hit = rays_hit(caster, low, high, rays, number)
        truth = np.union1d(np.union1d(long.faces, even.faces), np.union1d(region.faces, hit))
        starts, points = region.witnesses(scene)
        witnesses.append(confirmed(caster, starts, points))
        allowed = np.ones(len(scene), bool)
        allowed[: len(level.faces)] = level.bound(level.clusters(low, high))
        outside = np.flatnonzero(~allowed[region.faces])
        unseen = len(truth) - len(region.faces)
        rows.append(
            {
                "box": number,
                "eyes": eyes,
                "seconds": round(seconds, 2),
                "faces": len(region.faces),
                "outside": len(outside),
                "through walls": sum(level.crosses_solid(starts[k], points[k]) for k in outside),
                "witnesses": round(float(witnesses[-1].mean()), 4),
                "found of rays": round(float(np.isin(hit, region.faces).mean()), 4),
                "rays found of set": round(float(np.isin(region.faces, hit).mean()), 3),
                "unseen": unseen,
                "estimated": round(region.unseen, 1),
                "good": unseen / 2 <= region.unseen <= 2 * unseen or abs(unseen - region.unseen) <= 2,
            }
        )
        for kind, run in (("guided", long), ("even", even)):
            curves.setdefault(kind, []).append((run.growth / len(truth))[: 5 * eyes])
    bench.show("From-region sets of a compiled level", rows)
    together = np.concatenate(witnesses)
    total = sum(row["faces"] for row in rows)
    outside, walls = (sum(row[name] for row in rows) for name in ("outside", "through walls"))
    print(f"faces outside of the compiled sets: {outside} of {total}, {walls} of them through walls that are not drawn")
    print(f"witnesses confirmed: {together.mean():.5f} of {len(together)}")
    shares = [row["found of rays"] for row in rows]
    print(f"found of what {rays:,} rays find: median {np.median(shares):.4f}, least {min(shares):.4f}")
    print(f"estimates that are good: {np.mean([row['good'] for row in rows]):.0%} of {len(rows)} boxes")
    lines = {}
    for kind, runs in curves.items():
        length = min(map(len, runs))
        lines[kind] = (np.arange(1, length + 1), 1 - np.mean([run[:length] for run in runs], axis=0))
    path = bench.picture_folder() / "regions.png"
    charts.lines(lines, x="eyes", y="share of faces not found yet, mean over boxes", path=path, log="xy")
    print(path)


if __name__ == "__main__":
    main()
