"""What the scripts beside this one share: their options, the meshes and cameras, the machine's name and its memory."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import cyclorama as cyc
from cyclorama import _core, lab

CLONE = Path(__file__).resolve().parents[1]
MESHES = CLONE.parent / "shared" / "data"

# The oracle of the tests judges here too.
sys.path.insert(0, str(CLONE / "tests"))


def options(description: str | None, **defaults: Any) -> argparse.Namespace:
    """A script's command line: `--quick`, `--meshes`, and for each default an option of its type (a flag for False)."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer meshes and rounds, to see that it runs")
    parser.add_argument("--meshes", type=Path, default=MESHES, help="folder of meshes")
    for name, value in defaults.items():
        flag = "--" + name.replace("_", "-")
        if value is False:
            parser.add_argument(flag, action="store_true")
            continue
        many = isinstance(value, list)
        kind = type(value[0] if many else value)
        parser.add_argument(flag, type=kind, default=value, nargs="+" if many else None)
    chosen = parser.parse_args()
    if not chosen.meshes.is_dir():
        raise SystemExit(f"{chosen.meshes} is not there: give the folder of meshes with --meshes")
    return chosen


@cache
def scene(folder: Path, name: str) -> cyc.Scene:
    """The mesh `name` of the folder, whatever its suffix."""
    for path in sorted(folder.glob(f"{name}.*")):
        if path.suffix in (".ply", ".obj", ".stl"):
            return cyc.load(path)
    raise SystemExit(f"no mesh {name!r} in {folder}")


def around(scene: cyc.Scene, count: int, size: tuple[int, int] = (510, 480), fov_y: float = 45.0) -> list[cyc.Camera]:
    """Cameras on a Fibonacci sphere from which the scene's ball just fits the image."""
    width, height = size
    half = np.arctan(np.tan(np.radians(fov_y) / 2) * min(1, width / height))
    i = np.arange(count) + 0.5
    up, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    directions = np.column_stack([np.cos(turn) * np.sqrt(1 - up**2), up, np.sin(turn) * np.sqrt(1 - up**2)])
    eyes = scene.center + directions * scene.radius / np.sin(half)
    return [cyc.Camera.look_at(eye, scene.center, fov_y=fov_y, width=width, height=height) for eye in eyes]


#: Which way is up and where one can stand, for the scenes that are seen from inside.
INSIDE: dict[str, tuple[tuple[int, int, int], list[tuple[float, float, float]]]] = {
    "kitchen": ((0, 1, 0), [(0.84, 1.24, 0.06)]),
    "sibenik": ((0, 1, 0), [(6.0, 5.0, 0.0)]),
    "fzk_haus": ((0, 0, 1), [(4.5, 2.0, 1.6), (5.5, 8.0, 1.6), (9.5, 7.0, 1.6), (3.0, 5.0, 1.6)]),
    "q3_20kdm2": ((0, 0, 1), [(1888, 1344, 112), (1056, 1344, 112)]),
    "tori2m": ((0, 1, 0), [(6.5, 6.5, 5.5), (2.5, 3.5, 8.5)]),
}


def inside(name: str, count: int, size: tuple[int, int] = (510, 480), fov_y: float = 60.0) -> list[cyc.Camera]:
    """Cameras at the eyes inside the scene of that name, in turn, looking around and a little down."""
    up, eyes = INSIDE[name]
    ahead = np.roll(up, 1)
    beside = np.cross(up, ahead)
    cameras = []
    for k, turn in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False) + 0.4):
        eye = np.array(eyes[k % len(eyes)])
        gaze = np.cos(turn) * ahead + np.sin(turn) * beside - 0.15 * np.array(up)
        cameras.append(cyc.Camera.look_at(eye, eye + gaze, up, fov_y=fov_y, width=size[0], height=size[1]))
    return cameras


@dataclass(frozen=True)
class Setting:
    """A scene and the views of it."""

    name: str
    kind: str
    scene: cyc.Scene
    cameras: list[cyc.Camera]


#: Every setting of the races: its kind. The mesh is its name's first word.
SETTINGS = {
    **dict.fromkeys(("bunny", "horse", "igea", "scorpion", "dragon_100k"), "scan"),
    "kitchen": "interior",
    **dict.fromkeys(("kitchen inside", "sibenik inside", "fzk_haus inside", "q3_20kdm2 inside"), "interior"),
    **dict.fromkeys(("tori2m", "tori2m inside"), "deep"),
    **dict.fromkeys(("engine_2cylinder", "legocar", "x_wing"), "CAD"),
    **dict.fromkeys(("tree", "bamboo_truss"), "foliage"),
}


