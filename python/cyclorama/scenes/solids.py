"""The closed pieces that scenes are built from, wound outward: boxes, swept rings, and how to join and refine them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["Faces", "Mesh", "Points", "box", "cells", "join", "normals", "refine", "sweep", "turned"]

Points = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int64]
Mesh = tuple[Points, Faces]

# Corner c of a box lies high along axis k where bit k of c is set. Two triangles a side: -x, +x, -y, +y, -z, +z.
_BOX = np.array(
    [
        *[(0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)],
        *[(0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3)],
        *[(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6)],
    ]
)


def box(low: npt.ArrayLike, high: npt.ArrayLike) -> Mesh:
    """Boxes between corners of shape (3,) or (N, 3), 12 faces each, two a side in the order -x, +x, -y, +y, -z, +z."""
    low, high = np.atleast_2d(np.asarray(low, dtype=np.float64)), np.atleast_2d(np.asarray(high, dtype=np.float64))
    high_along = (np.arange(8)[:, None] >> np.arange(3)) & 1
    vertices = np.where(high_along, high[:, None], low[:, None])
    faces = _BOX + 8 * np.arange(len(vertices))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3)


def cells(lines: Sequence[npt.NDArray[np.floating]], solid: npt.NDArray[np.bool_]) -> Mesh:
    """The surface between the solid and the empty cells of a grid.

    `lines` holds the ascending grid planes along x, y and z, `solid` (X, Y, Z) tells which of the cells between them
    are filled. Each cell wall between full and empty becomes a quadrilateral of two faces, 2 q and 2 q + 1, whose
    corners are shared with its neighbours: the surface is closed, and wound outward.
    """
    filled = np.pad(solid, 1)
    shape = np.array([len(axis) for axis in lines])
    quads = []
    for k in range(3):
        u, v = (k + 1) % 3, (k + 2) % 3
        below, above = (np.moveaxis(filled, k, 0)[part] for part in (slice(None, -1), slice(1, None)))
        for wall, around in (
            (below & ~above, [(0, 0), (1, 0), (1, 1), (0, 1)]),
            (above & ~below, [(0, 0), (0, 1), (1, 1), (1, 0)]),
        ):
            cell = np.argwhere(np.moveaxis(wall, 0, k))
            cell[:, [u, v]] -= 1
            corners = np.repeat(cell[:, None], 4, axis=1)
            corners[:, :, [u, v]] += np.array(around)
            quads.append(corners)
    corners = np.concatenate(quads)
    used, index = np.unique(corners @ np.array([shape[1] * shape[2], shape[2], 1]), return_inverse=True)
    a, b, c, d = index.reshape(-1, 4).T
    faces = np.stack([np.column_stack([a, b, c]), np.column_stack([a, c, d])], axis=1).reshape(-1, 3)
    places = np.unravel_index(used, shape)
    return np.column_stack([axis[place] for axis, place in zip(lines, places, strict=True)]), faces


def sweep(rings: npt.ArrayLike) -> Mesh:
    """Tubes through rings of points, closed by flat caps.

    `rings` has the shape (..., M, S, 3): tubes of M rings of S points, which turn counter-clockwise around the
    direction of the sweep. A tube has 2 S (M - 1) faces around and S - 2 on each cap.
    """
    rings = np.asarray(rings, dtype=np.float64)
    count, length, sides = int(np.prod(rings.shape[:-3])), *rings.shape[-3:-1]
    here = np.arange(length * sides).reshape(length, sides)
    next_ = np.roll(here, -1, axis=1)
    a, b, c, d = here[:-1], next_[:-1], next_[1:], here[1:]
    around = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2).reshape(-1, 3)
    corner = np.arange(1, sides - 1)
    first = np.column_stack([np.zeros_like(corner), corner + 1, corner])
    last = np.column_stack([np.zeros_like(corner), corner, corner + 1]) + (length - 1) * sides
    faces = np.concatenate([first, around, last]) + length * sides * np.arange(count)[:, None, None]
    return rings.reshape(-1, 3), faces.reshape(-1, 3)


def turned(center: npt.ArrayLike, profile: Sequence[tuple[float, float]], sides: int = 12) -> Mesh:
    """A solid turned on a lathe about the vertical (+y) axis: `profile` lists (radius, height) from the foot up."""
    angle = -2.0 * np.pi * np.arange(sides) / sides
    circle = np.column_stack([np.cos(angle), np.zeros(sides), np.sin(angle)])
    outline = np.asarray(profile, dtype=np.float64)
    rings = outline[:, :1, None] * circle + outline[:, 1:, None] * np.array([0.0, 1.0, 0.0])
    return sweep(rings + np.asarray(center, dtype=np.float64))


def join(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh of many; faces in the order given."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in meshes[:-1]])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def refine(mesh: Mesh, pairs: int) -> Mesh:
    """Splits the diagonal of the first `pairs` quadrilaterals, whose halves are the faces 2 q and 2 q + 1.

    The halves must be (a, b, c) and (a, c, d). Each split adds one vertex and two faces, so that a closed mesh stays
    closed; the new faces come last.
    """
    vertices, faces = mesh
    if pairs == 0:
        return mesh
    (a, b, c), d = faces[0 : 2 * pairs : 2].T, faces[1 : 2 * pairs : 2, 2]
    middle = len(vertices) + np.arange(pairs)
    kept = faces.copy()
    kept[0 : 2 * pairs : 2] = np.column_stack([a, b, middle])
    kept[1 : 2 * pairs : 2] = np.column_stack([middle, c, d])
    added = np.stack([np.column_stack([b, c, middle]), np.column_stack([a, middle, d])], axis=1).reshape(-1, 3)
    return np.concatenate([vertices, (vertices[a] + vertices[c]) / 2]), np.concatenate([kept, added])


def normals(mesh: Mesh) -> Points:
    """(F, 3) normals, as long as twice the area of each face."""
    a, b, c = (mesh[0][mesh[1][:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)
