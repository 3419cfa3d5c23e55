"""Tiles of a slab as files: pictures that anything opens, and quads beside them.

The tiles of a panorama come in *sectors*, upright stripes of 8 columns of tiles: what a view to one side needs. A
sector of a slab is two files. The picture (PNG, or lossless WebP) holds the tiles that are kept, in the order of
their numbers, 8 in a row, each with a border of one pixel, which belongs to its neighbours: so bilinear look-ups in a
cell are those in the panorama. Red, green, blue, and an opacity of 0 or 255; what is transparent is black.

A quad is 7 numbers of 16 bits: column and row of the upper left pixel in the panorama, pixels a side, and the disparity
of each corner (upper left a, upper right b, lower left c, lower right d) in steps of the slab's range of disparities.
Their file, compressed by gzip, has them column by column, as differences modulo 65536, which are small: of column, row
and a from the quad before; the side itself; b - a, c - a, d - b - c + a. A difference v is written as 2 v, or -2 v - 1
where it is negative; first come the low bytes of all numbers, then the high bytes.
"""

from __future__ import annotations

import gzip
import io
import zlib
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

__all__ = ["ACROSS", "Codec", "check_codec", "decode", "encode", "tile_numbers"]

Pixels = npt.NDArray[np.uint8]
Quads = npt.NDArray[np.uint16]
Indices = npt.NDArray[np.int64]

Codec = Literal["png", "webp"]

#: Columns of tiles in a sector, and cells in a row of its picture.
ACROSS = 8


def check_codec(codec: str) -> None:
    """Refuses a codec that isn't one, or that can't be written here.

    Raises
    ------
    ValueError, ImportError
    """
    if codec not in get_args(Codec):
        raise ValueError(f"codec must be 'png' or 'webp', got {codec!r}")
    try:
        from PIL import features
    except ImportError as error:
        raise ImportError("panoramas are written by Pillow: pip install 'cyclorama[mesh]'") from error
    if codec == "webp" and not features.check("webp"):
        raise ValueError("codec='webp' needs a Pillow that was built with WebP: codec='png' always works")


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


def encode(pixels: Pixels, quads: Quads, tiles: Indices, tile: int, codec: Codec) -> tuple[bytes, bytes]:
    """The files of some tiles: picture and quads.

    Parameters
    ----------
    pixels : (H, W, 4) ndarray of uint8
        The slab.
    quads : (N, 7) ndarray of uint16
        Those of the tiles.
    tiles : (K,) ndarray of int
        Numbers of the tiles, ascending.
    tile : int
        Pixels a side.
    codec : {"png", "webp"}
    """
    from PIL import Image

    cell = tile + 2
    atlas = np.zeros((-(-len(tiles) // ACROSS) * cell, ACROSS * cell, 4), np.uint8)
    for index, number in enumerate(tiles):
        rows, columns, _ = _cell(pixels.shape, int(number), tile)
        top, left = index // ACROSS * cell, index % ACROSS * cell
        atlas[top : top + cell, left : left + cell] = pixels[rows, columns]
    picture = io.BytesIO()
    image = Image.fromarray(atlas)
    if codec == "png":
        image.save(picture, "PNG", compress_level=6)
    else:
        image.save(picture, "WEBP", lossless=True, quality=30, method=2, exact=True)
    return picture.getvalue(), gzip.compress(_differences(quads), compresslevel=6, mtime=0)


def _differences(quads: Quads) -> bytes:
    """(N, 7) quads as a file has them before gzip."""
    x, y, side, a, b, c, d = quads.T.astype(np.uint16)
    before = [np.diff(column, prepend=np.uint16(0)) for column in (x, y, a)]
    signed = np.stack([*before[:2], side, before[2], b - a, c - a, d - b - c + a]).view(np.int16)
    folded = ((signed << 1) ^ (signed >> 15)).view(np.uint16)
    return ((folded & 255).astype(np.uint8)).tobytes() + ((folded >> 8).astype(np.uint8)).tobytes()


def _sums(content: bytes) -> Quads:
    """The quads that `_differences` made a file of.

    Raises
    ------
    ValueError
        If the bytes aren't of whole quads.

    Examples
    --------
    >>> quads = np.array([(5, 7, 8, 9, 60000, 3, 4), (1, 9, 1, 65535, 0, 2, 1)], np.uint16)
    >>> bool((_sums(_differences(quads)) == quads).all())
    True
    """
    if len(content) % 14:
        raise ValueError(f"{len(content)} bytes are no whole quads")
    low, high = np.frombuffer(content, np.uint8).reshape(2, 7, -1).astype(np.uint16)
    folded = low | (high << 8)
    x, y, side, a, b, c, d = (folded >> 1) ^ (-(folded & 1).astype(np.int16)).view(np.uint16)
    x, y, a = (np.cumsum(column, dtype=np.uint16) for column in (x, y, a))
    b, c = b + a, c + a
    return np.column_stack([x, y, side, a, b, c, d + b + c - a])


def _cell(shape: tuple[int, ...], number: int, tile: int) -> tuple[Indices, Indices, npt.NDArray[np.bool_]]:
    """Rows and columns of a tile's cell, as an index of a slab, and which rows of the cell are in the panorama."""
    beside = np.arange(-1, tile + 1)
    across = shape[1] // tile
    rows, columns = number // across * tile + beside, (number % across * tile + beside) % shape[1]
    return np.clip(rows, 0, shape[0] - 1)[:, None], columns, (rows >= 0) & (rows < shape[0])


def decode(picture: bytes, packed: bytes, tiles: Indices, tile: int, pixels: Pixels, what: str) -> Quads:
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
        quads = _sums(gzip.decompress(packed))
    except (OSError, EOFError, ValueError, SyntaxError, zlib.error) as error:
        raise ValueError(f"{what} is not whole: {error}") from error
    if atlas.shape != (-(-len(tiles) // ACROSS) * cell, ACROSS * cell, 4):
        raise ValueError(f"{what} is of another size than its list of tiles says: {atlas.shape}")
    for index, number in enumerate(tiles):
        rows, columns, inside = _cell(pixels.shape, int(number), tile)
        top, left = index // ACROSS * cell, index % ACROSS * cell
        # With its border: what kept tiles mix their own borders with.
        pixels[rows[inside], columns] = atlas[top : top + cell, left : left + cell][inside]
    return quads
