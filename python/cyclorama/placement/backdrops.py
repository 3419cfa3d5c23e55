"""The painted backdrops of a plan: layered images in a folder, and frames drawn with them.

The dissertation's section 4.4: images are painted beforehand, in parallel, or when they are first needed; those near
the eye are loaded before they are.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import Any

import numpy as np
import numpy.typing as npt

from ..fingerprint import fingerprint
from ..ldi import LayeredDepthImage
from ..progress import Progress, reporter
from ..scene import Scene
from .drawing import Display, Drawn, Pictures, Splat, draw
from .painting import Coloring, Lit, Placement, Uses, Where, paint_image, uses
from .store import Store, size_of

__all__ = ["Backdrops", "plan_fingerprint"]

# Frames asked for, an image: what use an image has is known from a few dozen eyes, groups of which have a construction
# image each.
_FRAMES_FOR_ONE = 64


class Backdrops:
    """Layered images of all placements of a plan, on disk, and what they show.

    Parameters
    ----------
    plan : Plan
    scene : Scene
        What the plan was made for.
    folder : path
        Where the images are, or will be.
    size : (int, int)
        Width and height of an image in pixels.
    construction : int
        Construction images for each.
    where : {"use", "paper"}
        Where they are taken: amid the eyes that use the image, or at the eight places of the dissertation (4.3.2).
    color : callable, optional
        Takes a `View` and gives its colours (H, W, 3) uint8, for images and geometry alike. By default the scene's,
        lit the same from everywhere (`painting.Lit`). A folder knows it by its name.
    memory : int
        Bytes of images to keep in memory.
    on_demand : bool
        Paint an image that is not there when it is needed, instead of refusing.

    Attributes
    ----------
    store : Store

    Raises
    ------
    ValueError
        If an argument is none of the above, or the folder has backdrops of another scene, plan or size.
    """

    def __init__(
        self,
        plan: Placement,
        scene: Scene,
        folder: str | os.PathLike[str],
        *,
        size: tuple[int, int] = (512, 384),
        construction: int = 16,
        where: Where = "use",
        color: Coloring | None = None,
        memory: int = 1 << 30,
        on_demand: bool = True,
    ) -> None:
        if where not in ("use", "paper"):
            raise ValueError(f"where must be 'use' or 'paper', got {where!r}")
        if not (isinstance(construction, (int, np.integer)) and 0 <= construction <= 254):
            raise ValueError(f"construction must be an integer from 0 to 254, got {construction!r}")
        if len(size) != 2 or not all(isinstance(side, (int, np.integer)) and 1 <= side <= 1 << 15 for side in size):
            raise ValueError(f"size must be two numbers of pixels, got {size!r}")
        self.plan, self.scene = plan, scene
        width, height = size
        self._options: dict[str, Any] = {
            "size": (int(width), int(height)),
            "construction": int(construction),
            "where": where,
        }
        self.color = color or Lit(scene, plan.up)
        self._uses: Uses | None = None
        identity = {
            "scene": fingerprint(scene),
            "plan": plan_fingerprint(plan),
            "color": getattr(self.color, "__qualname__", type(self.color).__qualname__),
            **self._options,
        }
        count = len(plan.images)
        self.store = Store(
            LayeredDepthImage.load,
            size_of,
            folder,
            count,
            identity,
            memory=memory,
            make=self.make if on_demand else None,
        )
        self.pictures = Pictures(plan, scene, (int(width), int(height)), self.color, self.store.get)

    def make(self, index: int, threads: int | None = None) -> LayeredDepthImage:
        """Paints one image, and keeps it nowhere."""
        return paint_image(
            self.plan, self.scene, index, self._used(), color=self.color, threads=threads, **self._options
        )

    def _used(self) -> Uses:
        if self._uses is None:
            self._uses = uses(self.plan, _FRAMES_FOR_ONE * len(self.plan.images))
        return self._uses

    def paint(self, *, threads: int | None = None, progress: Progress = None) -> int:
        """Paints the images that are not there yet, each with one thread.

        Parameters
        ----------
        threads : int, optional
            Images painted at a time; all cores by default. The images don't depend on it.
        progress : bool or callable, optional
            One unit is an image; a bar by default, where somebody watches.

        Returns
        -------
        int
            How many were painted. Interrupted, it leaves whole images; the next call goes on from there.
        """
        todo = self.store.missing()
        done = self.store.count - len(todo)
        if not todo:
            return 0
        self._used()
        workers = threads or os.cpu_count() or 1

        def paint_one(index: int) -> None:
            self.store.put(index, self.make(index, threads=1))

        with reporter(progress, self.store.count, "painting") as report:
            pool = ThreadPoolExecutor(workers)
            try:
                report(done)
                for count, future in enumerate(_completed(pool, paint_one, todo, 2 * workers), 1):
                    future.result()
                    report(done + count)
            finally:
                pool.shutdown(cancel_futures=True)
        return len(todo)

    def prefetch(self, eye: npt.ArrayLike) -> None:
        """Loads the images of the viewpoints nearest to an eye, on a background thread, as many as memory holds.

        Parameters
        ----------
        eye : (3,) array_like of float
        """
        away = np.linalg.norm(self.plan.viewpoints - np.asarray(eye, np.float64), axis=1)
        self.store.prefetch(np.argsort(away[self.plan.images.viewpoint], kind="stable").tolist())

    def draw(
        self,
        eye: npt.ArrayLike,
        forward: npt.ArrayLike,
        size: tuple[int, int] = (510, 480),
        *,
        display: Display = "ldi",
        splat: Splat | None = None,
        warp_size: tuple[int, int] | None = None,
        prefetch: bool = True,
        threads: int | None = None,
    ) -> Drawn:
        """The composed picture of an eye: geometry, and the backdrop where that is nearer.

        Parameters
        ----------
        eye, forward : (3,) array_like of float
            Position and gaze, as for `Plan.frame`.
        size : (int, int)
            Of the picture in pixels. Its field of view is the plan's, whatever the shape of the pixels.
        display : {"ldi", "warp", "mesh", "quad", "geometry"}
            What stands for the culled geometry (section 1.4.1): "ldi" the layered image; "warp" one image with depth,
            taken at the viewpoint; "mesh" the same as a depth mesh; "quad" the same as a flat, opaque quadrilateral;
            "geometry" the quadrilateral, with the geometry beyond its plane bent to it (chapter 5). All but the first
            render their one image when it is first needed.
        splat : int or "projected", optional
            What a sample covers, for "ldi" and "warp": a square of so many pixels a side, odd, or a rectangle as large
            as it appears. By default that for "ldi" and 3 x 3 for "warp", as the dissertation has it.
        warp_size : (int, int), optional
            Warp a smaller picture and scale it up (section 4.4.3); `size` by default.
        prefetch : bool
            Load the images of viewpoints nearby on a background thread.
        threads : int, optional
            All cores by default. The picture doesn't depend on it.

        Returns
        -------
        Drawn

        Raises
        ------
        ValueError
            If an argument is none of the above, the plan doesn't serve this eye and gaze, or an image's file is broken.
        FileNotFoundError
            If an image is not painted and may not be painted on demand.
        """
        if prefetch and display == "ldi":
            self.prefetch(eye)
        return draw(
            self.pictures,
            eye,
            forward,
            size,
            display=display,
            splat=splat,
            warp_size=warp_size,
            threads=threads,
        )

    def close(self) -> None:
        """Ends the background thread."""
        self.store.close()


def _completed(pool: ThreadPoolExecutor, job: Any, items: list[int], ahead: int) -> Iterator[Any]:
    """Futures as they end, no more than `ahead` waiting, so that an interruption has little to wait for."""
    left, running = iter(items), set()
    for item in left:
        running.add(pool.submit(job, item))
        if len(running) >= ahead:
            ended, running = wait(running, return_when=FIRST_COMPLETED)
            yield from ended
    while running:
        ended, running = wait(running, return_when=FIRST_COMPLETED)
        yield from ended


def plan_fingerprint(plan: Placement) -> str:
    """32 hexadecimal digits that depend on every viewpoint, every image and the field of view."""
    digest = hashlib.blake2b(digest_size=16)
    images = plan.images
    for array in (plan.viewpoints, images.corners, images.forward, [plan.fov_x, plan.aspect], plan.up):
        # `+ 0.0` makes -0.0 and 0.0, which are the same place, the same bytes.
        digest.update((np.asarray(array, dtype="<f8") + 0.0).tobytes())
    digest.update(np.asarray(images.viewpoint, dtype="<i8").tobytes())
    return digest.hexdigest()
