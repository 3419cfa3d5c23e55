"""Several images in one frame against one (section 8.2 of the 1998 dissertation): faces drawn, images needed, quality.

    python benches/images_per_frame.py [--quick] [--faces 100000] [--share 0.25] [--frames 1000] [--pictures 12]

Faces are those of the frames that need an image. *Needed*: plans are placed for greater and greater budgets with one
image a frame, which takes fewer images, and the last is taken of which no sampled frame draws more than the budget that
was asked for once it has several. Sampled, not proved. Pictures are 255 x 240, the images of a frame share the pixels
of one, and nothing of the rest of the budget is spent.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from functools import partial

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab
from cyclorama.lab import Row
from cyclorama.placement import Plan, check, walking
from cyclorama.placement.backdrops import Backdrops

COUNTS = (1, 2, 3, 4)


def main() -> None:
    options = bench.options(__doc__, faces=100_000, share=0.25, frames=1000, pictures=12)
    faces = 20_000 if options.quick else options.faces
    share = 0.6 if options.quick else options.share
    scene = cyc.scenes.pipes(faces)
    budget = int(share * faces)
    steps = [1.0, 1.1, 1.2, 1.3, 1.4]
    plans = {step: cyc.place_images(scene, int(step * budget), progress=False) for step in steps}
    eyes, gazes = check.random_frames(plans[1.0], options.frames, 0)
    rows = []
    for count in COUNTS:
        row = drawn(plans[1.0], eyes, gazes, count)
        held = [s for s in steps if s == 1.0 or most(plans[s], eyes, gazes, count) <= budget]
        row["needed"] = min(len(plans[s].images) - plans[s].shell for s in held)
        rows.append(row | quality(plans[1.0], scene, count, options.pictures))
    bench.show(f"pipes, {faces:,} faces, budget {budget:,}, {options.frames} frames", rows)


def drawn(plan: Plan, eyes: np.ndarray, gazes: np.ndarray, count: int) -> Row:
    """Faces and images of the frames that need an image, and the time to find them."""
    several, faces, images, times = replace(plan, images_per_frame=count), [], [], []
    out = np.empty(plan.budget, np.uint32)
    for eye, gaze in zip(eyes, gazes, strict=True):
        frame, seconds = lab.elapsed(partial(several.frame, eye, gaze, out), clock=time.process_time)
        times.append(1e3 * seconds)
        if frame.image is not None:
            faces.append(len(frame.faces))
            images.append(len(frame.images))
    return {
        "images a frame": count,
        "shown": f"{np.mean(images):.2f}",
        "with one": f"{len(faces) / len(eyes):.1%}",
        "faces": f"{np.mean(faces):,.0f}",
        "most": f"{max(faces):,}",
        "plan.frame, CPU ms": f"{np.median(times):.2f}",
    }


def most(plan: Plan, eyes: np.ndarray, gazes: np.ndarray, count: int) -> int:
    """The most faces of any frame."""
    several = replace(plan, images_per_frame=count)
    return max(len(several.frame(eye, gaze).faces) for eye, gaze in zip(eyes, gazes, strict=True))


def quality(plan: Plan, scene: cyc.Scene, count: int, pictures: int) -> Row:
    """How frames that need an image differ from the whole scene."""
    if not pictures:
        return {}
    several = replace(plan, images_per_frame=count)
    eyes, gazes = check.random_frames(plan, 4000, 1)
    needs = [i for i in range(len(eyes)) if plan.frame(eyes[i], gazes[i]).image is not None][:pictures]
    with tempfile.TemporaryDirectory() as folder:
        backdrops = Backdrops(several, scene, folder, size=(256, 192), construction=6, spread=2.0, spend=False)
        row = walking.walk(backdrops, eyes[needs], gazes[needs], displays=("ldi",), size=(255, 240), progress=False)[0]
        backdrops.close()
    return {"pixels": f"{row['behind']:.1%}", "PSNR, dB": f"{row['psnr']:.1f}", "holes": f"{row['holes']:.2%}"}


if __name__ == "__main__":
    main()
