"""Efficient and conventional hierarchical culling: figure 7-2 of the 1998 dissertation, storage, and seconds.

    python benches/octree.py [--quick] [--frames 200] [--seed 0] [--rounds 3]

The path is closed and lies inside the scene's box: the middle, and on each axis three waves of periods 1, 1/2 and 1/3
with seeded phases and amplitudes that add up to 0.8 of half the box. The eye looks where it goes, level at most 30
degrees up or down, with a field of 60 x 46.8 degrees. Every 20 frames a new image is taken, from where the eye then is
along its gaze there: a rectangle over 0.7 of the field each way, at half the scene's radius. It stands still while the
eye goes on, and tiles what the eye sees (figure 7-1) as long as its corners are in front of the eye, and the eye before
its plane; else the frame is culled to the frustum alone.

The dissertation's machine room drew 60 % of what conventional culling drew.
"""

from __future__ import annotations

from functools import partial

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import charts, lab, octree
from cyclorama.octree import Octree

#: Frames that an image serves; the share of the field that it covers; its distance over the scene's radius.
SERVES, SHARE, DISTANCE = 20, 0.7, 0.5

UP = {"fzk_haus": (0, 0, 1), "q3_20kdm2": (0, 0, 1)}


def walk(scene: cyc.Scene, frames: int, seed: int, up: tuple[int, int, int]) -> list[cyc.Camera]:
    """Cameras along the path."""
    rng = np.random.default_rng(seed)
    half = (scene.bounds[1] - scene.bounds[0]) / 2
    waves = rng.dirichlet(np.ones(3), 3)
    phases = rng.uniform(0, 2 * np.pi, (3, 3))
    k = np.arange(1, 4)
    cameras = []
    for t in np.arange(frames) / frames * 2 * np.pi:
        eye = scene.center + 0.8 * half * (waves * np.sin(k * t + phases)).sum(axis=1)
        gaze = half * (waves * k * np.cos(k * t + phases)).sum(axis=1)
        high = gaze @ up
        level = gaze - high * np.array(up)
        steep = np.tan(np.radians(30)) * np.linalg.norm(level)
        target = eye + level + np.clip(high, -steep, steep) * np.array(up)
        cameras.append(cyc.Camera.look_at(eye, target, up, fov_y=46.8, width=640, height=480))
    return cameras


def image_of(camera: cyc.Camera, distance: float) -> np.ndarray:
    """(4, 3) the corners of the image taken by a camera."""
    size = np.array([camera.width, camera.height])
    pixels = size * (0.5 + SHARE / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))
    rays = np.column_stack([pixels, np.ones(4)]) @ np.linalg.inv(camera.K).T
    return camera.eye + distance * rays @ camera.world_to_camera[:3, :3]


def figure(name: str, scene: cyc.Scene, options: object) -> list[dict]:
    frames, seed = options.frames, options.seed
    conventional, efficient = Octree(scene, "conventional", progress=False), Octree(scene, progress=False)
    room = np.empty(5 * len(scene), np.uint32)
    counts: dict[str, list[int]] = {"frustum alone": [], "conventional": [], "efficient": []}
    alone, seen, tiled = [], [], 0
    corners = None
    for number, camera in enumerate(walk(scene, frames, seed, UP.get(name, (0, 1, 0)))):
        if number % SERVES == 0:
            corners = image_of(camera, DISTANCE * scene.radius)
            gaze = camera.forward
        # Its corners in front of the eye, and the eye before its plane: else nothing of it is seen, or its back.
        ahead = ((corners - camera.eye) @ camera.forward > 0).all() and (corners[0] - camera.eye) @ gaze > 0
        regions = octree.tiles(camera, corners) if ahead else [camera]
        tiled += ahead
        counts["frustum alone"].append(conventional.cull(camera, out=room).drawn)
        alone.append(efficient.cull(camera, out=room).drawn)
        seen.append(regions)
    jobs = {}
    for kind, tree in (("conventional", conventional), ("efficient", efficient)):
        counts[kind] = [tree.cull(regions, out=room).drawn for regions in seen]
        jobs[kind] = lambda tree=tree: [tree.cull(regions, out=room) for regions in seen]
    times = lab.medians(jobs, options.rounds)
    charts.lines(
        {kind: (np.arange(frames), values) for kind, values in counts.items()},
        x="frame",
        y="triangles drawn",
        title=f"{name}: {len(scene):,} faces, one image, path {seed}",
        path=bench.picture_folder() / f"octree_{name}.png",
    )
    means = {kind: float(np.mean(values)) for kind, values in counts.items()}
    return {
        "scene": name,
        "faces": len(scene),
        "frames with an image": f"{tiled} of {frames}",
        **{f"{kind}": round(mean) for kind, mean in means.items()},
        "alone, efficient": round(np.mean(alone)),
        "efficient / conventional": means["efficient"] / means["conventional"],
        "worst frame": max(e / c for e, c in zip(counts["efficient"], counts["conventional"], strict=True) if c),
        "ms conventional": times["conventional"] / frames,
        "ms efficient": times["efficient"] / frames,
    }


def built(name: str, scene: cyc.Scene) -> dict:
    row: dict = {"scene": name, "faces": len(scene)}
    for kind in ("conventional", "efficient"):
        tree, row[f"{kind}, s"] = lab.elapsed(partial(Octree, scene, kind, progress=False))
    return row | {
        "cells": tree.nodes,
        "crossing / faces": tree.crossing / len(scene),
        "references / faces": tree.references / len(scene),
    }


def main() -> None:
    options = bench.options(__doc__, frames=200, seed=0, rounds=3)
    meshes = ["engine_2cylinder", "sibenik", "kitchen", "fzk_haus"]
    scenes = {name: bench.scene(options.meshes, name) for name in meshes[: 2 if options.quick else None]}
    scenes["pipes"] = cyc.scenes.pipes(100_000 if options.quick else 1_000_000)
    bench.show("Triangles drawn along a path", [figure(name, scene, options) for name, scene in scenes.items()])
    bench.show(
        "Storage of engine_2cylinder against the level at which passing down stops",
        octree.storage(scenes["engine_2cylinder"], progress=False),
    )
    if not options.quick:
        scenes["pipes 5M"] = cyc.scenes.pipes(5_000_000)
    bench.show("Building", [built(name, scene) for name, scene in scenes.items()])


if __name__ == "__main__":
    main()
