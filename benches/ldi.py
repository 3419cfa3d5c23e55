"""Layered images of interiors: what nine images become, how long that takes, and how fast and good they are.

    python benches/ldi.py [--quick]

One central image and the eight construction images of the 1998 dissertation's section 4.3.2, for eyes within 10 % of
the mean depth. Beside the dissertation's figures: built in 7 to 23 s, warped 7 to 11 times a second at 512 x 384 on 3
processors, 2 to 4 samples a pixel, compressed by gzip by 2.6, 4 and 5.8.
"""

from __future__ import annotations

import gzip
import time
from importlib.util import find_spec

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import Camera, DepthImage, LayeredDepthImage
from cyclorama.ldi import construction_cameras, quadrilateral

Vector = tuple[float, float, float]

PLACES: dict[str, tuple[Vector, Vector, Vector]] = {
    "kitchen": ((0.84, 1.24, 0.06), (0.84, 1.24, 1), (0, 1, 0)),
    "fzk_haus": ((4.5, 2, 1.6), (5.42, 2.38, 1.6), (0, 0, 1)),
    "sibenik": ((6, 5, 0), (-1, 5, 0), (0, 1, 0)),
}


def picture(scene: cyc.Scene, camera: Camera) -> DepthImage:
    """Detailed colours that depend on the place in the world, lit from the eye."""
    view = scene.render(camera)
    points = np.nan_to_num(DepthImage.from_view(view).points())
    waves = [np.sin(points @ w + k) for k, w in enumerate([(9, 7, 5), (23, -17, 19), (-31, 29, 11)])]
    color = np.stack([127 + 60 * waves[0] + 60 * wave for wave in waves], -1)
    lit = 0.7 * np.clip(color, 0, 255) + 0.3 * view.color
    return DepthImage.from_view(view, color=lit.astype(np.uint8))


def compressed(layered: LayeredDepthImage) -> str:
    """How many times smaller gzip and zstd make the samples and the number of samples of each pixel."""
    counts = layered.counts.astype(np.uint8)
    arrays = (counts, layered.color, layered.place, layered.disparity)
    data = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)
    ratios = [f"{len(data) / len(gzip.compress(data, 6)):.2f}"]
    if find_spec("zstandard"):
        import zstandard

        ratios.append(f"{len(data) / len(zstandard.compress(data, 9)):.2f}")
    return " / ".join(ratios)


def main() -> None:
    options = bench.options(__doc__)
    rounds, views = (3, 2) if options.quick else (9, 8)
    columns = [
        "scene, size",
        "render 9, s",
        "build, s",
        "samples a pixel",
        "of the nine",
        "bytes a pixel",
        "gzip / zstd",
        "holes: one, layered, nine",
        "PSNR: one, layered, nine (dB)",
        "one image, ns a pixel",
        "layered, ns a sample",
        "warps a second: 1 thread, all",
    ]
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    sizes = [(512, 384)] if options.quick else [(256, 256), (512, 384), (512, 512), (1024, 768)]
    for name, (eye, target, up) in PLACES.items():
        scene = bench.scene(options.meshes, name)
        for size in sizes if name == "fzk_haus" else [(512, 384)]:
            print(row(f"{name}, {size[0]} x {size[1]}", scene, (eye, target, up), size, rounds, views), flush=True)


def row(
    name: str, scene: cyc.Scene, place: tuple[Vector, Vector, Vector], size: tuple[int, int], rounds: int, views: int
) -> str:
    inner = Camera.look_at(*place, fov_y=35, width=size[0], height=size[1])
    depth = scene.render(inner).depth
    reach = 0.1 * float(depth[np.isfinite(depth)].mean())
    corners = quadrilateral(inner, max(reach, 0.9 * float(depth.min())))
    cameras = construction_cameras(inner.eye, corners, reach, size, margin=0.1)
    start = time.perf_counter()
    images = [picture(scene, camera) for camera in cameras]
    rendered = time.perf_counter() - start
    start = time.perf_counter()
    layered = LayeredDepthImage.build(images[0], images[1:])
    built = time.perf_counter() - start
    turn = inner.world_to_camera[:3, :3]
    extent = 2 * np.abs([turn @ (camera.eye - inner.eye) for camera in cameras[1:]]).max(axis=0)
    rng = np.random.default_rng(0)
    holes, errors = [], []
    for _ in range(views):
        step = rng.normal(size=3)
        step *= rng.random() ** (1 / 3) / np.linalg.norm(step)
        pose = inner.world_to_camera.copy()
        there = inner.eye + turn.T @ (extent * (step[0], step[1], abs(step[2])))
        pose[:3, 3] = -turn @ there
        camera = inner.replace(world_to_camera=pose)
        truth = picture(scene, camera)
        seen = ~truth.missing
        order = sorted(images, key=lambda image: -np.linalg.norm(image.camera.eye - there))
        outs = [
            cyc.warp.forward(images[0], camera),
            layered.warp(camera),
            cyc.warp.forward(order, camera, order="zbuffer"),
        ]
        holes.append([out.hole[seen].mean() for out in outs])
        errors.append([np.square(out.color[seen].astype(float) - truth.color[seen]).mean() for out in outs])
    out, out_1 = cyc.warp.Warped.empty(camera), cyc.warp.Warped.empty(camera)
    ms = bench.medians(
        {
            "one": lambda: cyc.warp.forward(images[0], camera, out=out_1, threads=1),
            "layered": lambda: layered.warp(camera, out=out, threads=1),
            "all": lambda: layered.warp(camera, out=out),
        },
        rounds,
    )
    known = sum(int((~image.missing).sum()) for image in images)
    pixels = images[0].missing.size
    psnr = 10 * np.log10(255**2 / np.mean(errors, axis=0))
    cells = [
        name,
        f"{rendered:.2f}",
        f"{built:.3f}",
        f"{layered.samples / pixels:.2f}",
        f"{layered.samples / known:.1%}",
        f"{layered.nbytes / pixels:.1f}",
        compressed(layered),
        ", ".join(f"{share:.3%}" for share in np.mean(holes, axis=0)),
        ", ".join(f"{value:.2f}" for value in psnr),
        f"{1e6 * ms['one'] / pixels:.2f}",
        f"{1e6 * ms['layered'] / layered.samples:.2f}",
        f"{1e3 / ms['layered']:.0f}, {1e3 / ms['all']:.0f}",
    ]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
