"""What one view misses, what it reports wrongly, and its time: the three fills at 510 x 480 side by side.

The truth is Embree's (Open3D): 3 x 3 rays a pixel and 16 uniformly random points on every face that none of them hit,
with a seed of its own. Coincident faces count as one, faces without area not at all. A reported face is false if
neither that truth nor 500 further random points on it can confirm it; for the default sampler also: nor 20,000. Shares
are of all views of a mesh together.

Most views look at the mesh from outside; `kitchen` and `sibenik` are seen from inside.
"""

from __future__ import annotations

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab

MESHES = {
    "bunny": "scan",
    "horse": "scan",
    "igea": "scan",
    "dragon_100k": "scan",
    "engine_2cylinder": "CAD",
    "legocar": "CAD",
    "x_wing": "CAD",
    "tray_plate": "CAD",
    "kitchen": "CAD",
    "tree": "foliage",
    "bamboo_truss": "foliage",
    "sibenik": "building",
}
EYES_INSIDE = {"kitchen": (0.84, 1.24, 0.06), "sibenik": (6.0, 5.0, 0.0)}


def cameras_of(name: str, scene: cyc.Scene, views: int) -> list[cyc.Camera]:
    if name not in EYES_INSIDE:
        return bench.around(scene, views)
    eye = np.array(EYES_INSIDE[name])
    turns = np.linspace(0, 2 * np.pi, views, endpoint=False) + 0.4
    return [cyc.Camera.look_at(eye, eye + np.array([np.cos(turn), -0.15, np.sin(turn)]), fov_y=60) for turn in turns]


def main() -> None:
    asked = bench.options(__doc__, views=3, rounds=5, names=list(MESHES), seed=1)
    from reference.truth import Truth

    names = asked.names[:1] if asked.quick else asked.names
    views = 1 if asked.quick else asked.views
    table = []
    for name in names:
        scene = bench.scene(asked.meshes, name)
        cameras = cameras_of(name, scene, views)
        truth = Truth(scene.vertices, scene.faces)
        seen = [truth.view(camera, seed=asked.seed + place) for place, camera in enumerate(cameras)]
        fills = ["rays", "neighbours", None]
        timed = lab.sweep(
            {"fill": fills},
            timed=lambda fill, scene=scene, cameras=cameras: (
                lambda: [scene.visible(camera, fill, progress=False) for camera in cameras]
            ),
            rounds=asked.rounds,
            errors="raise",
            progress=False,
        )
        for row in timed:
            bits = scene.visible(cameras, row["fill"], progress=False)
            verdicts = [view.judge(bits.ids(place)) for place, view in enumerate(seen)]
            patient = None
            if row["fill"] == "rays":
                patient = sum(len(v.judge(bits.ids(place), points=20_000).false_faces) for place, v in enumerate(seen))
            reported = max(1, sum(v.reported for v in verdicts))
            table.append(
                {
                    "mesh": name,
                    "kind": MESHES.get(name, "other"),
                    "fill": row["fill"] or "none",
                    "visible": sum(v.visible for v in verdicts),
                    "missed, %": 100 * sum(len(v.missed_faces) for v in verdicts) / sum(v.visible for v in verdicts),
                    "false, %": 100 * sum(len(v.false_faces) for v in verdicts) / reported,
                    "by 20,000 points, %": None if patient is None else 100 * patient / reported,
                    "ms a view": row["time"] / len(cameras) * 1e3,
                }
            )
    bench.show(f"{views} views at 510 x 480 of each mesh, times: medians of {asked.rounds} interleaved rounds", table)


if __name__ == "__main__":
    main()
