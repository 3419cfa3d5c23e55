"""Quality and time of warps: against distance moved, kind of splat and resolution; and the flicker of a walk.

Surfaces are painted with a solid texture whose shortest wave is `--grain` pixels long at the mean depth, so the truth
is known from everywhere. The eye moves in random directions by a share of the reference's mean depth and turns by a
degree. Figures are over the pixels whose surface the reference saw, holes counted as black: *dB* and *ssim*; *known dB*
without the holes; *cracks, %* the share of them that are holes. Of all surface pixels *disoccluded, %* were seen by no
reference, and of these *guessed, %* are covered all the same. *above 3, dB* is what a picture is better than 3 x 3
splats. Meshes are cut by slope and ids ("mesh"), by slope alone, or by ids, shared edges and planes alone. Times are
whole calls from Python on one thread into memory that is there, medians of interleaved rounds.

*Flicker*: a walk in small steps, seen by warping the nearest reference, the two nearest ones or a layered image of
1 + 8 views; holes are black or what the previous picture shows there (`background=`). *flashing, %* are pixels that are
wrong by more than 32 grey levels while they were right, within 16, in the frame before and the one after.

Charts go to out/warp_quality.png and out/warp_flicker.png.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import Camera, DepthImage, LayeredDepthImage, lab, quality, warp

SCENES = ["kitchen inside", "sibenik inside", "bunny"]
MOVES = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5]
SIZES = [(256, 192), (512, 384), (1024, 768)]
SIZE, MOVE = SIZES[1], MOVES[2]

Draw = Callable[..., warp.Warped]


def cuts(image: DepthImage, scene: cyc.Scene) -> dict[str, Draw]:
    """The ways to draw an image."""
    ways: dict[str, Draw] = {str(s): functools.partial(warp.forward, image, splat=s) for s in (1, 3, 5)}
    ways |= {s: functools.partial(warp.forward, image, splat=s) for s in ("projected", "disparity", "mesh")}
    for name, cut in {
        "mesh, slope": image.cut(ids=False),
        "mesh, ids": image.cut(scene=scene, slope=0.0),
    }.items():
        ways[name] = functools.partial(warp.forward, cut, splat="mesh")
    return ways


def moved(camera: Camera, distance: float, rng: np.random.Generator, degrees: float = 1.0) -> Camera:
    """A camera so far away in a random direction, turned a little about a random axis."""
    way, axis = rng.standard_normal((2, 3))
    eye = camera.eye + distance * way / np.linalg.norm(way)
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    pose = np.eye(4)
    pose[:3, :3] = turn @ camera.world_to_camera[:3, :3]
    pose[:3, 3] = -pose[:3, :3] @ eye
    return camera.replace(world_to_camera=pose)


def mean_depth(image: DepthImage) -> float:
    return float(image.depth[~image.missing].mean())


def measure(setting: bench.Setting, move: float, grain: float, rounds: int, seed: int) -> list[dict[str, Any]]:
    """A row for each way to draw, averaged over the setting's cameras."""
    rng = np.random.default_rng(seed)
    found: dict[str, list[dict[str, float]]] = {}
    for camera in setting.cameras:
        depth = mean_depth(setting.scene.depth_image(camera))
        wave = grain * depth / camera.K[0, 0]
        image = quality.textured(setting.scene, camera, grain=wave)
        there = moved(camera, move * depth, rng)
        truth = quality.textured(setting.scene, there, grain=wave)
        seen = quality.seen(setting.scene, truth, camera)
        ways = cuts(image, setting.scene)
        out = warp.Warped.empty(there)
        jobs = {name: functools.partial(draw, there, threads=1, out=out) for name, draw in ways.items()}
        timed = lab.sweep({"way": list(jobs)}, timed=lambda way, jobs=jobs: jobs[way], rounds=rounds, progress=False)
        times = {row["way"]: row["time"] * 1e3 for row in timed}
        for name, draw in ways.items():
            judged = dataclasses.asdict(quality.compare(draw(there), truth, seen))
            found.setdefault(name, []).append(judged | {"ms": times[name]})
    rows = []
    for name, each in found.items():
        mean = {key: float(np.mean([row[key] for row in each])) for key in each[0]}
        rows.append(
            {
                "scene": setting.name,
                "moved": move,
                "width": setting.cameras[0].width,
                "splat": name,
                "dB": mean["psnr"],
                "above 3, dB": mean["psnr"] - float(np.mean([row["psnr"] for row in found["3"]])),
                "ssim": mean["ssim"],
                "known dB": mean["known_psnr"],
                "cracks, %": 100 * mean["cracks"],
                "disoccluded, %": 100 * mean["disoccluded"],
                "guessed, %": 100 * mean["guessed"],
                "ms": mean["ms"],
            }
        )
    return rows


