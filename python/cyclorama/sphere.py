"""Spheres of viewpoints: where views are sampled, which samples surround an eye, and which samples suffice.

A sphere is ``points`` (N, 3) and ``faces`` (F, 3): a closed triangulation of directions around the origin (the
model's centre), each face counter-clockwise seen from outside. A direction belongs to the face that a ray from the
origin passes through; lengths never matter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from . import _core, bitfield
from .arguments import checked_whole

__all__ = [
    "Cover",
    "Locator",
    "cover",
    "crossing_angle",
    "faces_in_cap",
    "fibonacci",
    "hull",
    "locate",
    "octahedron",
    "subdivide",
    "surrounding",
]

Points = npt.NDArray[np.float64]
Faces = npt.NDArray[np.uint32]
Indices = npt.NDArray[np.uint32]


def _vectors(name: str, values: npt.ArrayLike) -> Points:
    """`values` as a row-major (N, 3) float64 array."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be real numbers, got {array.dtype}")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} must have shape (N, 3), got {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float64)


def _indices(name: str, values: npt.ArrayLike, size: int, kind: str) -> npt.NDArray[np.int64]:
    """`values` as int64, each below `size`."""
    array = np.asarray(values)
    if array.dtype.kind not in "iu" and array.size:
        raise ValueError(f"{name} must be integers, got {array.dtype}")
    wrong = (array < 0) | (array >= size)
    if wrong.any():
        where = tuple(int(i) for i in np.argwhere(wrong)[0])
        place = f"{name}[{', '.join(map(str, where))}]" if where else name
        raise ValueError(f"{place} is {array[where]}, there are {size} {kind}")
    return np.asarray(array, dtype=np.int64, order="C")


def _faces(faces: npt.ArrayLike, points: int = 2**32 - 1) -> Faces:
    """`faces` as a row-major (F, 3) uint32 array of indices below `points`."""
    array = np.asarray(faces)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"faces must have shape (F, 3), got {array.shape}")
    return _indices("faces", array, points, "points").astype(np.uint32)


def octahedron(level: int) -> tuple[Points, Faces]:
    """The octahedron, its faces split in four `level` times (2002, section 3.2.1).

    Parameters
    ----------
    level : int
        0 to 10: 6, 18, 66, 258, 1026, 4098, ... points. The 2002 paper's "1026 samples" are level 4.

    Returns
    -------
    points : (4**(level + 1) + 2, 3) ndarray of float64
        Unit vectors: the axes ``+x -x +y -y +z -z``, then the new points of each level. So the points of a coarser
        level come first. Mirrored or permuted axes give the same points, to the bit.
    faces : (8 * 4**level, 3) ndarray of uint32
        Counter-clockwise seen from outside. Face f of one level is split into faces ``4 f`` to ``4 f + 3`` of the
        next: those at its three corners, in order, then the one in the middle.

    Raises
    ------
    ValueError
        If the level is not an integer from 0 to 10.

    Examples
    --------
    >>> points, faces = octahedron(2)
    >>> points.shape, faces.shape
    ((66, 3), (128, 3))
    """
    return _core.octahedron_sphere(checked_whole("level", level, 0, 10))


def fibonacci(n: int) -> Points:
    """`n` evenly spread directions: a spiral around the y axis that turns by the golden angle.

    For any number of samples, such as the 14, 25 or 55 of the 2001 paper. `hull` joins four or more to a sphere.

    Returns
    -------
    (n, 3) ndarray of float64
        Unit vectors, each in the middle of a zone of the same area.

    Raises
    ------
    ValueError
        If `n` is not an integer from 1 to 16,777,216.

    Examples
    --------
    >>> fibonacci(25).shape
    (25, 3)
    """
    return _core.fibonacci_points(checked_whole("n", n, 1, 2**24))


