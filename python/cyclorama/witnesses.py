"""Points that prove faces visible: a face is drawn as large as the image, among all others, and a pixel of it taken."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .render import View
from .scene import Scene

__all__ = ["toward", "witness"]

Floats = npt.NDArray[np.float64]

#: Tangent of the widest angle from the middle of a picture: of faces that reach behind the eye it shows so much.
_WIDEST = 20.0

#: Images, ever closer, after which it is given up: all of a face twice, then its quarters, and theirs.
_DEPTH = 4

#: Share of its depth that float32 may move a picture's depth by, twice over.
_COPLANAR = 2.0**-22


def witness(scene: Scene, face: int, eye: Floats, resolution: int, threads: int | None = None) -> Floats | None:
    """A point of a face that nothing hides from an eye; None if no pixel shows one.

    The images are square: one of all of the face, then, with four times as many pixels a side, of smaller and smaller
    parts of it.
    """
    triangle = np.asarray(scene.vertices[scene.faces[face]], np.float64)
    parts, size = [triangle], resolution
    for _ in range(_DEPTH):
        for part in parts:
            camera = _close_up(eye, part, size)
            point = _shown(camera, scene.render(camera, threads=threads), face, triangle)
            if point is not None:
                return point
        parts = [quarter for part in parts for quarter in _quarters(part)] if size > resolution else parts
        size = 4 * resolution
    return None


def _shown(camera: Camera, view: View, face: int, triangle: Floats) -> Floats | None:
    """Where the ray of the most central pixel that shows a face, or another one in its plane over it, meets it."""
    rows, columns = np.nonzero(np.isfinite(view.depth))
    rays = np.linalg.solve(camera.K, np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])).T
    rays = rays @ camera.world_to_camera[:3, :3]
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        # Along these rays a step of 1 is one of depth.
        depth = ((triangle[0] - camera.eye) @ normal) / (rays @ normal)
    is_face = view.ids[rows, columns] == face
    if not is_face.any():
        points = camera.eye + rays * depth[:, None]
        sides = np.cross(normal, np.roll(triangle, -1, axis=0) - triangle)
        within = (((points[:, None] - triangle) * sides).sum(axis=2) >= 0).all(axis=1)
        is_face = within & (depth > 0) & (depth <= view.depth[rows, columns] * (1 + _COPLANAR))
    at = np.flatnonzero(is_face)
    if not len(at):
        return None
    pixels = np.stack([rows[at], columns[at]], axis=1)
    best = at[np.abs(pixels - np.median(pixels, axis=0)).sum(axis=1).argmin()]
    return np.asarray(camera.eye + rays[best] * depth[best])


def _quarters(triangle: Floats) -> list[Floats]:
    """The four triangles that the middles of a triangle's sides cut it into."""
    a, b, c = triangle
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return [np.stack(corners) for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]


def toward(eye: Floats, triangle: npt.NDArray[np.floating]) -> Floats:
    """(3, 3) the turn from the world's axes to those of a camera at an eye that looks at a triangle."""
    away = triangle - eye
    forward = (away / np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None]).mean(axis=0)
    if np.linalg.norm(forward) < 1e-6:
        forward = away[0]
    up = np.eye(3)[int(np.argmin(np.abs(forward)))]
    return Camera.look_at(np.zeros(3), forward, up).world_to_camera[:3, :3]


def _close_up(eye: Floats, triangle: Floats, size: int) -> Camera:
    """A camera whose image a triangle fills, as far as it is in front of it."""
    away = triangle - eye
    distances = np.linalg.norm(away, axis=1)
    turn = toward(eye, triangle)
    local = away @ turn.T
    plane = local[:, :2] / np.maximum(local[:, 2], distances / _WIDEST)[:, None]
    low, high = plane.min(axis=0), plane.max(axis=0)
    focal = size / np.maximum((high - low) * 1.02, 1e-9)
    x, y = size / 2 - focal * (low + high) / 2
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = turn, -turn @ eye
    return Camera([[focal[0], 0, x], [0, focal[1], y], [0, 0, 1]], world_to_camera, size, size)
