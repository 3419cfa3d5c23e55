"""Cameras of glTF and GLB files."""

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
from .pose import FLIP, Floats, intrinsics, named, parse_json, pinhole, rotation

__all__ = ["read_gltf", "write_gltf"]

PathLike = str | os.PathLike[str]


def read_gltf(path: PathLike, height: int = 480) -> dict[str, Camera]:
    """The perspective cameras of a glTF or GLB file, where its nodes put them.

    Parameters
    ----------
    path : path
    height : int
        Of the images in pixels, which glTF does not say (a file of ours does).

    Returns
    -------
    dict of str to Camera
        By the name of the node, or its number where it has none or an earlier one has the same. A camera without an
        aspect ratio gets 4:3.

    Raises
    ------
    ValueError
        If the file is no glTF, a node with a camera is scaled or sheared, or nodes form a cycle.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_gltf(f"{folder}/cameras.gltf", {"a": Camera.look_at([0, 0, 5], [0, 0, 0])})
    ...     read_gltf(f"{folder}/cameras.gltf")["a"].eye.round(12)
    array([0., 0., 5.])
    """
    path = Path(path)
    whole = _gltf(path)
    nodes, cameras = _objects(path, whole, "nodes"), dict[str, Camera]()
    try:
        above = {child: index for index, node in enumerate(nodes) for child in node.get("children", [])}
    except TypeError as error:
        raise ValueError(f"{path}: children of nodes must be lists of numbers: {error}") from error
    for index, node in enumerate(nodes):
        if "camera" not in node:
            continue
        try:
            lens = whole["cameras"][node["camera"]]
            if lens.get("type") != "perspective":
                continue
            name = str(node.get("name", index))
            name = str(index) if name in cameras else name
            cameras[name] = _gltf_camera(lens, _placed(nodes, above, index), height)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ValueError(f"{path}: nodes[{index}]: {error}") from error
    return cameras


def write_gltf(path: PathLike, cameras: Mapping[str, Camera]) -> None:
    """Writes cameras as a glTF file without meshes, to be added to a scene or looked at.

    Parameters
    ----------
    path : path
        Ends in ``.gltf``.
    cameras : mapping of str to Camera
        Pinhole cameras with square pixels that look through the middle of their image, by the name of the node. The
        size of the image goes into ``extras``.

    Raises
    ------
    ValueError
        If the path ends otherwise, they have no names, or a camera is something else, which glTF can't say.
    OSError
        If the file can't be written.
    """
    if Path(path).suffix.lower() != ".gltf":
        raise ValueError(f"{os.fspath(path)} must end in .gltf")
    nodes: list[dict[str, Any]] = []
    lenses: list[dict[str, Any]] = []
    for name, camera in named(cameras).items():
        fx, fy, cx, cy = pinhole(name, camera)
        width, height = camera.width, camera.height
        off = max(abs(cx - width / 2), abs(cy - height / 2), abs(fx / fy - 1) * height)
        if off > 1e-6 * height:
            raise ValueError(
                f"camera {name!r} has pixels that are not square, or looks beside the middle: glTF has none"
            )
        lens = {"yfov": camera.fov_y * math.pi / 180, "aspectRatio": width / height, "znear": camera.near or 0.01}
        pose = (camera.camera_to_world @ FLIP).T.ravel().tolist()
        nodes.append({"name": name, "camera": len(lenses), "matrix": pose})
        lenses.append({"type": "perspective", "perspective": lens, "extras": {"width": width, "height": height}})
    whole = {
        "asset": {"version": "2.0", "generator": "cyclorama"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "cameras": lenses,
    }
    with whole_file(path) as file:
        file.write(json.dumps(whole, indent=1).encode())


def _gltf(path: Path) -> dict[str, Any]:
    raw = path.read_bytes()
    if raw[:4] == b"glTF":
        if len(raw) < 20 or len(raw) < 20 + int.from_bytes(raw[12:16], "little"):
            raise ValueError(f"{path}: a GLB file cut off in its header")
        raw = raw[20 : 20 + int.from_bytes(raw[12:16], "little")]
    whole = parse_json(path, raw)
    if "asset" not in whole:
        raise ValueError(f"{path}: has no asset, so it is no glTF")
    return whole


def _placed(nodes: list[dict[str, Any]], above: dict[int, int], index: int | None) -> Floats:
    pose: Floats = np.eye(4)
    passed: list[int] = []
    while index is not None:
        if index in passed:
            raise ValueError(f"its parents form a cycle, {' in '.join(map(str, passed))} in {index}")
        passed.append(index)
        pose = _local(nodes[index]) @ pose
        index = above.get(index)
    return pose


def _objects(path: Path, whole: dict[str, Any], name: str) -> list[dict[str, Any]]:
    found = whole.get(name, [])
    if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
        raise ValueError(f"{path}: {name} must be a list of objects")
    return found


def _local(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.asarray(node["matrix"], dtype=np.float64).reshape(4, 4).T
    pose = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    pose[:3, :3] = rotation(np.array([w, x, y, z])) * np.asarray(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    pose[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return pose


def _gltf_camera(lens: dict[str, Any], pose: Floats, height: int) -> Camera:
    perspective, extras = lens["perspective"], lens.get("extras") or {}
    height = int(extras.get("height", height))
    width = int(extras.get("width", round(height * float(perspective.get("aspectRatio", 4 / 3)))))
    focal = height / 2 / math.tan(float(perspective["yfov"]) / 2)
    world_to_camera = np.linalg.inv(pose @ FLIP)
    return Camera(intrinsics(focal, focal, width / 2, height / 2), world_to_camera, width, height)
