"""The ``transforms.json`` of nerfstudio and instant-ngp."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..camera import Camera
from ..files import whole_file
from .pose import FLIP, add, intrinsics, named, pinhole, read_json

__all__ = ["read_transforms", "write_transforms"]

PathLike = str | os.PathLike[str]

#: Coefficients of distortion that a file may have.
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")


def read_transforms(path: PathLike) -> dict[str, Camera]:
    """The cameras of a ``transforms.json`` (nerfstudio, instant-ngp).

    Parameters
    ----------
    path : path

    Returns
    -------
    dict of str to Camera
        By ``file_path``, in the order of the file.

    Raises
    ------
    ValueError
        If it is none, a value is missing, two frames have one name, or a camera has distortion. The message names the
        frame.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_transforms(f"{folder}/transforms.json", {"a.png": Camera.look_at([0, 0, 5], [0, 0, 0])})
    ...     read_transforms(f"{folder}/transforms.json")["a.png"].eye.round(12)
    array([0., 0., 5.])
    """
    whole = read_json(Path(path))
    frames = whole.get("frames")
    if not isinstance(frames, list):
        raise ValueError(f"{path}: has no list of frames, so it is no transforms.json")
    cameras: dict[str, Camera] = {}
    for index, frame in enumerate(frames):
        try:
            if not isinstance(frame, dict):
                raise ValueError(f"it must be an object, got {frame!r}")
            add(cameras, str(frame.get("file_path", index)), _transform(whole | frame))
        except (TypeError, ValueError, KeyError) as error:
            said = f"it has no {error}" if isinstance(error, KeyError) else str(error)
            raise ValueError(f"{path}: frames[{index}]: {said}") from error
    return cameras


def write_transforms(path: PathLike, cameras: Mapping[str, Camera]) -> None:
    """Writes cameras as a ``transforms.json``.

    Parameters
    ----------
    path : path
    cameras : mapping of str to Camera
        Pinhole cameras without skew, by ``file_path``.

    Raises
    ------
    ValueError
        If they have no names, or a camera is orthographic or skewed.
    OSError
        If the file can't be written.
    """
    frames = []
    for name, camera in named(cameras).items():
        fx, fy, cx, cy = pinhole(name, camera)
        frames.append(
            {
                "file_path": name,
                "fl_x": fx,
                "fl_y": fy,
                "cx": cx,
                "cy": cy,
                "w": camera.width,
                "h": camera.height,
                "transform_matrix": (camera.camera_to_world @ FLIP).tolist(),
            }
        )
    with whole_file(path) as file:
        file.write(json.dumps({"camera_model": "OPENCV", "frames": frames}, indent=1).encode())


def _transform(frame: dict[str, Any]) -> Camera:
    bent = [name for name in _DISTORTION if float(frame.get(name, 0.0)) != 0.0]
    if bent or str(frame.get("camera_model", "OPENCV")) not in ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE"):
        raise ValueError(
            f"the camera has distortion ({', '.join(bent) or frame['camera_model']}): undistort images first"
        )
    width, height = int(frame["w"]), int(frame["h"])
    if "fl_x" in frame:
        fx = float(frame["fl_x"])
    else:
        fx = width / 2 / math.tan(float(frame["camera_angle_x"]) / 2)
    fy = float(frame.get("fl_y", fx))
    cx, cy = float(frame.get("cx", width / 2)), float(frame.get("cy", height / 2))
    pose = np.linalg.inv(np.asarray(frame["transform_matrix"], dtype=np.float64) @ FLIP)
    return Camera(intrinsics(fx, fy, cx, cy), pose, width, height)
