"""Where to take the pictures that stand in for what a portal shows (sections 6.2.2 and 8.4 of the 1998 dissertation).

A portal is looked at from many places. The dissertation names three ways to choose those that pictures are taken from:
all over the space before it (*model-independent*), one that faces it (*single*), and its own: on a semicircle at eye
height before the portal, over the angles from which it is looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..camera import Camera

if TYPE_CHECKING:
    from .building import Building

__all__ = ["Side", "angle_range", "construction_viewpoints", "eyes_before", "grid", "nearest", "semicircle", "sides"]

Floats = npt.NDArray[np.float64]

# Where an eye is usually, as a share of the height of a door: 1.6 of 2.1 m.
_EYE_HEIGHT = 0.75

# Spans of angles that pictures are taken over, in degrees (6.3.3.1).
_LEAST_SPAN, _MOST_SPAN = 30.0, 120.0
# Steeper than this to a portal's normal it is a slit.
_STEEPEST = 80.0
# Share of the eyes that may lie beyond each end of the span.
_BEYOND = 0.01

# Eyes along each side of the grid before a portal, and pixels of the pictures by which it is found which of them see
# it.
_EYES, _PIXELS = 24, 128
# Where on a portal those pictures are taken, as shares of its half width and half height.
_PLACES = ((0.0, 0.0), (-0.8, -0.8), (0.8, -0.8), (0.8, 0.8), (-0.8, 0.8))
# What two roundings to float32 may move a depth by, and a pixel's width on what is seen at a grazing angle.
_SAME_DEPTH = 0.02

# Distances of the farther construction viewpoints and of the nearer ones at most, as shares of the sampling distance.
_FARTHER, _NEAREST = 1.6, 0.7
# And degrees to both sides of the image where there is no other one.
_ALONE = 30.0


@dataclass(frozen=True, eq=False)
class Side:
    """A portal as it is seen from one of its cells.

    Attributes
    ----------
    portal : int
    place, beyond : int
        The cell that it is seen from and the one that is seen; outdoors is ``len(building.cells)``.
    polygon : (N, 3) ndarray of float64
    normal : (3,) ndarray of float64
        Unit vector away from `place`.
    right, up : (3,) ndarray of float64
        Unit vectors in the portal's plane.
    corners : (4, 3) ndarray of float64
        The smallest rectangle around the polygon along those: top-left, top-right, bottom-right, bottom-left.
    center : (3,) ndarray of float64
        The middle of the portal, at eye height if the portal is upright.
    """

    portal: int
    place: int
    beyond: int
    polygon: Floats
    normal: Floats
    right: Floats
    up: Floats
    corners: Floats
    center: Floats

    @property
    def size(self) -> float:
        """The diagonal of the rectangle."""
        return float(np.linalg.norm(self.corners[2] - self.corners[0]))

    def before(self, eye: Floats) -> float:
        """How far an eye is in front of the portal's plane."""
        return float((self.corners[0] - eye) @ self.normal)

    def distance(self, eye: Floats) -> float:
        """Of an eye from the nearest point of the portal's rectangle."""
        local = eye - self.corners.mean(axis=0)
        half = [
            np.linalg.norm(self.corners[1] - self.corners[0]) / 2,
            np.linalg.norm(self.corners[3] - self.corners[0]) / 2,
        ]
        aside = np.maximum(np.abs([local @ self.right, local @ self.up]) - half, 0.0)
        return float(np.hypot(np.linalg.norm(aside), local @ self.normal))


def sides(building: Building, up: npt.ArrayLike = (0.0, 1.0, 0.0), height: float | None = None) -> list[Side]:
    """Both sides of all portals.

    Parameters
    ----------
    building : Building
    up : (3,) array_like of float
    height : float, optional
        Of eyes above a portal's lower edge; three quarters of its own height by default.

    Returns
    -------
    list of Side
        Two for each portal.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> home = cyc.scenes.house(rooms=3, seed=1)
    >>> found = sides(cyc.portals.Building(home, home.cells, home.portals))
    >>> len(found) == 2 * len(home.portals), found[0].portal, found[1].portal
    (True, 0, 0)
    """
    upright = np.asarray(up, np.float64) / np.linalg.norm(up)
    outdoors = len(building.cells)
    found = []
    for index, portal in enumerate(building.portals):
        polygon = portal.polygon
        normal = np.cross(polygon - polygon.mean(0), np.roll(polygon, -1, 0) - polygon.mean(0)).sum(0)
        normal /= np.linalg.norm(normal)
        first, second = (outdoors if side is None else side for side in portal.cells)
        if not _leads_to(building, second, first, polygon, normal):
            normal = -normal
        found.append(_side(index, first, second, polygon, normal, upright, height))
        found.append(_side(index, second, first, polygon, -normal, upright, height))
    return found