def wider(camera: Camera) -> Camera:
    """The same view with half as many pixels again each way: a layered image holds what its own frame holds."""
    K = camera.K.copy()
    K[:2, 2] += camera.width / 4, camera.height / 4
    return camera.replace(K=K, width=camera.width * 3 // 2, height=camera.height * 3 // 2)


def walk(setting: bench.Setting, grain: float, frames: int) -> list[dict[str, Any]]:
    """What a walk of 40 % of the mean depth looks like, a row for each way to draw it."""
    scene, start = setting.scene, setting.cameras[0]
    depth = mean_depth(scene.depth_image(start))
    wave = grain * depth / start.K[0, 0]
    right, ahead = start.camera_to_world[:3, 0], start.forward

    def at(t: float, aside: float = 0.0) -> Camera:
        pose = start.world_to_camera.copy()
        eye = start.eye + depth * (0.4 * (t - 0.5) * right + (0.1 * t + aside) * ahead)
        pose[:3, 3] = -pose[:3, :3] @ eye
        return start.replace(world_to_camera=pose)

    references = [quality.textured(scene, at(t, -0.02), grain=wave) for t in (0.0, 0.33, 0.67, 1.0)]
    middle = quality.textured(scene, wider(at(0.5, -0.02)), grain=wave)
    around = [quality.textured(scene, at(t, aside), grain=wave) for t in (0, 0.25, 0.75, 1) for aside in (-0.05, 0.05)]
    layered = LayeredDepthImage.build(middle, around)
    cameras = [at(t) for t in np.linspace(0, 1, frames)]
    truths = [quality.textured(scene, camera, grain=wave) for camera in cameras]

    def near(camera: Camera, count: int) -> list[DepthImage]:
        return sorted(references, key=lambda image: -np.linalg.norm(image.camera.eye - camera.eye))[-count:]

    rows = []
    for name, count, splat in (
        ("one reference", 1, 3),
        ("two references", 2, 3),
        ("one reference, mesh", 1, "mesh"),
        ("two references, mesh", 2, "mesh"),
        ("layered, 1 + 8", 0, 3),
    ):
        for persist in (False, True):
            previous = None
            errors, holes, decibels = [], [], []
            for camera, truth in zip(cameras, truths, strict=True):
                behind = previous if persist else None
                if count:
                    out = warp.forward(near(camera, count), camera, splat=splat, background=behind)
                else:
                    out = layered.warp(camera, splat=splat, background=behind)
                previous = out.color
                surface = ~truth.missing
                error = np.abs(out.color.astype(np.int16) - truth.color).max(axis=-1)
                errors.append(np.where(surface, error, 0))
                holes.append(float(out.hole[surface].mean()))
                decibels.append(quality.psnr(out.color, truth.color, where=surface))
            stack = np.array(errors)
            flash = (stack[1:-1] > 32) & (stack[:-2] <= 16) & (stack[2:] <= 16)
            rows.append(
                {
                    "scene": setting.name,
                    "drawn from": name,
                    "holes show": "the previous picture" if persist else "black",
                    "dB, all": float(np.mean(decibels)),
                    "hole, %": 100 * float(np.mean(holes)),
                    "flashing, %": 100 * float(flash.mean()),
                    "frames": [100 * float(frame.mean()) for frame in flash],
                }
            )
    return rows


def draw(rows: list[dict[str, Any]], sizes: list[dict[str, Any]], walks: list[dict[str, Any]]) -> None:
    """The charts."""
    from matplotlib.figure import Figure

    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    splats = list(dict.fromkeys(row["splat"] for row in rows))
    figure = Figure(figsize=(5 * len(scenes), 15), layout="constrained")
    panels = figure.subplots(4, len(scenes), squeeze=False)
    for column, scene in enumerate(scenes):
        here = [row for row in rows if row["scene"] == scene]
        for number, (key, scale) in enumerate((("dB", "linear"), ("cracks, %", "symlog"))):
            panel = panels[number][column]
            for splat in splats:
                some = [row for row in here if row["splat"] == splat]
                panel.plot([100 * r["moved"] for r in some], [r[key] for r in some], marker=".", label=splat)
            panel.set_xscale("log")
            panel.set_yscale(scale, **({"linthresh": 0.01} if scale == "symlog" else {}))
            if scale == "symlog":
                panel.set_ylim(bottom=0)
            panel.set_xlabel("moved, % of the mean depth")
            panel.set_ylabel(key)
        panels[0][column].set_title(scene)
        for number, key in ((2, "moved"), (3, "width")):
            panel = panels[number][column]
            of = here if key == "moved" else [row for row in sizes if row["scene"] == scene]
            for splat in splats:
                some = [row for row in of if row["splat"] == splat and (key == "width" or row["moved"] == MOVE)]
                panel.plot([r["ms"] for r in some], [r["dB"] for r in some], marker="o", label=splat)
            panel.set_xscale("log")
            panel.set_xlabel("ms a warp, one thread")
            panel.set_ylabel(f"dB, {100 * MOVE:g} % moved" + (", width 256 to 1024" if key == "width" else ""))
    panels[0][0].legend(fontsize=8)
    figure.savefig(bench.picture_folder() / "warp_quality.png", dpi=130)
    figure = Figure(figsize=(5 * len(scenes), 4), layout="constrained")
    panels = figure.subplots(1, len(scenes), squeeze=False)
    for column, scene in enumerate(scenes):
        panel = panels[0][column]
        for row in walks:
            if row["scene"] == scene:
                style = "-" if row["holes show"] == "black" else "--"
                panel.plot(row["frames"], style, label=f"{row['drawn from']}, {row['holes show']}")
        panel.set_title(scene)
        panel.set_xlabel("frame")
        panel.set_ylabel("flashing, %")
    panels[0][0].legend(fontsize=6)
    figure.savefig(bench.picture_folder() / "warp_flicker.png", dpi=130)


def main() -> None:
    asked = bench.options(__doc__, views=4, rounds=5, grain=4.0, frames=25, names=SCENES)
    views, rounds, moves = (1, 1, [MOVE]) if asked.quick else (asked.views, asked.rounds, MOVES)
    rows, sizes, walks = [], [], []
    for name in asked.names:

        def at(size: tuple[int, int], name: str = name) -> bench.Setting:
            known = bench.setting(asked.meshes, name, views)
            cameras = [camera.with_size(*size) for camera in known.cameras]
            return dataclasses.replace(known, cameras=cameras)

        for seed, move in enumerate(moves):
            rows += measure(at(SIZE), move, asked.grain, rounds, seed)
        for size in [SIZE] if asked.quick else SIZES:
            sizes += measure(at(size), MOVE, asked.grain * size[0] / SIZE[0], rounds, 0)
        walks += walk(at(SIZES[0]), asked.grain, 9 if asked.quick else asked.frames)
        print(f"{name}: done", flush=True)
    bench.show(f"Against distance moved, {SIZE[0]} x {SIZE[1]}, means of {views} views", rows)
    bench.show(f"Against resolution, {100 * MOVE:g} % of the mean depth moved", sizes)
    bench.show(
        f"A walk, {SIZES[0][0]} x {SIZES[0][1]}",
        [{key: value for key, value in row.items() if key != "frames"} for row in walks],
    )
    draw(rows, sizes, walks)


if __name__ == "__main__":
    main()