def hull(points: npt.ArrayLike) -> Faces:
    """The triangulation of free camera positions: the convex hull of their directions (2001, section 3.2.1).

    Parameters
    ----------
    points : (N, 3) array_like of float
        Positions around the origin (the model's centre), at any distance: only directions count.

    Returns
    -------
    (2 N - 4, 3) ndarray of uint32
        Counter-clockwise seen from outside, sorted, each beginning with its lowest corner. Every point is a corner:
        where more than three lie on one circle without another inside, their polygon is cut into triangles, in one of
        the possible ways (always the same for the same points).

    Raises
    ------
    ValueError
        If a position is zero, infinite or NaN; two have the same direction (less than 1e-6 radians, a fifth of an
        arc second, apart); there are fewer than four; or they do not surround the origin (all lie in a half-space, up
        to 1e-6 radians). The message says which, or where nothing is.

    Notes
    -----
    Computed with exact signs (Shewchuk's adaptive predicates), so no arrangement of points leaves a gap or an
    overlap.

    Examples
    --------
    >>> corners = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    >>> hull(corners).shape
    (12, 3)
    """
    return _core.hull_faces(_vectors("points", points))


class Locator:
    """A sphere, prepared to be asked often which face a direction passes through.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Directions of any length.
    faces : (F, 3) array_like of int
        A closed triangulation of them, such as `octahedron`, `hull` and `subdivide` return.

    Raises
    ------
    ValueError
        If the faces do not cover each direction exactly once, facing outward.

    Examples
    --------
    >>> points, faces = octahedron(1)
    >>> locator = Locator(points, faces)
    >>> locator.locate([[3, 2, 1], [0, 0, -1]])
    array([ 0, 17], dtype=uint32)
    """

    def __init__(self, points: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        points = _vectors("points", points)
        self._faces = _faces(faces, len(points))
        self._core = _core.Locator(points, self._faces)

    def locate(self, directions: npt.ArrayLike, *, out: Indices | None = None) -> Indices:
        """The face that each direction passes through, see the function `locate`.

        `out`, if given, is a contiguous (M,) uint32 array that the answer is written to and that is returned.
        """
        vectors = _vectors("directions", directions)
        if out is None:
            return self._core.locate(vectors)
        if not isinstance(out, np.ndarray) or out.dtype != np.uint32 or out.ndim != 1 or not out.flags.writeable:
            raise ValueError("out must be a writable (M,) array of uint32")
        self._core.locate_into(vectors, out)
        return out

    def surrounding(self, face: npt.ArrayLike, count: int = 3) -> Indices:
        """The samples around a face or faces, see the function `surrounding`, which this is quicker than."""
        return _around(self._faces, face, count, self._core.surrounding)


def locate(points: npt.ArrayLike, faces: npt.ArrayLike, directions: npt.ArrayLike) -> Indices:
    """The face that each direction passes through (2002, section 3.3.1).

    Octahedral spheres are descended, at most four tests a level; others are walked from a face near the direction.
    To ask the same sphere again, keep a `Locator`.

    Parameters
    ----------
    points, faces
        The sphere, see `Locator`.
    directions : (M, 3) array_like of float
        Of any length but zero.

    Returns
    -------
    (M,) ndarray of uint32
        Every direction has an answer. Signs are exact: one that is on an edge or a point, to the bit, belongs to the
        first of the faces around.

    Raises
    ------
    ValueError
        If a direction is zero, infinite or NaN, or the faces do not cover each direction once.

    Examples
    --------
    >>> points, faces = octahedron(4)
    >>> locate(points, faces, [[0, 0, 5.0], [1, 1, 1]])
    array([170, 255], dtype=uint32)
    """
    return Locator(points, faces).locate(directions)


def surrounding(faces: npt.ArrayLike, face: npt.ArrayLike, count: int = 3) -> Indices:
    """The samples around a face: its three corners, or six with those across its edges (2001, section 3.2.1).

    Parameters
    ----------
    faces : (F, 3) array_like of int
        A closed triangulation.
    face : int or (M,) array_like of int
        Which face, or faces.
    count : {3, 6}
        With 6, the corners are followed by the points opposite them across the edges from corner 0 to 1, 1 to 2, 2 to
        0. On a sphere of four or five points, points repeat.

    Returns
    -------
    (count,) or (M, count) ndarray of uint32

    Raises
    ------
    ValueError
        If `count` is neither, a face is none, or (with 6) the faces are not closed.

    Examples
    --------
    >>> points, faces = octahedron(0)
    >>> surrounding(faces, 0)
    array([0, 2, 4], dtype=uint32)
    >>> surrounding(faces, [0, 7], count=6)
    array([[0, 2, 4, 5, 1, 3],
           [1, 5, 3, 2, 0, 4]], dtype=uint32)
    """
    triangles = _faces(faces)
    return _around(triangles, face, count, lambda wanted: _core.surrounding_six(triangles, wanted))


def _around(faces: Faces, face: npt.ArrayLike, count: int, six: Callable[[npt.NDArray[np.int64]], Indices]) -> Indices:
    """The samples around `face`, of any shape; `six` answers for a row of faces."""
    wanted = _indices("face", face, len(faces), "faces")
    if count == 3:
        return faces[wanted]
    if count != 6:
        raise ValueError(f"count must be 3 or 6, got {count!r}")
    return six(wanted.reshape(-1)).reshape(*wanted.shape, 6)


def faces_in_cap(points: npt.ArrayLike, faces: npt.ArrayLike, direction: npt.ArrayLike, angle: float) -> Indices:
    """The faces that come within an angle of a direction.

    With `crossing_angle`, those through which the rays of an eye off the sampling sphere pass.

    Parameters
    ----------
    points, faces
        A closed triangulation of directions.
    direction : (3,) array_like of float
        The middle of the cap, of any length but zero.
    angle : float
        Its radius in degrees, 0 to 180.

    Returns
    -------
    (K,) ndarray of uint32
        Ascending. Conservative: a face farther by less than 1e-10 degrees may be among them, none that is nearer is
        missing.

    Raises
    ------
    ValueError
        If the direction is zero, infinite or NaN, or the angle is not between 0 and 180 degrees.

    Examples
    --------
    >>> points, faces = octahedron(0)
    >>> faces_in_cap(points, faces, [1, 1, 1], 40)
    array([0, 1, 2, 4], dtype=uint32)
    """
    middle = _vectors("direction", np.asarray(direction)[None])
    if not 0 <= angle <= 180:
        raise ValueError(f"angle must be between 0 and 180 degrees, got {angle!r}")
    points = _vectors("points", points)
    x, y, z = middle[0].tolist()
    return _core.faces_in_cap(points, _faces(faces, len(points)), (x, y, z), float(np.radians(angle)))


def crossing_angle(radius: float, sampling_radius: float, eye_distance: float) -> float:
    """How far from an eye's direction its rays cross the sampling sphere.

    Parameters
    ----------
    radius : float
        Of a ball around the centre that holds the model.
    sampling_radius : float
        Of the sphere that views were sampled on; at least `radius`.
    eye_distance : float
        Of the eye from the centre; at least `radius`, ``inf`` for an orthographic view.

    Returns
    -------
    float
        Degrees, at the centre, between the eye and the farthest point of the sampling sphere that one of the eye's
        rays to the model, or its line extended back past the eye, crosses on the eye's side.

    Raises
    ------
    ValueError
        If a length is negative or NaN, the radius is zero, or larger than one of the distances.

    Notes
    -----
    Take a ray at distance h from the centre, and on it the point nearest to the centre. Seen from the centre, that
    point is ``acos(h / d)`` from the eye at distance d, and ``acos(h / R)`` from the point where the ray crosses the
    sphere of radius R. Both are on the same side, so the crossing is ``|asin(h / R) - asin(h / d)|`` from the eye,
    which grows with h; the ray meets the ball where h is at most its radius r::

        angle = |asin(r / R) - asin(r / d)|

    Between eye and crossing there is nothing of the model, so what the eye sees along a ray is what an eye at
    the crossing sees along it. Hence an eye that is farther away than the samples (or nearer, but outside the ball)
    sees no more than all sphere faces within this angle do together, as far as their own rows are complete.

    Examples
    --------
    >>> round(crossing_angle(1.0, 2.613, float("inf")), 1)
    22.5
    >>> crossing_angle(1.0, 2.0, 2.0)
    0.0
    """
    if not (0 < radius <= sampling_radius and radius <= eye_distance):
        raise ValueError(
            "radius must be positive and at most sampling_radius and eye_distance, got "
            f"radius={radius!r}, sampling_radius={sampling_radius!r}, eye_distance={eye_distance!r}"
        )
    return float(np.degrees(_core.crossing_angle(radius, sampling_radius, eye_distance)))


def subdivide(points: npt.ArrayLike, faces: npt.ArrayLike, which: npt.ArrayLike) -> tuple[Points, Faces, Indices]:
    """Splits chosen faces in four, and faces beside them as far as the sphere needs it to stay closed.

    Parameters
    ----------
    points, faces
        A closed triangulation of directions.
    which : (K,) array_like of int
        Faces to split.

    Returns
    -------
    points : (N', 3) ndarray of float64
        Unit vectors: those given, normalised, then the middles of split edges, each once.
    faces : (F', 3) ndarray of uint32
        Closed, counter-clockwise seen from outside: no corner lies on another face's edge. A face that was not split
        keeps its index; of one that was, the first part does, and the others follow at the end.
    parents : (F',) ndarray of uint32
        For each face, the given face that it is (a part of).

    Raises
    ------
    ValueError
        If the faces are not closed, or one of `which` is none of them.

    Notes
    -----
    A face that shares a split edge is split in 2, 3 or 4, its longest edge always among the split ones. That may
    split the next face, but only across ever longer edges, and it keeps angles from vanishing when splitting is
    repeated (Rivara, Algorithms for refining triangular grids, 1984).

    Examples
    --------
    >>> points, faces = octahedron(1)
    >>> finer_points, finer_faces, parents = subdivide(points, faces, [3])
    >>> len(finer_faces), np.bincount(parents)[3]
    (38, np.int64(4))
    """
    points = _vectors("points", points)
    triangles = _faces(faces, len(points))
    wanted = _indices("which", which, len(triangles), "faces")
    if wanted.ndim != 1:
        raise ValueError(f"which must have shape (K,), got {wanted.shape}")
    return _core.subdivide_faces(points, triangles, wanted.astype(np.uint32))


@dataclass(frozen=True)
class Cover:
    """A small set of samples, and how much smaller one could be.

    Attributes
    ----------
    indices : (K,) ndarray of uint32
        Ascending.
    lower_bound : int
        No set of fewer samples covers as much: proved by the solver.
    """

    indices: Indices
    lower_bound: int

    @property
    def gap(self) -> float:
        """Share of the samples that a perfect answer might do without; 0 where this is one."""
        return (len(self.indices) - self.lower_bound) / max(len(self.indices), 1)


@overload
def cover(bits: Any, tolerance: float = ..., *, exact: Literal[False] = ..., time_limit: float = ...) -> Indices: ...


@overload
def cover(bits: Any, tolerance: float = ..., *, exact: Literal[True], time_limit: float = ...) -> Cover: ...


def cover(bits: Any, tolerance: float = 0.0, *, exact: bool = False, time_limit: float = 60.0) -> Indices | Cover:
    """The fewest samples whose union holds all that any sample sees (2002, section 5: future work).

    Parameters
    ----------
    bits : Bitfields, (S, W) ndarray of uint64 or (S, F) ndarray of bool
        What each sample sees.
    tolerance : float
        Share of what is seen that may be lost, 0 to 1.
    exact : bool
        Ask a solver (SciPy's HiGHS) for the smallest set, for small cases; it begins from the greedy answer and
        proves how good its own is.
    time_limit : float
        Seconds that the solver may take.

    Returns
    -------
    (K,) ndarray of uint32, or `Cover` if exact
        Samples in the order they were picked: each adds the most of what those before it leave out, the first of
        equals. None is needless. At most H(n) = 1 + 1/2 + ... + 1/n times as many as needed, n the most bits of one
        row (Chvátal, 1979).

    Raises
    ------
    ValueError
        If `bits` is something else or the tolerance is not between 0 and 1.
    ImportError
        If `exact` and SciPy is missing.

    Examples
    --------
    >>> seen = np.array([[1, 1, 0, 0], [0, 1, 1, 1], [1, 0, 0, 0]], dtype=bool)
    >>> cover(seen)
    array([1, 0], dtype=uint32)
    >>> cover(seen, tolerance=0.25)
    array([1], dtype=uint32)
    >>> best = cover(seen, exact=True)
    >>> best.indices, best.lower_bound, best.gap
    (array([0, 1], dtype=uint32), 2, 0.0)
    """
    if not 0 <= tolerance <= 1:
        raise ValueError(f"tolerance must be between 0 and 1, got {tolerance!r}")
    words = _words(bits)
    seen = int(np.bitwise_count(np.bitwise_or.reduce(words, axis=0)).sum()) if len(words) else 0
    # A share such as 0.1 of 30 is 3, though 0.1 * 30 rounds above or below.
    spare = int(tolerance * seen + 1e-9)
    greedy = _core.cover_rows(words, spare)
    return _smallest(words, spare, greedy, time_limit) if exact else greedy


def _words(bits: Any) -> npt.NDArray[np.uint64]:
    """Rows of `bits` as packed words."""
    array = np.asarray(getattr(bits, "words", bits))
    if array.ndim != 2 or array.dtype not in (np.uint64, np.bool_):
        raise ValueError(
            "bits must be Bitfields, an (S, W) array of uint64 or an (S, F) array of bool, "
            f"got shape {array.shape} of {array.dtype}"
        )
    return bitfield.pack(array) if array.dtype == np.bool_ else np.ascontiguousarray(array)


def _smallest(words: npt.NDArray[np.uint64], spare: int, greedy: Indices, time_limit: float) -> Cover:
    """The smallest cover that a solver finds in time, or the greedy one, with the bound that it proved."""
    if not time_limit > 0:
        raise ValueError(f"time_limit must be positive, got {time_limit!r}")
    try:
        from scipy.optimize import Bounds, LinearConstraint, milp
        from scipy.sparse import csr_array, hstack, identity
    except ImportError as error:
        raise ImportError("cover(exact=True) needs SciPy: pip install cyclorama[mesh]") from error
    rows = len(words)
    flags = np.unpackbits(words.astype("<u8").view(np.uint8), axis=1, bitorder="little")
    # Faces that the same samples see are one condition, of their number's weight.
    conditions, weights = np.unique(flags[:, flags.any(axis=0)].T, axis=0, return_counts=True)
    if not len(greedy):
        return Cover(greedy, 0)
    # Variables: a sample is taken; and, where some may be lost, a condition is given up.
    taken = csr_array(conditions.astype(np.float64))
    if spare:
        taken = hstack([taken, identity(len(conditions))])
    constraints = [LinearConstraint(taken, lb=1)]
    cost = np.zeros(taken.shape[1])
    cost[:rows] = 1
    if spare:
        constraints.append(LinearConstraint(np.concatenate([np.zeros(rows), weights])[None], ub=spare))
    result = milp(
        cost,
        integrality=np.ones_like(cost),
        bounds=Bounds(0, 1),
        constraints=constraints,
        options={"time_limit": float(time_limit)},
    )
    best = np.sort(greedy)
    if result.x is not None:
        found = np.flatnonzero(result.x[:rows] > 0.5).astype(np.uint32)
        lost = weights[~conditions[:, found].any(axis=1)].sum()
        if len(found) < len(best) and lost <= spare:
            best = found
    bound = result.mip_dual_bound if result.mip_dual_bound is not None else 1.0
    # The bound is a float that the solver trusts to 1e-6.
    return Cover(best, min(len(best), max(1, int(np.ceil(bound - 1e-6)))))
