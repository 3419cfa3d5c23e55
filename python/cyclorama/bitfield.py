"""Rows of bits: which faces (or patches) each view sees, packed 64 to a word.

Bit ``k`` of word ``w`` is face ``64 * w + k``; bits past the last face are zero. The functions work on plain
``(S, W)`` uint64 arrays; `Bitfields` keeps one together with the number of faces. They are the ID-bitfields of
the 2001 paper (sections 3.1 and 3.2.2).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _core

__all__ = [
    "Bitfields",
    "count",
    "decode",
    "difference",
    "encode",
    "face_lists",
    "ids",
    "intersection",
    "morton_order",
    "pack",
    "summary",
    "union",
    "unpack",
    "width",
]

Words = npt.NDArray[np.uint64]


def width(size: int) -> int:
    """Words that a row of `size` bits takes.

    Examples
    --------
    >>> width(64), width(65)
    (1, 2)
    """
    return (size + 63) // 64


def _rows(words: npt.ArrayLike, name: str = "words") -> Words:
    """`words` as a row-major (S, W) array, without a copy where it is one."""
    array = np.asarray(words)
    if array.dtype != np.uint64:
        raise ValueError(f"{name} must be uint64, got {array.dtype}")
    if array.ndim == 1:
        array = array[None]
    if array.ndim != 2:
        raise ValueError(f"{name} must have shape (S, W) or (W,), got {array.shape}")
    return np.ascontiguousarray(array)


def _row(words: npt.ArrayLike) -> Words:
    """`words` as one row-major (W,) row."""
    array = np.asarray(words)
    if array.dtype != np.uint64:
        raise ValueError(f"words must be uint64, got {array.dtype}")
    if array.ndim == 2 and len(array) == 1:
        array = array[0]
    if array.ndim != 1:
        raise ValueError(f"words must be one row, (W,), got shape {array.shape}")
    return np.ascontiguousarray(array)


def _indices(rows: npt.ArrayLike | None, count: int) -> npt.NDArray[np.int64]:
    """Row numbers: all, those of a mask, or as given."""
    if rows is None:
        return np.arange(count, dtype=np.int64)
    array = np.asarray(rows)
    if array.dtype == np.bool_:
        if array.shape != (count,):
            raise ValueError(f"a mask of rows must have shape ({count},), got {array.shape}")
        return np.flatnonzero(array).astype(np.int64, copy=False)
    if array.size == 0:
        return np.empty(0, dtype=np.int64)
    if array.dtype.kind not in "iu":
        raise ValueError(f"rows must be integers, got dtype {array.dtype}")
    return np.ascontiguousarray(array.reshape(-1), dtype=np.int64)


def _id_array(ids: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    array = np.asarray(ids)
    if array.size == 0:
        return np.empty(0, dtype=np.uint32)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise ValueError(f"ids must be (K,) integers, got {array.shape} {array.dtype}")
    wrong = (array < 0) | (array > 0xFFFFFFFF)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(f"ids[{k}] is {array[k]}: it must be in [0, 2**32)")
    return np.ascontiguousarray(array, dtype=np.uint32)


def pack(flags: npt.ArrayLike) -> Words:
    """Packs flags into rows of bits.

    Parameters
    ----------
    flags : (S, F) or (F,) array_like of bool
        Which of F faces each of S views sees; one row may come alone.

    Returns
    -------
    (S, W) ndarray of uint64
        Packed rows, W = ceil(F / 64).

    Raises
    ------
    ValueError
        If `flags` is not boolean or has another shape.

    Examples
    --------
    >>> pack([True, False, True])
    array([[5]], dtype=uint64)
    """
    array = np.asarray(flags)
    if array.dtype != np.bool_:
        raise ValueError(f"flags must be bool, got {array.dtype}")
    if array.ndim == 1:
        array = array[None]
    if array.ndim != 2:
        raise ValueError(f"flags must have shape (S, F) or (F,), got {array.shape}")
    return _core.bitfield_pack(np.ascontiguousarray(array))


def unpack(words: npt.ArrayLike, size: int) -> npt.NDArray[np.bool_]:
    """Spreads rows of bits over a flag for each face: the inverse of `pack`.

    Parameters
    ----------
    words : (S, W) or (W,) array_like of uint64
        Packed rows.
    size : int
        Number of faces, F.

    Returns
    -------
    (S, F) ndarray of bool

    Raises
    ------
    ValueError
        If W is not ceil(F / 64).

    Examples
    --------
    >>> unpack(np.array([[5]], dtype=np.uint64), 3)
    array([[ True, False,  True]])
    """
    return _core.bitfield_unpack(_rows(words), _size(size))


def union(words: npt.ArrayLike, rows: npt.ArrayLike | None = None, *, out: Words | None = None) -> Words:
    """Faces that any of the chosen rows has.

    Parameters
    ----------
    words : (S, W) array_like of uint64
        Packed rows.
    rows : (N,) array_like of int or (S,) array_like of bool, optional
        Which rows to join; all by default. None chosen: an empty row.
    out : (W,) ndarray of uint64, optional
        Written instead of a new array.

    Returns
    -------
    (W,) ndarray of uint64
        `out`, if given.

    Raises
    ------
    ValueError
        If a row is not in [0, S), or `out` has another shape or cannot be written.

    Examples
    --------
    >>> union(np.array([[1], [2], [8]], dtype=np.uint64), [0, 2])
    array([9], dtype=uint64)
    """
    array = _rows(words)
    out = _out(out, array.shape[1], np.uint64)
    _core.bitfield_union(array, _indices(rows, len(array)), out)
    return out


def intersection(words: npt.ArrayLike, rows: npt.ArrayLike | None = None, *, out: Words | None = None) -> Words:
    """Faces that all of the chosen rows have.

    Parameters
    ----------
    words : (S, W) array_like of uint64
        Packed rows.
    rows : (N,) array_like of int or (S,) array_like of bool, optional
        Which rows to join; all by default. At least one: of none, every face would be common.
    out : (W,) ndarray of uint64, optional
        Written instead of a new array.

    Returns
    -------
    (W,) ndarray of uint64
        `out`, if given.

    Raises
    ------
    ValueError
        If no row is chosen, a row is not in [0, S), or `out` has another shape or cannot be written.

    Examples
    --------
    >>> intersection(np.array([[3], [6]], dtype=np.uint64))
    array([2], dtype=uint64)
    """
    array = _rows(words)
    indices = _indices(rows, len(array))
    if len(indices) == 0:
        raise ValueError("rows is empty: an intersection needs at least one row")
    out = _out(out, array.shape[1], np.uint64)
    _core.bitfield_intersection(array, indices, out)
    return out


def difference(a: npt.ArrayLike, b: npt.ArrayLike) -> Words:
    """Faces of `a` that `b` does not have, row by row.

    Parameters
    ----------
    a, b : (S, W) or (W,) array_like of uint64
        Packed rows, as many of each.

    Returns
    -------
    (S, W) ndarray of uint64

    Raises
    ------
    ValueError
        If the shapes differ.

    Examples
    --------
    >>> difference(np.array([[7]], dtype=np.uint64), np.array([[2]], dtype=np.uint64))
    array([[5]], dtype=uint64)
    """
    return _core.bitfield_difference(_rows(a, "a"), _rows(b, "b"))


def count(words: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Number of faces in each row.

    Parameters
    ----------
    words : (S, W) or (W,) array_like of uint64
        Packed rows.

    Returns
    -------
    (S,) ndarray of int64

    Examples
    --------
    >>> count(np.array([[7], [8]], dtype=np.uint64))
    array([3, 1])
    """
    return _core.bitfield_count(_rows(words))


