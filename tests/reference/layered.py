"""Layered images in plain NumPy and loops, written to be read."""

import numpy as np


def place(source, target, x, y, disparity):
    """Column, row and disparity in the target of a point of the source's image, or None behind its eye."""
    turn = target.world_to_camera[:3, :3] @ source.world_to_camera[:3, :3].T
    move = target.world_to_camera[:3, 3] - turn @ source.world_to_camera[:3, 3]
    ray = np.linalg.inv(source.K) @ (x, y, 1.0)
    there = target.K @ (turn @ ray + move * disparity)
    if there[2] <= 0 or there[2] < target.near * disparity:
        return None
    return there[0] / there[2], there[1] / there[2], disparity / there[2]


def merge(images, tolerance, color_tolerance, corners):
    """For each pixel of the first image the samples (disparity, colour, place) of all images, nearest first.

    With `corners` those 3 sixteenths of a pixel or more right of and below its centre are apart from the others.
    """
    camera = images[0].camera
    pixels = [[] for _ in range(camera.width * camera.height)]
    for number, image in enumerate(images):
        for y, x in np.argwhere(~image.missing):
            disparity = float(image.disparity[y, x])
            at = (x + 0.5, y + 0.5, disparity)
            if number:
                at = place(image.camera, camera, *at)
            if at is None or not (0 <= at[0] < camera.width and 0 <= at[1] < camera.height):
                continue
            column, row = int(at[0]), int(at[1])
            steps = [min(7, int(np.round(16 * (at[axis] - int(at[axis]) - 0.5)))) for axis in (0, 1)]
            color = image.color[y, x, :3].astype(int)
            own = pixels[row * camera.width + column]
            footprint = tolerance / min(camera.K[0, 0], camera.K[1, 1])
            same = [
                abs(other - at[2]) <= footprint * max(other, at[2])
                and np.abs(c - color).max() <= color_tolerance
                and not (corners and (min(p) >= 3) != (min(steps) >= 3))
                for other, c, p in own
            ]
            if not any(same):
                own.append((at[2], color, steps))
    return [sorted(own, key=lambda sample: -sample[0]) for own in pixels]


def nearest_samples(image, camera):
    """Disparity and index of the nearest sample on each pixel of a camera, -1 where there is none."""
    nearness = np.full((camera.height, camera.width), -1.0)
    index = np.full((camera.height, camera.width), -1)
    for pixel in range(len(image.offsets) - 1):
        for sample in range(image.offsets[pixel], image.offsets[pixel + 1]):
            right, down = image.place[sample] / 16
            x, y = pixel % image.camera.width + 0.5 + right, pixel // image.camera.width + 0.5 + down
            at = place(image.camera, camera, x, y, float(image.disparity[sample]))
            if at is None or not (0 <= at[0] < camera.width and 0 <= at[1] < camera.height):
                continue
            column, row = int(at[0]), int(at[1])
            if at[2] > nearness[row, column]:
                nearness[row, column], index[row, column] = at[2], sample
    return nearness, index


def warp(image, camera, splat, step=1.03):
    """Colour, and which pixels are holes, of a layered image warped with a depth buffer."""
    nearness, index = nearest_samples(image, camera)
    height, width = nearness.shape
    if splat > 1:
        there = np.maximum(nearness, 0)
        beside = np.pad(there, 1)
        across = np.minimum(beside[1:-1, :-2], beside[1:-1, 2:])
        along = np.minimum(beside[:-2, 1:-1], beside[2:, 1:-1])
        crack = np.maximum(across, along) > step * there
        nearness[crack], index[crack] = -1, -1
    shown = index.copy()
    radius = splat // 2
    for y, x in np.argwhere(index < 0):
        rows = slice(max(0, y - radius), min(height, y + radius + 1))
        columns = slice(max(0, x - radius), min(width, x + radius + 1))
        around = nearness[rows, columns]
        if around.max() >= 0:
            shown[y, x] = index[rows, columns].reshape(-1)[np.argmax(around)]
    color = np.zeros((height, width, 3), np.uint8)
    color[shown >= 0] = image.color[shown[shown >= 0]]
    return color, shown < 0
