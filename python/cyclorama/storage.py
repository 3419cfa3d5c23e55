"""The file of a bake: one ``.npz`` that plain NumPy opens without pickle.

Members: ``header`` (a JSON text: format, settings, figures), ``points`` (N, 3) and ``sphere_faces`` (M, 3) of the
sphere, ``order`` (the bit j of a stored row is bit ``order[j]`` of the row in memory: a space-filling order, in which
rows are long runs), ``labels`` (F,) the patch of each face if there are patches, ``probes`` and ``found``, and for
shell k the rows ``bitfields_k`` and ``cells_k`` as `cyclorama.bitfield.encode` writes them.

A file is written beside its final name and renamed when it is whole.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from . import bitfield
from .bitfield import Bitfields
from .viewsphere import ViewSphere
from .visibility import Settings, Shell, Visibility

__all__ = ["load", "save"]

FORMAT = "cyclorama visibility 1"


def save(vis: Visibility, path: str | os.PathLike[str]) -> None:
    """Writes a bake; see `Visibility.save`."""
    header = {
        "format": FORMAT,
        "settings": asdict(vis.settings),
        "distances": list(vis.distances),
        "center": vis.sphere.center.tolist(),
        "radius": vis.sphere.radius,
        "model_radius": vis.model_radius,
        "faces": vis.size,
        "bits": vis.bitfields.size,
        "mesh": vis.mesh,
        "statement": vis.statement,
    }
    members: dict[str, npt.NDArray[Any]] = {
        "header": np.array(json.dumps(header)),
        "points": vis.sphere.points,
        "sphere_faces": vis.sphere.faces,
        "order": vis.order,
        "probes": vis.probes,
        "found": vis.found,
    }
    if vis.labels is not None:
        members["labels"] = vis.labels
    for k, shell in enumerate(vis.shells):
        members[f"bitfields_{k}"] = _encode(shell.bitfields, vis.order)
        if shell.cells is not None:
            members[f"cells_{k}"] = _encode(shell.cells, vis.order)
    with _whole_or_nothing(path) as file:
        np.savez_compressed(file, **members)  # type: ignore[arg-type]


def load(path: str | os.PathLike[str]) -> Visibility:
    """Reads a bake; see `Visibility.load`."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return _read(file)
    except (ValueError, KeyError, TypeError, EOFError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{os.fspath(path)} is not a whole visibility file: {error}") from error


def _read(file: Any) -> Visibility:
    header = json.loads(str(file["header"][()]))
    if header["format"] != FORMAT:
        raise ValueError(f"its format is {header['format']!r}, not {FORMAT!r}")
    settings = dict(header["settings"])
    settings["resolution"] = tuple(settings["resolution"])
    labels = file["labels"] if "labels" in file else None
    order, bits = file["order"], int(header["bits"])
    shells = [
        Shell(
            float(distance),
            _decode(file[f"bitfields_{k}"], order, bits),
            _decode(file[f"cells_{k}"], order, bits) if f"cells_{k}" in file else None,
        )
        for k, distance in enumerate(header["distances"])
    ]
    view_sphere = ViewSphere(
        file["points"], file["sphere_faces"], np.asarray(header["center"], dtype=np.float64), float(header["radius"])
    )
    return Visibility(
        view_sphere,
        shells,
        model_radius=header["model_radius"],
        size=header["faces"],
        labels=labels,
        settings=Settings(**settings),
        mesh=header["mesh"],
        order=order,
        probes=file["probes"],
        found=file["found"],
        statement=header["statement"],
    )


@contextmanager
def _whole_or_nothing(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A file that takes its name only when the block ends well."""
    final = Path(path)
    try:
        handle, name = tempfile.mkstemp(dir=final.parent, prefix=final.name, suffix=".part")
    except OSError as error:
        raise type(error)(error.errno, f"cannot write there: {error.strerror}", str(final)) from None
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, final)
    except BaseException:
        os.unlink(name)
        raise


def _encode(rows: Bitfields, order: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint64]:
    return _permuted(rows.words, rows.size, order)


def _decode(stored: npt.NDArray[np.uint64], order: npt.NDArray[np.uint32], size: int) -> Bitfields:
    back = np.empty_like(order)
    back[order] = np.arange(size, dtype=order.dtype)
    return Bitfields(_permuted(stored, size, back), size)


def _permuted(words: npt.NDArray[np.uint64], size: int, order: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint64]:
    """Rows whose bit j is bit ``order[j]`` of the given ones."""
    step = max(1, (1 << 26) // size)
    parts = [bitfield.pack(bitfield.unpack(words[k : k + step], size)[:, order]) for k in range(0, len(words), step)]
    return np.concatenate(parts) if parts else words
