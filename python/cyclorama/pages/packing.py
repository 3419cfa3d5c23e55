"""Arrays for scripts: one line of JSON that names them, then their bytes (`web/src/arrays.js` reads it)."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["pack", "pack_text"]

_TYPES = ("uint8", "uint32", "float32")


def pack(values: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> bytes:
    """Values as JSON has them, and arrays.

    Parameters
    ----------
    values : mapping
        Numbers, texts and None by name.
    arrays : mapping of str to ndarray
        Of uint8, uint32 or float32, any shape: a script gets them flat.

    Raises
    ------
    ValueError
        If an array is of another type.

    Examples
    --------
    >>> pack({"title": "one"}, {"ids": np.array([7], dtype=np.uint32)})[-8:]
    b'\\x07\\x00\\x00\\x00\\x00\\x00\\x00\\x00'
    """
    for name, array in arrays.items():
        if array.dtype.name not in _TYPES:
            raise ValueError(f"{name} is {array.dtype}: scripts read {', '.join(_TYPES)}")
    start = 0
    while True:  # where arrays begin depends on how long the line is that says so
        entries, end = [], start
        for name, array in arrays.items():
            entries.append({"name": name, "dtype": array.dtype.name, "start": end, "length": array.size})
            end += -(-array.nbytes // 8) * 8
        line = json.dumps({"values": dict(values), "arrays": entries}).encode() + b"\n"
        needed = -(-len(line) // 8) * 8
        if needed <= start:
            break
        start = needed
    body = [line[:-1].ljust(start - 1) + b"\n"]
    for array in arrays.values():
        raw = np.ascontiguousarray(array).tobytes()
        body.append(raw.ljust(-(-len(raw) // 8) * 8, b"\0"))
    return b"".join(body)


def pack_text(values: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]) -> str:
    """The same, gzipped and in base64, to stand in a page."""
    return base64.b64encode(gzip.compress(pack(values, arrays), 6, mtime=0)).decode()
