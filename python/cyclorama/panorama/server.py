"""A walkthrough over HTTP: the page to walk in, and tiles for any client.

``/`` is the page; the files of the folder are there under their own names (``/manifest.json``, ``/0000/view.json``);
``/walk.json`` is the manifest with the corners of the track (``knots``, ``at_knots``); ``/batch/0000?names=a,b,...``
answers many files of a reference's folder in one response (`cyclorama.pages.packing`: a byte array each). All but the
page has an ETag, made of the checksums in the manifest: a client that has a file asks whether it is still that one, and
gets 304. Only files that the manifest names are ever opened.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import threading
import webbrowser
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import checked_whole
from ..pages import page, script
from ..pages.packing import pack
from .store import MANIFEST, VIEW, Store

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

__all__ = ["FileCache", "application", "serve"]

#: Files that one request may ask for: pictures and quads of eight slabs, all round.
MOST_FILES = 256

_TYPES = {".json": "application/json", ".png": "image/png", ".webp": "image/webp"}


class FileCache:
    """Files of a walkthrough, checked when they are read, and kept up to a limit of bytes, those used last.

    Parameters
    ----------
    store : Store
    limit : int
        Bytes to keep.
    """

    def __init__(self, store: Store, limit: int) -> None:
        self.store, self.limit, self.bytes = store, limit, 0
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._lock = threading.Lock()
        self._checksums: dict[str, str] = {}
        self._views: dict[int, dict[str, Any]] = {}
        for entry in store.manifest["references"]:
            self._checksums[f"{entry['folder']}/{VIEW}"] = entry["sha256"]
        self._folders = {entry["folder"]: index for index, entry in enumerate(store.manifest["references"])}

    def checksum(self, name: str) -> str | None:
        """Of a file, by its name with slashes; None if the walkthrough has no such file.

        Raises
        ------
        ValueError
            If the `view.json` that would name it is missing or damaged.
        """
        folder = name.partition("/")[0]
        if name not in self._checksums and folder in self._folders:
            self.view(self._folders[folder])
        return self._checksums.get(name)

    def view(self, index: int) -> dict[str, Any]:
        """The `view.json` of a reference.

        Raises
        ------
        ValueError
            If it is missing, cut off or not the one that the manifest names.
        """
        if index not in self._views:
            said = self.store.describe(index)
            folder = self.store.references[index].folder
            for slab in said["slabs"]:
                for sector in slab["sectors"]:
                    for kind in ("image", "quads"):
                        self._checksums[f"{folder}/{sector[kind]}"] = sector[f"{kind}_sha256"]
            self._views[index] = said
        return self._views[index]

    def read(self, name: str) -> bytes:
        """A file that `checksum` knows.

        Raises
        ------
        ValueError
            If it is missing, cut off or not the one that was written.
        """
        with self._lock:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
        content = self.store.read(name, self._checksums[name])
        with self._lock:
            if name not in self._kept and len(content) <= self.limit:
                self._kept[name] = content
                self.bytes += len(content)
                while self.bytes > self.limit:
                    self.bytes -= len(self._kept.popitem(last=False)[1])
        return content


def application(walk: Store | str | os.PathLike[str], *, cache: int = 256 << 20) -> Starlette:
    """What `serve` runs: an ASGI application, for servers of one's own.

    Parameters
    ----------
    walk : Store or path
    cache : int
        Bytes of files to keep in memory.

    Raises
    ------
    ValueError, FileNotFoundError
        As for `Store`; or `cache` is no number of bytes.
    ImportError
        If Starlette is not installed: ``pip install cyclorama[server]``.

    Examples
    --------
    >>> application("no-such-folder")
    Traceback (most recent call last):
    FileNotFoundError: no-such-folder/manifest.json is not there...
    """
    store = walk if isinstance(walk, Store) else Store(walk)
    try:
        from starlette.applications import Starlette
        from starlette.responses import HTMLResponse, PlainTextResponse, Response
        from starlette.routing import Route
    except ImportError as error:
        raise ImportError("serving a walkthrough needs Starlette: pip install 'cyclorama[server]'") from error
    files = FileCache(store, checked_whole("cache", cache, 0))
    plain = store.source.read(MANIFEST)
    corners = {"knots": store.track.knots.tolist(), "at_knots": store.track.at_knots.tolist()}
    told = json.dumps(store.manifest | corners).encode()

    def answer(request: Request, tag: str, kind: str, content: Any) -> Response:
        headers = {"ETag": f'"{tag}"', "Cache-Control": "no-cache", "X-Content-Type-Options": "nosniff"}
        asked = [word.strip().removeprefix("W/") for word in request.headers.get("if-none-match", "").split(",")]
        if f'"{tag}"' in asked or "*" in asked:
            return Response(status_code=304, headers=headers)
        return Response(content(), media_type=kind, headers=headers)

    def refuse(status: int, text: str) -> Response:
        return PlainTextResponse(text + "\n", status_code=status)

    def home(request: Request) -> Response:
        return HTMLResponse(page("walk"))

    def known(request: Request, kind: str, content: bytes) -> Response:
        return answer(request, hashlib.sha256(content).hexdigest(), kind, lambda: content)

    def walk_script(request: Request) -> Response:
        try:
            return known(request, "text/javascript", script("walk").encode())
        except FileNotFoundError as error:
            return refuse(404, str(error))

    def manifest(request: Request) -> Response:
        return known(request, "application/json", plain)

    def described(request: Request) -> Response:
        return known(request, "application/json", told)

    def file(request: Request) -> Response:
        name = f"{request.path_params['folder']}/{request.path_params['name']}"
        checksum = files.checksum(name)
        if checksum is None:
            return refuse(404, f"{name} is no file of this walkthrough")
        kind = _TYPES.get(Path(name).suffix, "application/octet-stream")
        return answer(request, checksum, kind, lambda: files.read(name))

    def batch(request: Request) -> Response:
        folder = request.path_params["folder"]
        names = [f"{folder}/{name}" for name in request.query_params.get("names", "").split(",")]
        if len(names) > MOST_FILES:
            return refuse(400, f"names are {len(names)} files, at most {MOST_FILES} go in one answer")
        sums = [files.checksum(name) for name in names]
        for name, checksum in zip(names, sums, strict=True):
            if checksum is None:
                return refuse(404, f"{name} is no file of this walkthrough")

        def content() -> bytes:
            return pack({}, {name: np.frombuffer(files.read(name), dtype=np.uint8) for name in names})

        tag = hashlib.sha256("".join(map(str, [*names, *sums])).encode()).hexdigest()
        return answer(request, tag, "application/octet-stream", content)

    def damaged(request: Request, error: Exception) -> Response:
        return refuse(500, f"a file of this walkthrough can't be read: {error}")

    return Starlette(
        routes=[
            Route("/", home),
            Route("/walk.js", walk_script),
            Route(f"/{MANIFEST}", manifest),
            Route("/walk.json", described),
            Route("/batch/{folder}", batch),
            Route("/{folder}/{name}", file),
        ],
        exception_handlers={
            ValueError: damaged,
            404: lambda request, error: refuse(404, f"{request.url.path} is not here"),
            405: lambda request, error: refuse(405, f"{request.method} is not answered here"),
        },
    )


def serve(
    walk: Store | str | os.PathLike[str],
    *,
    host: str = "127.0.0.1",
    port: int = 8437,
    cache: int = 256 << 20,
    open_page: bool = False,
) -> None:
    """Serves a walkthrough until it is stopped (Ctrl-C): the page to walk in is at ``http://127.0.0.1:8437/``.

    Parameters
    ----------
    walk : Store or path
    host : str
        Only this machine by default. Another address shows the walkthrough to all who can reach it.
    port : int
        0 takes one that is free, and says which.
    cache : int
        Bytes of files to keep in memory.
    open_page : bool
        Whether to open the page in a browser.

    Raises
    ------
    ValueError
        As for `application`; or `host` is no text, or `port` no port.
    OSError
        If the port is in use, or the address isn't one of this machine's.
    ImportError
        If Starlette or uvicorn is not installed.
    """
    port = checked_whole("port", port, 0, 65535)
    if not isinstance(host, str):
        raise ValueError(f"host must be a name or an address, got {host!r}")
    app = application(walk, cache=cache)
    try:
        import uvicorn
    except ImportError as error:
        raise ImportError("serving a walkthrough needs uvicorn: pip install 'cyclorama[server]'") from error
    listening = _listen(host, port)
    with listening:
        shown = f"[{host}]" if ":" in host else host
        url = f"http://{shown}:{listening.getsockname()[1]}/"
        print(f"walk in {url} (Ctrl-C ends it)", flush=True)
        if open_page:
            webbrowser.open(url)
        uvicorn.Server(uvicorn.Config(app, log_level="warning")).run(sockets=[listening])


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listening = socket.socket(family, kind, protocol)
    except OSError as error:
        raise OSError(f"{host} is not an address of this machine: {error}") from error
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind(address)
        listening.listen(128)
    except OSError as error:
        listening.close()
        raise OSError(f"{host}:{port} can't be served from: {error.strerror}; give another port") from error
    return listening
