"""Portal images: pictures of what lies behind the doors of a room (chapter 6 of the 1998 dissertation).

Each side of each portal has a set of viewpoints (`cyclorama.portals.viewpoints`); what an eye sees through the portal
is shown by the picture from the nearest one. There are three kinds of pictures:

* *static*: flat, on the portal; they are right at their viewpoint alone, so there are many (section 6.3);
* *warped*: with depth, warped to the eye; the nearest one or two are shown (section 6.4);
* *layered*: layered depth images, warped to the eye (section 6.4).

They are painted all beforehand, or each when it is first needed; the painting may be spread over frames.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections import OrderedDict
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from ..archives import read_archive, write_archive
from ..camera import Camera
from ..depth_image import DepthImage
from ..fingerprint import fingerprint
from ..ldi import LayeredDepthImage
from ..placement.painting import Coloring, Lit, picture
from ..placement.store import Store, size_of
from ..placing import camera_through
from ..progress import Progress, reporter
from .viewpoints import Side, angle_range, construction_viewpoints, eyes_before, grid, nearest, semicircle, sides

if TYPE_CHECKING:
    from .building import Building

__all__ = ["KINDS", "STRATEGIES", "Deadline", "Flat", "Kind", "PortalImages", "Strategy"]

Floats = npt.NDArray[np.float64]

#: What stands in for a portal's view.
Kind = Literal["static", "warped", "layered"]
KINDS: tuple[Kind, ...] = ("static", "warped", "layered")

#: How viewpoints are chosen (6.2.2).
Strategy = Literal["semicircle", "grid", "single"]
STRATEGIES: tuple[Strategy, ...] = ("semicircle", "grid", "single")

# Degrees between images, and the spans that they are taken over (6.3.3.1 and 6.4.2); layered images hold what is seen
# from both sides, and do with fewer.
_STEP: dict[Kind, float] = {"static": 1.0, "warped": 10.0, "layered": 15.0}
_SPANS: dict[Kind, tuple[float, ...] | None] = {"static": None, "warped": (60.0, 120.0), "layered": (60.0, 120.0)}

# Distance from a portal at which it becomes geometry, and the sampling distance where no eye is farther away, as shares
# of the portal's diagonal.
_TRANSITION, _SAMPLING = 0.5, 1.0

# Images whose painting has begun and waits for the next frame; older ones are given up.
_BEGUN = 4

# Share of the samples that may lie beyond each border of a layered image, and how many times as wide it may be as the
# view through the portal.
_OUTSIDE, _WIDER = 0.0005, 3

# What one portal may have of its own.
_EACH = ("angles", "sampling_distance", "transition_distance", "viewing_height")

FLAT = "cyclorama portal image 1"


@dataclass(frozen=True, eq=False)
class Flat:
    """A picture without depth, and the camera that took it; 3 bytes a pixel.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
    camera : Camera
    """

    color: npt.NDArray[np.uint8]
    camera: Camera

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an ``.npz``; the name keeps what it had until all is written."""
        camera = self.camera
        header = {"size": (camera.width, camera.height), "near": camera.near}
        arrays: dict[str, npt.NDArray[Any]] = {
            "color": self.color,
            "K": camera.K,
            "world_to_camera": camera.world_to_camera,
        }
        write_archive(path, FLAT, header, arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Flat:
        """Reads what `save` wrote.

        Raises
        ------
        ValueError
            If the file is cut off, damaged or something else.
        """
        with read_archive(path, FLAT, "portal image") as (header, file):
            camera = Camera(file["K"], file["world_to_camera"], *header["size"], near=header["near"])
            color = file["color"]
            if color.shape != (camera.height, camera.width, 3) or color.dtype != np.uint8:
                raise ValueError(f"its color is {color.shape} {color.dtype}")
            return cls(color, camera)


def _bytes(image: Flat | DepthImage | LayeredDepthImage) -> int:
    if isinstance(image, Flat):
        return image.color.nbytes
    if isinstance(image, LayeredDepthImage):
        return size_of(image)
    return image.color.nbytes + image.disparity.nbytes + image.depth.nbytes + image.missing.nbytes


_LOAD: dict[Kind, Callable[[Path], Any]] = {
    "static": Flat.load,
    "warped": DepthImage.load,
    "layered": LayeredDepthImage.load,
}


class Deadline:
    """When the painting of a frame ends; at least one picture is taken.

    Parameters
    ----------
    max_ms : float
        Milliseconds from now on.
    """

    def __init__(self, max_ms: float) -> None:
        if not max_ms >= 0:
            raise ValueError(f"max_ms must be at least 0 milliseconds, got {max_ms}")
        self.begun = False
        self._until = time.perf_counter() + max_ms / 1e3

    def over(self) -> bool:
        return self.begun and time.perf_counter() >= self._until


class PortalImages:
    """The images of all portals of a building.

    Parameters
    ----------
    building : Building
    kind : {"static", "warped", "layered"}
    up : (3,) array_like of float
        Of the building.
    strategy : {"semicircle", "grid", "single"}
        Where images are taken: on a semicircle at eye height before each side of a portal; all over the space before
        it; or once, facing it.
    viewing_height : float, optional
        Of eyes above the lower edge of a portal; three quarters of its own height by default.
    sampling_distance : float, optional
        Of viewpoints from the middle of a portal. By default the median distance of the eyes at that height that see
        it, in its cell, beyond the transition distance.
    transition_distance : float, optional
        From a portal, at which it becomes geometry; half its diagonal by default.
    angles : sequence of float, optional
        Of the viewpoints on the semicircle, in degrees to the right of where an eye faces the portal. By default they
        cover those from which it is seen: static images every degree over 30 to 120 of them, the other ones over 60 or
        120, warped images every 10 degrees and layered ones every 15.
    step : float, optional
        Degrees between images, instead.
    references : int
        How many warped images are shown at a time, one drawn over the other.
    size : (int, int)
        Of an image in pixels.
    each : mapping of int to mapping, optional
        For some portals, by index, other ``angles``, ``sampling_distance``, ``transition_distance``,
        ``viewing_height``.
    color : callable, optional
        Gives a view's colours, for images and geometry alike (`placement.painting.Lit` by default). A folder knows it
        by its name.
    folder : path, optional
        Where images are kept, and found again.
    memory : int
        Bytes of images to keep in memory; without a folder the rest is forgotten, and painted again when needed.

    Attributes
    ----------
    sides : list of Side
        Two for each portal.
    viewpoints : list of (N, 3) ndarray of float64
        Of each side's images.
    transition_distances, sampling_distances : (S,) ndarray of float64
        Of each side.
    store : Store
        The images, numbered side by side.

    Raises
    ------
    ValueError
        If an argument is none of the above, or the folder has other images.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> home = cyc.scenes.house(rooms=3, seed=1)
    >>> building = cyc.portals.Building(home, home.cells, home.portals)
    >>> images = PortalImages(building, "warped", size=(32, 32))
    >>> {len(viewpoints) for viewpoints in images.viewpoints} <= {7, 13}
    True
    """

    def __init__(
        self,
        building: Building,
        kind: Kind = "static",
        *,
        up: npt.ArrayLike = (0.0, 1.0, 0.0),
        strategy: Strategy = "semicircle",
        viewing_height: float | None = None,
        sampling_distance: float | None = None,
        transition_distance: float | None = None,
        angles: Sequence[float] | None = None,
        step: float | None = None,
        references: int = 2,
        size: tuple[int, int] = (256, 256),
        each: Mapping[int, Mapping[str, Any]] | None = None,
        color: Coloring | None = None,
        folder: str | os.PathLike[str] | None = None,
        memory: int = 1 << 28,
    ) -> None:
        if kind not in KINDS:
            raise ValueError(f"kind must be one of {KINDS}, got {kind!r}")
        if strategy not in STRATEGIES:
            raise ValueError(f"strategy must be one of {STRATEGIES}, got {strategy!r}")
        upright = np.asarray(up, np.float64)
        if upright.shape != (3,) or not (np.isfinite(upright).all() and np.linalg.norm(upright) > 0):
            raise ValueError(f"up must be three finite numbers, not all zero, got {up!r}")
        if not (isinstance(references, (int, np.integer)) and 1 <= references <= 8):
            raise ValueError(f"references must be an integer from 1 to 8, got {references!r}")
        if len(size) != 2 or not all(isinstance(side, (int, np.integer)) and 1 <= side <= 1 << 15 for side in size):
            raise ValueError(f"size must be two numbers of pixels, got {size!r}")
        if step is not None and not (np.isfinite(step) and 0 < step <= 180):
            raise ValueError(f"step must lie in (0, 180] degrees, got {step}")
        self.building, self.kind, self.up = building, kind, upright / np.linalg.norm(upright)
        self.references = int(references) if kind == "warped" else 1
        self.size = (int(size[0]), int(size[1]))
        self.color = color or Lit(building.scene, self.up)
        self._step = _STEP[kind] if step is None else float(step)
        common = {
            "angles": angles,
            "sampling_distance": sampling_distance,
            "transition_distance": transition_distance,
            "viewing_height": viewing_height,
        }
        self._place(strategy, common, each or {})
        self._jobs: OrderedDict[int, Generator[None, None, Any]] = OrderedDict()
        self.painted = 0
        identity = {
            "scene": fingerprint(building.scene),
            "portals": self._fingerprint(),
            "kind": kind,
            "size": self.size,
            "color": getattr(self.color, "__qualname__", type(self.color).__qualname__),
        }
        self.store: Store[Any] = Store(
            _LOAD[kind], _bytes, folder, self._first[-1], identity, memory=memory, make=self.make
        )

    def _place(self, strategy: Strategy, common: dict[str, Any], each: Mapping[int, Mapping[str, Any]]) -> None:
        """Finds the viewpoints of all sides."""
        for index, options in each.items():
            if not (isinstance(index, (int, np.integer)) and 0 <= index < len(self.building.portals)):
                raise ValueError(f"each names portal {index!r}, there are {len(self.building.portals)}")
            for name in options:
                if name not in _EACH:
                    raise ValueError(f"each[{index}] has {name!r}, a portal has {_EACH}")
        found = sides(self.building, self.up, common["viewing_height"])
        self.sides: list[Side] = []
        self.viewpoints: list[Floats] = []
        self._spacing: list[float | None] = []
        transitions, samplings = [], []
        for number, side in enumerate(found):
            own = {**common, **each.get(side.portal, {})}
            where = f"each[{side.portal}]." if side.portal in each else ""
            for name in ("viewing_height", "sampling_distance", "transition_distance"):
                _check_length(where + name, own[name], zero=name == "transition_distance")
            if own["viewing_height"] != common["viewing_height"]:
                side = sides(self.building, self.up, own["viewing_height"])[number]
            transition = own["transition_distance"]
            transition = _TRANSITION * side.size if transition is None else float(transition)
            wanted = None if own["angles"] is None else _angles(where + "angles", own["angles"])
            automatic = own["sampling_distance"] is None or (wanted is None and strategy == "semicircle")
            eyes = eyes_before(self.building, side, transition) if automatic else np.empty((0, 3))
            sampling = own["sampling_distance"]
            if sampling is None:
                away = np.linalg.norm(eyes - side.center, axis=1)
                sampling = float(np.median(away)) if len(eyes) else max(_SAMPLING * side.size, transition)
            if strategy == "grid":
                points, spacing = grid(side, sampling), None
            elif strategy == "single":
                points, spacing = semicircle(side, [0.0], sampling), None
            else:
                if wanted is None:
                    low, high = angle_range(side, eyes, _SPANS[self.kind])
                    count = max(round((high - low) / self._step), 1)
                    wanted = np.linspace(low, high, count + 1)
                points, spacing = semicircle(side, wanted, sampling), self._step
            self.sides.append(side)
            self.viewpoints.append(points)
            self._spacing.append(spacing)
            transitions.append(transition)
            samplings.append(float(sampling))
        self.transition_distances, self.sampling_distances = np.array(transitions), np.array(samplings)
        self._first: list[int] = np.cumsum([0, *(len(points) for points in self.viewpoints)]).tolist()
        self._number = {(side.portal, side.place): number for number, side in enumerate(self.sides)}

    def _fingerprint(self) -> str:
        digest = hashlib.blake2b(digest_size=16)
        for side, points, spacing in zip(self.sides, self.viewpoints, self._spacing, strict=True):
            digest.update(side.corners.tobytes() + points.tobytes() + str(spacing).encode())
        return digest.hexdigest()

    def __len__(self) -> int:
        """How many images there are when all are painted."""
        return self._first[-1]

    def __repr__(self) -> str:
        return f"<PortalImages: {len(self):,} {self.kind} images of {len(self.sides)} sides of portals>"

    def number(self, portal: int, place: int) -> int:
        """The index in `sides` of a portal seen from a cell."""
        return self._number[portal, place]

    def side_of(self, index: int) -> int:
        """The side that an image belongs to."""
        return int(np.searchsorted(self._first, index, "right")) - 1

    def viewpoint(self, index: int) -> Floats:
        """(3,) where an image is taken."""
        number = self.side_of(index)
        return np.asarray(self.viewpoints[number][index - self._first[number]])

    def camera(self, index: int) -> Camera:
        """The camera of an image, or of a layered image's central one: its near plane is the portal."""
        return camera_through(self.viewpoint(index), self.sides[self.side_of(index)].corners, self.size, clip=True)

    def best(self, number: int, eye: npt.ArrayLike, count: int = 1) -> npt.NDArray[np.int64]:
        """The images of a side that show it most as an eye sees it, by angle at its middle; the nearest first."""
        at = np.asarray(eye, np.float64)
        first: int = self._first[number]
        return first + nearest(self.sides[number], self.viewpoints[number], at, count)

    def _steps(self, index: int, threads: int | None) -> Generator[None, None, Any]:
        """Paints an image, a picture at a time."""
        scene, central = self.building.scene, self.camera(index)
        first = picture(scene, central, None, self.color, threads=threads)
        if self.kind == "static":
            return Flat(first.color, central)
        if self.kind == "warped":
            return first
        number = self.side_of(index)
        side, spacing, least = self.sides[number], self._spacing[number], self.transition_distances[number]
        others = []
        for place in construction_viewpoints(side, self.viewpoint(index), spacing, float(least)):
            yield
            camera = camera_through(place, side.corners, self.size, clip=True)
            others.append(picture(scene, camera, None, self.color, threads=threads))
        yield
        return LayeredDepthImage.build(_frame([first, *others]), [first, *others], threads=threads)

    def make(self, index: int, threads: int | None = None) -> Any:
        """Paints one image, and keeps it nowhere."""
        steps = self._steps(index, threads)
        while True:
            try:
                next(steps)
            except StopIteration as done:
                self.painted += 1
                return done.value

    def paint(self, *, threads: int | None = None, progress: Progress = None) -> int:
        """Paints the images that are not there yet.

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
        if not todo:
            return 0

        def paint_one(index: int) -> None:
            self.store.put(index, self.make(index, threads=1))

        workers = threads or os.cpu_count() or 1
        with reporter(progress, len(self), "painting") as report:
            pool = ThreadPoolExecutor(workers)
            try:
                done = len(self) - len(todo)
                report(done)
                # A few at a time, so that Ctrl-C doesn't wait for all.
                for first in range(0, len(todo), 4 * workers):
                    part = todo[first : first + 4 * workers]
                    list(pool.map(paint_one, part))
                    done += len(part)
                    report(done)
            finally:
                pool.shutdown(cancel_futures=True)
        return len(todo)

    def ready(
        self, number: int, eye: npt.ArrayLike, deadline: Deadline | None = None, threads: int | None = None
    ) -> list[int]:
        """The images by which a side is shown to an eye: the best ones, or until these are painted the best there are.

        Parameters
        ----------
        number : int
            Of the side.
        eye : (3,) array_like of float
        deadline : Deadline, optional
            When to stop painting; by default the best ones are painted when they are asked for.
        threads : int, optional

        Returns
        -------
        list of int
            By index, the nearest first; empty if there is none yet.
        """
        best: list[int] = self.best(number, eye, self.references).tolist()
        if deadline is None:
            return best
        self._work([index for index in best if not self.store.has(index)], deadline, threads)
        if all(self.store.has(index) for index in best):
            return best
        every: list[int] = self.best(number, eye, len(self.viewpoints[number])).tolist()
        return [index for index in every if self.store.has(index)][: self.references]

    def _work(self, wanted: list[int], deadline: Deadline, threads: int | None) -> None:
        for index in wanted:
            if deadline.over():
                return
            job = self._jobs.setdefault(index, self._steps(index, threads))
            self._jobs.move_to_end(index)
            while len(self._jobs) > _BEGUN:
                self._jobs.popitem(last=False)
            while True:
                deadline.begun = True
                try:
                    next(job)
                except StopIteration as done:
                    self.store.put(index, done.value)
                    self.painted += 1
                    del self._jobs[index]
                    break
                if deadline.over():
                    return

    def nbytes(self) -> int:
        """What all images of this kind take in memory; layered ones as those do that are there."""
        width, height = self.size
        if self.kind == "static":
            return 3 * width * height * len(self)
        if self.kind == "warped":
            return 12 * width * height * len(self)
        there = [index for index in range(len(self)) if self.store.has(index)]
        return round(float(np.mean([_bytes(self.store.get(index)) for index in there])) * len(self)) if there else 0

    def close(self) -> None:
        """Ends what the store does in the background."""
        self.store.close()


def _frame(images: Sequence[DepthImage]) -> DepthImage:
    """An image without samples at the first one's viewpoint, whose pixels are as large, that holds what all saw.

    Through the portal itself the viewpoint sees less than eyes beside it do.
    """
    camera = images[0].camera
    turn, focal = camera.world_to_camera[:3, :3], np.diag(camera.K)[:2]
    points = np.concatenate([(image.points()[image.disparity > 0] - camera.eye) @ turn.T for image in images])
    slopes = points[:, :2] / points[:, 2:]
    own = np.array([-camera.K[:2, 2], np.array([camera.width, camera.height]) - camera.K[:2, 2]]) / focal
    beyond = np.quantile(slopes, [_OUTSIDE, 1 - _OUTSIDE], axis=0) if len(slopes) else own
    low, high = np.minimum(own[0], beyond[0]), np.maximum(own[1], beyond[1])
    size = np.minimum(np.ceil((high - low) * focal), _WIDER * np.array([camera.width, camera.height]))
    K = np.diag([*(size / (high - low)), 1.0])
    K[:2, 2] = -low * np.diag(K)[:2]
    width, height = (int(side) for side in size)
    wide = camera.replace(K=K, width=width, height=height)
    nothing = np.ones((height, width), np.bool_)
    return DepthImage(np.zeros((height, width, 3), np.uint8), np.full((height, width), np.inf), wide, missing=nothing)


def _check_length(name: str, value: float | None, *, zero: bool) -> None:
    if value is not None and not (np.isfinite(value) and (value > 0 or (zero and value == 0))):
        raise ValueError(f"{name} must be {'at least 0' if zero else 'positive'} and finite, got {value}")


def _angles(name: str, value: Sequence[float]) -> Floats:
    angles = np.asarray(value, np.float64)
    if angles.ndim != 1 or not len(angles):
        raise ValueError(f"{name} must be (N,) degrees, at least one, got shape {angles.shape}")
    for index in np.flatnonzero(~(np.abs(angles) < 90)):
        raise ValueError(f"{name}[{index}] is {angles[index]}: a portal is seen from angles between -90 and 90 degrees")
    return angles
