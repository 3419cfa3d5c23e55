"""A sphere of flat faces: the scene whose answer is known from every eye."""

from __future__ import annotations

from .. import sphere as view_sphere
from ..scene import Scene

__all__ = ["sphere"]


def sphere(faces: int = 330_000) -> Scene:
    """A closed convex polyhedron: the hull of Fibonacci points on the unit sphere.

    What is convex hides nothing of itself: exactly the front-facing faces are visible, from every eye outside. That
    is the oracle of the samplers, with faces of equal size, as small as one likes.

    Parameters
    ----------
    faces : int
        Number of faces, at least 4, met exactly; odd numbers are rounded up, as a closed mesh has an even number of
        faces.

    Raises
    ------
    ValueError
        If `faces` is below 4.

    Examples
    --------
    >>> len(sphere(1_000))
    1000
    """
    if faces < 4:
        raise ValueError(f"a sphere needs at least 4 faces, got {faces}")
    points = view_sphere.fibonacci((faces + faces % 2) // 2 + 2)
    return Scene(points, view_sphere.hull(points))
