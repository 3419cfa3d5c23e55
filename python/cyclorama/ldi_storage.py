"""Files of layered images: ``.npz`` that plain NumPy opens, and deep scanline OpenEXR that other programs open.

Both keep every bit. The ``.npz`` has ``offsets``, ``color``, ``disparity`` and ``place`` (and ``normals``) as
`LayeredDepthImage` has them, ``K`` and ``world_to_camera``, and a JSON ``header``.

The OpenEXR file has a deep pixel for each pixel, its samples nearest first: ``R``, ``G``, ``B`` (half floats: bytes
over 255, not linearised), ``A`` (1), ``Z`` (depth, float), and what programs that don't know them leave alone:
``disparity`` (float, as it is: 1 / depth twice isn't), ``place.x`` and ``place.y`` (sixteenths of a pixel), and
``normal`` (16 bits) if there are any. Its header has the camera as JSON under ``cyclorama``.

A file is written beside its final name and renamed when it is whole.
"""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .archives import UNREADABLE, check_format, read_archive, write_archive
from .camera import Camera
from .files import whole_path

if TYPE_CHECKING:
    from .ldi import LayeredDepthImage

__all__ = ["load", "save"]

FORMAT = "cyclorama layered depth image 1"


def save(image: LayeredDepthImage, path: str | os.PathLike[str]) -> None:
    """Writes a layered image; see `LayeredDepthImage.save`."""
    if _is_exr(path):
        _save_exr(image, path)
    else:
        _save_npz(image, path)


def load(path: str | os.PathLike[str]) -> LayeredDepthImage:
    """Reads a layered image; see `LayeredDepthImage.load`."""
    return _load_exr(path) if _is_exr(path) else _load_npz(path)


def _openexr() -> Any:
    try:
        import OpenEXR
    except ImportError as error:
        raise ImportError(".exr files need OpenEXR: pip install cyclorama[exr]") from error
    return OpenEXR


def _is_exr(path: str | os.PathLike[str]) -> bool:
    ending = os.path.splitext(os.fspath(path))[1].lower()
    if ending not in (".npz", ".exr"):
        raise ValueError(f"{os.fspath(path)} must end in .npz or .exr")
    return ending == ".exr"


def _save_npz(image: LayeredDepthImage, path: str | os.PathLike[str]) -> None:
    camera = image.camera
    header = {"size": (camera.width, camera.height), "near": camera.near}
    members: dict[str, npt.NDArray[Any]] = {
        "offsets": image.offsets,
        "color": image.color,
        "disparity": image.disparity,
        "place": image.place,
        "K": camera.K,
        "world_to_camera": camera.world_to_camera,
    }
    if image.normals is not None:
        members["normals"] = image.normals
    write_archive(path, FORMAT, header, members)


def _load_npz(path: str | os.PathLike[str]) -> LayeredDepthImage:
    from .ldi import LayeredDepthImage

    with read_archive(path, FORMAT, "layered image") as (header, file):
        camera = Camera(file["K"], file["world_to_camera"], *header["size"], near=header["near"])
        normals = file["normals"] if "normals" in file else None
        return LayeredDepthImage(camera, file["offsets"], file["color"], file["disparity"], file["place"], normals)


def _save_exr(image: LayeredDepthImage, path: str | os.PathLike[str]) -> None:
    OpenEXR = _openexr()

    camera = image.camera
    header = {
        "format": FORMAT,
        "K": camera.K.tolist(),
        "world_to_camera": camera.world_to_camera.tolist(),
        "size": (camera.width, camera.height),
        "near": camera.near,
    }
    with np.errstate(divide="ignore"):
        depth = (1.0 / image.disparity.astype(np.float64)).astype(np.float32)
    color = (image.color / 255.0).astype(np.float16)
    values: dict[str, npt.NDArray[Any]] = {
        "R": color[:, 0],
        "G": color[:, 1],
        "B": color[:, 2],
        "A": np.ones(image.samples, np.float16),
        "Z": depth,
        "disparity": image.disparity,
        "place.x": image.place[:, 0].astype(np.float16),
        "place.y": image.place[:, 1].astype(np.float16),
    }
    if image.normals is not None:
        values["normal"] = image.normals.astype(np.uint32)
    pixels = {name: _split(array, image.offsets, (camera.height, camera.width)) for name, array in values.items()}
    attributes = {
        "type": OpenEXR.deepscanline,
        "compression": OpenEXR.ZIPS_COMPRESSION,
        "cyclorama": json.dumps(header),
    }
    with whole_path(path) as beside, OpenEXR.File(attributes, pixels) as file:
        file.write(os.fspath(beside))


def _split(array: npt.NDArray[Any], offsets: npt.NDArray[np.uint32], shape: tuple[int, int]) -> npt.NDArray[Any]:
    """An array of samples as one array a pixel, None where there are none, but for the first: it tells their type."""
    pixels = np.empty(shape[0] * shape[1], object)
    array = np.ascontiguousarray(array)
    pixels[0] = array[:0]
    starts = offsets.tolist()
    for pixel in np.flatnonzero(offsets[1:] != offsets[:-1]).tolist():
        pixels[pixel] = array[starts[pixel] : starts[pixel + 1]]
    return pixels.reshape(shape)


def _load_exr(path: str | os.PathLike[str]) -> LayeredDepthImage:
    OpenEXR = _openexr()

    from .ldi import LayeredDepthImage

    if not os.path.exists(path):
        raise FileNotFoundError(f"there is no file {os.fspath(path)}")
    try:
        with OpenEXR.File(os.fspath(path), separate_channels=True) as file:
            attributes = file.header()
            if "cyclorama" not in attributes:
                raise ValueError("it has no attribute 'cyclorama'")
            header = json.loads(attributes["cyclorama"])
            check_format(header, FORMAT)
            camera = Camera(header["K"], header["world_to_camera"], *header["size"], near=header["near"])
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, OSError, *UNREADABLE) as error:
        raise ValueError(f"{os.fspath(path)} is not a whole layered image: {error}") from error
    try:
        disparity, offsets = _joined(channels["disparity"], np.float32)
        parts = {name: _joined(channels[name], np.float16)[0] for name in ("R", "G", "B", "place.x", "place.y")}
        color = np.stack([parts[name].astype(np.float64) * 255.0 for name in "RGB"], axis=1)
        place = np.stack([parts["place.x"], parts["place.y"]], axis=1)
        normals = _joined(channels["normal"], np.uint32)[0] if "normal" in channels else None
        colors = np.rint(color).astype(np.uint8)
        return LayeredDepthImage(camera, offsets, colors, disparity, place.astype(np.int8), normals)
    except UNREADABLE as error:
        raise ValueError(f"{os.fspath(path)} is not a whole layered image: {error}") from error


def _joined(pixels: npt.NDArray[Any], dtype: npt.DTypeLike) -> tuple[npt.NDArray[Any], npt.NDArray[np.int64]]:
    """One array of all pixels' samples, and where each pixel's begin."""
    arrays = pixels.reshape(-1).tolist()
    offsets = np.zeros(len(arrays) + 1, np.int64)
    np.cumsum([0 if array is None else len(array) for array in arrays], out=offsets[1:])
    there = [array for array in arrays if array is not None and len(array)]
    return np.concatenate([np.empty(0, dtype), *there]).astype(dtype), offsets