def ids(
    words: npt.ArrayLike,
    *,
    out: npt.NDArray[np.uint32] | None = None,
    summary: npt.ArrayLike | None = None,
) -> npt.NDArray[np.uint32]:
    """Faces of one row, ascending.

    Parameters
    ----------
    words : (W,) array_like of uint64
        A packed row.
    out : (N,) ndarray of uint32, optional
        Room for the answer, N at least the number of faces in the row: saves the time that a fresh array takes, which
        is more than the traversal's.
    summary : (ceil(W / 64),) array_like of uint64, optional
        The row's `summary`. Only the words it names are looked at, which pays where few are set.

    Returns
    -------
    (K,) ndarray of uint32
        The front of `out`, if given.

    Raises
    ------
    ValueError
        If `out` is too small or cannot be written, or `summary` is not that of a row this wide.

    Examples
    --------
    >>> ids(np.array([5, 1], dtype=np.uint64))
    array([ 0,  2, 64], dtype=uint32)
    """
    row = _row(words)
    if summary is not None:
        found = _core.bitfield_ids_under(row, _row(summary))
        if out is None:
            return found
        if len(_out(out, len(out), np.uint32)) < len(found):
            raise ValueError(f"out has room for {len(out)} ids, the row has {len(found)}")
        out[: len(found)] = found
        return out[: len(found)]
    if out is None:
        return _core.bitfield_ids(row)
    return out[: _core.bitfield_ids_into(row, _out(out, len(out), np.uint32))]


