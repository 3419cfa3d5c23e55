"""Foliage: thousands of open leaves, seen through one another."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scene import Scene
from .solids import Mesh, Points, join, sweep, turned

__all__ = ["plant", "tree"]

Colors = npt.NDArray[np.uint8]
GOLDEN_ANGLE = np.pi * (3.0 - 5.0**0.5)


def plant(faces: int = 60_000, *, seed: int = 0, clusters: int = 6) -> Scene:
    """A potted plant whose leaves stand in clusters of very different density.

    Each cluster has half the leaves of the one before in over twice its volume, so that the number of faces in a unit
    of space spans three orders of magnitude: what divides space evenly, or by one cell size, is wrong somewhere.

    Parameters
    ----------
    faces : int
        Number of faces, met exactly, at least 1000. With an odd number the last leaf is cut in half.
    seed : int
        Seed of the plant.
    clusters : int
        Number of clusters, from 1 to 10.

    Raises
    ------
    ValueError
        If a number is out of range.

    Examples
    --------
    >>> len(plant(5_000, seed=3))
    5000
    """
    if faces < 1000 or not 1 <= clusters <= 10:
        raise ValueError(f"a plant takes at least 1000 faces and 1 to 10 clusters, got {faces} and {clusters}")
    random = np.random.default_rng(seed)
    pot = turned([0.0, 0.0, 0.0], [(0.16, 0.0), (0.24, 0.34), (0.27, 0.34), (0.27, 0.4), (0.22, 0.4), (0.2, 0.36)], 24)
    radius = 0.07 * 1.32 ** np.arange(clusters)
    turn = GOLDEN_ANGLE * np.arange(clusters) + random.uniform(0.0, 2.0 * np.pi)
    away = 0.1 + 1.5 * radius
    height = 0.75 + 0.17 * np.arange(clusters)[::-1] + random.uniform(-0.05, 0.05, clusters)
    centers = np.column_stack([away * np.cos(turn), height, away * np.sin(turn)])
    foot = 0.06 * np.column_stack([np.cos(turn), np.zeros(clusters), np.sin(turn)]) + [0.0, 0.3, 0.0]
    stems = _branches(foot, centers, np.full(clusters, 0.022), np.full(clusters, 0.008), random)
    wood = join([pot, stems])
    leaves = (faces - len(wood[1]) + 1) // 2
    share = 0.5 ** np.arange(clusters)
    ends = np.rint(np.cumsum(share) / share.sum() * leaves).astype(np.int64)
    numbers = np.diff(ends, prepend=0)
    cluster = np.repeat(np.arange(clusters), numbers)
    within = _directions(random, leaves)
    place = centers[cluster] + within * (radius[cluster] * random.uniform(0.0, 1.0, leaves) ** (1 / 3))[:, None]
    size = (2.2 * radius / np.maximum(numbers, 8) ** (1 / 3))[cluster] * random.uniform(0.7, 1.3, leaves)
    green = np.array([[60, 120, 50], [96, 150, 60], [140, 170, 70], [70, 140, 100], [170, 180, 90], [120, 160, 120]])
    tint = green[cluster % len(green)] + random.integers(-18, 19, size=(leaves, 1))
    leafage = _leaves(place, within + 0.6 * _directions(random, leaves) + [0.0, 0.3, 0.0], size, random)
    bark = np.repeat([[176, 98, 70], [110, 130, 70]], [len(pot[1]), len(stems[1])], axis=0)
    return _grown(faces, wood, bark, leafage, tint)


def tree(faces: int = 20_000, *, seed: int = 0) -> Scene:
    """A broad-leaved tree: closed, tapered branches and open leaves around the twigs.

    Foliage is what a bare id-buffer loses most of: nearly every leaf shows somewhere through the gaps of the others,
    in slivers smaller than a pixel.

    Parameters
    ----------
    faces : int
        Number of faces, met exactly, at least 200; up to two fifths are wood. With an odd number the last leaf is cut
        in half.
    seed : int
        Seed of the tree.

    Raises
    ------
    ValueError
        If `faces` is below 200.

    Examples
    --------
    >>> len(tree(5_000, seed=2))
    5000
    """
    if faces < 200:
        raise ValueError(f"a tree takes at least 200 faces, got {faces}")
    random = np.random.default_rng(seed)
    start, end = np.zeros((1, 3)), np.array([[0.05, 1.1, 0.03]])
    thick = np.array([0.075])
    parts: list[Mesh] = []
    total, children = 0, 5
    while not parts or total + children * len(start) * BRANCH_FACES <= 0.4 * faces:
        if parts:
            start, end, thick = _forks(start, end, thick, children, random)
        parts.append(_branches(start, end, thick, 0.6 * thick, random))
        total += len(parts[-1][1])
    leaves = (faces - total + 1) // 2
    twig = np.arange(leaves) % len(start)
    along = random.uniform(0.25 if len(parts) > 1 else 0.6, 1.08, size=(leaves, 1))
    spread = np.linalg.norm(end - start, axis=1).mean()
    out = _directions(random, leaves)
    place = start[twig] + along * (end - start)[twig] + out * random.uniform(0.02, 0.28, (leaves, 1)) * spread
    direction = out + 0.8 * (end - start)[twig] / spread + [0.0, -0.25, 0.0]
    size = np.full(leaves, 2.0 * (3.0 / max(leaves, 200)) ** 0.4) * random.uniform(0.7, 1.25, leaves)
    shade = random.uniform(0.0, 1.0, (leaves, 1))
    tint = np.array([58, 112, 44]) + shade * np.array([92, 66, 30])
    bark = np.full((total, 3), [112, 84, 62])
    return _grown(faces, join(parts), bark, _leaves(place, direction, size, random), tint)


# Faces of one branch: a tube of 4 rings of 6 points.
BRANCH_FACES = 2 * 6 * 3 + 2 * 4


def _forks(
    start: Points, end: Points, thick: Points, children: int, random: np.random.Generator
) -> tuple[Points, Points, Points]:
    """The next level of branches: `children` from each, one of them going on at its end."""
    parent = np.repeat(np.arange(len(start)), children)
    order = np.tile(np.arange(children), len(start))
    along = np.where(order == 0, 1.0, 0.45 + 0.5 * order / children)[:, None]
    axis = (end - start)[parent]
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    axis = axis / length
    side, other = _frame(axis)
    turn = (GOLDEN_ANGLE * order + random.uniform(0.0, 2.0 * np.pi, len(start))[parent])[:, None]
    tilt = np.where(order == 0, 0.15, random.uniform(0.65, 1.05, len(parent)))[:, None]
    direction = np.cos(tilt) * axis + np.sin(tilt) * (np.cos(turn) * side + np.sin(turn) * other)
    direction[:, 1] += 0.12
    begin = start[parent] + along * (end - start)[parent]
    reach = length * random.uniform(0.58, 0.78, (len(parent), 1))
    return begin, begin + reach * direction, thick[parent] * np.where(order == 0, 0.6, 0.45)


def _branches(start: Points, end: Points, thick: Points, thin: Points, random: np.random.Generator) -> Mesh:
    """Slightly crooked, tapered, closed tubes."""
    axis = end - start
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    side, other = _frame(axis / length)
    share = np.linspace(0.0, 1.0, 4)
    crook = random.uniform(-0.05, 0.05, (len(start), 4, 1)) * length[:, None] * np.array([0.0, 1.0, 1.0, 0.0])[:, None]
    middle = start[:, None] + share[:, None] * axis[:, None] + crook * side[:, None]
    radius = thick[:, None] + share * (thin - thick)[:, None]
    angle = 2.0 * np.pi * np.arange(6) / 6
    circle = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None]
    return sweep(middle[:, :, None] + radius[:, :, None, None] * circle[:, None])


def _leaves(place: Points, direction: Points, size: Points, random: np.random.Generator) -> Mesh:
    """Pointed leaves of two triangles, folded a little along the midrib from `place` on."""
    ahead = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    side, up = _frame(ahead)
    roll = random.uniform(0.0, 2.0 * np.pi, (len(place), 1))
    side, up = np.cos(roll) * side + np.sin(roll) * up, np.cos(roll) * up - np.sin(roll) * side
    size = size[:, None]
    widest = place + 0.45 * size * ahead + 0.08 * size * up
    corners = [place, widest - 0.28 * size * side, place + size * ahead, widest + 0.28 * size * side]
    first = 4 * np.arange(len(place))[:, None]
    faces = (first[:, None] + np.array([[0, 3, 2], [0, 2, 1]])).reshape(-1, 3)
    return np.stack(corners, axis=1).reshape(-1, 3), faces


def _grown(faces: int, wood: Mesh, bark: npt.NDArray[np.integer], leafage: Mesh, tint: npt.ArrayLike) -> Scene:
    vertices, triangles = join([wood, leafage])
    colors = np.concatenate([bark, np.repeat(np.asarray(tint, dtype=np.float64), 2, axis=0)])
    if len(vertices) == faces:  # face colours would be taken for vertex colours
        vertices = np.concatenate([vertices, vertices[-1:]])
    return Scene(vertices, triangles[:faces], np.clip(colors[:faces], 0, 255).astype(np.uint8))


def _directions(random: np.random.Generator, count: int) -> Points:
    """(count, 3) unit vectors, uniform over the sphere."""
    vectors = random.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _frame(axis: Points) -> tuple[Points, Points]:
    """Two unit vectors across each unit axis, which make a right-handed frame with it: side x other = axis."""
    helper = np.where(np.abs(axis[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(helper, axis)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return side, np.cross(axis, side)