def _leads_to(building: Building, place: int, other: int, polygon: Floats, normal: Floats) -> bool:
    """Whether a portal's normal points into a place, out of another one."""
    middle, size = polygon.mean(0), float(np.ptp(polygon, axis=0).max())
    for step in (1e-3, 1e-2, 1e-1):
        ahead, back = middle + step * size * normal, middle - step * size * normal
        for here, there, cell in ((ahead, back, place), (back, ahead, other)):
            if cell < len(building.cells):
                held = building.cells[cell]
                if held.holds(here) != held.holds(there):
                    return held.holds(here)
    # A portal within thick walls: the cells' middles tell.
    centers = [None if cell == len(building.cells) else _middle(building, cell) for cell in (place, other)]
    into, out = centers
    reach = 0.0 if into is None else float((into - middle) @ normal)
    reach -= 0.0 if out is None else float((out - middle) @ normal)
    return reach > 0.0


def _middle(building: Building, cell: int) -> Floats:
    return np.asarray((building.cells[cell].low + building.cells[cell].high) / 2)


def _side(
    portal: int, place: int, beyond: int, polygon: Floats, normal: Floats, upright: Floats, height: float | None
) -> Side:
    level = np.cross(normal, upright)
    lies = float(np.linalg.norm(level)) < 0.1
    if lies:
        # A portal in a floor or ceiling: its longest edge is as good as any.
        edges = np.roll(polygon, -1, 0) - polygon
        level = edges[np.linalg.norm(edges, axis=1).argmax()]
    right = level / np.linalg.norm(level)
    up = np.cross(right, normal)
    middle = polygon.mean(0)
    local = (polygon - middle) @ np.column_stack([right, up])
    low, high = local.min(0), local.max(0)
    places = [(low[0], high[1]), (high[0], high[1]), (high[0], low[1]), (low[0], low[1])]
    corners = middle + np.array(places) @ np.stack([right, up])
    at = (low[1] + high[1]) / 2 if lies else low[1] + (_EYE_HEIGHT * (high[1] - low[1]) if height is None else height)
    center = middle + (low[0] + high[0]) / 2 * right + at * up
    return Side(portal, place, beyond, polygon, normal, right, np.asarray(up), corners, center)


def semicircle(side: Side, angles: npt.ArrayLike, distance: float) -> Floats:
    """Viewpoints on a semicircle around a portal's middle.

    Parameters
    ----------
    side : Side
    angles : (N,) array_like of float
        Degrees to the right of where an eye faces the portal, between -90 and 90.
    distance : float
        From the middle.

    Returns
    -------
    (N, 3) ndarray of float64
    """
    turn = np.radians(np.asarray(angles, np.float64))[:, None]
    return np.asarray(side.center + distance * (np.sin(turn) * side.right - np.cos(turn) * side.normal))


def grid(side: Side, distance: float) -> Floats:
    """The model-independent viewpoints: regularly spaced all over the space before a portal.

    Returns
    -------
    (60, 3) ndarray of float64
        Four by three steps of half the distance ahead and sideways each way, at three heights.
    """
    ahead, aside, above = np.meshgrid(
        [0.5, 1.0, 1.5, 2.0], [-1.0, -0.5, 0.0, 0.5, 1.0], [-0.5, 0.0, 0.5], indexing="ij"
    )
    local = distance * np.stack([aside, above, -ahead], axis=-1).reshape(-1, 3)
    return np.asarray(side.center + local @ np.stack([side.right, side.up, side.normal]))


def construction_viewpoints(side: Side, viewpoint: Floats, spacing: float | None, least: float) -> Floats:
    """Where the images of which a layered one is built are taken: to both sides, nearer and farther.

    Parameters
    ----------
    side : Side
    viewpoint : (3,) ndarray of float64
        Of the central image.
    spacing : float or None
        Degrees between this image and the next.
    least : float
        Of the distances at which eyes see it: the transition distance.

    Returns
    -------
    (8, 3) ndarray of float64
        The nearest to the viewpoint first.
    """
    out = viewpoint - side.center
    half = np.radians(_ALONE if spacing is None else spacing / 2)
    nearer = min(max(least, 1e-3 * side.size) / float(np.linalg.norm(out)), _NEAREST)
    around = []
    for turn in (0.0, half, -half):
        cos, sin = np.cos(turn), np.sin(turn)
        ahead, aside = -float(out @ side.normal), float(out @ side.right)
        # Not so far around that it would look along the portal.
        turned = np.array([cos * ahead - sin * aside, sin * ahead + cos * aside])
        least = np.sin(np.radians(90 - _STEEPEST)) * np.linalg.norm(turned)
        turned[0] = max(turned[0], least)
        level = -turned[0] * side.normal + turned[1] * side.right + (out @ side.up) * side.up
        around += [side.center + scale * level for scale in (1.0, nearer, _FARTHER)]
    points = np.array(around[1:])
    return points[np.argsort(np.linalg.norm(points - viewpoint, axis=1), kind="stable")]