def setting(folder: Path, name: str, views: int) -> Setting:
    """The setting of that name: its mesh from outside, or from inside where the name says so."""
    mesh, _, where = name.partition(" ")
    subject = tori() if mesh == "tori2m" else scene(folder, mesh)
    cameras = inside(mesh, views) if where == "inside" else around(subject, views)
    return Setting(name, SETTINGS.get(name, "other"), subject, cameras)


@cache
def tori(grid: tuple[int, int, int] = (13, 13, 12), around: int = 32, across: int = 16, seed: int = 0) -> cyc.Scene:
    """Randomly turned tori at the integers of a grid, none touching another: by default 2,076,672 faces."""
    rng = np.random.default_rng(seed)
    u, v = (2 * np.pi * np.arange(n) / n for n in (around, across))
    ring = 0.35 + 0.14 * np.cos(v)
    torus = np.stack(
        [np.cos(u)[:, None] * ring, np.sin(u)[:, None] * ring, np.broadcast_to(0.14 * np.sin(v), (around, across))], -1
    ).reshape(-1, 3)
    k = np.arange(around * across).reshape(around, across)
    a, b, c, d = k, np.roll(k, -1, 0), np.roll(k, (-1, -1), (0, 1)), np.roll(k, -1, 1)
    quads = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    centers = np.stack(np.meshgrid(*(np.arange(n) for n in grid), indexing="ij"), -1).reshape(-1, 3)
    turns, _ = np.linalg.qr(rng.normal(size=(len(centers), 3, 3)))
    vertices = torus @ turns + centers[:, None]
    faces = quads + len(torus) * np.arange(len(centers))[:, None, None]
    return cyc.Scene(vertices.reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3))


def write_raw(path: Path, scene: cyc.Scene, cameras: list[cyc.Camera]) -> None:
    """The scene around zero and the cameras, as the programs of this folder read them.

    uint32: vertices, faces, cameras, width, height; float32 (V, 3) and uint32 (F, 3); for each camera 12 float32: the
    eye, the ray through the centre of the first pixel, with depth 1, and its steps to the next column and row.
    """
    sizes = len(scene.vertices), len(scene), len(cameras), cameras[0].width, cameras[0].height
    rays = []
    for camera in cameras:
        back = camera.world_to_camera[:3, :3].T @ np.linalg.inv(camera.K)
        rays.append([camera.eye - scene.center, back @ (0.5, 0.5, 1), back[:, 0], back[:, 1]])
    with path.open("wb") as file:
        for part in (np.uint32(sizes), np.float32(scene.vertices - scene.center), scene.faces, np.float32(rays)):
            file.write(part.tobytes())


@cache
def bandwidth(megabytes: int = 256) -> dict[str, dict[str, float]]:
    """GB/s that NumPy fills, copies (counted twice) and reads, on one thread and on all cores: the best of 9 runs."""
    rows = {}
    for title, threads in {"1 thread": 1, "all cores": cores()}.items():
        parts = [np.ones((2, megabytes * 2**17 // threads), np.uint64) for _ in range(threads)]
        jobs: dict[str, tuple[int, Callable[[np.ndarray], object]]] = {
            "fill": (1, lambda part: part[0].fill(7)),
            "copy": (2, lambda part: np.copyto(part[0], part[1])),
            "read": (1, lambda part: np.bitwise_or.reduce(part[0])),
        }
        size = sum(part[0].nbytes for part in parts) / 1e9
        with ThreadPoolExecutor(threads) as pool:

            def timed(name: str, pool: ThreadPoolExecutor = pool, parts: Any = parts, jobs: Any = jobs) -> Any:
                return lambda: list(pool.map(jobs[name][1], parts))

            found = lab.sweep({"name": jobs}, timed=timed, rounds=9, errors="raise", progress=False)
        rows[title] = {row["name"]: jobs[row["name"]][0] * size / min(row["times"]) for row in found}
    return rows


def cores() -> int:
    """The cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def show(title: str, rows: list[dict[str, Any]], columns: list[str] | None = None) -> None:
    """Prints the rows as a table under the title and the machine."""
    print(f"\n## {title}\n{machine()}\n\n{lab.table(rows, columns)}", flush=True)


@cache
def machine() -> str:
    """The processor, the cores at hand, the versions and the instructions we use, in one line."""
    name = platform.machine()
    if Path("/proc/cpuinfo").exists():
        models = [line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
        name = models[0] if models else name
    ours = f"cyclorama {cyc.__version__} {_core.instruction_set()}"
    return f"{name}, {cores()} cores, Python {platform.python_version()}, {ours}"


def picture_folder() -> Path:
    """Where charts go: `out/` of the clone."""
    folder = CLONE / "out"
    folder.mkdir(exist_ok=True)
    return folder
