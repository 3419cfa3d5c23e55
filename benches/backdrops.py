"""Walks with backdrops: every display beside the true pictures, what a frame costs, and what could be stored once.

    python benches/backdrops.py [--quick] [--budget 0.2] [--faces 1000000] [--frames 200] [--until 0] [--folder DIR]
        [--scenes ...] [--plain] [--unspent] [--picture FILE] [--parts walk sizes speed overlap]

A plan is placed, then a seeded path at 510 x 480 is drawn in the displays of the 1998 dissertation's section 1.4.1 and
compared with the whole scene drawn from the same eyes, everything painted with a solid texture: flat faces would hide
errors. Images are painted when they are first needed and stay in the folder, if one is given: run again, nothing is
painted twice.

`pixels` is the share of the pixels behind the image that are taken from it: the rest of the budget draws what is
nearest, but with `--unspent`. PSNR, `holes` and `lost` (something deeper is shown) are over those. `behind` is the
PSNR over all pixels that truly show what the image stands for. Popping, jump and step are in grey levels of 255.
*half a pixel* is what the truth itself loses when it is drawn half a pixel beside: no picture that is sampled anew
can be much better. `--until` ends the walk after so many of its frames. `--picture` writes the last one: the truth,
which pixels show the backdrop, and the layered image; below, one image warped, flat, and with geometry bent to it
(`--plain`: in the scene's colours).

Then, over every tenth frame: the layered image warped at smaller sizes and scaled up (4.4.3); and the whole scene in
pyrender's OpenGL beside the faces of the plan in it with our warp (without a picture of it: flat colours). Last: how
much of an image's samples the one taken nearest to it has as well.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import bench
import cyclorama as cyc
from cyclorama import lab, quality
from cyclorama.lab import Row
from cyclorama.placement import Plan, walking
from cyclorama.placement.backdrops import Backdrops
from cyclorama.placement.painting import frame_camera
from cyclorama.render import View
from frame_rates import Pipeline

SIZE = (510, 480)
#: Of the warp, smaller and smaller.
SIZES = (None, (408, 384), (340, 320), (255, 240), (170, 160), (102, 96))
PARTS = ["walk", "sizes", "speed", "overlap"]


class Texture:
    """Colours of a solid texture (`cyclorama.quality.paint`)."""

    def __init__(self, grain: float) -> None:
        self.grain = grain

    def __call__(self, view: View) -> np.ndarray:
        black = np.zeros((*view.depth.shape, 3), np.uint8)
        points = cyc.DepthImage(black, view.depth, view.camera, ids=view.ids).points()
        return quality.paint(points, self.grain)


def main() -> None:
    options = bench.options(
        __doc__,
        budget=0.2,
        construction=16,
        faces=1_000_000,
        frames=200,
        until=0,
        plain=False,
        unspent=False,
        picture="",
        folder="",
        scenes=["pipes", "sibenik"],
        parts=PARTS,
    )
    frames = 20 if options.quick else options.frames
    sibenik = bench.scene(options.meshes, "sibenik")
    # The nave and its aisles at a walker's height: what an eye of this scene is for.
    nave = np.array([[-14.0, 0.5, -6.0], [14.0, 9.0, 6.0]])
    pipes = cyc.scenes.pipes(100_000 if options.quick else options.faces)
    settings = {"pipes": (pipes, pipes.bounds, 0.01 * pipes.radius), "sibenik": (sibenik, nave, 0.3)}
    with tempfile.TemporaryDirectory() as temporary:
        for name in options.scenes:
            scene, box, grain = settings[name]
            folder = (
                Path(options.folder or temporary) / f"{name}-{len(scene)}-{options.budget:g}{'-plain' * options.plain}"
            )
            folder.mkdir(parents=True, exist_ok=True)
            plan, placed = planned(scene, int(options.budget * len(scene)), folder / "plan.npz")
            region = np.clip(box, *plan.domain)
            backdrops = Backdrops(
                plan,
                scene,
                folder,
                region=region,
                construction=options.construction,
                spend=not options.unspent,
                color=None if options.plain else Texture(grain),
            )
            low, high = region
            eyes, _ = walking.path(low, high, frames, seed=1)
            # Toward the middle of the box: an eye that looks outward needs no image.
            gazes = ((low + high) / 2 - eyes) * (1, 0, 1)
            eyes, gazes = eyes[: options.until or None], gazes[: options.until or None]
            if "walk" in options.parts:
                # Images are painted when a frame first shows some of them: that is not part of its time (a median).
                rows = walking.walk(backdrops, eyes, gazes, size=SIZE, progress=False)
                used = painted(backdrops)
                samples = np.array([layered.samples for layered in used] or [0])
                title = (
                    f"{name}: {len(scene):,} faces, budget {plan.budget:,}, {len(plan.images)} images placed in "
                    f"{placed:.1f} s; {len(used)} layered images painted, "
                    f"{np.median(samples):,.0f} samples each, {8 * samples.sum() / 2**20:.0f} MB; half a pixel "
                    f"{half_a_pixel(backdrops, eyes[::20], gazes[::20]):.1f} dB"
                )
                bench.show(title, [shown(row) for row in rows])
            if "sizes" in options.parts:
                bench.show(f"{name}: smaller warps", sizes(backdrops, eyes[::10], gazes[::10]))
            if "speed" in options.parts:
                bench.show(f"{name}: in OpenGL", [speed(backdrops, eyes[::10], gazes[::10])])
            if options.picture:
                picture(backdrops, eyes[-1], gazes[-1], Path(options.picture))
            if "overlap" in options.parts:
                rows = [overlap(backdrops, painted(backdrops))]
                bench.show(f"{name}: samples that the image taken nearest has too", rows)
            backdrops.close()


def planned(scene: cyc.Scene, budget: int, path: Path) -> tuple[Plan, float]:
    """A plan, from its file if it is there, and the seconds to place it."""
    if path.exists():
        return Plan.load(path, scene), 0.0
    plan, seconds = lab.elapsed(partial(cyc.place_images, scene, budget=budget, progress=False))
    plan.save(path)
    return plan, seconds


def painted(backdrops: Backdrops) -> list[cyc.LayeredDepthImage]:
    """The layered images that are in the folder."""
    keys = [key for index in range(len(backdrops.plan.images)) for key in backdrops.leaves(index)]
    return [backdrops.store.get(key) for key in keys if backdrops.store.has(key)]


def sizes(backdrops: Backdrops, eyes: np.ndarray, gazes: np.ndarray) -> list[Row]:
    """Rows of the layered image warped at smaller sizes and scaled up."""
    rows = []
    for size in SIZES:
        row = walking.walk(backdrops, eyes, gazes, displays=("ldi",), size=SIZE, warp_size=size, progress=False)[0]
        width, height = size or SIZE
        columns = ("frames", "PSNR, dB", "behind, dB", "holes", "worst", "step", "frame, ms", "backdrop, ms")
        rows.append({"warped at": f"{width} x {height}"} | {name: shown(row)[name] for name in columns})
    return rows


def speed(backdrops: Backdrops, eyes: np.ndarray, gazes: np.ndarray, rounds: int = 5) -> Row:
    """A row of what frames that need an image take in OpenGL: medians over frames of the best of some rounds."""
    plan, scene = backdrops.plan, backdrops.scene
    pipeline = Pipeline(scene, SIZE)
    span = (1e-3 * scene.radius, 4 * scene.radius)
    cells = np.arange(len(plan.cells()[1]))
    found: dict[str, list[float]] = {"whole": [], "in frustum": [], "plan": [], "warp": [], "own": []}
    try:
        for eye, gaze in zip(eyes, gazes, strict=True):
            drawn = backdrops.draw(eye, gaze, SIZE)
            if drawn.stats.image is None:
                continue
            camera = drawn.camera
            faces = np.concatenate([plan.frame(eye, gaze).faces, drawn.nearer])
            inside = backdrops.foreground.of(cells, camera, len(scene)).faces
            ways = {
                "whole": lambda camera=camera: pipeline.draw(camera, None, span),
                "in frustum": lambda camera=camera, faces=inside: pipeline.draw(camera, faces, span),
                "plan": lambda camera=camera, faces=faces: pipeline.draw(camera, faces, span),
                "own": lambda camera=camera: scene.render(camera),
            }
            best = dict.fromkeys(found, np.inf)
            for _ in range(rounds):
                for way, job in ways.items():
                    best[way] = min(best[way], 1e3 * lab.elapsed(job)[1])
                stats = backdrops.draw(eye, gaze, SIZE).stats
                best["warp"] = min(best["warp"], stats.placed + stats.warped + stats.composed)
            for way, value in best.items():
                found[way].append(value)
        name = pipeline.name()
    finally:
        pipeline.close()
    middle = {way: float(np.median(values)) for way, values in found.items()}
    return {
        "OpenGL": name,
        "frames": len(found["whole"]),
        "whole, ms": middle["whole"],
        "in frustum, ms": middle["in frustum"],
        "plan's faces, ms": middle["plan"],
        "placed, warped, composed, ms": middle["warp"],
        "whole / plan": middle["whole"] / (middle["plan"] + middle["warp"]),
        "in frustum / plan": middle["in frustum"] / (middle["plan"] + middle["warp"]),
        "own rasteriser, whole, ms": middle["own"],
    }


def picture(backdrops: Backdrops, eye: np.ndarray, gaze: np.ndarray, path: Path) -> None:
    """A frame as it truly is, which of its pixels show the backdrop, and in the displays; holes are magenta."""
    size = (SIZE[0] * 2 // 3, SIZE[1] * 2 // 3)
    drawn = {
        display: backdrops.draw(eye, gaze, size, display=display) for display in ("ldi", "warp", "quad", "geometry")
    }
    truth = backdrops.color(backdrops.scene.render(drawn["ldi"].camera))
    pale = np.where(drawn["ldi"].backdrop[..., None], truth, (0.35 * truth + 160).astype(np.uint8))
    panels = {"the truth": truth, "of it the backdrop": pale}
    for display, frame in drawn.items():
        panels[f'display="{display}"'] = np.where(frame.hole[..., None], np.array([255, 0, 255], np.uint8), frame.color)
    sheet = Image.new("RGB", (3 * (size[0] + 6) - 6, 2 * (size[1] + 22)), "white")
    for place, (title, panel) in enumerate(panels.items()):
        x, y = place % 3 * (size[0] + 6), place // 3 * (size[1] + 22)
        ImageDraw.Draw(sheet).text((x + size[0] / 2, y + 11), title, "black", anchor="mm", font_size=13)
        sheet.paste(Image.fromarray(panel), (x, y + 22))
    sheet.save(path)


def half_a_pixel(backdrops: Backdrops, eyes: np.ndarray, gazes: np.ndarray) -> float:
    """The PSNR of true pictures against those that are drawn half a pixel to the right of and below them."""
    squares = []
    for eye, gaze in zip(eyes, gazes, strict=True):
        camera = frame_camera(backdrops.plan, eye, gaze, SIZE)
        K = camera.K.copy()
        K[:2, 2] += 0.5
        one, two = (backdrops.color(backdrops.scene.render(c)).astype(float) for c in (camera, camera.replace(K=K)))
        squares.append(np.square(one - two).mean())
    return float(10 * np.log10(255**2 / np.mean(squares)))


def shown(row: Row) -> Row:
    """A row of a walk as the table has it."""
    return {
        "display": row["display"],
        "frames": f"{row['frames']} of {row['of']}",
        "pixels": f"{row['pixels']:.2%}",
        "PSNR, dB": f"{row['psnr']:.2f}",
        "behind, dB": f"{row['behind_psnr']:.2f}",
        "holes": f"{row['holes']:.3%}",
        "worst": f"{row['worst_holes']:.2%}",
        "lost": f"{row['lost']:.2%}",
        "popping": f"{row['popping']:.1f}",
        "jump": f"{row['jump']:.1f}",
        "step": f"{row['step']:.1f}",
        "faces": f"{row['faces']:,.0f}",
        "in frustum": f"{row['in_frustum']:,.0f}",
        "frame, ms": f"{row['ms']:.1f}",
        "backdrop, ms": f"{row['warp_ms']:.1f}",
        "all geometry, ms": f"{row['all_ms']:.1f}",
    }


def overlap(backdrops: Backdrops, used: list[cyc.LayeredDepthImage], tolerance: float = 2.0) -> Row:
    """The share of an image's samples that the image taken nearest to it has too, within `tolerance` pixels' widths."""
    shares = []
    eyes = np.array([image.camera.eye for image in used]).reshape(-1, 3)
    for index, one in enumerate(used[:8]):
        away = np.linalg.norm(eyes - one.camera.eye, axis=1)
        away[index] = np.inf
        if not np.isfinite(away).any():
            continue
        two = used[int(away.argmin())]
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
