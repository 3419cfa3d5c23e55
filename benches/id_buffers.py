"""The race: rows of bits from cameras at 510 x 480, ours beside everybody's, and how far all are from the memory.

Whole calls from Python, acceleration structures built before, rounds interleaved, medians. *bare* is
`scene.visible(cameras, fill=None)`, *sure* the default, which also finds the faces between the pixels. Columns ending
in *1* are on one thread, the others on all cores. A number under *x* says how many times longer a rival takes than our
bare row (*x sure*: than our sure one) on as many threads:

* o3d: Open3D's ray caster with NumPy scattering and packing, its own rays or NumPy's, whichever is faster;
* trimesh: embreex's first hits, on the one thread that it has, against ours on all; pyrender: OpenGL in software with a
  shader that writes the number of the face, on all cores; opencv: `triangleRasterizeDepth`, which gives depth only;
* emb16: Embree 3 from C++, coherent packets of 4 x 4 pixels, built with -O3 -march=native; emb: its single rays.

*auto/best* is how many times as long a bare row takes by the engine that is chosen as by the faster one. *depth* is the
depth complexity: the faces that the ray through a pixel's centre crosses, averaged over the pixels that see any.
*differ* is the share of bits that differ between ours and Open3D's, of all set; nearly all of them are ties of
coincident faces. *limit* is the time in which all cores read the mesh once (12 bytes a vertex and a face) and write ids
and depths once, at the measured bandwidth; *of it* is how many times as long our bare row takes. What stays in the
caches, as images do, costs less than that. The last columns are shares of the time of a sure row. `--instructions AVX2`
does without AVX-512.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib import metadata
from typing import Any

import numpy as np

import bench
import rivals
from cyclorama import _core, lab, peers
from cyclorama.camera import stack

QUICK = ["bunny", "kitchen inside", "tree"]

#: Seconds a view from which on a rival draws only one.
SLOW = 0.5
ENGINES = ("auto", "raster", "raycast")
RIVALS = ["o3d", "emb16", "trimesh", "pyrender", "opencv"]

Job = Callable[[], object]


def jobs_of(setting: bench.Setting, asked: list[str]) -> tuple[dict[str, tuple[int, Job]], dict[str, str], list[Any]]:
    """How many views each job draws and the job; notes on rivals; the rivals that are there."""
    scene, cameras = setting.scene, setting.cameras
    few = cameras[:: max(1, len(cameras) // 4)]
    jobs: dict[str, tuple[int, Job]] = {}
    for name, threads in {"": None, " 1": 1}.items():
        see = functools.partial(scene.visible, cameras, threads=threads, progress=False)
        jobs["bare" + name] = len(cameras), functools.partial(see, fill=None)
        jobs["sure" + name] = len(cameras), see
    for engine in ENGINES:
        see = functools.partial(scene.visible, few, fill=None, engine=engine, progress=False)
        jobs[engine] = len(few), see
    notes, here = {}, []
    makers: dict[str, Callable[[], Any]] = {
        "o3d": lambda: rivals.Open3D(scene),
        "emb16": lambda: rivals.Embree16(scene, cameras),
        "trimesh": lambda: rivals.Trimesh(scene),
        "pyrender": lambda: rivals.Pyrender(scene),
        "opencv": lambda: rivals.OpenCV(scene),
    }
    for name in asked:
        make = makers[name]
        try:
            rival = make()
        except peers.Missing as why:
            notes[name] = f"missing, {why}"
            continue
        here.append(rival)
        if name == "o3d":
            for suffix, threads in {"": 0, " 1": 1}.items():
                for own in (False, True):
                    cast = functools.partial(rival.rows, cameras, own=own, threads=threads)
                    jobs[f"o3d{suffix}{', own rays' if own else ''}"] = len(cameras), cast
        elif name == "emb16":
            notes[name] = rival.version
            for title, lanes, threads in (("emb16", 16, bench.cores()), ("emb16 1", 16, 1), ("emb 1", 1, 1)):
                jobs[title] = len(cameras), functools.partial(rival.draw, lanes, threads)
        else:
            slow = lab.elapsed(functools.partial(rival.rows, few[:1]))[1] > SLOW
            if slow:
                notes[f"{name}, {setting.name}"] = f"more than {SLOW} s a view, so one view only"
            some = few[:1] if slow else few
            jobs[name] = len(some), functools.partial(rival.rows, some)
    return jobs, notes, here


def race(setting: bench.Setting, asked: list[str], rounds: int) -> tuple[dict[str, Any], dict[str, str]]:
    """The row of a setting, and notes on the rivals."""
    jobs, notes, here = jobs_of(setting, asked)
    timed = lab.sweep({"job": jobs}, timed=lambda job: jobs[job][1], rounds=rounds, progress=False)
    notes |= {row["job"]: row["error"] for row in timed if "error" in row}
    ms = {row["job"]: row["time"] / jobs[row["job"]][0] * 1e3 for row in timed if "time" in row}
    for name in ("o3d", "o3d 1"):
        known = [ms[job] for job in (name, f"{name}, own rays") if job in ms]
        if known:
            ms[name] = min(known)
    row: dict[str, Any] = {"scene": setting.name, "kind": setting.kind, "faces": len(setting.scene)}
    opened = next((rival for rival in here if isinstance(rival, rivals.Open3D)), None)
    row["depth"] = opened.depth_complexity(setting.cameras[:4]) if opened else None
    for name in ("bare", "sure"):
        row |= {f"{name} ms": ms[name], f"{name} /s": round(1e3 / ms[name])}
    row |= {"o3d ms": ms.get("o3d"), "x o3d": ratio(ms, "o3d", "bare"), "x sure": ratio(ms, "o3d", "sure")}
    row |= {"bare 1": ms["bare 1"], "sure 1": ms["sure 1"], "o3d 1": ms.get("o3d 1")}
    row |= {"x o3d 1": ratio(ms, "o3d 1", "bare 1"), "x sure 1": ratio(ms, "o3d 1", "sure 1")}
    row |= {f"x {name}": ratio(ms, name, "bare") for name in ("trimesh", "pyrender", "opencv", "emb16")}
    row |= {"x emb16 1": ratio(ms, "emb16 1", "bare 1"), "x emb 1": ratio(ms, "emb 1", "bare 1")}
    row |= {f"{name} ms": ms[name] for name in ENGINES[1:]}
    row["auto/best"] = ms["auto"] / min(ms[name] for name in ENGINES)
    row["differ, %"] = 100 * differ(setting, opened) if opened else None
    row["limit ms"] = limit(setting)
    row["of it"] = ms["bare"] / row["limit ms"]
    row |= shares(setting)
    for rival in here:
        if hasattr(rival, "close"):
            rival.close()
    return row, notes


def ratio(ms: dict[str, float], theirs: str, ours: str) -> float | None:
    return ms[theirs] / ms[ours] if theirs in ms else None


def differ(setting: bench.Setting, opened: rivals.Open3D) -> float:
    """Share of bits that differ from Open3D's, of all set."""
    ours = setting.scene.visible(setting.cameras, fill=None, progress=False).words.view(np.uint8)
    theirs = np.array(opened.rows(setting.cameras))
    ours = ours[:, : theirs.shape[1]]
    return float(np.bitwise_count(ours ^ theirs).sum() / np.bitwise_count(ours | theirs).sum())


