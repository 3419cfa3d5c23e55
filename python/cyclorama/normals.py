"""Normals of surfaces in 16 bits, and where they come from.

A unit vector is put on an octahedron, whose lower half is folded over the upper one to make a square: eight bits for
each side of it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .depth_image import DepthImage

__all__ = ["decode", "encode", "of_faces", "of_image"]

Floats = npt.NDArray[np.float64]


def encode(directions: npt.ArrayLike) -> npt.NDArray[np.uint16]:
    """Directions as 16-bit words.

    Parameters
    ----------
    directions : (..., 3) array_like of float
        Of any length; NaN and zero become the word of +z.

    Returns
    -------
    (...) ndarray of uint16
        `decode` gives back a direction within 1 degree.

    Raises
    ------
    ValueError
        If the last axis is not 3.

    Examples
    --------
    >>> decode(encode([0.0, 0.0, -2.0]))
    array([ 0.,  0., -1.])
    """
    vectors = np.asarray(directions, dtype=np.float64)
    if vectors.ndim == 0 or vectors.shape[-1] != 3:
        raise ValueError(f"directions must have shape (..., 3), got {vectors.shape}")
    size = np.abs(vectors).sum(axis=-1, keepdims=True)
    known = np.isfinite(size) & (size > 0)
    unit = np.where(known, vectors, (0.0, 0.0, 1.0)) / np.where(known, size, 1.0)
    flat = unit[..., :2]
    flat = np.where(unit[..., 2:] >= 0, flat, (1 - np.abs(flat[..., ::-1])) * _signs(flat))
    # 254 steps, so that the middle, and with it each axis, has a word of its own.
    steps = np.rint((flat * 0.5 + 0.5) * 254).astype(np.uint16)
    return np.asarray(steps[..., 0] | steps[..., 1] << 8, dtype=np.uint16)


def decode(words: npt.ArrayLike) -> Floats:
    """Unit vectors from their words.

    Parameters
    ----------
    words : (...) array_like of uint16

    Returns
    -------
    (..., 3) ndarray of float64

    Examples
    --------
    >>> decode(encode([1.0, 0.0, 0.0]))
    array([1., 0., 0.])
    """
    array = np.asarray(words, dtype=np.int64)
    flat = np.stack([array & 255, array >> 8], axis=-1) / 127 - 1
    up = 1 - np.abs(flat).sum(axis=-1, keepdims=True)
    flat = np.where(up >= 0, flat, (1 - np.abs(flat[..., ::-1])) * _signs(flat))
    vectors = np.concatenate([flat, up], axis=-1)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def of_faces(vertices: npt.ArrayLike, faces: npt.ArrayLike, toward: npt.ArrayLike) -> Floats:
    """Normals of triangles, on the side that is asked for.

    Parameters
    ----------
    vertices : (V, 3) array_like of float
    faces : (N, 3) array_like of int
        Corners of each triangle.
    toward : (N, 3) array_like of float
        A direction of any length that each normal is not to point away from; the normal itself where a triangle has no
        area.

    Returns
    -------
    (N, 3) ndarray of float64
        Unit vectors.

    Examples
    --------
    >>> of_faces([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]], [[1, 0, 9], [1, 0, 9]])
    array([[0., 0., 1.],
           [0., 0., 1.]])
    """
    corners = np.asarray(vertices, dtype=np.float64)[np.asarray(faces)]
    side = np.asarray(toward, dtype=np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(size > 0, normal, side)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    away = (normal * side).sum(axis=-1, keepdims=True) < 0
    return np.asarray(np.where(away, -normal, normal) + 0.0)


def of_image(image: DepthImage) -> Floats:
    """World normals of what an image with depth shows, toward its eye.

    Each is of the plane through a pixel's point and the nearer in depth of its neighbours left and right, and above and
    below; where there are none, it points at the eye.

    Parameters
    ----------
    image : DepthImage
        H x W pixels.

    Returns
    -------
    (H, W, 3) ndarray of float64
        Unit vectors.

    Examples
    --------
    >>> from cyclorama import Camera
    >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=3, height=3)
    >>> of_image(DepthImage(np.zeros((3, 3, 3), np.uint8), np.full((3, 3), 4.0), camera))[1, 1]
    array([0., 0., 1.])
    """
    points = image.points()
    across, down = _steps(points, image.depth, 1), _steps(points, image.depth, 0)
    _, directions = image.camera.rays()
    normal = np.cross(across, down)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    lost = ~np.isfinite(normal).all(axis=-1, keepdims=True)
    toward = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    normal = np.where(lost, toward, normal)
    away = (normal * toward).sum(axis=-1, keepdims=True) < 0
    return np.asarray(np.where(away, -normal, normal) + 0.0)


def _steps(points: Floats, depth: npt.NDArray[np.float32], axis: int) -> Floats:
    """From each point to its neighbour before or after along an axis, whichever is nearer in depth; NaN without one."""
    steps = np.full((2, *points.shape), np.nan)
    gaps = np.full((2, *depth.shape), np.inf)
    first, last = [slice(None)] * 2, [slice(None)] * 2
    first[axis], last[axis] = slice(None, -1), slice(1, None)
    with np.errstate(invalid="ignore"):
        step = np.diff(points, axis=axis)
        gap = np.nan_to_num(np.abs(depth[tuple(last)] - depth[tuple(first)]), nan=np.inf)
    steps[0][tuple(first)] = steps[1][tuple(last)] = step
    gaps[0][tuple(first)] = gaps[1][tuple(last)] = gap
    return np.asarray(np.where((gaps[0] <= gaps[1])[..., None], steps[0], steps[1]), dtype=np.float64)


def _signs(values: Floats) -> Floats:
    return np.asarray(np.where(values >= 0, 1.0, -1.0), dtype=np.float64)
