"""What an eye in a building sees through its doors, in plain NumPy, one portal after the other (section 6.2.1)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

import cyclorama as cyc
from cyclorama.portals import Building
from cyclorama.portals.cones import Cone

Floats = npt.NDArray[np.float64]

# Radians between two corners from which on they are two.
SLIVER = 1e-10


def visible(building: Building, camera: cyc.Camera) -> npt.NDArray[np.uint32]:
    """The faces that a camera in one cell or outdoors, in no portal, may see."""
    corners = np.asarray(building.scene.vertices, np.float64)[building.scene.faces]
    place = building.cell(camera.eye)
    seen = np.zeros(len(corners), bool)
    for at, cone in views(building, len(building.cells) if place is None else place, Cone.of(camera), frozenset()):
        faces = building.faces[at]
        seen[faces[~cone.misses(corners[faces])]] = True
    return np.flatnonzero(seen).astype(np.uint32)


def views(
    building: Building, place: int, cone: Cone, used: frozenset[int], entered: bool = False
) -> Iterator[tuple[int, Cone]]:
    """Every sequence of portals, whatever was looked at before."""
    yield place, cone
    if entered and place < len(building.cells) and building.cells[place].shut:
        return
    for index, portal in enumerate(building.portals):
        sides = [len(building.cells) if side is None else side for side in portal.cells]
        if index in used or place not in sides:
            continue
        narrower = through(cone, clip(cone, portal.polygon))
        if narrower is not None:
            yield from views(building, sides[1 - sides.index(place)], narrower, used | {index}, True)


def clip(cone: Cone, polygon: Floats) -> Floats:
    """The part of a convex polygon inside, (N, 3); N is 0 if nothing is."""
    for normal, offset in zip(cone.normals, cone.offsets, strict=True):
        inside = polygon @ normal - offset
        if (inside >= 0).all():
            continue
        if (inside < 0).all():
            return np.empty((0, 3))
        corners = []
        for a, b, p, q in zip(polygon, np.roll(polygon, -1, 0), inside, np.roll(inside, -1), strict=True):
            if p >= 0:
                corners.append(a)
            if (p >= 0) != (q >= 0):
                corners.append(a + (b - a) * (p / (p - q)))
        polygon = np.array(corners)
    return polygon


def through(cone: Cone, polygon: Floats) -> Cone | None:
    """What is seen of what lies behind a portal's polygon, already clipped; None if that is nothing."""
    if len(polygon) < 3:
        return None
    rays = polygon - cone.eye
    normal = np.cross(polygon - polygon.mean(0), np.roll(polygon, -1, 0) - polygon.mean(0)).sum(0)
    length = np.linalg.norm(normal)
    if length == 0.0:
        return None
    normal /= length
    ahead = float(rays.mean(0) @ normal)
    if ahead < 0.0:
        normal, ahead = -normal, -ahead
    sides = np.cross(rays, np.roll(rays, -1, 0))
    lengths, reach = np.linalg.norm(sides, axis=1), np.linalg.norm(rays, axis=1)
    # Corners that rounding tells apart have a plane of any direction between them: it bounds nothing.
    edges = lengths > SLIVER * reach * np.roll(reach, -1)
    sides = sides[edges] / lengths[edges, None]
    if len(sides) < 3:
        return None
    if (sides @ rays.mean(0)).sum() < 0.0:
        sides = -sides
    normals = np.vstack([sides, normal])
    return Cone(cone.eye, normals, np.append(sides @ cone.eye, normal @ polygon[0]))


def winding(triangles: Floats, point: Floats) -> float:
    """How often a closed surface winds around a point: 0 outside, 1 or -1 inside (van Oosterom and Strackee, 1983).

    `triangles` has shape (3, 3, T): corner, coordinate, triangle.
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = triangles - point[:, None]
    a, b, c = (np.sqrt(x * x + y * y + z * z) for x, y, z in ((ax, ay, az), (bx, by, bz), (cx, cy, cz)))
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    rest = a * b * c + (ax * bx + ay * by + az * bz) * c + (bx * cx + by * cy + bz * cz) * a
    rest += (cx * ax + cy * ay + cz * az) * b
    return float(np.arctan2(volume, rest).sum() / (2 * np.pi))
