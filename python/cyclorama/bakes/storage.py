"""The file of a bake: one ``.npz`` that plain NumPy opens without pickle.

Members: ``header`` (a JSON text: format, settings, figures), ``points`` (N, 3) and ``sphere_faces`` (M, 3) of the
sphere, ``labels`` (F,) the patch of each face if there are patches, ``probes`` and ``found``, and ``rows_...``: the
rows of all viewpoints, then of all sphere faces, shell by shell, as `cyclorama.bitfield.encode` writes them.

A file is written beside its final name and renamed when it is whole.
"""

from __future__ import annotations

import os
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import bitfield
from ..archives import read_archive, write_archive
from .viewsphere import ViewSphere
from .visibility import Settings, Shell, Visibility

__all__ = ["load", "save"]

FORMAT = "cyclorama visibility 1"


def save(vis: Visibility, path: str | os.PathLike[str]) -> None:
    """Writes a bake; see `Visibility.save`."""
    header = {
        "settings": asdict(vis.settings),
        "distances": list(vis.distances),
        "center": vis.sphere.center.tolist(),
        "radius": vis.sphere.radius,
        "model_radius": vis.model_radius,
        "faces": vis.size,
        "cells": vis.cells is not None,
        "mesh": vis.mesh,
        "statement": vis.statement,
    }
    members: dict[str, npt.NDArray[Any]] = {
        "points": vis.sphere.points,
        "sphere_faces": vis.sphere.faces,
        "probes": vis.probes,
        "found": vis.found,
    }
    if vis.labels is not None:
        members["labels"] = vis.labels
    members |= {f"rows_{name}": array for name, array in _coded(vis).items()}
    write_archive(path, FORMAT, header, members)


def load(path: str | os.PathLike[str]) -> Visibility:
    """Reads a bake; see `Visibility.load`."""
    with read_archive(path, FORMAT, "visibility file") as (header, file):
        return _read(header, file)


def _read(header: dict[str, Any], file: Any) -> Visibility:
    settings = dict(header["settings"])
    settings["resolution"] = tuple(settings["resolution"])
    size, labels = int(header["faces"]), file["labels"] if "labels" in file else None
    points, faces, probes = file["points"], file["sphere_faces"], file["probes"]
    rows = bitfield.decode({name.removeprefix("rows_"): file[name] for name in file if name.startswith("rows_")})
    each = len(points) + (len(faces) if header["cells"] else 0)
    if len(rows) != each * len(header["distances"]):
        raise ValueError(f"it has {len(rows)} rows for {len(header['distances'])} distances of {each}")
    if rows.size != (size if labels is None else int(labels.max()) + 1):
        raise ValueError(f"its rows have {rows.size} bits, for {size} faces or their patches")
    for name, array, count in (("labels", labels, size), ("probes", probes, len(faces))):
        if array is not None and (array.shape != (count,) or array.dtype.kind not in "iu"):
            raise ValueError(f"its {name} are {array.shape} {array.dtype}, not {count} integers")
    shells = []
    for k, distance in enumerate(header["distances"]):
        own = rows[k * each : (k + 1) * each]
        shells.append(Shell(float(distance), own[: len(points)], own[len(points) :] if header["cells"] else None))
    view_sphere = ViewSphere(points, faces, np.asarray(header["center"], dtype=np.float64), float(header["radius"]))
    return Visibility(
        view_sphere,
        shells,
        model_radius=header["model_radius"],
        size=size,
        labels=labels,
        settings=Settings(**settings),
        mesh=header["mesh"],
        probes=probes,
        found=file["found"],
        statement=header["statement"],
    )


def _coded(vis: Visibility) -> dict[str, npt.NDArray[Any]]:
    """All rows in one stream: a cell's row is best told from those of its corners."""
    rows = [part.words for shell in vis.shells for part in (shell.bitfields, shell.cells) if part is not None]
    return bitfield.encode(np.concatenate(rows), vis.bitfields.size)
