"""Files of arrays with a header: `.npz` archives that plain NumPy opens, and that are whole or refused."""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from .files import whole_file

__all__ = ["UNREADABLE", "check_format", "read_archive", "write_archive"]

UNREADABLE = (
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    AttributeError,
    IndexError,
    NotImplementedError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy, zipfile and decoders raise at files that are cut off, damaged or something else."""


def write_archive(
    path: str | os.PathLike[str], format: str, header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]
) -> None:
    """Writes arrays and a header; the name keeps what it had until all is written.

    Parameters
    ----------
    path : path
    format : str
        What the file is, with its version; becomes part of the header.
    header : mapping
        What JSON can hold.
    arrays : mapping of str to ndarray
        By names other than "header".

    Raises
    ------
    OSError
        If it can't be written.

    Examples
    --------
    See `read_archive`.
    """
    written = {"header": np.array(json.dumps({"format": format, **header})), **arrays}
    with whole_file(path) as file:
        np.savez_compressed(file, **written)  # type: ignore[arg-type]


@contextmanager
def read_archive(path: str | os.PathLike[str], format: str, what: str) -> Iterator[tuple[dict[str, Any], Any]]:
    """The header and the arrays that `write_archive` wrote; what is wrong with them, also in the block, is one error.

    Parameters
    ----------
    path : path
    format : str
        What the file must be.
    what : str
        The same in words, for the error.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is cut off, damaged or something else, or the block finds it to be.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "numbers.npz"
    ...     write_archive(path, "numbers 1", {"unit": "m"}, {"lengths": np.arange(3)})
    ...     with read_archive(path, "numbers 1", "list of numbers") as (header, arrays):
    ...         print(arrays["lengths"], header["unit"])
    ...     try:
    ...         with read_archive(path, "letters 1", "list of letters") as _:
    ...             pass
    ...     except ValueError as error:
    ...         print(str(error).split("numbers.npz ")[1])
    [0 1 2] m
    is not a whole list of letters: its format is 'numbers 1', not 'letters 1'
    """
    try:
        with open(path, "rb") as raw:
            if raw.read(2) != b"PK":
                raise ValueError("it is no .npz archive")
        with np.load(path, allow_pickle=False) as file:
            header = json.loads(str(file["header"][()]))
            check_format(header, format)
            yield header, file
    except UNREADABLE as error:
        raise ValueError(f"{os.fspath(path)} is not a whole {what}: {error}") from error


def check_format(header: Mapping[str, Any], format: str) -> None:
    """Refuses a header of another format, or of another version of it.

    Raises
    ------
    ValueError
        If it is one.

    Examples
    --------
    >>> check_format({"format": "numbers 1"}, "numbers 1")
    """
    found = header.get("format")
    if found == format:
        return
    kind, _, version = format.rpartition(" ")
    its_kind, _, its_version = str(found).rpartition(" ")
    if its_kind == kind and its_version.isdecimal() and int(its_version) > int(version):
        raise ValueError(f"it was written by a newer Cyclorama: its format is {found!r}, this one reads {format!r}")
    raise ValueError(f"its format is {found!r}, not {format!r}")
