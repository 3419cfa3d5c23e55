"""The folder of a walkthrough: what is in it, and reading it.

``manifest.json``
    ``format``: "cyclorama walk 3". ``complete``: whether the bake came to its end. ``projection``, ``size``, ``axes``:
    of the panoramas; rows of `axes` are right, up and back (see `Projection`). ``track``: ``points``, ``spline``,
    ``closed`` (see `Track`); ``track_length``. ``tile``: pixels a side. ``codec``: "png", "webp" or "smallest" (of
    both). ``sector``: columns of tiles in a sector. ``slabs``: [nearest, farthest] range of each, nearest slab first;
    the last one's farthest is null: no end. Renders reach over both ends by a share of ``overlap``, so that a surface
    which two slabs cut leaves no gap. ``culling``: ``method`` ("exact", "paper" or null) and ``alpha``. ``mesh``: quads
    of more than a pixel are drawn half a pixel larger on all sides; ``pixels``, how far in pixels of the panorama a
    quad may move a pixel, for an eye at the next reference. ``background``: red, green, blue where nothing is.
    ``made_by``: what drew it. ``references``: one entry a reference viewpoint, in the order of the track: ``t`` (0 to
    1), ``eye``; and once it is drawn ``folder``, ``bytes``, ``sha256`` (of ``view.json`` in it).

``0000/view.json`` (a folder a reference)
    ``slabs``: one entry each: ``disparity``, [low, high] that the steps 0 and 65535 of quads stand for; ``error``, the
    greatest distance of a quad from what was rendered, in disparity; ``empty``, ``culled``: how many tiles were left
    out because nothing is in them, and because the track never sees it; ``sectors``: one entry for each that has
    tiles: ``sector``, ``tiles`` (their numbers, by rows of the panorama), ``image`` and ``quads`` (names of files, see
    `cyclorama.panorama.tiles`), with ``image_bytes``, ``quads_bytes``, ``image_sha256``, ``quads_sha256``.

A reference's folder is written beside and renamed, so it is whole or not there.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from ..archives import UNREADABLE, check_format
from ..arguments import checked_number
from .projection import Projection
from .sources import Folder, Source, source_of
from .tiles import decode
from .track import Track

__all__ = ["FORMAT", "MANIFEST", "VIEW", "Entry", "Reference", "Slab", "Store", "read_manifest"]

FORMAT = "cyclorama walk 3"
MANIFEST = "manifest.json"
VIEW = "view.json"

Pixels = npt.NDArray[np.uint8]
Quads = npt.NDArray[np.uint16]
Mask = npt.NDArray[np.bool_]
Content = bytes


@dataclass(frozen=True)
class Slab:
    """A slab of a reference viewpoint, in memory.

    Attributes
    ----------
    pixels : (H, W, 4) ndarray of uint8
        Red, green, blue, and opacity: 0 or 255. Of dropped tiles what borders on kept ones may be there.
    quads : (N, 7) ndarray of uint16
        See `cyclorama.panorama.tiles`.
    disparity : (float, float)
        What the first and the last step of the quads' corners stand for.
    error : float
        How far, in disparity, a quad may be from what was rendered.
    tiles : (H / tile, W / tile) ndarray of bool
        Those that are kept.
    """

    pixels: Pixels
    quads: Quads
    disparity: tuple[float, float]
    error: float
    tiles: Mask

    def without(self, kept: Mask) -> Slab:
        """The same slab with only the tiles that are set in (H / tile, W / tile) `kept`."""
        tile = self.pixels.shape[0] // kept.shape[0]
        stays = kept[self.quads[:, 1] // tile, self.quads[:, 0] // tile]
        return replace(self, quads=np.ascontiguousarray(self.quads[stays]), tiles=self.tiles & kept)


@dataclass(frozen=True)
class Reference:
    """A reference viewpoint: its position, and its slabs, nearest first."""

    eye: npt.NDArray[np.float64]
    slabs: tuple[Slab, ...]

    def panorama(self) -> Pixels:
        """(H, W, 4) the slabs composed front to back: what the viewpoint itself sees."""
        composed = np.zeros_like(self.slabs[0].pixels)
        for slab in self.slabs:
            free = (composed[..., 3] == 0) & (slab.pixels[..., 3] > 0)
            composed[free] = slab.pixels[free]
        return composed

    @property
    def memory(self) -> int:
        """Bytes that it takes."""
        return sum(slab.pixels.nbytes + slab.quads.nbytes for slab in self.slabs)


@dataclass(frozen=True)
class Entry:
    """A reference viewpoint of a manifest.

    Attributes
    ----------
    t : float
        Where on the track, 0 to 1.
    eye : (3,) ndarray
    folder : str or None
        None until it is drawn.
    bytes : int
        Of all its files.
    """

    t: float
    eye: npt.NDArray[np.float64]
    folder: str | None
    bytes: int


def read_manifest(place: str | os.PathLike[str] | Source) -> dict[str, Any]:
    """The manifest of a walkthrough.

    Parameters
    ----------
    place : path, address or Source
        A folder, or what `source_of` takes.

    Raises
    ------
    FileNotFoundError
        If there is none.
    ValueError
        If it is cut off, damaged, or of another version.
    OSError
        If a server can't be reached.
    """
    source = source_of(place)
    path = source.where(MANIFEST)
    try:
        found = json.loads(source.read(MANIFEST))
        check_format(found, FORMAT)
        for key in ("projection", "size", "axes", "track", "tile", "slabs", "references", "complete"):
            found[key]
    except FileNotFoundError:
        raise FileNotFoundError(f"{path} is not there: bake(..., out={str(source)!r}) makes it") from None
    except UNREADABLE as error:
        raise ValueError(f"{path} is not a whole manifest of a walkthrough: {error}") from error
    return dict(found)


class Store:
    """A walkthrough that `bake` wrote.

    Parameters
    ----------
    place : path, str or Source
        Its folder, or the address of a server (``http://``): what lies ahead on the way is fetched from it in advance.
    memory : int
        Bytes of decoded references to keep; at least two are kept whatever they take.

    Attributes
    ----------
    manifest : dict
        See the module.
    track : Track
    projection : Projection
    tile : int
    slabs : list of (float, float)
        Nearest and farthest range of each.
    references : list of Entry

    Raises
    ------
    FileNotFoundError
        If there is no manifest.
    ValueError
        If the manifest is cut off, damaged or of another version, or the bake didn't come to its end.
    OSError
        If a server can't be reached.
    """

    def __init__(self, place: str | os.PathLike[str] | Source, *, memory: int = 1 << 30) -> None:
        self.source = source_of(place)
        self.manifest = read_manifest(self.source)
        if not self.manifest["complete"]:
            drawn = sum("folder" in entry for entry in self.manifest["references"])
            raise ValueError(
                f"{self.source} is not finished: {drawn} of {len(self.manifest['references'])} references are drawn; "
                "the same bake goes on where it ended"
            )
        try:
            track = self.manifest["track"]
            self.track = Track(track["points"], spline=track["spline"], closed=track["closed"])
            self.projection = Projection(
                self.manifest["projection"], self.manifest["size"], up=self.manifest["axes"][1]
            )
            self.tile = int(self.manifest["tile"])
            self.background = tuple(int(channel) for channel in self.manifest["background"])
            self.slabs = [(float(a), math.inf if b is None else float(b)) for a, b in self.manifest["slabs"]]
            self.references = [
                Entry(float(e["t"]), np.array(e["eye"], np.float64), e.get("folder"), int(e.get("bytes", 0)))
                for e in self.manifest["references"]
            ]
            if self.tile < 1 or self.projection.width % self.tile or self.projection.height % self.tile:
                raise ValueError(f"tiles of {self.tile} don't divide {self.projection!r}")
            for index, entry in enumerate(self.references):
                if entry.eye.shape != (3,) or not np.isfinite(entry.eye).all():
                    raise ValueError(f"reference {index} has its eye at {entry.eye.tolist()}")
            if not np.allclose(self.projection.axes, self.manifest["axes"], atol=1e-9):
                raise ValueError("its axes are not those of its up direction")
        except UNREADABLE as error:
            path = self.source.where(MANIFEST)
            raise ValueError(f"{path} is not a whole manifest of a walkthrough: {error}") from error
        _check_order(self.slabs, self.references, self.source.where(MANIFEST))
        self._memory = memory
        self._kept: OrderedDict[int, Reference] = OrderedDict()
        self._lock = threading.Lock()
        self._place: float | None = None
        self._fetching: threading.Thread | None = None

    def __repr__(self) -> str:
        return (
            f"<Store: {len(self.references)} references, {len(self.slabs)} slabs, "
            f"{self.projection.width} x {self.projection.height}, {self.bytes:,} bytes>"
        )

    def __len__(self) -> int:
        """Number of references."""
        return len(self.references)

    @property
    def bytes(self) -> int:
        """Bytes of all files but the manifest."""
        return sum(entry.bytes for entry in self.references)

    def describe(self, index: int) -> dict[str, Any]:
        """The `view.json` of a reference: see the module.

        Raises
        ------
        ValueError
            If it is missing, cut off or not the one that the manifest names.
        """
        entry = self.manifest["references"][index]
        name = f"{entry['folder']}/{VIEW}"
        content = self.read(name, entry["sha256"])
        try:
            return dict(json.loads(content))
        except UNREADABLE as error:
            raise ValueError(f"{self.source.where(name)} is not whole: {error}") from error

    def read(self, name: str, digest: str) -> Content:
        """A file whose checksum (SHA-256, hexadecimal) is known.

        Raises
        ------
        ValueError
            If it is missing, can't be read, or is not the one that was written.
        """
        path = self.source.where(name)
        if ".." in name.split("/") or name.startswith("/"):
            raise ValueError(f"{path} is outside the walkthrough: only files in its folder are read")
        try:
            content = self.source.read(name)
        except OSError as error:
            raise ValueError(f"{path} can't be read: {error.strerror or error}; bake again to make it anew") from error
        if hashlib.sha256(content).hexdigest() != digest:
            raise ValueError(f"{path} is not the file that was written ({len(content)} bytes): its checksum differs")
        return content

    def expect(self, t: float) -> None:
        """Says where on the track an eye is: what lies ahead of it is fetched meanwhile, where that takes long.

        Errors are kept to themselves: who asks for a file that can't be read will be told.
        """
        before, self._place = self._place, t
        if isinstance(self.source, Folder) or before is None or t == before:
            return
        first, second, _ = self.beside(t)
        ahead = second + 1 if t > before else first - 1
        if 0 <= ahead < len(self) and ahead not in self._kept and not (self._fetching and self._fetching.is_alive()):
            self._fetching = threading.Thread(target=self._fetch, args=(ahead,), daemon=True)
            self._fetching.start()

    def wait(self) -> None:
        """Until what was expected is here."""
        if self._fetching is not None:
            self._fetching.join()

    def _fetch(self, index: int) -> None:
        with contextlib.suppress(ValueError, OSError):
            self.reference(index)

    def reference(self, index: int) -> Reference:
        """A reference viewpoint with its slabs, from memory or from its files.

        Raises
        ------
        ValueError
            If a file is missing, cut off, damaged, or not the one that was written.
        """
        with self._lock:
            if index in self._kept:
                self._kept.move_to_end(index)
                return self._kept[index]
        found = self._load(index)
        with self._lock:
            self._kept[index] = found
            while len(self._kept) > 2 and sum(kept.memory for kept in self._kept.values()) > self._memory:
                self._kept.popitem(last=False)
        return found

    def _load(self, index: int) -> Reference:
        entry, said = self.references[index], self.describe(index)
        try:
            return self._decoded(entry, said)
        except ValueError:
            raise
        except (*UNREADABLE, OverflowError) as error:
            path = self.source.where(f"{entry.folder}/{VIEW}")
            raise ValueError(f"{path} is not whole: {error!r}") from error

    def _decoded(self, entry: Entry, said: dict[str, Any]) -> Reference:
        names = [
            f"{entry.folder}/{sector[kind]}"
            for slab in said["slabs"]
            for sector in slab["sectors"]
            for kind in ("image", "quads")
        ]
        try:
            self.source.coming(names)
        except OSError as error:
            raise ValueError(f"{self.source.where(str(entry.folder))} can't be read: {error}") from error
        height, width = self.projection.shape
        slabs = []
        for slab in said["slabs"]:
            pixels = np.zeros((height, width, 4), np.uint8)
            kept = np.zeros((height // self.tile) * (width // self.tile), np.bool_)
            quads = [np.zeros((0, 7), np.uint16)]
            for sector in slab["sectors"]:
                numbers = np.array(sector["tiles"], np.int64)
                picture = self.read(f"{entry.folder}/{sector['image']}", sector["image_sha256"])
                packed = self.read(f"{entry.folder}/{sector['quads']}", sector["quads_sha256"])
                what = f"{entry.folder}/{sector['image']}"
                quads.append(decode(self.projection, picture, packed, numbers, self.tile, pixels, what))
                kept[numbers] = True
            low, high = slab["disparity"]
            slabs.append(
                Slab(
                    pixels,
                    np.concatenate(quads),
                    (float(low), float(high)),
                    float(slab["error"]),
                    kept.reshape(height // self.tile, width // self.tile),
                )
            )
        return Reference(entry.eye, tuple(slabs))

    def panorama(self, index: int) -> Pixels:
        """(H, W, 4) uint8: what a reference sees, its slabs composed front to back; opacity 0 where nothing is."""
        return self.reference(index).panorama()

    def beside(self, t: float) -> tuple[int, int, float]:
        """The references before and after a place of the track, and how far between them it is.

        Returns
        -------
        (int, int, float)
            The share is 0 at the first and below 1; from the last reference on, and before the first, both are the
            same one.

        Raises
        ------
        ValueError
            If `t` isn't from 0 to 1.
        """
        t = checked_number("t", t, 1)
        places = np.array([entry.t for entry in self.references])
        first = int(np.searchsorted(places, t, side="right")) - 1
        if first in (-1, len(places) - 1):
            first = max(first, 0)
            return first, first, 0.0
        return first, first + 1, float((t - places[first]) / (places[first + 1] - places[first]))


def _check_order(slabs: list[tuple[float, float]], references: list[Entry], path: str) -> None:
    for index, ((_, end), (start, _)) in enumerate(pairwise(slabs)):
        if end != start:
            raise ValueError(f"{path}: slab {index} ends at {end}, slab {index + 1} begins at {start}: out of order")
    if any(not near < far for near, far in slabs) or not slabs:
        raise ValueError(f"{path}: slabs are out of order: {slabs}")
    places = [entry.t for entry in references]
    if not places or sorted(set(places)) != places:
        raise ValueError(f"{path}: references are out of order: {places}")
