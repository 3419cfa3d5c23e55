"""Whether `engine="auto"` picks well: milliseconds a view of both engines and of its choice, by scene and image size.

    python benches/auto.py

Bare rows (`scene.visible(cameras, fill=None)`) of tori, one to thousands, from outside and from between them, and of a
few meshes, in square images. Both engines are warm: clusters and hierarchy are there. The last column is auto's time
over the better engine's.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Literal

import numpy as np

import cyclorama as cyc
from bench import around, cores, options, scene, show, tori
from cyclorama import lab

Engine = Literal["raster", "raycast", "auto"]
ENGINES: tuple[Engine, ...] = ("raster", "raycast", "auto")

#: Tori along each axis: 1,024 faces to 3.9 million.
GRIDS = [(1, 1, 1), (3, 3, 3), (6, 6, 6), (13, 13, 12), (16, 16, 15)]


def between(scene: cyc.Scene, grid: tuple[int, int, int], count: int, side: int) -> list[cyc.Camera]:
    """Cameras in the gap nearest the middle of the tori, looking around."""
    eye = np.floor((np.array(grid) - 1) / 2) + 0.5
    directions = [camera.eye - scene.center for camera in around(scene, count)]
    return [cyc.Camera.look_at(eye, eye + d, fov_y=60.0, width=side, height=side) for d in directions]


def settings(chosen: Any) -> Iterator[tuple[str, cyc.Scene, list[cyc.Camera]]]:
    """What is looked at, from where, in which size."""
    views, sides = (2, chosen.sides[::2]) if chosen.quick else (chosen.views, chosen.sides)
    for grid in GRIDS[: 3 if chosen.quick else None]:
        subject = tori(grid)
        for side in sides:
            yield "tori", subject, around(subject, views, (side, side))
            if grid != (1, 1, 1):
                yield "tori inside", subject, between(subject, grid, views, side)
    for name in [] if chosen.quick else chosen.names:
        subject = scene(chosen.meshes, name)
        for side in sides:
            yield name, subject, around(subject, views, (side, side))


def race(subject: cyc.Scene, cameras: list[cyc.Camera], rounds: int, threads: int) -> dict[str, float]:
    """Median milliseconds a view of each engine, in turn round by round; short calls are repeated to fill 10 ms."""
    see = partial(subject.visible, cameras, fill=None, threads=threads)
    jobs = {engine: partial(see, engine=engine) for engine in ENGINES}
    times = lab.medians(jobs, rounds, warm_up=2, at_least=0.01)
    return {engine: ms / len(cameras) for engine, ms in times.items()}


def main() -> None:
    chosen = options(
        __doc__,
        sides=[16, 32, 64, 128, 256, 1024],
        names=["bunny", "kitchen", "bamboo_truss"],
        views=16,
        rounds=5,
        threads=cores(),
    )
    rows, worst = [], []
    for name, subject, cameras in settings(chosen):
        times = race(subject, cameras, 2 if chosen.quick else chosen.rounds, chosen.threads)
        worst.append(round(times["auto"] / min(times["raster"], times["raycast"]), 2))
        rows.append(
            {
                "scene": name,
                "faces": len(subject),
                "image": f"{cameras[0].width} x {cameras[0].height}",
                **{f"ms {engine}": round(times[engine], 3) for engine in ENGINES},
                "auto / better": worst[-1],
            }
        )
    show("auto: bare rows", rows)
    print(f"\nworst: {max(worst)}")


if __name__ == "__main__":
    main()
