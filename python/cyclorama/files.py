"""Files that are whole or not there."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

__all__ = ["check_writable", "whole_file", "whole_path"]


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """A file that takes its name only when the block ends well; until then the name keeps what it had.

    Parameters
    ----------
    path : path

    Raises
    ------
    OSError
        If the folder is not there or can't be written to.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_file(Path(folder) / "answer") as file:
    ...         _ = file.write(b"42")
    ...     (Path(folder) / "answer").read_bytes()
    b'42'
    """
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


@contextmanager
def whole_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """As `whole_file`, for libraries that want a name to write to.

    Parameters
    ----------
    path : path

    Raises
    ------
    OSError
        If the folder is not there or can't be written to.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with whole_path(Path(folder) / "answer") as beside:
    ...         _ = beside.write_bytes(b"42")
    ...     (Path(folder) / "answer").read_bytes()
    b'42'
    """
    final = Path(path)
    with whole_file(final) as file:
        try:
            with tempfile.TemporaryDirectory(dir=final.parent, prefix=final.name) as folder:
                beside = Path(folder) / final.name
                yield beside
                with open(beside, "rb") as written:
                    shutil.copyfileobj(written, file)
        except OSError as error:
            raise type(error)(error.errno, f"cannot write there: {error.strerror}", str(final)) from None


def check_writable(path: str | os.PathLike[str]) -> None:
    """Finds out before long work whether its result can be written; leaves nothing behind.

    Raises
    ------
    OSError
        If not: the folder is not there or read-only, or `path` is a folder.
    """
    final = Path(path)
    if final.is_dir():
        raise IsADirectoryError(f"{final} is a folder, not a file to write")
    try:
        with tempfile.TemporaryFile(dir=final.parent):
            pass
    except OSError as error:
        raise type(error)(error.errno, f"cannot write there: {error.strerror}", str(final)) from None
