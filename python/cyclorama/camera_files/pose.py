"""What files of cameras have in common: lenses, rotations, JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..camera import Camera

__all__ = ["FLIP", "add", "intrinsics", "named", "parse_json", "pinhole", "quaternion", "read_json", "rotation"]

Floats = npt.NDArray[np.float64]

#: From OpenGL's camera axes (+y up, -z forward) to ours, and back.
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def intrinsics(fx: float, fy: float, cx: float, cy: float) -> Floats:
    """(3, 3) matrix of a lens without skew."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)


def read_json(path: Path) -> dict[str, Any]:
    return parse_json(path, path.read_bytes())


def parse_json(path: Path, raw: bytes) -> dict[str, Any]:
    try:
        whole = json.loads(raw)
    except ValueError as error:
        raise ValueError(f"{path}: not JSON, or cut off: {error}") from error
    if not isinstance(whole, dict):
        raise ValueError(f"{path}: holds a {type(whole).__name__}, not an object")
    return whole


def named(cameras: Mapping[str, Camera]) -> dict[str, Camera]:
    """The cameras to be written, by their names.

    Raises
    ------
    ValueError
        If they have no names, or one is no camera.
    """
    if not isinstance(cameras, Mapping):
        raise ValueError(f"cameras must be a mapping from names to cameras, got a {type(cameras).__name__}")
    for name, camera in cameras.items():
        if not isinstance(name, str):
            raise ValueError(f"cameras must be named by text, got {name!r}")
        if not isinstance(camera, Camera):
            raise ValueError(f"cameras[{name!r}] must be a Camera, got a {type(camera).__name__}")
    return dict(cameras)


def add(cameras: dict[str, Camera], name: str, camera: Camera) -> None:
    """Adds a camera that was read; a ValueError if another one has its name."""
    if name in cameras:
        raise ValueError(f"another camera is named {name!r}, too")
    cameras[name] = camera


def pinhole(name: str, camera: Camera) -> tuple[float, float, float, float]:
    """Focal lengths and principal point of a camera, in pixels."""
    if camera.orthographic or camera.K[0, 1] != 0:
        raise ValueError(f"camera {name!r} is {'orthographic' if camera.orthographic else 'skewed'}: not in such files")
    (fx, _, cx), (_, fy, cy), _ = camera.K.tolist()
    return fx, fy, cx, cy


def rotation(quaternion: Floats) -> Floats:
    """(3, 3) rotation of a quaternion (w, x, y, z) of any length but zero."""
    length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"{quaternion.tolist()} is no rotation")
    w, x, y, z = (quaternion / length).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion(turn: Floats) -> Floats:
    """(w, x, y, z) of a rotation, w not negative: the nearest where it is none, by Bar-Itzhack's matrix."""
    m = turn
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [0, m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [0, 0, m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [0, 0, 0, m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    vector = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    return np.asarray(vector if vector[0] >= 0 else -vector)
