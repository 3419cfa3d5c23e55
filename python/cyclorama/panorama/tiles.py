"""Tiles of a slab as files: pictures that anything opens, and quads beside them.

The tiles of a panorama come in *sectors*, upright stripes of 8 columns of tiles: what a view to one side needs. A
sector of a slab is two files. The picture (PNG, with a palette where its colours fit in one, or lossless WebP) holds
the tiles that are kept, in the order of their numbers, 8 in a row, each with a border of one pixel, which belongs to
its neighbours: so bilinear look-ups in a cell are those in the panorama. Red, green, blue, and an opacity of 0 or 255;
what is transparent is black.

A quad is 7 numbers of 16 bits: column and row of the upper left pixel in the panorama, pixels a side, and the disparity
of each corner (upper left a, upper right b, lower left c, lower right d) in steps of the slab's range of disparities.
Their file, compressed by gzip, does not say where they are: tile by tile, a block of the tile's pixels of which one is
opaque is a quad or is halved, into upper left, upper right, lower left and lower right, down to single pixels. It has

- the number of quads, 32 bits, low byte first;
- for each quad's a, then each one's b, c, d: the difference v to a guess, modulo 65536, written as 2 v, or -2 v - 1
  where it is negative: first the low bytes of all, then the high bytes;
- for each block of more than a pixel, in the order of the walk, a bit that is 1 if it is a quad: 8 in a byte, the
  lowest bit first.

The guess for a is the corner that was last at one of the quad's four places (a's first, then b's, c's, d's), in the
sector's tiles so far, or else the a of the quad before, or 0. For b and c, a is expected, for d, b + c - a: the guess
is the corner that was last at the same place if it is within 32 steps of what is expected, else what is expected.
"""

from __future__ import annotations

import gzip
import io
import zlib
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from ..arguments import checked_choice
from .projection import Projection

__all__ = ["ACROSS", "Codec", "check_codec", "decode", "encode", "tile_numbers"]

Pixels = npt.NDArray[np.uint8]
Quads = npt.NDArray[np.uint16]
Indices = npt.NDArray[np.int64]

Codec = Literal["smallest", "png", "webp"]

#: Columns of tiles in a sector, and cells in a row of its picture.
ACROSS = 8


def check_codec(codec: str) -> None:
    """Refuses a codec that isn't one, or that can't be written here.

    Raises
    ------
    ValueError, ImportError
    """
    checked_choice("codec", codec, get_args(Codec))
    if codec == "webp" and not _has_webp():
        raise ValueError("codec='webp' needs a Pillow that was built with WebP: codec='png' always works")


def _has_webp() -> bool:
    try:
        from PIL import features
    except ImportError as error:
        raise ImportError("panoramas are written by Pillow: pip install 'cyclorama[mesh]'") from error
    return bool(features.check("webp"))


