"""Time of a bare view against the number of faces, 10^4 to 10^7, and of 10^6 faces against depth complexity, 1 to 100.

*whole*: a displaced sphere from outside. *hidden*: 20 of them one within another, as many faces together, of which all
but the outermost are hidden. *layers*: sheets one behind another, each filling the image, their faces in random order.
Everything as in id_buffers.py: whole calls at 510 x 480 from Python, rounds interleaved, medians; *first, s* is from
arrays to the first view. *peak, GB* is the memory of a process that does no more than that and one call.
"""

from __future__ import annotations

import functools
import gc
import multiprocessing
import resource
from collections.abc import Callable
from typing import Any

import numpy as np

import bench
import cyclorama as cyc
import rivals
from cyclorama import lab, peers

SHELLS = 20
Arrays = tuple[np.ndarray, np.ndarray]


def grid(across: int, along: int) -> Arrays:
    """(N, 2) points in [-1, 1] squared, and two faces a cell."""
    v, u = np.meshgrid(np.linspace(-1, 1, along + 1), np.linspace(-1, 1, across + 1), indexing="ij")
    here = np.arange(u.size, dtype=np.uint32).reshape(u.shape)
    a, b, c, d = here[:-1, :-1], here[:-1, 1:], here[1:, 1:], here[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)
    return np.column_stack([u.ravel(), v.ravel()]), faces.reshape(-1, 3)


def joined(parts: list[Arrays]) -> Arrays:
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]], dtype=np.uint32)
    faces = np.concatenate([part[1] + start for part, start in zip(parts, starts, strict=True)])
    return np.concatenate([part[0] for part in parts]).astype(np.float32), faces


def bumps(points: np.ndarray, size: float) -> np.ndarray:
    """Hills and hollows of up to `size` at points about one from zero."""
    return size * np.sin(9 * points + 1).prod(axis=1)


def spheres(faces: int, shells: int = 1) -> Arrays:
    """Displaced spheres one within another, each a cube's sides blown up."""
    steps = max(1, round((faces / (12 * shells)) ** 0.5))
    flat, cells = grid(steps, steps)
    bent = np.tan(flat * np.pi / 4)
    parts = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            cube = np.insert(bent, axis, side, axis=1)
            parts.append((cube / np.linalg.norm(cube, axis=1)[:, None], cells))
    ball = joined(parts)
    sizes = 1 - 0.4 * np.arange(shells) / shells
    relief = 1 + bumps(ball[0], 0.1 if shells == 1 else 0.15 / shells)[:, None]
    return joined([(ball[0] * relief * size, ball[1]) for size in sizes])


def sheets(faces: int, layers: int, seed: int = 0) -> Arrays:
    """Bumpy sheets before an eye at zero that looks along z, all of one size to it; their faces in random order."""
    across = max(1, round((faces / layers / 2) ** 0.5))
    flat, cells = grid(across, across)
    parts = []
    for layer in range(layers):
        away = 1 + (layer + bumps(np.insert(flat, 2, layer, axis=1), 0.3)) / layers
        parts.append((np.column_stack([flat * 0.5, np.ones(len(flat))]) * away[:, None], cells))
    vertices, faces_of = joined(parts)
    return vertices, np.random.default_rng(seed).permutation(faces_of)


def outside(scene: cyc.Scene) -> list[cyc.Camera]:
    return bench.around(scene, 4)


def before(scene: cyc.Scene) -> list[cyc.Camera]:
    """Cameras at zero that look along z and a little about."""
    aims = [(0.02, 0.01, 1), (-0.02, 0.02, 1), (-0.01, -0.02, 1), (0.01, -0.01, 1)]
    return [cyc.Camera.look_at((0, 0, 0), aim, width=510, height=480) for aim in aims]


def first_of_open3d(scene: cyc.Scene, cameras: list[cyc.Camera]) -> rivals.Open3D:
    """Open3D with its hierarchy, which it builds with the first view."""
    opened = rivals.Open3D(scene)
    opened.rows(cameras[:1])
    return opened


