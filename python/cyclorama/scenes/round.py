"""A sphere of flat faces: the scene whose answer is known from every eye."""

from __future__ import annotations

import numpy as np

from ..scene import Scene

__all__ = ["sphere"]


def sphere(faces: int = 330_000) -> Scene:
    """A closed convex polyhedron inscribed in the unit sphere.

    What is convex hides nothing of itself: exactly the front-facing faces are visible, from every eye outside. That
    is the oracle of the samplers, with faces far smaller than pixels.

    Parameters
    ----------
    faces : int
        Number of faces, at least 8. Rounded to the nearest number that is twice a product of the segments around and
        the bands between the poles, with triangles as square as that allows; 330,000 is met exactly.

    Raises
    ------
    ValueError
        If `faces` is below 8.

    Examples
    --------
    >>> len(sphere(1_000))
    1000
    """
    if faces < 8:
        raise ValueError(f"a sphere needs at least 8 faces, got {faces}")
    segments = np.arange(3, max(4, int(2 * faces**0.5) + 1))
    bands = np.maximum(1, np.rint(faces / (2 * segments)).astype(np.int64))
    off = np.abs(2 * segments * bands - faces)
    skew = np.abs(np.log(segments / (2.0 * bands)))
    best = np.lexsort((skew, off))[0]
    around, rings = int(segments[best]), int(bands[best])
    theta = np.pi * np.arange(1, rings + 1) / (rings + 1)
    phi = 2.0 * np.pi * np.arange(around) / around
    x, z = np.sin(theta)[:, None] * np.cos(phi), np.sin(theta)[:, None] * np.sin(phi)
    y = np.broadcast_to(np.cos(theta)[:, None], x.shape)
    vertices = np.concatenate([np.stack([x, y, z], axis=-1).reshape(-1, 3), [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    here = np.arange(around * rings).reshape(rings, around)
    after = np.roll(here, -1, axis=1)
    top, bottom = np.full(around, around * rings), np.full(around, around * rings + 1)
    a, b, c, d = (part.ravel() for part in (here[:-1], after[:-1], after[1:], here[1:]))
    triangles = np.concatenate(
        [
            np.column_stack([top, after[0], here[0]]),
            np.column_stack([a, b, c]),
            np.column_stack([a, c, d]),
            np.column_stack([bottom, here[-1], after[-1]]),
        ]
    )
    return Scene(vertices, triangles)
