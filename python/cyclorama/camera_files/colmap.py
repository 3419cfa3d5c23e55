"""COLMAP's models, text and binary."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..camera import Camera
from ..files import whole_file
from .pose import Floats, add, intrinsics, named, pinhole, quaternion, rotation

__all__ = ["read_colmap", "write_colmap"]

PathLike = str | os.PathLike[str]

#: Camera models, by their number in binary files, and how many parameters each has: one focal length or two, the
#: principal point, and then distortion, which has to be zero.
_COLMAP_MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
}
_TWO_FOCAL_LENGTHS = ("PINHOLE", "OPENCV")


class _Distorted(ValueError):
    """A camera that is read well, and bends lines."""


def read_colmap(folder: PathLike) -> dict[str, Camera]:
    """The cameras of a COLMAP model, text or binary.

    Parameters
    ----------
    folder : path
        Holds ``cameras.txt`` and ``images.txt``, or both with ``.bin``.

    Returns
    -------
    dict of str to Camera
        By the name of the image, in the order of the file.

    Raises
    ------
    FileNotFoundError
        If the folder holds neither pair.
    ValueError
        If a file is cut off or wrong, two images have one name, or a camera has distortion.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_colmap(folder, {"a.png": Camera.look_at([0, 0, 5], [0, 0, 0])})
    ...     read_colmap(folder)["a.png"].eye.round(12)
    array([0., 0., 5.])
    """
    folder = Path(folder)
    for ending, cameras_of, images_of in ((".bin", _binary_cameras, _binary_images), (".txt", _cameras, _images)):
        lenses_path, images_path = folder / f"cameras{ending}", folder / f"images{ending}"
        if lenses_path.exists() and images_path.exists():
            lenses = _read(lenses_path, lambda file, of=cameras_of: dict(of(file)))  # type: ignore[misc]
            images = _read(images_path, lambda file, of=images_of: list(of(file)))  # type: ignore[misc]
            return _posed(images_path, lenses, images)
    raise FileNotFoundError(f"{folder}: holds neither cameras.bin and images.bin nor cameras.txt and images.txt")


def write_colmap(folder: PathLike, cameras: Mapping[str, Camera]) -> None:
    """Writes cameras as a COLMAP model in text, without points.

    Parameters
    ----------
    folder : path
        Made if it is not there; gets ``cameras.txt``, ``images.txt`` and an empty ``points3D.txt``.
    cameras : mapping of str to Camera
        Pinhole cameras without skew, by the name of the image.

    Raises
    ------
    ValueError
        If they have no names, a camera is orthographic or skewed, or a name has a space or is empty.
    OSError
        If the folder can't be written to.
    """
    folder = Path(folder)
    lenses: dict[str, int] = {}
    images = []
    for index, (name, camera) in enumerate(named(cameras).items(), 1):
        if not name or any(c.isspace() for c in name):
            raise ValueError(f"{name!r} is no name for an image: COLMAP's text files end names at spaces")
        fx, fy, cx, cy = pinhole(name, camera)
        lens = f"PINHOLE {camera.width} {camera.height} {fx!r} {fy!r} {cx!r} {cy!r}"
        number = lenses.setdefault(lens, len(lenses) + 1)
        turn, move = quaternion(camera.world_to_camera[:3, :3]), camera.world_to_camera[:3, 3]
        pose = " ".join(repr(float(x)) for x in [*turn, *move])
        images.append(f"{index} {pose} {number} {name}\n\n")
    folder.mkdir(parents=True, exist_ok=True)
    texts = {
        "cameras.txt": "".join(f"{number} {lens}\n" for lens, number in lenses.items()),
        "images.txt": "".join(images),
        "points3D.txt": "",
    }
    for name, text in texts.items():
        with whole_file(folder / name) as file:
            file.write(text.encode())


def _posed(
    path: Path, lenses: dict[int, tuple[int, int, Floats]], images: list[tuple[str, int, Floats]]
) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    for name, lens, pose in images:
        if lens not in lenses:
            raise ValueError(f"{path}: image {name} has camera {lens}, which cameras do not name")
        width, height, (fx, fy, cx, cy) = lenses[lens]
        world_to_camera = np.eye(4)
        try:
            world_to_camera[:3, :3], world_to_camera[:3, 3] = rotation(pose[:4]), pose[4:]
            add(cameras, name, Camera(intrinsics(fx, fy, cx, cy), world_to_camera, width, height))
        except ValueError as error:
            raise ValueError(f"{path}: image {name}: {error}") from error
    return cameras


def _read(path: Path, read: Callable[[IO[bytes]], Any]) -> Any:
    try:
        with path.open("rb") as file:
            return read(file)
    except _Distorted as error:
        raise ValueError(f"{path}: {error}") from error
    except (ValueError, IndexError, struct.error) as error:
        raise ValueError(f"{path}: not a readable COLMAP file, or cut off: {error}") from error


def _cameras(file: IO[bytes]) -> Iterator[tuple[int, tuple[int, int, Floats]]]:
    for line in _lines(file):
        number, model, width, height, *parameters = line.split()
        yield int(number), _lens(int(number), model, int(width), int(height), np.array(parameters, dtype=np.float64))


def _images(file: IO[bytes]) -> Iterator[tuple[str, int, Floats]]:
    lines = [line for line in (raw.decode().strip() for raw in file) if not line.startswith("#")]
    while lines and not lines[-1]:
        lines.pop()
    for line in lines[::2]:  # every second line is of the image's points
        words = line.split()
        if len(words) != 10:
            raise ValueError(f"an image has 10 words, got {line!r}")
        yield words[9], int(words[8]), np.array(words[1:8], dtype=np.float64)


def _lines(file: IO[bytes]) -> Iterator[str]:
    for raw in file:
        line = raw.decode().strip()
        if line and not line.startswith("#"):
            yield line


def _binary_cameras(file: IO[bytes]) -> Iterator[tuple[int, tuple[int, int, Floats]]]:
    for _ in range(_unpack(file, "<Q")[0]):
        number, model, width, height = _unpack(file, "<iiQQ")
        if model not in _COLMAP_MODELS:
            raise _Distorted(f"camera {number} has model {model}, which has distortion: undistort the images first")
        name, count = _COLMAP_MODELS[model]
        yield number, _lens(number, name, width, height, np.array(_unpack(file, f"<{count}d")))


def _binary_images(file: IO[bytes]) -> Iterator[tuple[str, int, Floats]]:
    for _ in range(_unpack(file, "<Q")[0]):
        _, *pose, camera = _unpack(file, "<i7di")
        name = bytearray()
        while (byte := _unpack(file, "<c")[0]) != b"\0":
            name += byte
        (points,) = _unpack(file, "<Q")
        if len(file.read(24 * points)) < 24 * points:
            raise ValueError(f"image {name.decode()} ends among its points")
        yield name.decode(), camera, np.array(pose)


def _unpack(file: IO[bytes], shape: str) -> tuple[Any, ...]:
    return struct.unpack(shape, file.read(struct.calcsize(shape)))


def _lens(number: int, model: str, width: int, height: int, parameters: Floats) -> tuple[int, int, Floats]:
    counts = dict(_COLMAP_MODELS.values())
    if model not in counts:
        raise _Distorted(f"camera {number} is {model}, which has distortion: undistort the images first")
    if len(parameters) != counts[model]:
        raise ValueError(f"camera {number} is {model} with {counts[model]} parameters, got {len(parameters)}")
    own, bent = (
        (parameters[:4], parameters[4:]) if model in _TWO_FOCAL_LENGTHS else (parameters[[0, 0, 1, 2]], parameters[3:])
    )
    if bent.any():
        raise _Distorted(
            f"camera {number} is {model}, which has distortion {bent.tolist()}: undistort the images first"
        )
    return width, height, own
