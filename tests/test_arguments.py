"""Arguments of the wrong kind are refused by name, wherever pictures with depth take them."""

import numpy as np
import pytest

import cyclorama as cyc

CAMERA = cyc.Camera.look_at((0, 0, 4), (0, 0, 0), width=8, height=6)
WALL = cyc.DepthImage(np.full((6, 8, 3), 200, np.uint8), np.full((6, 8), 4.0), CAMERA)
LAYERED = cyc.LayeredDepthImage.build(WALL)
WRONG = [1.5, "x", object(), [1, 2], np.nan, -1, {}, np.zeros((2, 2))]


@pytest.mark.parametrize(
    ("call", "name", "right"),
    [
        (lambda v: cyc.warp.forward(WALL, CAMERA, threads=v), "threads", []),
        (lambda v: cyc.warp.forward(v, CAMERA), "images", [{}]),
        (lambda v: cyc.warp.forward(WALL, v), "camera", []),
        (lambda v: cyc.warp.forward(WALL, CAMERA, order=v), "order", []),
        (lambda v: cyc.warp.forward(WALL, CAMERA, splat=v), "splat", []),
        (lambda v: cyc.warp.forward(WALL, CAMERA, background=v), "background", []),
        (lambda v: cyc.warp.forward(WALL, CAMERA, out=v), "out", []),
        (lambda v: cyc.warp.map(CAMERA, CAMERA, v), "depth", [1.5]),
        (lambda v: cyc.warp.fill(cyc.warp.forward(WALL, CAMERA), method=v), "method", []),
        (lambda v: LAYERED.warp(CAMERA, threads=v), "threads", []),
        (lambda v: LAYERED.warp(CAMERA, cull=v), "cull", []),
        (lambda v: LAYERED.warp(CAMERA, cull="paper", thresholds=v), "thresholds", [[1, 2]]),
        (lambda v: LAYERED.warp(CAMERA, v), "splat", []),
        (lambda v: LAYERED.cull_faults(CAMERA, thresholds=v), "thresholds", [[1, 2]]),
        (lambda v: LAYERED.octree(v), "thresholds", [[1, 2]]),
        (lambda v: LAYERED.compact(v), "cameras", []),
        (lambda v: LAYERED.compact([CAMERA], loss=v), "loss", []),
        (lambda v: cyc.LayeredDepthImage.build(v), "central", []),
        (lambda v: cyc.LayeredDepthImage.build(WALL, v), "construction", [{}]),
        (lambda v: cyc.LayeredDepthImage.build(WALL, tolerance=v), "tolerance", [1.5]),
        (lambda v: cyc.LayeredDepthImage.build(WALL, [WALL], max_error=v), "max_error", [1.5]),
        (lambda v: cyc.LayeredDepthImage.build(WALL, [WALL], max_error=1, held_out=v), "held_out", []),
        (lambda v: cyc.LayeredDepthImage.build(WALL, threads=v), "threads", []),
        (lambda v: cyc.LayeredDepthImage.cast(v, CAMERA), "scene", []),
        (lambda v: cyc.LayeredDepthImage.cast(cyc.scenes.layers(20, 2), CAMERA, color=v), "color", []),
    ],
)
def test_what_is_of_the_wrong_kind_is_refused_by_name(call, name, right):
    for value in WRONG:
        if any(type(value) is type(fine) and value == fine for fine in right):
            call(value)
            continue
        with pytest.raises(ValueError, match=name):
            call(value)