def summary(words: npt.ArrayLike) -> Words:
    """One bit per word: whether it has any face (the 2001 paper's hierarchical encoding, section 5).

    Parameters
    ----------
    words : (S, W) or (W,) array_like of uint64
        Packed rows.

    Returns
    -------
    (S, ceil(W / 64)) ndarray of uint64
        Bit ``k`` of word ``w`` of a row says whether word ``64 * w + k`` of that row is not zero. The summary of a
        union is the union of the summaries.

    Examples
    --------
    >>> summary(np.array([[0, 5, 0, 1]], dtype=np.uint64))
    array([[10]], dtype=uint64)
    """
    return _core.bitfield_summary(_rows(words))


def face_lists(words: npt.ArrayLike) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.uint32]]:
    """Faces of each row as index lists, for renderers that take those (2001, section 3.2.2).

    Parameters
    ----------
    words : (S, W) array_like of uint64
        Packed rows, such as one for each face of the sphere of viewpoints.

    Returns
    -------
    offsets : (S + 1,) ndarray of uint64
        Where each row's list begins.
    ids : (K,) ndarray of uint32
        Row ``r`` has ``ids[offsets[r]:offsets[r + 1]]``, ascending.

    Examples
    --------
    >>> face_lists(np.array([[5], [2]], dtype=np.uint64))
    (array([0, 2, 3], dtype=uint64), array([0, 2, 1], dtype=uint32))
    """
    return _core.bitfield_lists(_rows(words))


