"""Bakes of real meshes: how long they take, what they miss and cull, beside the papers.

    python benches/bakes.py                                       # every table
    python benches/bakes.py DATA                                  # DATA holds bunny.ply, horse.ply, ...
    python benches/bakes.py DATA --only default                   # default bakes against the union of corner samples
    python benches/bakes.py DATA --only papers                    # culling for patches and polygons, bytes of files
    python benches/bakes.py DATA --only promise --max-missed 1e-3     # bakes that find views and patches themselves

With Open3D installed, missed pixels are judged by Embree's id-buffers instead of this library's own.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab
from cyclorama.bakes.confidence import bootstrap_interval
from cyclorama.bakes.evaluation import random_directions

DEFAULT = [("bunny", 258), ("bunny", 1026), ("horse", 258), ("dragon_100k", 258), ("igea", 258), ("scorpion", 258)]

#: Model, patches and culling rate with 1026 samples in the 2002 paper, table 1.
TABLE_1 = [
    ("bunny", 50, "15 %"),
    ("bunny", 1000, "60 %"),
    ("horse", 400, "38 %"),
    ("dragon_100k", 600, "44 % (of 871,414)"),
    ("brain_icbm152", 1000, "66 % (of 288,334)"),
]

Judge = Callable[[cyc.Camera], np.ndarray]


def judge(scene: cyc.Scene) -> Judge:
    """A second opinion on the nearest face of each pixel, from Embree where it is there."""
    try:
        import open3d as o3d
    except ImportError:
        return lambda camera: scene.render(camera).ids
    rays = o3d.t.geometry.RaycastingScene()
    # Embree is float32: the scene is brought to unit size around zero first.
    scale = 1 / scene.radius
    rays.add_triangles(((scene.vertices - scene.center) * scale).astype(np.float32), scene.faces)

    def ids(camera: cyc.Camera) -> np.ndarray:
        pose = camera.world_to_camera.copy()
        pose[:3, 3] = (pose[:3, 3] + pose[:3, :3] @ scene.center) * scale
        pinhole = o3d.core.Tensor(camera.K), o3d.core.Tensor(pose)
        return rays.cast_rays(rays.create_rays_pinhole(*pinhole, camera.width, camera.height))["primitive_ids"].numpy()

    return ids


def missed(
    vis: cyc.Visibility, scene: cyc.Scene, judged: Judge, views: int, seed: int, distance: float = 1.0
) -> np.ndarray:
    """(V,) share of covered pixels whose nearest face is not answered, over random views."""
    shares = np.empty(views)
    directions = random_directions(views, [seed, 99])
    for k, camera in enumerate(vis.framing.with_resolution((510, 480)).cameras(directions, distance)):
        kept = np.zeros(len(scene), dtype=bool)
        kept[vis.visible_faces(camera.eye)] = True
        ids = judged(camera)
        covered = ids[ids != cyc.BACKGROUND]
        shares[k] = 1 - kept[covered].mean()
    return shares


def corner_union(vis: cyc.Visibility) -> cyc.Visibility:
    """The same bake answered as the papers do."""
    union = copy(vis)
    union.shells = tuple(replace(shell, cells=None) for shell in vis.shells)
    return union


def in_patches(vis: cyc.Visibility, scene: cyc.Scene, count: int) -> cyc.Visibility:
    """The same bake with a bit per patch."""
    return vis.in_patches(cyc.patches.tile(scene.vertices, scene.faces, count))


def file_bytes(vis: cyc.Visibility) -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bake.npz"
        vis.save(path)
        return path.stat().st_size


def default_bakes(data: Path, jobs: list[tuple[str, int]], views: int, seed: int) -> None:
    print(
        "| mesh | views | seconds | missed, cells | missed, corners | culled, cells | culled, corners | probes | file |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, count in jobs:
        scene = cyc.load(data / f"{name}.ply")
        vis, seconds = lab.elapsed(partial(cyc.bake, scene, views=count, progress=False))
        judged = judge(scene)
        corners = corner_union(vis)
        ours, theirs = (missed(v, scene, judged, views, seed).mean() for v in (vis, corners))
        print(
            f"| {name} | {count} | {seconds:.0f} | {ours:.1e} | {theirs:.1e} | {vis.culling_rate():.3f} | "
            f"{corners.culling_rate():.3f} | {vis.probes.mean():.1f} a face | {file_bytes(vis) / 1e6:.2f} MB |",
            flush=True,
        )


def papers(data: Path, names: list[str]) -> None:
    print("| mesh | patches | culled, 2002 paper | ours, corners of 1026 views |")
    print("| --- | --- | --- | --- |")
    bakes: dict[str, tuple[cyc.Scene, cyc.Visibility]] = {}
    for name, count, paper in TABLE_1:
        if names and name not in names:
            continue
        if name not in bakes:
            scene = cyc.load(data / f"{name}.ply")
            vis = cyc.bake(scene, views=1026, join="samples", fill=None, progress=False)
            bakes = {name: (scene, vis)}
            print(f"| {name} | polygons | | {vis.culling_rate():.3f} |", flush=True)
        scene, vis = bakes[name]
        print(f"| {name} | {count} | {paper} | {in_patches(vis, scene, count).culling_rate():.3f} |", flush=True)
        if name == "brain_icbm152":
            for patches, theirs in ((50, 183), (2000, 709)):
                size = file_bytes(in_patches(vis, scene, patches))
                print(f"file of {patches} patches x 1026 samples: {size / 1024:.0f} KB, the paper's {theirs} KB")


def promises(data: Path, names: list[str], max_missed: float, views: int, seed: int) -> None:
    for name in names or ["bunny"]:
        scene = cyc.load(data / f"{name}.ply")
        vis, seconds = lab.elapsed(partial(cyc.bake, scene, max_missed=max_missed, progress=False))
        print(f"{name}: {vis} in {seconds:.0f} s\n  {vis.statement}", flush=True)
        judged = judge(scene)
        for distance in (1.0, 1.5, 4.0):
            shares = missed(vis, scene, judged, views, seed, distance)
            low, high = bootstrap_interval(shares)
            print(
                f"  {views} fresh views at {distance:g} sampling radii: mean {shares.mean():.1e}, "
                f"95 % interval {low:.1e} to {high:.1e}, worst {shares.max():.1e}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", default=bench.MESHES)
    parser.add_argument("--quick", action="store_true", help="one small default bake, to see that it runs")
    parser.add_argument("--only", choices=["default", "papers", "promise"])
    parser.add_argument("--meshes", nargs="*", default=[])
    parser.add_argument("--max-missed", type=float, default=1e-3)
    parser.add_argument("--views", type=int, help="held-out views (24; 200 for a promise)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    if args.quick:
        default_bakes(args.data, [("tree", 18)], args.views or 4, args.seed)
        return
    if args.only in (None, "default"):
        chosen = [job for job in DEFAULT if not args.meshes or job[0] in args.meshes]
        default_bakes(args.data, chosen, args.views or 24, args.seed)
    if args.only in (None, "papers"):
        papers(args.data, args.meshes)
    if args.only in (None, "promise"):
        promises(args.data, args.meshes, args.max_missed, args.views or 200, args.seed)


if __name__ == "__main__":
    main()
