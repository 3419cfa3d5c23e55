"""Making the folder of a walkthrough."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arguments import checked_number, checked_whole
from ..files import whole_file
from ..fingerprint import fingerprint
from ..progress import Progress, reporter
from ..scene import Scene
from .culling import Method, check_culling, eyes_around, kept_tiles
from .projection import Kind, Projection
from .renderers import BuiltIn, Renderer
from .slicing import OVERLAP, closed_step, filled, mesh_error, places_of, ranges_between, reach_of, slabs_of
from .spacing import fewer, places_by_error
from .store import FORMAT, MANIFEST, VIEW, Slab, Store, read_manifest
from .tiles import ACROSS, Codec, check_codec, encode, tile_numbers
from .track import Track

__all__ = ["bake"]


def bake(
    scene: Scene | Renderer,
    track: Track | npt.ArrayLike,
    slabs: int | Sequence[float] = 3,
    size: tuple[int, int] = (4096, 1024),
    projection: Kind = "cylinder",
    tile: int = 32,
    alpha: float = 1.0,
    out: str | os.PathLike[str] = "walk",
    *,
    method: Method | None = "exact",
    spacing: float | None = None,
    places: npt.ArrayLike | None = None,
    max_error: float | None = None,
    mesh_pixels: float = 0.25,
    codec: Codec = "smallest",
    background: tuple[int, int, int] = (255, 255, 255),
    up: npt.ArrayLike = (0.0, 1.0, 0.0),
    allow_outside: bool = False,
    progress: Progress = None,
) -> Store:
    """Renders panoramas along a track and writes the folder of a walkthrough.

    A bake that was stopped goes on where it ended when it is called again in the same way.

    Parameters
    ----------
    scene : Scene or Renderer
        What is looked at; a scene is drawn by `BuiltIn`.
    track : Track or (N, 3) array_like of float
    slabs : int or sequence of float
        How many slabs (`find_slabs` says where they are cut), or the ranges between them, ascending.
    size : (int, int)
        Columns and rows of the panoramas, multiples of `tile`.
    projection : {"cylinder", "equirect"}
    tile : int
        Pixels a side of a tile: a power of two.
    alpha : float
        A tile is dropped if so large a share of it is hidden: 1 drops what is never seen.
    out : path
        A folder; made if it isn't there.
    method : {"exact", "paper", None}
        How tiles are found to be hidden: see `kept_tiles`. None keeps all that aren't empty.
    spacing : float, optional
        The largest distance between references, in the scene's units: a twentieth of the median range seen from the
        track's ends and middle by default.
    places : (R,) array_like of float, optional
        Where references are, by shares of the track's length, instead: ascending, within 0 to 1. Before the first and
        after the last that one alone is used.
    max_error : float, optional
        Or: references only where the view half-way between two would be wrong by more than so many grey levels, root
        mean square. See `places_by_error`.
    mesh_pixels : float
        How far, in pixels, quads may move a pixel, for an eye at the next reference.
    codec : {"smallest", "png", "webp"}
        All are lossless. Of PNG (with a palette where that will do) and WebP, by default, whichever is smaller, file by
        file; of PNG alone where Pillow has no WebP.
    background : (int, int, int)
        Red, green, blue where nothing is.
    up : (3,) array_like of float
    allow_outside : bool
        Whether the track may leave the scene's bounds.
    progress : bool or callable, optional
        A bar by default, where somebody watches; it counts references.

    Returns
    -------
    Store

    Raises
    ------
    ValueError
        If an argument is bad, the track passes through a wall or leaves the scene, or the folder holds another
        walkthrough, which stays as it is.
    OSError
        If a file can't be written (a disk that is full, say): what was whole stays whole.

    Examples
    --------
    >>> import tempfile, cyclorama as cyc
    >>> house = cyc.scenes.house(rooms=2)
    >>> eye = (house.cells[0]["min"] + house.cells[0]["max"]) / 2
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store = bake(house, [eye, eye + [0.2, 0, 0]], 2, (256, 64), spacing=0.2, out=folder, progress=False)
    ...     len(store), len(store.slabs), store.panorama(0).shape
    (2, 2, (64, 256, 4))
    """
    renderer = BuiltIn(scene) if isinstance(scene, Scene) else scene
    if not isinstance(renderer, Renderer):
        raise ValueError(f"scene must be a Scene or a Renderer, got {type(scene).__name__}")
    rail = track if isinstance(track, Track) else Track(track)
    panorama = Projection(projection, size, up=up)
    _check_tile(tile, panorama)
    check_codec(codec)
    channels = background if isinstance(background, (tuple, list, np.ndarray)) else ()
    if len(channels) != 3:
        raise ValueError(f"background must be red, green, blue from 0 to 255, got {background!r}")
    shade = [checked_whole("each channel of background", channel, 0, 255) for channel in channels]
    if not checked_number("mesh_pixels", mesh_pixels):
        raise ValueError(f"mesh_pixels must be above 0, got {mesh_pixels!r}")
    check_culling(method, alpha)
    if isinstance(renderer, BuiltIn):
        rail.check(renderer.scene, allow_outside=allow_outside)
    if max_error is not None:
        if spacing is not None or places is not None:
            raise ValueError("give spacing, places or max_error, only one of them")
        places = places_by_error(
            renderer, rail, max_error, slabs=slabs, panorama=fewer(panorama), mesh_pixels=mesh_pixels
        )
    where = places_of(rail, renderer, panorama, spacing, places)
    cuts = ranges_between(slabs, renderer, panorama, rail.at(where))
    identity = {
        "format": FORMAT,
        **panorama.to_json(),
        "track": rail.to_json(),
        "track_length": rail.length,
        "tile": tile,
        "sector": ACROSS,
        "codec": codec,
        "slabs": [[near, None if math.isinf(far) else far] for near, far in cuts],
        "overlap": OVERLAP,
        "culling": {"method": method, "alpha": alpha},
        "mesh": {"pixels": mesh_pixels},
        "background": shade,
        "made_by": _made_by(renderer),
        "references": [{"t": float(t), "eye": eye.tolist()} for t, eye in zip(where, rail.at(where), strict=True)],
    }
    folder = Path(out)
    manifest = _claim(folder, json.loads(json.dumps(identity)))
    reach = reach_of(rail, where)
    missing = [index for index, entry in enumerate(manifest["references"]) if "folder" not in entry]
    with reporter(progress, len(manifest["references"]), "references") as report:
        for done, index in enumerate(missing, len(manifest["references"]) - len(missing)):
            report(done)
            entry = manifest["references"][index]
            made, disparities = slabs_of(
                renderer, panorama, np.array(entry["eye"]), cuts, tile, mesh_pixels, float(reach[index])
            )
            kept = kept_tiles(
                panorama,
                disparities,
                cuts,
                eyes_around(rail, where, index),
                tile=tile,
                method=method,
                alpha=alpha,
                closed=closed_step(panorama, float(reach[index])),
                error=mesh_error(panorama, float(reach[index]), mesh_pixels),
            )
            made = [slab.without(keep) for slab, keep in zip(made, kept, strict=True)]
            entry.update(_write(folder, f"{index:04d}", panorama, made, tile, codec))
            manifest["complete"] = all("folder" in other for other in manifest["references"])
            _put(folder / MANIFEST, manifest)
        report(len(manifest["references"]))
    return Store(folder)


def _check_tile(tile: int, panorama: Projection) -> None:
    if checked_whole("tile", tile, 4) & (tile - 1):
        raise ValueError(f"tile must be a power of two of at least 4, got {tile!r}")
    if panorama.width % tile or panorama.height % tile:
        raise ValueError(f"size must be multiples of tile={tile}, got {panorama.width} x {panorama.height}")


def _made_by(renderer: Renderer) -> dict[str, Any]:
    said: dict[str, Any] = {"renderer": type(renderer).__name__}
    if isinstance(renderer, BuiltIn):
        said["scene"] = fingerprint(renderer.scene)
        said["textured"] = renderer.texture is not None
    return said


def _claim(folder: Path, identity: dict[str, Any]) -> dict[str, Any]:
    """The manifest of a folder: a new one, or the one of the same bake that is there."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / MANIFEST).exists():
        if any(not path.name.endswith(".part") for path in folder.iterdir()):
            raise ValueError(f"{folder} has other files in it: bake into a folder of its own")
        manifest = {**identity, "complete": False}
        _put(folder / MANIFEST, manifest)
        return manifest
    found = read_manifest(folder)
    for key, wanted in identity.items():
        there = found.get(key)
        if key == "references":
            there = [{"t": entry["t"], "eye": entry["eye"]} for entry in found[key]]
        if there != wanted:
            raise ValueError(
                f"{folder} has a walkthrough of another {key}: {there!r}, not {wanted!r}; bake into another folder, "
                "or delete this one"
            )
    return found