def limit(setting: bench.Setting) -> float:
    """Milliseconds to read the mesh and to write one view of it, on all cores."""
    speed = bench.bandwidth()["all cores"]
    mesh = 12 * (len(setting.scene.vertices) + len(setting.scene))
    image = 8 * setting.cameras[0].width * setting.cameras[0].height
    return (mesh / speed["read"] + image / speed["fill"]) / 1e6


def shares(setting: bench.Setting) -> dict[str, float]:
    """Shares of a sure row's time, in per cent."""
    seconds = dict(setting.scene._mesh.stages(stack(setting.cameras), "rays"))
    return {f"{name}, %": 100 * value / sum(seconds.values()) for name, value in seconds.items()}


def surroundings() -> str:
    """The versions of the rivals, and how fast the memory is."""
    owners = metadata.packages_distributions()
    names = [owners[module][0] for module in ("open3d", "trimesh", "embreex", "pyrender", "cv2") if module in owners]
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in names)
    speeds = "; ".join(
        f"{title}: " + ", ".join(f"{name} {speed:.0f}" for name, speed in row.items())
        for title, row in bench.bandwidth().items()
    )
    return f"versions: {versions}\nmemory, GB/s: {speeds}"


def main() -> None:
    asked = bench.options(__doc__, views=16, rounds=5, names=list(bench.SETTINGS), rivals=RIVALS, instructions="")
    if asked.instructions:
        _core.use_instruction_set(asked.instructions)
    names = QUICK if asked.quick else asked.names
    views, rounds = (4, 3) if asked.quick else (asked.views, asked.rounds)
    table, notes = [], {}
    for name in names:
        half = bench.SETTINGS.get(name) == "deep"
        setting = bench.setting(asked.meshes, name, max(1, views // 2) if half else views)
        row, more = race(setting, asked.rivals, rounds)
        table.append(row)
        notes |= more
        print(f"{name}: {row['bare ms']:.2f} ms bare, {row['sure ms']:.2f} sure", flush=True)
    bench.show(f"Rows of bits at 510 x 480, {views} views a call, medians of {rounds} interleaved rounds", table)
    print()
    for name, note in notes.items():
        print(f"{name}: {note}")
    print(surroundings())


if __name__ == "__main__":
    main()
