"""A forward warp written to be read: every sample goes through the world, the nearest on a pixel is shown."""

from __future__ import annotations

import numpy as np

import cyclorama as cyc


def positions(image: cyc.DepthImage, camera: cyc.Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixel coordinates (H, W, 2) and depths (H, W) in `camera`; NaN where a sample isn't in front of its eye.

    Infinitely far samples are put so far away that moving the eye makes no difference.
    """
    height, width = image.disparity.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    far = np.where(image.disparity > 0, 1.0 / np.maximum(image.disparity, 1e-30).astype(float), 1e15)
    here = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(image.camera.K).T * far[..., None]
    pose = camera.world_to_camera @ np.linalg.inv(image.camera.world_to_camera)
    there = here @ pose[:3, :3].T + pose[:3, 3]
    with np.errstate(all="ignore"):
        pixel = there @ camera.K.T / there[..., 2:]
    seen = (there[..., 2] > 0) & (there[..., 2] >= camera.near) & ~image.missing
    depth = np.where(image.disparity > 0, there[..., 2], np.inf)
    return np.where(seen[..., None], pixel[..., :2], np.nan), np.where(seen, depth, np.nan)


def forward(images: list[cyc.DepthImage], camera: cyc.Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours, depths and holes of a warp with splats of one pixel and a depth buffer.

    Of equally near samples on a pixel the last is shown.
    """
    color = np.zeros((camera.height, camera.width, 3), np.uint8)
    nearest = np.full((camera.height, camera.width), np.inf)
    hole = np.ones(nearest.shape, bool)
    for image in images:
        pixel, depth = positions(image, camera)
        size = (camera.width, camera.height)
        inside = ((pixel >= 0) & (pixel < size)).all(-1)
        for row, column in np.argwhere(inside):
            x, y = pixel[row, column].astype(int)
            if depth[row, column] <= nearest[y, x]:
                nearest[y, x] = depth[row, column]
                color[y, x] = image.color[row, column, :3]
                hole[y, x] = False
    return color, nearest, hole


def square(color: np.ndarray, depth: np.ndarray, hole: np.ndarray, radius: int) -> tuple[np.ndarray, ...]:
    """The same with larger splats: an empty pixel shows the nearest of the samples shown in the square around it.

    Of equally near ones one of the least distant row, of these of the least distant column, of these the upper or left.
    """
    height, width = hole.shape
    shown, deep, empty = color.copy(), depth.copy(), hole.copy()
    apart = sorted(range(-radius, radius + 1), key=lambda step: (abs(step), step))
    for y, x in np.argwhere(hole):
        best = None
        for dy in apart:
            for dx in apart:
                v, u = y + dy, x + dx
                if (
                    0 <= v < height
                    and 0 <= u < width
                    and not hole[v, u]
                    and (best is None or depth[v, u] < depth[best])
                ):
                    best = v, u
        if best is not None:
            shown[y, x], deep[y, x], empty[y, x] = color[best], depth[best], False
    return shown, deep, empty


def eroded(mask: np.ndarray, radius: int) -> np.ndarray:
    """Pixels around which all within so many each way are set."""
    padded = np.pad(mask, radius, constant_values=True)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1, 2 * radius + 1))
    return windows.all((-1, -2))