def morton_order(points: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Order of points along the Morton (Z) curve of their bounding cube, 2^21 steps a side.

    Parameters
    ----------
    points : (F, 3) array_like of float
        Such as the faces' centroids, in any unit.

    Returns
    -------
    (F,) ndarray of uint32
        Index of the first point on the curve, of the second, and so on; points in the same step by index.

    Raises
    ------
    ValueError
        If a coordinate is not finite.

    Examples
    --------
    >>> morton_order([[3, 0, 0], [0, 0, 0], [1, 0, 0]])
    array([1, 2, 0], dtype=uint32)
    """
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points must have shape (F, 3), got {array.shape}")
    return _core.morton_order(np.ascontiguousarray(array))


#: Dimensions of the arrays that `encode` makes.
_CODED = {"version": 0, "size": 0, "checksum": 0, "references": 2, "starts": 1, "stream": 1}
_VERSION = 1


def encode(words: npt.ArrayLike, size: int) -> dict[str, npt.NDArray[Any]]:
    """Rows as few bytes, in arrays of plain dtypes for an ``.npz``.

    Parameters
    ----------
    words : (S, W) array_like of uint64
        Packed rows.
    size : int
        Number of faces, F.

    Returns
    -------
    dict of ndarray
        ``version``, ``size`` and ``checksum`` (unsigned integers, no dimensions); ``references`` ((S, 8) unsigned: the
        earlier rows that each row is coded after, the highest value for none); ``stream`` (uint8: the coded bytes) and
        ``starts`` (uint64: where each block of at most 2^16 faces begins in it, and the end).

    Raises
    ------
    ValueError
        If the words have another shape, or a bit is set past the last face.

    Notes
    -----
    Rows resemble each other, and so do the bits of faces that other views see alike. A context-adaptive binary
    arithmetic coder predicts each bit from the bits of the eight earlier rows most like its row, and from the bits
    before it in an order of the faces in which those that earlier rows see alike are neighbours. The decoder knows
    those rows, so that order is nowhere stored. Rows that resemble each other belong in one call: a sphere's rows for
    its faces after those for its corners take little more. ``benches/bitfield_coding.py`` shows sizes and times.

    Examples
    --------
    >>> bits = Bitfields.from_ids([[1, 2], [1, 2, 3]], 1000)
    >>> decode(encode(bits.words, bits.size)) == bits
    True
    """
    bits = Bitfields(words, size)
    references, stream, starts, checksum = _core.bitfield_encode(bits.words, bits.size)
    narrow = np.uint16 if len(bits) < 0xFFFF else np.uint32
    return {
        "version": np.array(_VERSION, dtype=np.uint8),
        "size": np.array(bits.size, dtype=np.uint64),
        "checksum": np.array(checksum, dtype=np.uint64),
        "references": references.astype(narrow),
        "starts": starts,
        "stream": stream,
    }


def decode(arrays: Mapping[str, npt.NDArray[Any]]) -> Bitfields:
    """The rows that `encode` was given.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        What `encode` returned, or an opened ``.npz`` of it. Other names in it are ignored.

    Returns
    -------
    Bitfields

    Raises
    ------
    ValueError
        If an array is missing, has another dtype or shape, or the rows are not those that were coded: the stream is
        truncated, damaged or something else's.
    """
    found = {}
    for name, dimensions in _CODED.items():
        if name not in arrays:
            raise ValueError(f"these are not coded rows: {name!r} is missing")
        array = np.asarray(arrays[name])
        if array.dtype.kind != "u" or array.ndim != dimensions:
            raise ValueError(f"these are not coded rows: {name!r} is {array.dtype} with shape {array.shape}")
        found[name] = array
    if found["version"] != _VERSION:
        raise ValueError(f"rows are coded as version {found['version']}, this library reads version {_VERSION}")
    references = found["references"]
    if references.shape[1] != 8 or found["stream"].dtype != np.uint8 or found["size"] > np.iinfo(np.int64).max:
        raise ValueError(
            f"these are not coded rows: references {references.shape}, stream {found['stream'].dtype}, "
            f"size {found['size']}"
        )
    none = references == np.iinfo(references.dtype).max
    if references.size and references[~none].max(initial=0) >= len(references):
        raise ValueError(f"references name row {references[~none].max()}, but there are {len(references)}")
    size = int(found["size"])
    words = _core.bitfield_decode(
        size,
        np.where(none, np.uint32(0xFFFFFFFF), references).astype(np.uint32, order="C"),
        np.ascontiguousarray(found["stream"]),
        found["starts"].astype(np.uint64, order="C"),
        int(found["checksum"]),
    )
    return Bitfields(words, size)


def _size(size: int) -> int:
    if isinstance(size, bool) or not isinstance(size, (int, np.integer)) or size < 0:
        raise ValueError(f"size must be an integer of at least 0, got {size!r}")
    return int(size)


def _out(out: npt.NDArray[Any] | None, length: int, dtype: type[np.generic]) -> npt.NDArray[Any]:
    """`out` or a new array of `length`."""
    if out is None:
        return np.empty(length, dtype=dtype)
    if not isinstance(out, np.ndarray) or out.ndim != 1 or out.dtype != dtype or len(out) != length:
        shape, kind = getattr(out, "shape", "no shape"), getattr(out, "dtype", type(out).__name__)
        raise ValueError(f"out must be ({length},) {np.dtype(dtype)}, got {shape} {kind}")
    return out


class Bitfields:
    """Rows of bits, one per view, over `size` faces.

    Parameters
    ----------
    words : (S, W) array_like of uint64
        Packed rows, W = ceil(size / 64); bits past the last face must be zero. A row-major array is kept, not copied.
    size : int
        Number of faces (or patches), F.

    Raises
    ------
    ValueError
        If the words have another dtype or shape, or a bit is set past the last face.

    Examples
    --------
    >>> bits = Bitfields.from_ids([[0, 2], [2, 3]], 4)
    >>> bits
    <Bitfields: 2 rows of 4 bits, 50.0% set>
    >>> bits.ids(1)
    array([2, 3], dtype=uint32)
    >>> ids(bits.union([0, 1]))
    array([0, 2, 3], dtype=uint32)
    """

    __slots__ = ("size", "words")

    words: Words
    size: int

    def __init__(self, words: npt.ArrayLike, size: int) -> None:
        self.words = _rows(words)
        self.size = _size(size)
        _core.bitfield_check(self.words, self.size)

    @classmethod
    def pack(cls, flags: npt.ArrayLike) -> Bitfields:
        """Rows from (S, F) flags; see `pack`."""
        array = np.asarray(flags)
        return cls(pack(array), array.shape[-1])

    @classmethod
    def from_ids(cls, rows: Iterable[npt.ArrayLike], size: int) -> Bitfields:
        """Rows from a list of face ids each, in any order, repeated or not.

        Raises
        ------
        ValueError
            If an id is not in [0, size).
        """
        size = _size(size)
        packed = [_core.bitfield_from_ids(_id_array(row), size) for row in rows]
        return cls(np.stack(packed) if packed else np.empty((0, width(size)), dtype=np.uint64), size)

    @classmethod
    def zeros(cls, rows: int, size: int) -> Bitfields:
        """Rows in which no face is set."""
        return cls(np.zeros((_size(rows), width(_size(size))), dtype=np.uint64), size)

    def _view(self, words: Words) -> Bitfields:
        """Rows of these, which need no second check."""
        view = Bitfields.__new__(Bitfields)
        view.words = np.ascontiguousarray(words)
        view.size = self.size
        return view

    def __len__(self) -> int:
        """Number of rows, S."""
        return len(self.words)

    def __getitem__(self, rows: Any) -> Bitfields:
        """Some rows: an integer (one row), a slice (a view), integers or a mask."""
        chosen = self.words[rows]
        if chosen.ndim not in (1, 2) or chosen.shape[-1] != self.words.shape[1]:
            raise ValueError(f"index rows with an integer, a slice, integers or a mask, got {rows!r}")
        return self._view(chosen.reshape(-1, self.words.shape[1]))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Bitfields):
            return NotImplemented
        return self.size == other.size and np.array_equal(self.words, other.words)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        bits = len(self) * self.size
        share = 100.0 * int(self.count().sum()) / bits if bits else 0.0
        return f"<Bitfields: {len(self):,} rows of {self.size:,} bits, {share:.1f}% set>"

    @property
    def nbytes(self) -> int:
        """Bytes of the words in memory."""
        return self.words.nbytes

    def ids(self, row: int, *, out: npt.NDArray[np.uint32] | None = None) -> npt.NDArray[np.uint32]:
        """Faces of one row, ascending; see `ids`."""
        return ids(self.words[row], out=out)

    def union(self, rows: npt.ArrayLike | None = None, *, out: Words | None = None) -> Words:
        """(W,) words: faces that any of the chosen rows (all by default) has; see `union`."""
        return union(self.words, rows, out=out)

    def intersection(self, rows: npt.ArrayLike | None = None, *, out: Words | None = None) -> Words:
        """(W,) words: faces that all of the chosen rows (all by default) have; see `intersection`."""
        return intersection(self.words, rows, out=out)

    def difference(self, other: Bitfields) -> Bitfields:
        """Row by row, the faces that `other` does not have; see `difference`."""
        if self.size != other.size:
            raise ValueError(f"both must have the same size, got {self.size} and {other.size}")
        return self._view(difference(self.words, other.words))

    def count(self) -> npt.NDArray[np.int64]:
        """(S,) number of faces in each row."""
        return count(self.words)

    def unpack(self) -> npt.NDArray[np.bool_]:
        """(S, F) flags."""
        return unpack(self.words, self.size)

    def summary(self) -> Words:
        """(S, ceil(W / 64)) one bit per word: whether it has any face; see `summary`."""
        return summary(self.words)

    def face_lists(self) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.uint32]]:
        """Faces of all rows as offsets and ids; see `face_lists`."""
        return face_lists(self.words)
