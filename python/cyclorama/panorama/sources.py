"""Where the files of a walkthrough are read from: a folder, or a server (see `cyclorama.panorama.server`)."""

from __future__ import annotations

import json
import os
import threading
import urllib.error
import urllib.parse
import urllib.request
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

__all__ = ["Folder", "Server", "Source", "source_of"]

#: Files in one request; the server takes no more.
_BATCH = 256


class Source(Protocol):
    """Files by their names, with slashes."""

    def read(self, name: str) -> bytes:
        """A file.

        Raises
        ------
        FileNotFoundError
            If it isn't there.
        OSError
            If it can't be read.
        """

    def coming(self, names: Sequence[str]) -> None:
        """Says which files are read next."""

    def where(self, name: str) -> str:
        """The file's place, for messages."""


class Folder:
    """A folder.

    Parameters
    ----------
    folder : path
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)

    def __repr__(self) -> str:
        return str(self.folder)

    def read(self, name: str) -> bytes:
        return (self.folder / name).read_bytes()

    def coming(self, names: Sequence[str]) -> None:
        """A folder's files are read one by one."""

    def where(self, name: str) -> str:
        return str(self.folder / name)


class Server:
    """A server of a walkthrough.

    Parameters
    ----------
    url : str
        Of its page.
    cache : int
        Bytes of files to keep, those used last.
    timeout : float
        Seconds to wait for an answer.

    Attributes
    ----------
    received : int
        Bytes received so far.
    """

    def __init__(self, url: str, *, cache: int = 256 << 20, timeout: float = 30.0) -> None:
        self.url = url if url.endswith("/") else url + "/"
        self.cache, self.timeout, self.received, self.bytes = cache, timeout, 0, 0
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._lock = threading.Lock()

    def __repr__(self) -> str:
        return self.url

    def read(self, name: str) -> bytes:
        with self._lock:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
        content = self._get(name)
        self._keep(name, content)
        return content

    def coming(self, names: Sequence[str]) -> None:
        with self._lock:
            missing = [name for name in names if name not in self._kept]
        by_folder: dict[str, list[str]] = {}
        for name in missing:
            by_folder.setdefault(name.rpartition("/")[0], []).append(name.rpartition("/")[2])
        for folder, short in by_folder.items():
            for start in range(0, len(short), _BATCH):
                asked = ",".join(short[start : start + _BATCH])
                packed = self._get(f"batch/{folder}?names={asked}")
                for name, content in _unpack(packed, self.where(folder)).items():
                    self._keep(name, content)

    def where(self, name: str) -> str:
        return urllib.parse.urljoin(self.url, name)

    def _get(self, name: str) -> bytes:
        url = self.where(name)
        try:
            with urllib.request.urlopen(url, timeout=self.timeout) as answer:
                content: bytes = answer.read()
        except urllib.error.HTTPError as error:
            with error:
                said = error.read(500).decode(errors="replace").strip()
            kind = FileNotFoundError if error.code == 404 else OSError
            raise kind(f"{url} was refused ({error.code}): {said}") from None
        except (urllib.error.URLError, TimeoutError, ConnectionError) as error:
            raise OSError(f"{url} can't be reached: {getattr(error, 'reason', error)}") from error
        with self._lock:
            self.received += len(content)
        return content

    def _keep(self, name: str, content: bytes) -> None:
        with self._lock:
            if name in self._kept or len(content) > self.cache:
                return
            self._kept[name] = content
            self.bytes += len(content)
            while self.bytes > self.cache:
                self.bytes -= len(self._kept.popitem(last=False)[1])


def source_of(place: str | os.PathLike[str] | Source) -> Source:
    """A source, from what names it: the address of a server (``http://`` or ``https://``), or a folder.

    Raises
    ------
    ValueError
        If it is neither, nor a source.
    """
    if isinstance(place, str) and place.startswith(("http://", "https://")):
        return Server(place)
    if isinstance(place, str | os.PathLike):
        return Folder(place)
    if not hasattr(place, "read") or not hasattr(place, "where"):
        raise ValueError(f"a walkthrough is named by a folder or an address, got {place!r}")
    return place


def _unpack(packed: bytes, where: str) -> dict[str, bytes]:
    """The byte arrays of `cyclorama.pages.packing`."""
    try:
        entries: list[dict[str, Any]] = json.loads(packed[: packed.index(b"\n")])["arrays"]
        found = {e["name"]: packed[e["start"] : e["start"] + e["length"]] for e in entries}
        if any(len(found[e["name"]]) != e["length"] for e in entries):
            raise ValueError("it is cut off")
    except (ValueError, KeyError, TypeError) as error:
        raise OSError(f"{where} answered something else than files: {error}") from error
    return found
