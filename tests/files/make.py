"""Writes the small files of this folder with the versions of today: python tests/files/make.py [folder].

They are what older versions wrote, so files that are there are kept: a new version of a format gets new names.
"""

import json
import sys
from pathlib import Path

import numpy as np

import cyclorama as cyc

HERE = Path(__file__).parent


def scene() -> cyc.Scene:
    """300 triangles that lie about, by sines alone: the same bytes forever."""
    places = np.sin(np.arange(900) * 1.7 + 1)[:, None] * [1, 0, 0] + np.sin(np.arange(900) * 0.31)[:, None] * [0, 1, 0]
    places = places + np.sin(np.arange(900) * 2.3 + 2)[:, None] * [0, 0, 1]
    corners = np.round(places[::3, None] + 0.2 * places.reshape(-1, 3, 3)[::-1], 3)
    colors = (np.arange(900).reshape(300, 3) * 37 % 200 + 50).astype(np.uint8)
    return cyc.Scene(corners.reshape(-1, 3), np.arange(900).reshape(300, 3), colors)


CAMERA = cyc.Camera.look_at((0.3, 0.2, 4), (0, 0, 0), width=20, height=16)
ASIDE = cyc.Camera.look_at((0.8, 0.2, 4), (0, 0, 0), width=20, height=16)

BUILDING = {
    "format": "cyclorama building 1",
    "cells": [{"min": [-2, -2, -2], "max": [0, 2, 2]}, {"min": [0, -2, -2], "max": [2, 2, 2]}],
    "portals": [{"cells": [0, 1], "polygon": [[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]]}],
}


def answers(folder: Path) -> dict[str, object]:
    """What the files say."""
    shapes = scene()
    vis = cyc.Visibility.load(folder / "visibility-1.npz")
    plan = cyc.placement.Plan.load(folder / "plan-2.npz", shapes)
    frames = [plan.frame([0.1 * k, 0.2, 0.1 * k - 0.9], [0.6, 0.0, 0.8]) for k in range(5)]
    walk = cyc.panorama.Store(folder / "walk-3")
    image = cyc.DepthImage.load(folder / "depth-image-1.npz")
    building = cyc.portals.Building.load(folder / "building-1.json", shapes)
    layered = [cyc.LayeredDepthImage.load(folder / f"layered-1.{kind}") for kind in ("npz", "exr")]
    return {
        "visible": [int(vis.visible_along(way).sum()) for way in np.eye(3)],
        "rows": [int(rows.ids(k).sum()) for rows in (vis.bitfields, vis.cells) for k in range(len(rows))],
        "images": len(plan.images),
        "frames": [[int(frame.faces.sum()), None if frame.image is None else frame.image.index] for frame in frames],
        "panorama": [len(walk), int(walk.panorama(0).astype(int).sum())],
        "depth": [int(image.missing.sum()), int(image.ids[~image.missing].sum()), float(image.disparity.max())],
        "rooms": [building.cell([x, 0.0, 0.0]) for x in (-1.0, 1.0)],
        "layered": [[ldi.samples, int(ldi.warp(ASIDE).color.astype(int).sum())] for ldi in layered],
    }


def main(folder: Path) -> None:
    shapes = scene()
    vis = cyc.bake(shapes, views=6, resolution=(48, 40), probes=4, progress=False)
    plan = cyc.place_images(shapes, 200, leaf_depth=2, progress=False)
    central, other = (shapes.depth_image(camera) for camera in (CAMERA, ASIDE))
    layered = cyc.LayeredDepthImage.build(central, [other])
    for name, save in (
        ("visibility-1.npz", vis.save),
        ("plan-2.npz", plan.save),
        ("certificate-1.npz", plan.certify),
        ("depth-image-1.npz", central.save),
        ("layered-1.npz", layered.save),
        ("layered-1.exr", layered.save),
        ("building-1.json", lambda path: path.write_text(json.dumps(BUILDING))),
    ):
        if not (folder / name).exists():
            save(folder / name)
    if not (folder / "walk-3").exists():
        cyc.panorama.bake(
            shapes, [[0, 0, 0], [0.05, 0, 0]], 2, (64, 16), tile=16, places=[0.0], out=folder / "walk-3", progress=False
        )
    if not (folder / "answers.json").exists():
        (folder / "answers.json").write_text(json.dumps(answers(folder)) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