def nearest(side: Side, viewpoints: Floats, eye: Floats, count: int = 1) -> npt.NDArray[np.int64]:
    """The viewpoints that see a portal most as an eye does: by the angle between them at its middle, then by distance.

    Parameters
    ----------
    side : Side
    viewpoints : (N, 3) ndarray of float64
    eye : (3,) ndarray of float64
    count : int

    Returns
    -------
    (min(count, N),) ndarray of int64
        The nearest first.
    """
    to_eye, rays = eye - side.center, viewpoints - side.center
    lengths = np.linalg.norm(rays, axis=1) * max(float(np.linalg.norm(to_eye)), np.finfo(np.float64).tiny)
    cosine = np.where(lengths > 0, rays @ to_eye / np.where(lengths > 0, lengths, 1.0), -1.0)
    away = np.linalg.norm(viewpoints - eye, axis=1)
    return np.lexsort([away, np.round(-cosine, 12)])[:count]


def eyes_before(building: Building, side: Side, least: float) -> Floats:
    """Eyes of a portal's cell, at eye height, that see some of the portal (section 8.4).

    Parameters
    ----------
    building : Building
    side : Side
    least : float
        Eyes nearer to the portal than this don't count: they see geometry.

    Returns
    -------
    (K, 3) ndarray of float64
        Of an even grid. Outdoors it covers half a disc of the scene's radius.
    """
    eyes = _even_eyes(building, side)
    eyes = eyes[[side.before(eye) > 0 and side.distance(eye) > least for eye in eyes]] if len(eyes) else eyes
    seen = np.zeros(len(eyes), bool)
    half = (side.corners[[1, 0]] - side.corners[[0, 3]]) / 2
    middle = side.corners.mean(0)
    for across, down in _PLACES:
        # Before the portal by a hair, so that its own faces don't hide all.
        start = middle + across * half[0] + down * half[1] - 1e-4 * side.size * side.normal
        for turn in (-1.0, 1.0):
            camera = _wide(start, -side.normal + turn * side.right, side.up)
            depth = building.scene.render(camera).depth
            pixels, away = camera.project(eyes)
            with np.errstate(invalid="ignore"):
                inside = (away > 0) & (pixels >= 0).all(1) & (pixels < _PIXELS).all(1)
            column, row = pixels[inside].astype(int).T
            seen[inside] |= depth[row, column] >= away[inside] * (1 - _SAME_DEPTH)
    return eyes[seen]


def _even_eyes(building: Building, side: Side) -> Floats:
    outdoors = side.place == len(building.cells)
    if outdoors:
        reach = building.scene.radius
        low, high = np.array([-reach, 0.0]), np.array([reach, reach])
    else:
        cell = building.cells[side.place]
        box = np.stack([cell.low, cell.high])
        corners = np.stack(np.meshgrid(*box.T, indexing="ij"), -1).reshape(-1, 3) - side.center
        local = corners @ np.column_stack([side.right, -side.normal])
        low, high = local.min(0), local.max(0)
    steps = (np.arange(_EYES) + 0.5) / _EYES
    aside, ahead = np.meshgrid(low[0] + steps * (high[0] - low[0]), low[1] + steps * (high[1] - low[1]))
    eyes = side.center + aside.reshape(-1, 1) * side.right - ahead.reshape(-1, 1) * side.normal
    if outdoors:
        return np.asarray(eyes[np.hypot(aside, ahead).ravel() <= building.scene.radius])
    return np.asarray(eyes[[building.cells[side.place].holds(eye) for eye in eyes]])


def _wide(eye: Floats, gaze: Floats, up: Floats) -> Camera:
    return Camera.look_at(eye, eye + gaze, up, fov_y=100.0, width=_PIXELS, height=_PIXELS)


def angle_range(side: Side, eyes: Floats, spans: Sequence[float] | None = None) -> tuple[float, float]:
    """The angles from which a portal is looked at.

    Parameters
    ----------
    side : Side
    eyes : (K, 3) ndarray of float64
        That see it.
    spans : sequence of float, optional
        The spans to choose from, ascending; any from 30 to 120 degrees by default.

    Returns
    -------
    low, high : float
        Degrees to the right of where an eye faces the portal; around 0 if there are no eyes.
    """
    low = high = 0.0
    if len(eyes):
        local = (eyes - side.center) @ np.column_stack([side.right, -side.normal])
        turn = np.degrees(np.arctan2(local[:, 0], local[:, 1]))
        low, high = (float(value) for value in np.quantile(turn, [_BEYOND, 1 - _BEYOND]))
    if spans is None:
        span = min(max(high - low, _LEAST_SPAN), _MOST_SPAN)
    else:
        span = next((span for span in spans if span >= high - low), spans[-1])
    middle = (low + high) / 2
    room = max(_STEEPEST - span / 2, 0.0)
    middle = min(max(middle, -room), room)
    return middle - span / 2, middle + span / 2
