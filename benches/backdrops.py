"""Walks with backdrops: every display beside the true pictures, what a frame costs, and what could be stored once.

    python benches/backdrops.py [--quick] [--budget 0.2] [--construction 16]

A plan is placed and painted, then a seeded path of 200 frames at 510 x 480 is drawn in all displays of the 1998
dissertation's section 1.4.1 and compared with the whole scene drawn from the same eyes, everything painted with a solid
texture: flat faces would hide errors. `holes` are shares of the pixels that truly show what the image stands for;
`lost` those of them that show something else than the backdrop. Popping, jump and step are in grey levels of 255.

Then: how much of an image's samples another one of the same viewpoint has as well.
"""

from __future__ import annotations

import tempfile
import time

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import quality
from cyclorama.lab import Row
from cyclorama.placement import walking
from cyclorama.placement.backdrops import Backdrops
from cyclorama.render import View

SIZE = (510, 480)


class Texture:
    """Colours of a solid texture (`cyclorama.quality.paint`)."""

    def __init__(self, grain: float) -> None:
        self.grain = grain

    def __call__(self, view: View) -> np.ndarray:
        black = np.zeros((*view.depth.shape, 3), np.uint8)
        points = cyc.DepthImage(black, view.depth, view.camera, ids=view.ids).points()
        return quality.paint(points, self.grain)


def main() -> None:
    options = bench.options(__doc__, budget=0.2, construction=16, faces=1_000_000)
    frames = 20 if options.quick else 200
    sibenik = bench.scene(options.meshes, "sibenik")
    # The nave and its aisles at a walker's height: what an eye of this scene is for.
    nave = np.array([[-14.0, 0.5, -6.0], [14.0, 9.0, 6.0]])
    pipes = cyc.scenes.pipes(100_000 if options.quick else options.faces)
    settings = {"pipes": (pipes, pipes.bounds, 0.01 * pipes.radius), "sibenik": (sibenik, nave, 0.3)}
    for name, (scene, box, grain) in settings.items():
        budget = int(options.budget * len(scene))
        start = time.perf_counter()
        plan = cyc.place_images(scene, budget=budget, progress=False)
        placed = time.perf_counter() - start
        low, high = np.maximum(plan.domain[0], box[0]), np.minimum(plan.domain[1], box[1])
        with tempfile.TemporaryDirectory() as folder:
            # Images of the walk are painted when it needs them: all of them are as the first ones.
            backdrops = Backdrops(plan, scene, folder, construction=options.construction, color=Texture(grain))
            eyes, _ = walking.path(low, high, frames, seed=1)
            # Toward the middle of the box: an eye that looks outward needs no image.
            gazes = ((low + high) / 2 - eyes) * (1, 0, 1)
            needed = {image.index for image in (plan.frame(*at).image for at in zip(eyes, gazes, strict=True)) if image}
            start = time.perf_counter()
            layered = [backdrops.store.get(index) for index in sorted(needed)]
            painted = (time.perf_counter() - start) / max(1, len(layered))
            rows = walking.walk(backdrops, eyes, gazes, size=SIZE, progress=False)
            title = (
                f"{name}: {len(scene):,} faces, budget {budget:,}, {len(plan.images)} images placed in {placed:.1f} s; "
                f"{len(needed)} of them used, {painted:.2f} s to paint one, "
                f"{np.mean([i.samples / i.offsets.size for i in layered] or [0]):.2f} samples a pixel"
            )
            bench.show(title, [shown(row) for row in rows])
            bench.show(f"{name}: samples that another image of the viewpoint has too", [overlap(backdrops, needed)])
            backdrops.close()


def shown(row: Row) -> Row:
    """A row of a walk as the table has it."""
    return {
        "display": row["display"],
        "frames": f"{row['frames']} of {row['of']}",
        "pixels": f"{row['pixels']:.2%}",
        "PSNR, dB": f"{row['psnr']:.2f}",
        "holes": f"{row['holes']:.3%}",
        "lost": f"{row['lost']:.2%}",
        "popping": f"{row['popping']:.1f}",
        "jump": f"{row['jump']:.1f}",
        "step": f"{row['step']:.1f}",
        "faces": f"{row['faces']:,.0f}",
        "frame, ms": f"{row['ms']:.1f}",
        "backdrop, ms": f"{row['warp_ms']:.1f}",
        "all geometry, ms": f"{row['all_ms']:.1f}",
    }


def overlap(backdrops: Backdrops, needed: set[int], tolerance: float = 2.0) -> Row:
    """The share of an image's samples that the viewpoint's next image has too, within `tolerance` pixels' widths."""
    plan, shares = backdrops.plan, []
    for index in sorted(needed)[:4]:
        others = np.flatnonzero(plan.images.viewpoint == plan.images.viewpoint[index])
        others = others[others != index]
        if not len(others):
            shares.append(0.0)
            continue
        nearest = others[np.argmax(plan.images.forward[others] @ plan.images.forward[index])]
        one, two = backdrops.store.get(index), backdrops.store.get(int(nearest))
        pixel = np.repeat(np.arange(one.counts.size), one.counts.ravel())
        x, y = pixel % one.camera.width, pixel // one.camera.width
        finite = one.disparity > 0
        points = one.camera.unproject(np.column_stack([x, y])[finite] + 0.5, 1 / one.disparity[finite])
        at, depth = two.camera.project(points)
        with np.errstate(invalid="ignore"):
            inside = (depth > 0) & ((at >= 0) & (at < (two.camera.width, two.camera.height))).all(axis=1)
        found = np.zeros(len(points), np.bool_)
        cell = (at[inside, 1].astype(int) * two.camera.width + at[inside, 0].astype(int)).astype(np.int64)
        first, end, target = two.offsets[cell], two.offsets[cell + 1], 1 / depth[inside]
        same = np.zeros(len(cell), np.bool_)
        for step in range(int(two.counts.max())):
            there = first + step < end
            other = two.disparity[np.minimum(first + step, two.samples - 1)]
            same |= there & (np.abs(other - target) <= tolerance / two.camera.K[0, 0] * target)
        found[inside] = same
        shares.append(float(found.mean()))
    return {"images": len(shares), "shared": f"{np.mean(shares or [0]):.1%}"}


if __name__ == "__main__":
    main()
