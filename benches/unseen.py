"""What the estimate of unseen faces is worth: ten boxes in each of five scenes.

    python benches/unseen.py [--quick] [--boxes 10] [--eyes 216] [--rays 10000000] [--seed 44] [--names ...] [--out DIR]

Boxes lie in the open in a castle, a furnished house, a kitchen and a cathedral, and around an engine. `visible_from`
looks from at most so many eyes; the truth is what five times as many eyes more and random rays find beyond its set (see
`regions.py`, which asks more of the castle). An estimate is good within a factor of 2, or within 2 faces. With `--out`
each box is kept in a file, and one that is there is not done again.
"""

from __future__ import annotations

import json
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import open3d as o3d

import bench
import cyclorama as cyc
from cyclorama.lab import Row
from reference.level import Level
from regions import Box, caster_of, is_good, long_runs, rays_hit

#: In rooms: how far the middles of boxes lie from where one can stand, and half of a box's side at most.
ROOMS = {"fzk_haus": (0.4, 0.3), "kitchen": (0.3, 0.25), "sibenik": (2.0, 1.2)}
CASTLE = "q3_20kdm2"
SCENES = [CASTLE, *ROOMS, "engine_2cylinder"]

#: Truth is looked for with so many times as many eyes.
MORE = 5


def around(scene: cyc.Scene, rng: np.random.Generator) -> Box:
    """A box beside a scene: its middle 0.6 to 1.2 of the scene's diagonal from the scene's."""
    low, high = scene.bounds
    diagonal = float(np.linalg.norm(high - low))
    direction = rng.normal(size=3)
    middle = (low + high) / 2 + direction / np.linalg.norm(direction) * diagonal * rng.uniform(0.6, 1.2)
    half = rng.uniform(0.02, 0.1, 3) * diagonal
    return middle - half, middle + half


def within(name: str, number: int, rng: np.random.Generator) -> Box:
    """A box in a room."""
    (_, places), (spread, reach) = bench.INSIDE[name], ROOMS[name]
    middle = np.array(places[number % len(places)]) + rng.uniform(-spread, spread, 3)
    half = rng.uniform(0.2, 1.0, 3) * reach
    return middle - half, middle + half


def boxes_of(folder: Path, name: str, count: int, seed: int) -> tuple[cyc.Scene, list[Box]]:
    if name == CASTLE:
        level = Level(folder)
        return level.scene, level.boxes(count, seed)
    scene = bench.scene(folder, name)
    rngs = [np.random.default_rng([seed, number]) for number in range(count)]
    if name in ROOMS:
        return scene, [within(name, number, rng) for number, rng in enumerate(rngs)]
    return scene, [around(scene, rng) for rng in rngs]


def measured(
    scene: cyc.Scene, caster: o3d.t.geometry.RaycastingScene, box: Box, eyes: int, rays: int, number: int
) -> Row:
    look = partial(cyc.visible_from, scene, *box, resolution=128, progress=False)
    region = look(max_eyes=eyes)
    runs = long_runs(look, MORE * len(region.eyes))
    hit = rays_hit(caster, *box, rays, number)
    truth = np.unique(np.concatenate([hit, *(run.faces for run in runs)]))
    unseen = len(np.setdiff1d(truth, region.faces))
    return {
        "box": number,
        "eyes": len(region.eyes),
        "faces": len(region.faces),
        "unseen": unseen,
        "estimated": round(region.unseen, 1),
        "good": is_good(region.unseen, unseen),
        "found of rays": round(float(np.isin(hit, region.faces).mean()), 4),
    }


def main() -> None:
    options = bench.options(__doc__, boxes=10, eyes=216, rays=10_000_000, seed=44, names=SCENES, out="")
    if options.quick:
        options.boxes, options.eyes, options.rays, options.names = 1, 24, 300_000, options.names[:2]
    folder = Path(options.out or tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    every: list[Row] = []
    table: list[Row] = []
    for name in options.names:
        scene, boxes = boxes_of(options.meshes, name, options.boxes, options.seed)
        caster = caster_of(scene, np.zeros(3))
        rows: list[Row] = []
        for number, box in enumerate(boxes):
            path = folder / f"{name}-{options.seed}-{number}-{options.eyes}-{options.rays}.json"
            if not path.exists():
                path.write_text(json.dumps(measured(scene, caster, box, options.eyes, options.rays, number)))
            rows.append(json.loads(path.read_text()))
        bench.show(name, rows)
        every += rows
        table.append(
            {
                "scene": name,
                "boxes": len(rows),
                "faces": round(float(np.mean([row["faces"] for row in rows]))),
                "unseen": float(np.median([row["unseen"] for row in rows])),
                "good": sum(row["good"] for row in rows),
                "too low": sum(not row["good"] and row["estimated"] < row["unseen"] for row in rows),
                "found of rays, least": min(row["found of rays"] for row in rows),
            }
        )
    bench.show("Estimates of unseen faces", table)
    print(f"good: {sum(row['good'] for row in every)} of {len(every)} boxes")


if __name__ == "__main__":
    main()
