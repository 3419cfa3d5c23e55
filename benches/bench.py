"""What the scripts beside this one share: their options, where the meshes are, the cameras, the machine's name."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import cyclorama as cyc
from cyclorama import lab

CLONE = Path(__file__).resolve().parents[1]
MESHES = CLONE.parent / "shared" / "data"

# The oracle of the tests judges here too.
sys.path.insert(0, str(CLONE / "tests"))


def options(description: str | None, **defaults: Any) -> argparse.Namespace:
    """The command line of a script: `--quick`, `--meshes`, and an option for each default, of its type."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer meshes and rounds, to see that it runs")
    parser.add_argument("--meshes", type=Path, default=MESHES, help="folder of meshes")
    for name, value in defaults.items():
        many = isinstance(value, list)
        kind = type(value[0] if many else value)
        flag = "--" + name.replace("_", "-")
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


def show(title: str, rows: list[dict[str, Any]], columns: list[str] | None = None) -> None:
    """Prints the rows as a table under the title and the machine."""
    print(f"\n## {title}\n{machine()}\n\n{lab.table(rows, columns)}", flush=True)


@cache
def machine() -> str:
    """The processor, the cores at hand and the versions, in one line."""
    name = platform.machine()
    if Path("/proc/cpuinfo").exists():
        models = [line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
        name = models[0] if models else name
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{name}, {cores} cores, Python {platform.python_version()}, cyclorama {cyc.__version__}"


def picture_folder() -> Path:
    """Where charts go: `out/` of the clone."""
    folder = CLONE / "out"
    folder.mkdir(exist_ok=True)
    return folder
