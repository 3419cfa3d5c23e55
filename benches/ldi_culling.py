"""What culling saves of a layered image: the measures that the LDI culling paper planned and never took.

    python benches/ldi_culling.py [--quick]

For densely and coarsely occluded scenes, and for one object made of 12 depth images around it: the share of depth
pixels left out, faults of each kind (visible culled, invisible kept), and the time of a warp without culling, with the
paper's and with the exact culling, which changes no pixel. Then the same for stacked sheets of growing number: from
which depth complexity culling pays. Single thread, 512 x 384, 3 x 3 splats, medians of interleaved rounds.
"""

from __future__ import annotations

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import Camera, LayeredDepthImage, lab

SIZE = (512, 384)
MOVES = {"there": (0.0, 0.0), "aside 5 %": (0.05, 0.0), "ahead 5 %": (0.0, 0.05)}


def row(name: str, layered: LayeredDepthImage, camera: Camera, rounds: int) -> str:
    out, culled, paper = (cyc.warp.Warped.empty(camera) for _ in range(3))
    whole, exact = layered.warp(camera, out=out), layered.warp(camera, cull="exact", out=culled)
    if not (np.array_equal(whole.color, exact.color) and np.array_equal(whole.depth, exact.depth)):
        raise SystemExit(f"{name}: cull='exact' changed the picture")
    faults = layered.cull_faults(camera)
    ms = lab.medians(
        {
            "none": lambda: layered.warp(camera, out=out, threads=1),
            "exact": lambda: layered.warp(camera, cull="exact", out=culled, threads=1),
            "paper": lambda: layered.warp(camera, cull="paper", out=paper, threads=1),
            "none, depth": lambda: layered.warp(camera, order="zbuffer", out=out, threads=1),
            "exact, depth": lambda: layered.warp(camera, order="zbuffer", cull="exact", out=culled, threads=1),
        },
        rounds,
    )
    per_pixel = layered.samples / max(1, int((layered.counts > 0).sum()))
    return (
        f"| {name} | {layered.samples:,} | {per_pixel:.2f} | {exact.stats.eliminated:.1%} | {faults.eliminated:.1%} | "
        f"{faults.visible_culled:.2%} | {faults.invisible_kept:.1%} | {ms['none']:.2f} | {ms['exact']:.2f} | "
        f"{ms['paper']:.1f} | {ms['none, depth']:.2f} | {ms['exact, depth']:.2f} |"
    )


COLUMNS = [
    "scene, move",
    "samples",
    "a pixel",
    "left out, exact",
    "left out, paper",
    "visible culled",
    "invisible kept",
    "none, ms",
    "exact, ms",
    "paper, ms",
    "depth buffer, ms",
    "exact, ms",
]
HEADER = f"\n| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}"


def moved(camera: Camera, aside: float, ahead: float) -> Camera:
    pose = camera.world_to_camera.copy()
    pose[:3, 3] -= (aside, 0.0, ahead)
    return camera.replace(world_to_camera=pose)


def scenes(folder: bench.Path, quick: bool) -> dict[str, tuple[LayeredDepthImage, Camera, float]]:
    """Layered images, their cameras, and the mean depth."""

    def cast(
        scene: cyc.Scene, eye: object, target: object, up: tuple[int, int, int] = (0, 1, 0)
    ) -> tuple[LayeredDepthImage, Camera, float]:
        camera = Camera.look_at(eye, target, up, width=SIZE[0], height=SIZE[1])
        depth = scene.render(camera).depth
        return LayeredDepthImage.cast(scene, camera), camera, float(depth[np.isfinite(depth)].mean())

    found = {"dense: kitchen": cast(bench.scene(folder, "kitchen"), (0.84, 1.24, 0.06), (0.84, 1.24, 1))}
    pipes = cyc.scenes.pipes(20_000 if quick else 100_000)
    if not quick:
        found["dense: house"] = cast(bench.scene(folder, "fzk_haus"), (4.5, 2, 1.6), (5.42, 2.38, 1.6), (0, 0, 1))
        found["dense: cathedral"] = cast(bench.scene(folder, "sibenik"), (6, 5, 0), (-1, 5, 0))
    found["dense: pipes"] = cast(pipes, pipes.center + (0, 0, 2.2 * pipes.radius), pipes.center)
    tree = bench.scene(folder, "tree")
    found["coarse: tree"] = cast(tree, tree.center + (0, 0, 2.6 * tree.radius), tree.center)
    bunny = bench.scene(folder, "bunny")
    eyes = bunny.center + 2.6 * bunny.radius * cyc.sphere.fibonacci(12)
    cameras = [Camera.look_at(eye, bunny.center, width=SIZE[0], height=SIZE[1]) for eye in eyes]
    images = [bunny.depth_image(camera) for camera in cameras]
    built = LayeredDepthImage.build(images[0], images[1:])
    found["object: bunny, 12 images"] = built, cameras[0], 2.6 * bunny.radius
    return found


def main() -> None:
    options = bench.options(__doc__)
    rounds = 3 if options.quick else 9
    print(f"{SIZE[0]} x {SIZE[1]}, 3 x 3 splats, one thread, medians of {rounds} interleaved rounds")
    print(HEADER)
    for name, (layered, camera, depth) in scenes(options.meshes, options.quick).items():
        for move, (aside, ahead) in MOVES.items():
            print(row(f"{name}, {move}", layered, moved(camera, aside * depth, ahead * depth), rounds), flush=True)
    print("\nStacked sheets, moved aside 5 %: from which depth complexity culling pays\n" + HEADER)
    camera = Camera.look_at((0, 0, 3.2), (0, 0, 0), width=SIZE[0], height=SIZE[1])
    for sheets in (1, 2, 3, 4) if options.quick else (1, 2, 3, 4, 6, 8, 12, 16):
        layered = LayeredDepthImage.cast(cyc.scenes.layers(4000, sheets), camera)
        print(row(f"{sheets} sheets", layered, moved(camera, 0.11, 0.0), rounds), flush=True)


if __name__ == "__main__":
    main()