def tile_numbers(shape: tuple[int, int], tile: int, sector: int) -> Indices:
    """The numbers of a sector's tiles, ascending; tiles are numbered by rows of the panorama of (H, W) pixels.

    Examples
    --------
    >>> tile_numbers((64, 512), 32, 1)
    array([ 8,  9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31])
    """
    across = shape[1] // tile
    columns = np.arange(sector * ACROSS, min((sector + 1) * ACROSS, across))
    return (np.arange(shape[0] // tile)[:, None] * across + columns).ravel()


def encode(
    panorama: Projection, pixels: Pixels, quads: Quads, tiles: Indices, tile: int, codec: Codec
) -> tuple[bytes, str, bytes]:
    """The files of some tiles: picture, its format ("png" or "webp"), quads.

    Parameters
    ----------
    panorama : Projection
        Of H x W pixels.
    pixels : (H, W, 4) ndarray of uint8
        The slab.
    quads : (N, 7) ndarray of uint16
        Those of the tiles, tile by tile as `tiles` has them.
    tiles : (K,) ndarray of int
        Numbers of the tiles, ascending.
    tile : int
        Pixels a side.
    codec : {"smallest", "png", "webp"}
    """
    cell = tile + 2
    atlas = np.zeros((-(-len(tiles) // ACROSS) * cell, ACROSS * cell, 4), np.uint8)
    for index, number in enumerate(tiles):
        rows, columns, _ = _cell(pixels.shape, int(number), tile)
        top, left = index // ACROSS * cell, index % ACROSS * cell
        atlas[top : top + cell, left : left + cell] = pixels[rows, columns]
    made = {}
    if codec != "webp":
        made["png"] = _png(atlas)
    if codec == "webp" or (codec == "smallest" and _has_webp()):
        made["webp"] = _saved(atlas, "RGBA", "WEBP", lossless=True, quality=30, method=2, exact=True)
    kind = min(made, key=lambda name: len(made[name]))
    packed = panorama.kernel.packed(pixels[..., 3] > 0, tile, tiles.tolist(), np.ascontiguousarray(quads))
    return made[kind], kind, gzip.compress(packed, compresslevel=9, mtime=0)


def _png(atlas: Pixels) -> bytes:
    """A PNG, with a palette if its colours fit in one."""
    colors, index = np.unique(np.ascontiguousarray(atlas).view(np.uint32), return_inverse=True)
    if len(colors) > 256:
        return _saved(atlas, "RGBA", "PNG", compress_level=6)
    table = colors.view(np.uint8).reshape(-1, 4)
    # What is transparent is 0, and so the first.
    clear = {"transparency": 0} if not table[0, 3] else {}
    return _saved(
        index.reshape(atlas.shape[:2]).astype(np.uint8), "P", "PNG", table[:, :3].tobytes(), compress_level=9, **clear
    )


def _saved(pixels: Pixels, mode: str, kind: str, palette: bytes | None = None, **how: Any) -> bytes:
    from PIL import Image

    image = Image.frombytes(mode, (pixels.shape[1], pixels.shape[0]), np.ascontiguousarray(pixels).tobytes())
    if palette is not None:
        image.putpalette(palette)
    file = io.BytesIO()
    image.save(file, kind, **how)
    return file.getvalue()


def _cell(shape: tuple[int, ...], number: int, tile: int) -> tuple[Indices, Indices, npt.NDArray[np.bool_]]:
    """Rows and columns of a tile's cell, as an index of a slab, and which rows of the cell are in the panorama."""
    beside = np.arange(-1, tile + 1)
    across = shape[1] // tile
    rows, columns = number // across * tile + beside, (number % across * tile + beside) % shape[1]
    return np.clip(rows, 0, shape[0] - 1)[:, None], columns, (rows >= 0) & (rows < shape[0])


def decode(
    panorama: Projection, picture: bytes, packed: bytes, tiles: Indices, tile: int, pixels: Pixels, what: str
) -> Quads:
    """Puts the tiles of a picture into a slab's pixels, and gives their quads.

    Raises
    ------
    ValueError
        If a file is cut off, damaged or something else.
    """
    from PIL import Image

    cell = tile + 2
    try:
        with Image.open(io.BytesIO(picture)) as image:
            atlas = np.asarray(image.convert("RGBA"))
        content = gzip.decompress(packed)
    except (OSError, EOFError, ValueError, SyntaxError, zlib.error) as error:
        raise ValueError(f"{what} is not whole: {error}") from error
    if atlas.shape != (-(-len(tiles) // ACROSS) * cell, ACROSS * cell, 4):
        raise ValueError(f"{what} is of another size than its list of tiles says: {atlas.shape}")
    for index, number in enumerate(tiles):
        rows, columns, inside = _cell(pixels.shape, int(number), tile)
        top, left = index // ACROSS * cell, index % ACROSS * cell
        # With its border: what kept tiles mix their own borders with.
        pixels[rows[inside], columns] = atlas[top : top + cell, left : left + cell][inside]
    try:
        return panorama.kernel.unpacked(pixels[..., 3] > 0, tile, tiles.tolist(), content)
    except ValueError as error:
        raise ValueError(f"the quads of {what} are not whole: {error}") from error
