"""A folder of images, and those of them that are in memory (1998 dissertation, section 4.4.1).

An image is a file, written whole or not there; a manifest says which scene and which plan they belong to. What was used
last stays in memory, up to a limit; a thread loads what will be wanted next.
"""

from __future__ import annotations

import json
import os
import threading
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from ..archives import check_format
from ..files import whole_file
from ..ldi import LayeredDepthImage

__all__ = ["FORMAT", "Store", "size_of"]

FORMAT = "cyclorama backdrops 1"
MANIFEST = "manifest.json"

# What `LayeredDepthImage` says of itself: bytes of a sample, with what warping adds, and of a pixel.
_SAMPLE, _PIXEL = 18, 4


class Saved(Protocol):
    """What can be written to a file."""

    def save(self, path: str | os.PathLike[str]) -> None: ...


Image = TypeVar("Image", bound=Saved)


class Store(Generic[Image]):
    """Images in a folder, by index.

    Parameters
    ----------
    load : callable
        Reads what an image's `save` wrote: ``LayeredDepthImage.load``.
    size_of : callable
        The bytes that an image takes in memory: `size_of` of a layered one.
    folder : path or None
        Made if it isn't there. None: what doesn't fit in memory is forgotten, and made again.
    count : int
        How many images there are when all are made.
    identity : dict
        What the images depend on, as JSON has it. A folder that was made for anything else is refused.
    memory : int
        Bytes of images to keep in memory; at least one is kept whatever it takes.
    make : callable, optional
        Makes the image of an index: on demand, where it is not in the folder yet.

    Attributes
    ----------
    folder : Path
    count : int
    hits, loads, made : int
        How often an image was in memory, was loaded, and was made on demand.

    Raises
    ------
    ValueError
        If the folder is of something else; the message says what differs.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from cyclorama import Camera
    >>> camera = Camera.look_at((0, 0, 4), (0, 0, 0), width=2, height=1)
    >>> image = LayeredDepthImage(camera, [0, 2, 3], np.zeros((3, 3), np.uint8), [0.5, 0.25, 1.0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store = Store(LayeredDepthImage.load, size_of, folder, 2, {"scene": "bunny"})
    ...     store.put(1, image)
    ...     store.missing(), store.get(1)
    ([0], <LayeredDepthImage: 2 x 1, 3 samples, 1.50 a pixel>)
    """

    def __init__(
        self,
        load: Callable[[Path], Image],
        size_of: Callable[[Image], int],
        folder: str | os.PathLike[str] | None,
        count: int,
        identity: dict[str, Any],
        *,
        memory: int = 1 << 30,
        make: Callable[[int], Image] | None = None,
    ) -> None:
        if not (isinstance(memory, int) and memory >= 0):
            raise ValueError(f"memory must be a number of bytes, got {memory!r}")
        self._load, self._size_of = load, size_of
        self.folder, self.count = None if folder is None else Path(folder), count
        self.hits = self.loads = self.made = 0
        self._memory, self._make = memory, make
        self._images: OrderedDict[int, Image] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()
        self._busy: dict[int, threading.Lock] = {}
        self._wanted: list[int] = []
        self._more = threading.Condition()
        self._thread: threading.Thread | None = None
        self._idle = threading.Event()
        self._idle.set()
        self._closed = False
        if self.folder is not None:
            self._claim(self.folder, json.loads(json.dumps({"format": FORMAT, "images": count, **identity})))

    @staticmethod
    def _claim(folder: Path, identity: dict[str, Any]) -> None:
        """Writes the manifest, or compares with the one that is there."""
        path = folder / MANIFEST
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            with whole_file(path) as file:
                file.write(json.dumps(identity, indent=1).encode())
            return
        try:
            found = json.loads(path.read_bytes())
            check_format(found, FORMAT)
        except (ValueError, AttributeError) as error:
            raise ValueError(f"{path} is no whole manifest of backdrops: {error}") from error
        for key in identity | found:
            if found.get(key) != identity.get(key):
                raise ValueError(
                    f"{folder} has backdrops of another {key}: {found.get(key)!r}, not {identity.get(key)!r}; "
                    "paint into another folder, or delete this one"
                )

    def path(self, index: int) -> Path | None:
        """The file of an image; None without a folder."""
        return None if self.folder is None else self.folder / f"{index:06d}.npz"

    def has(self, index: int) -> bool:
        """Whether an image is in memory or in the folder."""
        path = self.path(index)
        with self._lock:
            return index in self._images or (path is not None and path.exists())

    def missing(self, indices: Iterable[int] | None = None) -> list[int]:
        """Those of some images, of all by default, that are not in the folder; without one, not in memory.

        Raises
        ------
        ValueError
            If one is cut off.
        """
        gone = []
        for index in range(self.count) if indices is None else indices:
            path = self.path(index)
            if not self.has(index):
                gone.append(index)
            elif path is not None and path.exists() and not zipfile.is_zipfile(path):
                raise ValueError(f"{path} is not a whole image: delete it, and it will be made again")
        return gone

    def put(self, index: int, image: Image) -> None:
        """Writes an image to its file; without a folder, keeps it in memory."""
        path = self.path(index)
        if path is None:
            self._keep(index, image)
        else:
            image.save(path)

    def get(self, index: int) -> Image:
        """An image, from memory, else from its file, else made.

        Raises
        ------
        ValueError
            If its file is cut off or damaged.
        FileNotFoundError
            If there is none, and none can be made.
        """
        image = self._kept(index)
        if image is not None:
            return image
        with self._lock:
            busy = self._busy.setdefault(index, threading.Lock())
        # Two that want the same image load it once.
        with busy:
            image = self._kept(index)
            if image is None:
                image = self._fetch(index)
                self._keep(index, image)
        return image

    def _kept(self, index: int) -> Image | None:
        with self._lock:
            image = self._images.get(index)
            if image is not None:
                self._images.move_to_end(index)
                self.hits += 1
            return image

    def _fetch(self, index: int) -> Image:
        path = self.path(index)
        if path is not None and path.exists():
            image = self._load(path)
            self.loads += 1
            return image
        if self._make is None:
            raise FileNotFoundError(f"image {index} is not painted yet: {path or 'it'} is not there")
        image = self._make(index)
        if path is not None:
            image.save(path)
        self.made += 1
        return image

    def _keep(self, index: int, image: Image) -> None:
        with self._lock:
            before = self._images.pop(index, None)
            if before is not None:
                self._bytes -= self._size_of(before)
            self._images[index] = image
            self._bytes += self._size_of(image)
            while self._bytes > self._memory and len(self._images) > 1:
                _, gone = self._images.popitem(last=False)
                self._bytes -= self._size_of(gone)

    @property
    def in_memory(self) -> tuple[int, ...]:
        """The images in memory, the one that was used last at the end."""
        with self._lock:
            return tuple(self._images)

    @property
    def bytes_in_memory(self) -> int:
        """What they take, with what warping them adds."""
        return self._bytes

    def prefetch(self, order: Iterable[int]) -> None:
        """Loads images on a background thread, until the limit is reached; a later call takes the place of this one.

        Parameters
        ----------
        order : iterable of int
            The most wanted first. Those without a file are passed over; so are broken ones, which `get` will tell of.
        """
        if self._closed:
            raise ValueError("the store is closed")
        with self._more:
            self._wanted = list(order)
            self._idle.clear()
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="prefetch", daemon=True)
                self._thread.start()
            self._more.notify()

    def _work(self) -> None:
        while True:
            with self._more:
                self._more.wait_for(lambda: bool(self._wanted) or self._closed)
                if self._closed:
                    return
                order, self._wanted = self._wanted, []
            self._load_all(order)
            with self._more:
                if not self._wanted:
                    self._idle.set()

    def _load_all(self, order: list[int]) -> None:
        # Whatever is wanted more than the next one stays: it counts as used before that is loaded.
        held = largest = 0
        for index in order:
            if self._closed or self._wanted:
                return
            if held + largest > self._memory:
                return
            with self._lock:
                image = self._images.get(index)
                if image is not None:
                    self._images.move_to_end(index)
            if image is None:
                if not self.has(index):
                    continue
                try:
                    image = self.get(index)
                except (ValueError, OSError):
                    continue
            held += self._size_of(image)
            largest = max(largest, self._size_of(image))

    def wait(self, seconds: float | None = None) -> bool:
        """Waits until what was to be prefetched is there, for so long at most; whether it is."""
        return self._idle.wait(seconds)

    def close(self) -> None:
        """Ends the background thread."""
        with self._more:
            self._closed = True
            self._more.notify()
        if self._thread is not None:
            self._thread.join()


def size_of(image: LayeredDepthImage) -> int:
    """Bytes that a layered image takes in memory once it was warped."""
    return _SAMPLE * image.samples + _PIXEL * image.camera.width * image.camera.height
