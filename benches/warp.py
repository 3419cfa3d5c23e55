"""Forward warps: the race against everybody, how often the two orders differ, and how much pictures flicker.

*The race*: whole calls from Python with reused memory, rounds interleaved, medians, milliseconds. In each round a job
is called three times in a row: else it would be timed with the caches that another one left behind. A rival's column
says how many times longer it takes than our row:

* numba: a compiled loop with a depth buffer, depth and index out, on one thread, with splats of one pixel or 3 x 3;
* cv2: OpenCV's `warpFrame`, depth only, one pixel, all cores; minimum.at: NumPy.

Ours writes colour, depth, hole, exact and source. *limit* is the time in which one core reads the image and writes the
picture once at the measured bandwidth of the memory; *of it* how many times as long ours takes. *fresh* is a call that
returns new arrays. The 1998 dissertation warped layered images of 512 x 384 pixels 7 to 11 times a second on three
processors (table 4-2); *x 1998* is against 11.

*Layered*: the balls as a layered image of 1 + 8 views and as the central one alone, 3 x 3 splats, one thread: what a
sample of the first costs beside a pixel of the second, after each move.

*The orders*: shares of pixels that `order="occlusion"` and `order="zbuffer"` show differently, and on which the first
shows a surface more than 5 % deeper. Of two samples of one ray the right one is shown; but samples of neighbouring rows
share pixels where the target sees the source smaller or turned, and then the row decides. Most that differ are of one
surface: the nearest of its samples on a pixel is not the one drawn last.

*Flicker*: how much the change from a picture to the next differs from that of the true pictures, in grey levels, on a
walk of small steps sideways; with black holes, and with the previous picture as the background.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

import bench
import cyclorama as cyc
from cyclorama import lab

SIZES = ["512x384", "1024x768"]
SHAPES: list[Any] = [1, 3, 5, "projected", "disparity", "mesh"]

#: Calls of a job that are timed together.
CALLS = 3

#: Warps a second of a 512 x 384 image in the dissertation, at best.
DISSERTATION = 11

BALLS = [(-0.6, -0.2, 2.4, 0.5), (0.5, 0.3, 2.0, 0.35), (0.1, -0.4, 3.0, 0.6)]

Floats = npt.NDArray[np.float64]


def camera(size: tuple[int, int], offset: Floats | tuple[float, float, float], turn: tuple[float, float]) -> cyc.Camera:
    """From the origin along z, moved in its axes and turned aside and down (degrees)."""
    a, b = np.radians(turn)
    aside = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    down = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    pose = np.eye(4)
    pose[:3, :3] = down @ aside
    pose[:3, 3] = -pose[:3, :3] @ offset
    focal = 0.9 * size[0]
    return cyc.Camera([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]], pose, *size)


def image(view: cyc.Camera) -> cyc.DepthImage:
    """Balls before a wall with bumps in z, with a texture that every point of space has of its own."""
    eye, rays = view.rays()
    eye, rays = np.broadcast_to(eye, rays.shape)[0, 0], np.asarray(rays)
    rays = rays / (rays @ view.world_to_camera[2, :3])[..., None]
    # The wall is a height field: a few steps of a fixed point find it.
    depth = (4 - eye[2]) / rays[..., 2]
    for _ in range(12):
        x, y, _ = np.moveaxis(eye + rays * depth[..., None], -1, 0)
        depth = (4 + 0.3 * np.sin(2.2 * x) * np.cos(1.8 * y) - eye[2]) / rays[..., 2]
    for *center, radius in BALLS:
        away = np.subtract(center, eye)
        a, b, c = (rays**2).sum(-1), rays @ away, away @ away - radius**2
        inner = np.maximum(b * b - a * c, 0)
        depth = np.where(inner > 0, np.minimum(depth, (b - np.sqrt(inner)) / a), depth)
    point = eye + rays * depth[..., None]
    waves = np.sin(point @ np.array([[31.0, 17, -11], [13, -29, 23], [-19, 7, 37]]))
    return cyc.DepthImage((127.5 + 100 * waves * np.roll(waves, 1, -1)).astype(np.uint8), depth, view)


def sizes(names: list[str]) -> list[tuple[int, int]]:
    return [(int(width), int(height)) for width, height in (name.split("x") for name in names)]


def numba_warp(source: cyc.DepthImage, target: cyc.Camera, radius: int) -> Callable[[], object]:
    """A loop over all samples that keeps the nearest, compiled."""
    import numba

    pose = target.world_to_camera @ np.linalg.inv(source.camera.world_to_camera)
    matrix = (target.K @ pose[:3, :3] @ np.linalg.inv(source.camera.K)).astype(np.float32)
    offset = (target.K @ pose[:3, 3]).astype(np.float32)
    nearness = np.zeros((target.height, target.width), np.float32)
    index = np.zeros(nearness.shape, np.int32)

    @numba.njit(fastmath=True, error_model="numpy")
    def loop(depth, m, t, nearness, index):  # type: ignore[no-untyped-def]
        height, width = depth.shape
        nearness[:] = 0
        index[:] = -1
        for row in range(height):
            v = np.float32(row) + np.float32(0.5)
            for column in range(width):
                u = np.float32(column) + np.float32(0.5)
                d = depth[row, column]
                z = (m[2, 0] * u + m[2, 1] * v + m[2, 2]) * d + t[2]
                if z <= 0:
                    continue
                near = np.float32(1) / z
                x = int(np.floor(((m[0, 0] * u + m[0, 1] * v + m[0, 2]) * d + t[0]) * near))
                y = int(np.floor(((m[1, 0] * u + m[1, 1] * v + m[1, 2]) * d + t[1]) * near))
                for yy in range(max(y - radius, 0), min(y + radius + 1, nearness.shape[0])):
                    for xx in range(max(x - radius, 0), min(x + radius + 1, nearness.shape[1])):
                        if near > nearness[yy, xx]:
                            nearness[yy, xx] = near
                            index[yy, xx] = row * width + column

    def run() -> object:
        loop(source.depth, matrix, offset, nearness, index)
        with np.errstate(divide="ignore"):
            return np.where(nearness > 0, 1 / nearness, 0)

    return run


def opencv_warp(source: cyc.DepthImage, target: cyc.Camera) -> Callable[[], object]:
    import cv2

    warp = cv2.warpFrame if hasattr(cv2, "warpFrame") else cv2.rgbd.warpFrame
    pose = target.world_to_camera @ np.linalg.inv(source.camera.world_to_camera)
    intrinsics = source.camera.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    return functools.partial(warp, source.depth, None, None, pose, intrinsics)


def numpy_warp(source: cyc.DepthImage, target: cyc.Camera) -> Callable[[], object]:
    """The least depth of each pixel by `np.minimum.at`, and which sample has it."""
    pose = target.world_to_camera @ np.linalg.inv(source.camera.world_to_camera)
    matrix = (target.K @ pose[:3, :3] @ np.linalg.inv(source.camera.K)).astype(np.float32)
    offset = (target.K @ pose[:3, 3]).astype(np.float32)
    x, y = np.meshgrid(np.arange(source.camera.width) + 0.5, np.arange(source.camera.height) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], -1).astype(np.float32).reshape(-1, 3) @ matrix.T
    width, height = target.width, target.height

    def run() -> object:
        p = rays * source.depth.reshape(-1, 1) + offset
        z = p[:, 2]
        u, v = np.floor(p[:, 0] / z).astype(np.int32), np.floor(p[:, 1] / z).astype(np.int32)
        seen = np.flatnonzero((z > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height))
        at, z = v[seen] * width + u[seen], z[seen]
        nearest = np.full(width * height, np.inf, np.float32)
        np.minimum.at(nearest, at, z)
        index = np.full(width * height, -1, np.int32)
        first = nearest[at] == z
        index[at[first]] = seen[first]
        return nearest, index

    return run


def calls(job: Callable[[], object]) -> None:
    for _ in range(CALLS):
        job()


def race(size: tuple[int, int], rounds: int) -> list[dict[str, Any]]:
    """Rows of the race at a size: a twentieth of the mean depth sideways and a turn of two degrees."""
    source = image(camera(size, (0, 0, 0), (0, 0)))
    step = 0.05 * float(source.depth.mean())
    target = camera(size, np.array([1, 0.2, 0.1]) * step, (2, 0.5))
    out = cyc.warp.Warped.empty(target)
    jobs: dict[str, Callable[[], object]] = {}
    for splat in SHAPES:
        for order in ("occlusion", "zbuffer") if splat != "mesh" else ("zbuffer",):
            for threads in (1, None):
                call = functools.partial(cyc.warp.forward, source, target, splat=splat, order=order, threads=threads)
                jobs[f"{splat} {order} {threads}"] = functools.partial(call, out=out)
                if threads == 1:
                    jobs[f"{splat} {order} fresh"] = call
    rivals: dict[str, Callable[[], Callable[[], object]]] = {
        "numba 1": lambda: numba_warp(source, target, 0),
        "numba 3": lambda: numba_warp(source, target, 1),
        "cv2": lambda: opencv_warp(source, target),
        "minimum.at": lambda: numpy_warp(source, target),
    }
    for name, make in rivals.items():
        try:
            jobs[name] = make()
        except (ImportError, AttributeError) as why:
            print(f"{name}: missing, {why}")
    timed = lab.sweep(
        {"job": jobs}, timed=lambda job: functools.partial(calls, jobs[job]), rounds=rounds, progress=False
    )
    ms = {row["job"]: row["time"] * 1e3 / CALLS for row in timed if "time" in row}
    speed = bench.bandwidth()["1 thread"]
    pixels = size[0] * size[1]
    limit = (pixels * (4 + 3) / speed["read"] + pixels * (3 + 4 + 1 + 1 + 1) / speed["fill"]) / 1e6
    rows = []
    for splat in SHAPES:
        for order in ("occlusion", "zbuffer") if splat != "mesh" else ("zbuffer",):
            own = ms[f"{splat} {order} 1"]
            everywhere = ms[f"{splat} {order} None"]
            against = {"numba": "numba 1" if splat == 1 else "numba 3"}
            if splat == 1:
                against |= {"cv2": "cv2", "minimum.at": "minimum.at"}
            row: dict[str, Any] = {"size": f"{size[0]} x {size[1]}", "splat": str(splat), "order": order}
            row |= {"ms, 1 thread": own, f"ms, {bench.cores()}": everywhere, "ms, fresh": ms[f"{splat} {order} fresh"]}
            row |= {f"x {name}, 1": ms[job] / own for name, job in against.items() if job in ms}
            row |= {f"x {name}, {bench.cores()}": ms[job] / everywhere for name, job in against.items() if job in ms}
            row |= {"limit ms": limit, "of it": own / limit}
            if size == (512, 384):
                row["x 1998"] = 1e3 / everywhere / DISSERTATION
            rows.append(row)
    return rows


MOVES: dict[str, tuple[tuple[float, float, float], tuple[float, float]]] = {
    "sideways": ((0.2, 0, 0), (0, 0)),
    "sideways and turned": ((0.2, 0.04, 0.02), (2, 0.5)),
    "forward": ((0.02, 0.01, 0.6), (0, 0)),
    "backward": ((0.02, 0.01, -0.6), (0, 0)),
    "far aside": ((0.8, 0.2, 0), (10, 3)),
}


def layered_samples(size: tuple[int, int], rounds: int) -> list[dict[str, Any]]:
    """What a sample of a layered image costs beside a pixel of one image, after each move."""
    central = image(camera(size, (0, 0, 0), (0, 0)))
    step = 0.1 * float(central.depth.mean())
    around = [(x * step, y * step, 0.0) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
    layered = cyc.LayeredDepthImage.build(central, [image(camera(size, offset, (0, 0))) for offset in around])
    rows = []
    for name, (offset, turn) in MOVES.items():
        target = camera(size, offset, turn)
        outs = [cyc.warp.Warped.empty(target) for _ in range(2)]
        jobs: dict[str, Callable[[], object]] = {
            "one": functools.partial(cyc.warp.forward, central, target, out=outs[0], threads=1),
            "layered": functools.partial(layered.warp, target, out=outs[1], threads=1),
        }
        ms = lab.medians({job: functools.partial(calls, call) for job, call in jobs.items()}, rounds)
        ns = [1e6 * ms["one"] / CALLS / (size[0] * size[1]), 1e6 * ms["layered"] / CALLS / layered.samples]
        row: dict[str, Any] = {"size": f"{size[0]} x {size[1]}", "move": name}
        row["samples a pixel"] = layered.samples / (size[0] * size[1])
        rows.append(row | {"one, ns a pixel": ns[0], "layered, ns a sample": ns[1], "ratio": ns[1] / ns[0]})
    return rows


def orders(size: tuple[int, int]) -> list[dict[str, Any]]:
    rows = []
    source = image(camera(size, (0, 0, 0), (0, 0)))
    for name, (offset, turn) in MOVES.items():
        target = camera(size, offset, turn)
        row: dict[str, Any] = {"move": name}
        for splat in (1, 3, "projected"):
            drawn = cyc.warp.forward(source, target, splat=splat, order="occlusion")
            nearest = cyc.warp.forward(source, target, splat=splat, order="zbuffer")
            seen = ~drawn.hole & ~nearest.hole
            row[f"differ, % ({splat})"] = 100 * (drawn.color != nearest.color).any(-1).mean()
            other = drawn.depth[seen] > 1.05 * nearest.depth[seen]
            row[f"other surface, % ({splat})"] = 100 * other.mean()
        row["hole, % (1)"] = 100 * cyc.warp.forward(source, target, splat=1).hole.mean()
        rows.append(row)
    return rows


def flicker(size: tuple[int, int], steps: int) -> list[dict[str, Any]]:
    """A walk from one reference to the other: one of them, both, and a layered image of them and two more."""
    ends = [image(camera(size, (x, 0, 0), (0, 0))) for x in (-0.3, 0.3)]
    between = [image(camera(size, (0, y, 0), (0, 0))) for y in (0.0, -0.15, 0.15)]
    layered = cyc.LayeredDepthImage.build(between[0], [*ends, *between[1:]])
    path = [camera(size, (x, 0.02, 0), (0, 0)) for x in np.linspace(-0.3, 0.3, steps)]
    truth = [image(view).color.astype(float) for view in path]

    def nearer_last(view: cyc.Camera) -> list[cyc.DepthImage]:
        return sorted(ends, key=lambda end: -float(np.linalg.norm(end.camera.eye - view.eye)))

    warps: dict[str, Callable[..., cyc.warp.Warped]] = {
        "one reference": lambda view, behind: cyc.warp.forward(ends[0], view, background=behind),
        "two references": lambda view, behind: cyc.warp.forward(nearer_last(view), view, background=behind),
        "layered image": lambda view, behind: layered.warp(view, background=behind),
    }
    rows = []
    for name, warp in warps.items():
        row: dict[str, Any] = {"warped": name}
        for title, persists in (("black holes", False), ("previous behind", True)):
            pictures: list[cyc.warp.Warped] = []
            for view in path:
                pictures.append(warp(view, pictures[-1] if persists and pictures else None))
            colors = [picture.color.astype(float) for picture in pictures]
            pairs = range(1, len(path))
            change = [np.abs((colors[i] - colors[i - 1]) - (truth[i] - truth[i - 1])).mean() for i in pairs]
            error = [np.abs(color - true).mean() for color, true in zip(colors, truth, strict=True)]
            row |= {f"flicker, {title}": float(np.mean(change)), f"error, {title}": float(np.mean(error))}
            row["hole, %"] = 100 * float(np.mean([picture.hole.mean() for picture in pictures]))
        rows.append(row)
    return rows


def main() -> None:
    asked = bench.options(__doc__, rounds=15, sizes=SIZES, steps=25)
    names = SIZES[:1] if asked.quick else asked.sizes
    rounds, steps = (5, 5) if asked.quick else (asked.rounds, asked.steps)
    rows = [row for size in sizes(names) for row in race(size, rounds)]
    bench.show(f"Warps of one image, medians of {rounds} interleaved rounds", rows)
    rows = [row for size in sizes(names) for row in layered_samples(size, rounds)]
    bench.show("A layered image beside one image, 3 x 3 splats, one thread", rows)
    bench.show("The two orders, 512 x 384", orders((512, 384)))
    bench.show(f"Flicker on a walk of {steps} pictures, 256 x 192, 3 x 3 splats", flicker((256, 192), steps))


if __name__ == "__main__":
    main()
