"""A folder of layered images, and those of them that are in memory (1998 dissertation, section 4.4.1).

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
from typing import Any

from ..archives import check_format
from ..files import whole_file
from ..ldi import LayeredDepthImage

__all__ = ["FORMAT", "Store"]

FORMAT = "cyclorama backdrops 1"
MANIFEST = "manifest.json"

# What `LayeredDepthImage` says of itself: bytes of a sample, with what warping adds, and of a pixel.
_SAMPLE, _PIXEL = 18, 4


class Store:
    """Layered images in a folder, by index.

    Parameters
    ----------
    folder : path
        Made if it isn't there.
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
    ...     store = Store(folder, 2, {"scene": "bunny"})
    ...     store.put(1, image)
    ...     store.missing(), store.get(1)
    ([0], <LayeredDepthImage: 2 x 1, 3 samples, 1.50 a pixel>)
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        count: int,
        identity: dict[str, Any],
        *,
        memory: int = 1 << 30,
        make: Callable[[int], LayeredDepthImage] | None = None,
    ) -> None:
        if not (isinstance(memory, int) and memory >= 0):
            raise ValueError(f"memory must be a number of bytes, got {memory!r}")
        self.folder, self.count = Path(folder), count
        self.hits = self.loads = self.made = 0
        self._memory, self._make = memory, make
        self._images: OrderedDict[int, LayeredDepthImage] = OrderedDict()
        self._bytes = 0
        self._lock = threading.Lock()
        self._busy: dict[int, threading.Lock] = {}
        self._wanted: list[int] = []
        self._more = threading.Condition()
        self._thread: threading.Thread | None = None
        self._idle = threading.Event()
        self._idle.set()
        self._closed = False
        self._claim(json.loads(json.dumps({"format": FORMAT, "images": count, **identity})))

    def _claim(self, identity: dict[str, Any]) -> None:
        """Writes the manifest, or compares with the one that is there."""
        path = self.folder / MANIFEST
        self.folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            with whole_file(path) as file:
                file.write(json.dumps(identity, indent=1).encode())
            return
        try:
            found = json.loads(path.read_bytes())
            check_format(found, FORMAT)
        except (ValueError, AttributeError) as error:
            raise ValueError(f"{path} is no whole manifest of backdrops: {error}") from error
        for key in identity.keys() | found.keys():
            if found.get(key) != identity.get(key):
                raise ValueError(
                    f"{self.folder} has backdrops of another {key}: {found.get(key)!r}, not {identity.get(key)!r}; "
                    "paint into another folder, or delete this one"
                )

    def path(self, index: int) -> Path:
        """The file of an image."""
        return self.folder / f"{index:06d}.npz"

    def missing(self) -> list[int]:
        """The images that are not in the folder.

        Raises
        ------
        ValueError
            If one is cut off.
        """
        there = {path.name for path in self.folder.glob("*.npz")}
        for name in sorted(there):
            if not zipfile.is_zipfile(self.folder / name):
                raise ValueError(
                    f"{self.folder / name} is not a whole layered image: delete it, and it will be made again"
                )
        return [index for index in range(self.count) if self.path(index).name not in there]

    def put(self, index: int, image: LayeredDepthImage) -> None:
        """Writes an image to its file."""
        image.save(self.path(index))

    def get(self, index: int) -> LayeredDepthImage:
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

    def _kept(self, index: int) -> LayeredDepthImage | None:
        with self._lock:
            image = self._images.get(index)
            if image is not None:
                self._images.move_to_end(index)
                self.hits += 1
            return image

    def _fetch(self, index: int) -> LayeredDepthImage:
        path = self.path(index)
        if not path.exists() and self._make is not None:
            image = self._make(index)
            self.put(index, image)
            self.made += 1
            return image
        if not path.exists():
            raise FileNotFoundError(f"image {index} is not painted yet: {path} is not there")
        image = LayeredDepthImage.load(path)
        self.loads += 1
        return image

    def _keep(self, index: int, image: LayeredDepthImage) -> None:
        with self._lock:
            self._images[index] = image
            self._bytes += size_of(image)
            while self._bytes > self._memory and len(self._images) > 1:
                _, gone = self._images.popitem(last=False)
                self._bytes -= size_of(gone)

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
                if not self.path(index).exists():
                    continue
                try:
                    image = self.get(index)
                except (ValueError, OSError):
                    continue
            held += size_of(image)
            largest = max(largest, size_of(image))

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
    """Bytes that an image takes in memory once it was warped."""
    return _SAMPLE * image.samples + _PIXEL * image.camera.width * image.camera.height