def row_of(make: Callable[[], Arrays], look: Callable[[cyc.Scene], list[cyc.Camera]], rounds: int) -> dict[str, Any]:
    """What a view of the mesh costs ours on one thread and on all cores, and Open3D on all."""
    vertices, faces = make()

    def first() -> tuple[cyc.Scene, list[cyc.Camera]]:
        scene = cyc.Scene(vertices, faces)
        cameras = look(scene)
        scene.visible(cameras[:1], fill=None, progress=False)
        return scene, cameras

    (scene, cameras), seconds = lab.elapsed(first)
    row: dict[str, Any] = {"faces": len(faces), "first, s": seconds}
    see = functools.partial(scene.visible, cameras, fill=None, progress=False)
    jobs: dict[str, Callable[[], object]] = {"ours 1": functools.partial(see, threads=1), "ours": see}
    try:
        opened, row["o3d first, s"] = lab.elapsed(functools.partial(first_of_open3d, scene, cameras))
        jobs["o3d"] = functools.partial(opened.rows, cameras)
        row["depth"] = opened.depth_complexity(cameras[:1])
    except peers.Missing as missing:
        print(f"* Open3D is missing: {missing}")
    timed = lab.sweep({"job": jobs}, timed=lambda job: jobs[job], rounds=rounds, errors="raise", progress=False)
    ms = {r["job"]: r["time"] / len(cameras) * 1e3 for r in timed}
    row |= {"ms, 1 thread": ms["ours 1"], "ms": ms["ours"], "ns a face, 1 thread": ms["ours 1"] / len(faces) * 1e6}
    if "o3d" in ms:
        row |= {"o3d, ms": ms["o3d"], "x o3d": ms["o3d"] / ms["ours"]}
    return row


def peak(faces: int) -> float:
    """GB that a process has used at most after a call for a sphere of so many faces."""
    scene = cyc.Scene(*spheres(faces))
    gc.collect()
    scene.visible(outside(scene), progress=False)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def draw(by_faces: list[dict[str, Any]], by_layers: list[dict[str, Any]], path: object) -> None:
    import matplotlib.pyplot as plt

    figure, (time_axes, face_axes, layer_axes) = plt.subplots(1, 3, figsize=(15, 4.5), layout="constrained")
    for color, kind in (("C0", "whole"), ("C1", "hidden")):
        rows = [row for row in by_faces if row["scene"] == kind]
        faces = [row["faces"] for row in rows]
        time_axes.plot(faces, [row["ms"] for row in rows], "o-", color=color, label=f"ours, {kind}")
        face_axes.plot(faces, [row["ns a face, 1 thread"] for row in rows], "o-", color=color, label=kind)
        if all("o3d, ms" in row for row in rows):
            time_axes.plot(faces, [row["o3d, ms"] for row in rows], "s:", color=color, label=f"Open3D, {kind}")
    layers = [row["layers"] for row in by_layers]
    layer_axes.plot(layers, [row["ms"] for row in by_layers], "o-", label="ours")
    if all("o3d, ms" in row for row in by_layers):
        layer_axes.plot(layers, [row["o3d, ms"] for row in by_layers], "s:", label="Open3D")
    time_axes.set(xlabel="faces", ylabel="ms a view, all cores")
    face_axes.set(xlabel="faces", ylabel="ns a face, one thread")
    layer_axes.set(xlabel="layers", ylabel="ms a view, all cores", title=f"{by_layers[0]['faces']:,} faces in layers")
    for axes in (time_axes, face_axes, layer_axes):
        axes.set(xscale="log", yscale="log")
        axes.grid(alpha=0.3)
        axes.legend()
    figure.savefig(path, dpi=150, bbox_inches="tight")


def main() -> None:
    counts, depths = [10**4, 3 * 10**4, 10**5, 3 * 10**5, 10**6, 3 * 10**6, 10**7], [1, 2, 5, 10, 20, 50, 100]
    asked = bench.options(__doc__, rounds=5, faces=counts, layers=depths)
    counts, depths, many = asked.faces, asked.layers, 10**6
    if asked.quick:
        counts, depths, many = [10**4, 10**5], [1, 10], 10**5
    by_faces = []
    for count in counts:
        for kind, shells in (("whole", 1), ("hidden", SHELLS)):
            row = row_of(functools.partial(spheres, count, shells), outside, asked.rounds)
            by_faces.append({"scene": kind, **row})
    by_layers = [{"layers": k, **row_of(functools.partial(sheets, many, k), before, asked.rounds)} for k in depths]
    bench.show(f"Bare views against faces, medians of {asked.rounds} interleaved rounds", by_faces)
    bench.show("Bare views against layers of randomly ordered faces", by_layers)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        gigabytes = pool.apply(peak, (counts[-1],))
    print(f"\npeak, GB, of a process with {counts[-1]:,} faces and 4 views of them as by default: {gigabytes:.2f}")
    path = bench.picture_folder() / "scaling.png"
    draw(by_faces, by_layers, path)
    print(f"chart: {path}")


if __name__ == "__main__":
    main()
