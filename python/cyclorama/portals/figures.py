"""What portal images save and cost along a path: figures 6-5, 6-6 and 6-8 of the 1998 dissertation."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .. import charts
from ..camera import Camera
from ..lab import Row
from ..progress import Progress, reporter
from ..quality import psnr
from .building import Building
from .cells import Portal
from .cones import Cone
from .drawing import PortalDrawn, PortalWalk
from .images import PortalImages

__all__ = ["cameras_of", "chart_cache", "chart_path", "chart_popping", "culling", "route", "summary", "walk"]

Floats = npt.NDArray[np.float64]

# Sine of the angle between a portal's plane and the vertical up to which one walks through it.
_UPRIGHT = 0.1
# Frames over which a gaze is turned.
_TURN = 8


def route(
    building: Building,
    frames: int = 200,
    *,
    height: float = 1.6,
    up: npt.ArrayLike = (0.0, 1.0, 0.0),
    start: int | None = None,
    seed: int = 0,
) -> tuple[Floats, Floats]:
    """A path at eye height from room to room through their doors, looking where it goes.

    Parameters
    ----------
    building : Building
    frames : int
        Eyes wanted, evenly spaced.
    height : float
        Of the eye above the lowest door of the first cell.
    up : (3,) array_like of float
        Along an axis.
    start : int, optional
        The first cell; a random one by default.
    seed : int
        Of the doors taken. A room's least visited neighbour comes first.

    Returns
    -------
    eyes, gazes : (frames, 3) ndarray of float64
        Straight between the middles of doors and rooms; furniture that is as high as the eye is walked through, so
        eyes in something solid are left out, and others closer together.

    Raises
    ------
    ValueError
        If no upright door leads from the first cell to another one at that height.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> home = cyc.scenes.house(rooms=3, seed=1)
    >>> eyes, gazes = route(Building(home, home.cells, home.portals), 20)
    >>> eyes.shape, bool((eyes[:, 1] == 1.6).all())
    ((20, 3), True)
    """
    rng = np.random.default_rng(seed)
    axis = np.asarray(up, np.float64) / np.linalg.norm(up)
    cell = int(rng.integers(len(building.cells))) if start is None else start
    low = building.cells[cell].low
    sills = [float((portal.polygon @ axis).min()) for portal, _ in _upright(building, axis) if cell in portal.cells]
    if not sills:
        raise ValueError(f"no upright door leads from cell {cell} ({building.cells[cell].name}) to another one")
    level = min(sills) + height

    def at_level(point: Floats) -> Floats:
        return np.asarray(point + (level - point @ axis) * axis)

    doors = [
        (portal.polygon.mean(axis=0), sides)
        for portal, sides in _upright(building, axis)
        if (portal.polygon @ axis).min() < level < (portal.polygon @ axis).max()
    ]
    if not any(cell in sides for _, sides in doors):
        raise ValueError(f"no door of cell {cell} ({building.cells[cell].name}) is as high as {height}")
    visits = np.zeros(len(building.cells), int)
    points = [at_level((low + building.cells[cell].high) / 2)]
    for _ in range(4 * len(building.cells)):
        visits[cell] += 1
        ways = [(middle, sides[1] if sides[0] == cell else sides[0]) for middle, sides in doors if cell in sides]
        least = min(visits[there] for _, there in ways)
        ways = [way for way in ways if visits[way[1]] == least]
        middle, cell = ways[int(rng.integers(len(ways)))]
        inner = building.cells[cell]
        points += [at_level(middle), at_level((inner.low + inner.high) / 2)]
        if visits.all() and len(points) > 2 * len(building.cells):
            break
    corners = np.array(points)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    places = np.linspace(0.0, lengths[-1], 2 * frames)
    eyes = np.column_stack([np.interp(places, lengths, corners[:, k]) for k in range(3)])
    smooth = np.concatenate([eyes, np.repeat(eyes[-1:], _TURN, axis=0)])
    gazes = smooth[_TURN:] - eyes
    gazes[-_TURN:] = gazes[-_TURN - 1]
    free = np.flatnonzero([not building.is_solid(eye) for eye in eyes])
    kept = free[np.linspace(0, len(free) - 1, frames).round().astype(int)]
    return eyes[kept], gazes[kept] / np.linalg.norm(gazes[kept], axis=1, keepdims=True)


def _upright(building: Building, axis: Floats) -> list[tuple[Portal, tuple[int, int]]]:
    """Upright portals between cells, and those cells."""
    found = []
    for portal in building.portals:
        normal = np.cross(portal.polygon[1] - portal.polygon[0], portal.polygon[2] - portal.polygon[0])
        upright = abs(normal @ axis) < _UPRIGHT * np.linalg.norm(normal)
        if portal.cells[1] is not None and upright:
            found.append((portal, (portal.cells[0], portal.cells[1])))
    return found


def cameras_of(
    eyes: Floats, gazes: Floats, up: npt.ArrayLike, size: tuple[int, int], fov_y: float = 60.0
) -> list[Camera]:
    """A camera for each eye of a path."""
    return [Camera.look_at(eye, eye + gaze, up, fov_y, *size) for eye, gaze in zip(eyes, gazes, strict=True)]


def culling(building: Building, cameras: Sequence[Camera], how: Literal["frustum", "portals"]) -> list[Row]:
    """Faces and milliseconds of each frame of a path without images.

    Parameters
    ----------
    building : Building
    cameras : sequence of Camera
    how : {"frustum", "portals"}
        All faces in the frustum; or those that portals let it see.

    Returns
    -------
    list of dict
        ``faces``, ``ms`` of the frame, and ``drawing``, what of that is not culling.
    """
    rows = []
    for camera in cameras:
        begin = time.perf_counter()
        if how == "portals":
            faces = building.visible(camera)
        else:
            faces = np.flatnonzero(~Cone.of(camera).misses(building._corners)).astype(np.uint32)
        culled = time.perf_counter()
        building.scene.render(camera, faces)
        end = time.perf_counter()
        rows.append({"faces": len(faces), "ms": 1e3 * (end - begin), "drawing": 1e3 * (end - culled)})
    return rows


def walk(
    images: PortalImages,
    cameras: Sequence[Camera],
    *,
    max_ms: float | None = None,
    truth: bool = True,
    progress: Progress = None,
) -> list[Row]:
    """Each frame of a path with portal images.

    Parameters
    ----------
    images : PortalImages
        Painted, or painted as they are needed.
    cameras : sequence of Camera
    max_ms : float, optional
        As for `Building.draw`.
    truth : bool
        Compare with the whole scene, drawn.
    progress : bool or callable, optional
        One unit is a frame.

    Returns
    -------
    list of dict
        ``faces``, ``images`` shown, images ``painted``, ``ms``, ``drawing`` as for `culling`; with `truth` also
        ``pixels``, the share that shows images, and of these ``psnr`` in dB (NaN without any), ``holes``, and
        ``popping``: the root mean square, in grey levels, of how much the error of pixels changes that show an image in
        this frame and the last.
    """
    steps = PortalWalk(images)
    rows: list[Row] = []
    last: tuple[PortalDrawn, Floats] | None = None
    with reporter(progress, len(cameras), "frames") as report:
        for number, camera in enumerate(cameras):
            drawn = steps.draw(camera, max_ms=max_ms)
            row: Row = {
                "faces": drawn.stats.faces,
                "images": drawn.stats.images,
                "painted": drawn.stats.painted,
                "ms": drawn.stats.total,
                "drawing": drawn.stats.rendered + drawn.stats.shown,
            }
            if truth:
                real = images.color(images.building.scene.render(camera))
                shown = drawn.portal >= 0
                error = drawn.color.astype(np.float64) - real
                both = shown & (last[0].portal >= 0) if last is not None else np.zeros_like(shown)
                row["pixels"] = float(shown.mean())
                row["psnr"] = psnr(drawn.color, real, where=shown) if shown.any() else np.nan
                row["holes"] = float(drawn.hole[shown].mean()) if shown.any() else 0.0
                change = error[both] - last[1][both] if last is not None else error[both]
                row["popping"] = float(np.sqrt((change**2).mean())) if both.any() else np.nan
                last = drawn, error
            rows.append(row)
            report(number + 1)
    return rows


def summary(rows: Sequence[Row]) -> Row:
    """Means of the rows of a path, and its worst frame.

    Examples
    --------
    >>> summary([{"faces": 10, "ms": 1.0}, {"faces": 30, "ms": 5.0}])
    {'faces': 20.0, 'most faces': 30.0, 'ms': 3.0}
    """
    found: Row = {}
    for name in rows[0]:
        values = np.array([row[name] for row in rows], np.float64)
        if name == "painted":
            found[name] = int(values.sum())
        elif np.isfinite(values).any():
            finite = values[np.isfinite(values)]
            # Of decibels, what the mean squared error has.
            found[name] = (
                float(-10 * np.log10((10 ** (-finite / 10)).mean())) if name == "psnr" else float(finite.mean())
            )
        if name in ("faces", "drawing"):
            found[f"most {name}"] = float(values.max())
    return found


def chart_path(
    paths: Mapping[str, Sequence[Row]],
    what: Literal["faces", "ms", "drawing"] = "drawing",
    *,
    title: str = "A path through a building (figures 6-5 and 6-8)",
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """Figures 6-5 and 6-8: primitives or milliseconds of each frame of a path.

    Parameters
    ----------
    paths : mapping of str to list of dict
        By name, what `culling` and `walk` found.
    what : {"faces", "ms", "drawing"}
    title : str
    path : path-like, optional
        A picture to write.

    Returns
    -------
    matplotlib.figure.Figure
    """
    names = {"faces": "primitives", "ms": "milliseconds", "drawing": "milliseconds of drawing"}
    lines = {name: (np.arange(len(rows)), [row[what] for row in rows]) for name, rows in paths.items()}
    return charts.lines(lines, x="frame", y=names[what], title=title, path=path)


def chart_cache(
    paths: Mapping[str, Sequence[Row]],
    *,
    title: str = "Images painted when they are needed (figure 6-6)",
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """Figure 6-6: milliseconds of each frame with a cold cache and a warm one.

    Parameters
    ----------
    paths, title, path
        As for `chart_path`.
    """
    lines = {name: (np.arange(len(rows)), [row["ms"] for row in rows]) for name, rows in paths.items()}
    return charts.lines(lines, x="frame", y="milliseconds", title=title, log="y", path=path)


def chart_popping(
    rows: Mapping[str, Sequence[tuple[float, float]]],
    *,
    title: str = "Popping against images",
    path: str | os.PathLike[str] | None = None,
) -> Any:
    """How much pictures jump as the eye moves, against the images that a portal has.

    Parameters
    ----------
    rows : mapping of str to sequence of (float, float)
        By kind: images on a portal's side, and mean popping in grey levels.
    title : str
    path : path-like, optional
        A picture to write.

    Returns
    -------
    matplotlib.figure.Figure
    """
    lines = {name: tuple(np.array(sorted(pairs)).T) for name, pairs in rows.items()}
    return charts.lines(
        {name: (line[0], line[1]) for name, line in lines.items()},
        x="images on one side of a portal",
        y="popping, grey levels",
        title=title,
        log="x",
        path=path,
    )