def _put(path: Path, content: dict[str, Any]) -> None:
    with whole_file(path) as file:
        file.write(json.dumps(content, indent=1).encode())


def _write(folder: Path, name: str, panorama: Projection, slabs: list[Slab], tile: int, codec: Codec) -> dict[str, Any]:
    """Writes the folder of a reference beside and renames it; what the manifest says of it."""
    beside = Path(tempfile.mkdtemp(dir=folder, prefix=name, suffix=".part"))
    try:
        said = {"slabs": [_write_slab(beside, index, panorama, slab, tile, codec) for index, slab in enumerate(slabs)]}
        content = json.dumps(said).encode()
        (beside / VIEW).write_bytes(content)
        total = sum(path.stat().st_size for path in beside.iterdir())
        os.chmod(beside, 0o755)
        if (folder / name).exists():
            # Drawn by a bake that was stopped before it could say so.
            shutil.rmtree(folder / name)
        os.replace(beside, folder / name)
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        raise
    return {"folder": name, "bytes": total, "sha256": hashlib.sha256(content).hexdigest()}


def _write_slab(folder: Path, index: int, panorama: Projection, slab: Slab, tile: int, codec: Codec) -> dict[str, Any]:
    shape = slab.pixels.shape[:2]
    across = shape[1] // tile
    owners = slab.quads[:, 1].astype(np.int64) // tile * across + slab.quads[:, 0] // tile
    kept = slab.tiles.ravel()
    sectors = []
    for sector in range(-(-across // ACROSS)):
        numbers = tile_numbers(shape, tile, sector)
        numbers = numbers[kept[numbers]]
        if not len(numbers):
            continue
        own = slab.quads[np.isin(owners, numbers)]
        picture, kind, packed = encode(panorama, slab.pixels, own, numbers, tile, codec)
        entry: dict[str, Any] = {"sector": sector, "tiles": numbers.tolist()}
        for part, content, suffix in (("image", picture, kind), ("quads", packed, "quads.gz")):
            file = f"slab{index}-{sector:02d}.{suffix}"
            (folder / file).write_bytes(content)
            entry |= {
                part: file,
                f"{part}_bytes": len(content),
                f"{part}_sha256": hashlib.sha256(content).hexdigest(),
            }
        sectors.append(entry)
    return {
        "disparity": list(slab.disparity),
        "error": slab.error,
        "empty": int(np.count_nonzero(~filled(slab.pixels[..., 3] > 0, tile))),
        "culled": int(np.count_nonzero(filled(slab.pixels[..., 3] > 0, tile) & ~slab.tiles)),
        "sectors": sectors,
    }
