"""The painted backdrops of a plan: layered images in a folder, and frames drawn with them.

The dissertation's section 4.4: images are painted beforehand, in parallel, or when they are first needed; those near
the eye are loaded before they are.
"""

from __future__ import annotations

import hashlib
import heapq
import itertools
import math
import os
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arguments import checked_floats, checked_number
from ..executors import Executor, Team
from ..fingerprint import fingerprint
from ..ldi import LayeredDepthImage
from ..progress import Progress, reporter
from ..scene import Scene
from .drawing import Display, Drawn, Pictures, Splat, draw
from .foreground import Foreground
from .groups import Group, Groups, filled, place
from .notes import Notes
from .painting import WITNESSES, Coloring, Lit, Painted, Placement, Uses, Where, paint_as_paper, paint_group, uses
from .store import Store, size_of

__all__ = ["Backdrops", "plan_fingerprint"]

# Frames asked for, an image: what use an image has is known from a hundred eyes, groups of which have a layered image
# each.
_FRAMES_FOR_ONE = 128


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
        Width and height in pixels of what one frame shows of an image; it has more, if its frames look around.
    construction : int
        The most frames that a layered image is built from.
    max_holes : float
        A layered image takes frames in until of the others none has more of the pixels that show it unknown, or
        `construction` are in it. Then all layers are added of the faces that frames ask it for.
    spread : float
        Eyes and gazes that use an image are divided into groups, each with a layered image of its own, so that none is
        farther from the middle of its group: in radians, of turning or of what moves by parallax.
    max_error : float, optional
        Groups are divided further until the layered image of each, in frames that it was not built from, is no more
        than this off, in grey levels of 255 (`painting.Painted`). A group of a few frames can't be divided: `unmet`
        has those.
    region : (2, 3) array_like of float, optional
        Where eyes will be, lowest and highest coordinates, in the plan's domain; all of it by default. Images are
        painted for those; others see what they can.
    where : {"use", "paper"}
        Where images are taken: amid the eyes that use them, or at the nine places of the dissertation (4.3.2), one
        layered image for each placement.
    spend : bool
        Draw of what an image stands for the nearest as geometry, as far as the budget goes (`foreground`).
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
    notes : Notes

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
        max_holes: float = 0.005,
        spread: float = 0.5,
        max_error: float | None = None,
        region: npt.ArrayLike | None = None,
        where: Where = "use",
        spend: bool = True,
        color: Coloring | None = None,
        memory: int = 1 << 30,
        on_demand: bool = True,
    ) -> None:
        if where not in ("use", "paper"):
            raise ValueError(f"where must be 'use' or 'paper', got {where!r}")
        if not (isinstance(construction, (int, np.integer)) and 0 <= construction <= 254):
            raise ValueError(f"construction must be an integer from 0 to 254, got {construction!r}")
        sides = size if isinstance(size, (tuple, list, np.ndarray)) else ()
        if len(sides) != 2 or not all(isinstance(side, (int, np.integer)) and 1 <= side <= 1 << 15 for side in sides):
            raise ValueError(f"size must be two numbers of pixels, got {size!r}")
        if color is not None and not callable(color):
            raise ValueError(f"color must take a View and give its colours, got {color!r}")
        self._max_holes, self._spread = checked_number("max_holes", max_holes), checked_number("spread", spread)
        self._max_error = None if max_error is None else checked_number("max_error", max_error)
        eyes = checked_floats("region", plan.domain if region is None else region)
        low, high = plan.domain
        if (
            eyes.shape != (2, 3)
            or not (low <= eyes[0]).all()
            or not (eyes[1] <= high).all()
            or (eyes[0] > eyes[1]).any()
        ):
            raise ValueError(
                f"region must be lowest and highest coordinates, (2, 3), in the plan's domain, got {region!r}"
            )
        self.plan, self.scene, self.region = plan, scene, eyes
        # The images of one frame share the pixels of one.
        share = math.sqrt(plan.images_per_frame)
        width, height = (max(1, round(int(side) / share)) for side in size)
        self._size, self._where = (width, height), where
        self._construction = int(construction)
        self._on_demand = on_demand
        self._painting = threading.Lock()
        self.color = color or Lit(plan.whole if plan.lod else scene, plan.up)
        self._uses: Uses | None = None
        identity = {
            "scene": fingerprint(scene),
            "plan": plan_fingerprint(plan),
            "budget": int(plan.budget),
            "color": getattr(self.color, "__qualname__", type(self.color).__qualname__),
            "size": self._size,
            "construction": self._construction,
            "max_holes": self._max_holes,
            "spread": self._spread,
            "max_error": self._max_error,
            "region": eyes.tolist(),
            "where": where,
            "spend": bool(spend),
        }
        count = len(plan.images)
        self.store = Store(LayeredDepthImage.load, size_of, folder, count, identity, memory=memory)
        self.notes = Notes(Path(folder))
        self.foreground = Foreground(plan, scene)
        drawn = self.foreground if spend else None
        self._painter = _Painter(
            plan, scene, drawn, eyes, self._size, where, self._construction, self._max_holes, self.color
        )
        self.pictures = Pictures(plan, scene, self._size, self.color, self.images, drawn)

    @cached_property
    def groups(self) -> Groups:
        """The frames that use each image."""
        return Groups(self.plan, self._used(), self.region)

    def _used(self) -> Uses:
        if self._uses is None:
            self._uses = uses(self.plan, _FRAMES_FOR_ONE * len(self.plan.images), region=self.region)
        return self._uses

    def key(self, group: Group) -> int:
        """Where the store has the layered image of a group."""
        return group.image + len(self.plan.images) * (group.node - 1)

    def make(self, group: Group, threads: int | None = None) -> Painted:
        """Paints a group's layered image, and keeps it nowhere."""
        return self._painter.make(group, threads)

    def image(self, index: int, eye: npt.ArrayLike, gaze: npt.ArrayLike) -> LayeredDepthImage:
        """The layered image of a placement for a frame.

        Raises
        ------
        ValueError
            If its file is cut off or damaged.
        FileNotFoundError
            If it is not painted and may not be painted on demand.
        """
        return next(self.images(index, eye, gaze))

    def images(self, index: int, eye: npt.ArrayLike, gaze: npt.ArrayLike) -> Iterator[LayeredDepthImage]:
        """The layered images of a placement, that of a frame's own group first, then those of others that are painted,
        nearer ones first: what one does not know another may. Raises what `image` does."""
        own = self._own(index, eye, gaze)
        yield self.store.get(own)
        waiting = [(0.0, index)]
        while waiting:
            _, key = heapq.heappop(waiting)
            if self.store.has(key):
                if key != own:
                    yield self.store.get(key)
            elif self._is_divided(key):
                away, halves = self._halves(key, eye, gaze)
                for nearness, half in zip(away, halves, strict=True):
                    heapq.heappush(waiting, (nearness, half))

    def _own(self, key: int, eye: npt.ArrayLike, gaze: npt.ArrayLike) -> int:
        """The image that serves a frame, of those that a group is divided into; painted if it is not and may be."""
        while not self.store.has(key):
            if self._is_divided(key):
                away, halves = self._halves(key, eye, gaze)
                key = halves[int(away[1] < away[0])]
                continue
            if not self._on_demand:
                index = key % len(self.plan.images)
                raise FileNotFoundError(f"image {index} is not painted yet: {self.store.path(key)} is not there")
            # Painting takes all cores: one at a time.
            with self._painting:
                self._settle(self._group(key), None)
        return key

    def _is_divided(self, key: int) -> bool:
        note = self.notes.get(key)
        return note is not None and bool(note["divided"])

    def _halves(self, key: int, eye: npt.ArrayLike, gaze: npt.ArrayLike) -> tuple[list[float], list[int]]:
        """How far a frame is from the halves of a group, and their keys."""
        note = self.notes.get(key)
        assert note is not None
        away = np.linalg.norm(np.subtract(note["halves"], place(eye, gaze, note["scale"])), axis=1)
        count = len(self.plan.images)
        first = key % count + count * (2 * (key // count + 1) - 1)
        return away.tolist(), [first, first + count]

    def _group(self, key: int) -> Group:
        count = len(self.plan.images)
        return self.groups.group(key % count, key // count + 1)

    def _settle(self, group: Group, threads: int | None) -> None:
        """Paints a group's image, or finds that its halves have images instead."""
        key = self.key(group)
        note = self.notes.get(key)
        if self.store.has(key) or (note is not None and note["divided"]):
            return
        self._conclude(group, self.make(group, threads) if self._is_small(group) else None)

    def _is_small(self, group: Group) -> bool:
        """Whether one image may serve a group."""
        return self._where == "paper" or group.spread <= self._spread or not self.groups.can_divide(group)

    def _conclude(self, group: Group, painted: Painted | None) -> list[int]:
        """Keeps a group's image if it is good enough, else notes its halves, and returns their keys."""
        key, groups, limit = self.key(group), self.groups, self._max_error
        if painted is not None and (limit is None or not painted.error > limit or not groups.can_divide(group)):
            found = {"error": painted.error, "holes": painted.holes, "judges": painted.judges}
            self.notes.put(key, {"divided": False, "center": self._center(group), **found})
            self.store.put(key, painted.image)
            return []
        parts = [groups.group(group.image, 2 * group.node + half) for half in (0, 1)]
        halves = [half.middle.tolist() for half in parts]
        self.notes.put(key, {"divided": True, "scale": group.scale, "halves": halves})
        return [self.key(half) for half in parts]

    def leaves(self, index: int) -> list[int]:
        """The images of a placement, by key: those that are there, and those that are to be painted."""
        found, waiting, count = [], [index], len(self.plan.images)
        while waiting:
            key = waiting.pop()
            note = self.notes.get(key)
            if note is not None and note["divided"]:
                first = index + count * (2 * (key // count + 1) - 1)
                waiting.extend((first + count, first))
            else:
                found.append(key)
        return found

    def missing(self) -> list[int]:
        """The placements whose images are not all in the folder.

        Raises
        ------
        ValueError
            If one is cut off.
        """
        every = range(len(self.plan.images))
        return [i for i in every if self.store.missing(self.leaves(i))]

    def unmet(self) -> dict[int, float]:
        """The errors of images over `max_error` whose groups can't be divided, by key: more frames would be needed."""
        if self._max_error is None:
            return {}
        keys = [key for index in range(len(self.plan.images)) for key in self.leaves(index)]
        notes = {key: self.notes.get(key) for key in keys}
        return {key: note["error"] for key, note in notes.items() if note and note.get("error", 0) > self._max_error}

    def paint(self, *, threads: int | None = None, executor: Executor | None = None, progress: Progress = None) -> int:
        """Paints the images that are not there yet, those of a placement with one thread.

        Parameters
        ----------
        threads : int, optional
            Placements painted at a time; all cores by default. The images don't depend on it.
        executor : Executor, optional
            Paints the images in the place of threads; see `cyclorama.executors`. It gets plan and scene, and this
            process writes what comes back into the folder, image by image. A `color` of one's own has to be picklable.
        progress : bool or callable, optional
            One unit is a placement; a bar by default, where somebody watches.

        Returns
        -------
        int
            Of how many placements something was painted. Interrupted or killed, it leaves whole images; the next call
            goes on from there.
        """
        if threads is not None and not (isinstance(threads, (int, np.integer)) and threads >= 1):
            raise ValueError(f"threads must be a whole number of at least 1, or None for all cores, got {threads!r}")
        todo = self.missing()
        done = len(self.plan.images) - len(todo)
        if not todo:
            return 0
        workers = threads or os.cpu_count() or 1

        def paint_one(index: int) -> None:
            while left := self.store.missing(self.leaves(index)):
                self._settle(self._group(left[0]), 1)

        if executor is not None:
            with reporter(progress, len(self.plan.images), "painting") as report:
                self._paint_elsewhere(Team(executor, self._painter), todo, lambda more: report(done + more))
            return len(todo)
        with reporter(progress, len(self.plan.images), "painting") as report:
            pool = ThreadPoolExecutor(workers)
            try:
                report(done)
                for count, future in enumerate(_completed(pool, paint_one, todo, 2 * workers), 1):
                    future.result()
                    report(done + count)
            finally:
                pool.shutdown(cancel_futures=True)
        return len(todo)

    def _paint_elsewhere(self, team: Team, todo: list[int], report: Callable[[int], object]) -> None:
        keys = deque(key for index in todo for key in self.store.missing(self.leaves(index)))
        left = Counter(key % len(self.plan.images) for key in keys)
        under_way: dict[int, Group] = {}

        def conclude(group: Group, painted: Painted | None) -> None:
            halves = self._conclude(group, painted)
            keys.extendleft(reversed(halves))
            left[group.image] += len(halves) - 1
            report(sum(1 for index in todo if left[index] == 0))

        def following() -> Iterator[tuple[Group]]:
            numbers = itertools.count()
            while keys:
                group = self._group(keys.popleft())
                if self._is_small(group):
                    under_way[next(numbers)] = group
                    yield (group,)
                else:
                    conclude(group, None)

        report(0)
        # The last results may bring more.
        while keys:
            for number, painted in team.run(_paint, following()):
                conclude(under_way.pop(number), painted)

    def prefetch(self, eye: npt.ArrayLike) -> None:
        """Loads the images used nearest to an eye, on a background thread, as many as memory holds.

        Parameters
        ----------
        eye : (3,) array_like of float
        """
        keys, centers = self.notes.centers()
        away = np.linalg.norm(centers - np.asarray(eye, np.float64), axis=1)
        self.store.prefetch(keys[np.argsort(away, kind="stable")].tolist())

    def _center(self, group: Group) -> list[float]:
        """Amid the eyes that use a group's image."""
        if len(group.eyes):
            return list(group.eyes.mean(axis=0).tolist())
        return list(self.plan.viewpoints[self.plan.images.viewpoint[group.image]].tolist())

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
        out: Drawn | None = None,
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
        out : Drawn, optional
            A frame of the same size that is not wanted any more: its memory is used again.

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
            out=out,
        )

    def close(self) -> None:
        """Ends the background thread."""
        self.store.close()


@dataclass(frozen=True, eq=False)
class _Painter:
    """All that painting an image takes."""

    plan: Placement
    scene: Scene
    foreground: Foreground | None
    region: npt.NDArray[np.float64]
    size: tuple[int, int]
    where: Where
    construction: int
    max_holes: float
    color: Coloring

    def make(self, group: Group, threads: int | None) -> Painted:
        """Paints a group's layered image."""
        if self.where == "paper" or not len(group.eyes):
            image = paint_as_paper(self.plan, self.scene, group, size=self.size, color=self.color, threads=threads)
            return Painted(image, math.nan, math.nan, 0)
        return paint_group(
            self.plan,
            self.scene,
            filled(group, self.plan, self.region, WITNESSES),
            self.foreground,
            size=self.size,
            construction=self.construction,
            max_holes=self.max_holes,
            color=self.color,
            threads=threads,
        )


def _paint(painter: _Painter, group: Group) -> Painted:
    """A task: a group's layered image."""
    return painter.make(group, 1)


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
