"""A track through a scene, by arc length."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .. import _core
from ..arguments import checked_floats, checked_number

if TYPE_CHECKING:
    from ..scene import Scene

__all__ = ["Track"]

Floats = npt.NDArray[np.float64]

# Chords of a spline a stretch between two of its points: the widest is off by less than a thousandth of the stretch.
_CHORDS = 32
# References of a walkthrough: a spacing that asks for more is a slip.
_MOST_PLACES = 10_000


class Track:
    """A polyline, or a spline, through points.

    Parameters
    ----------
    points : (N, 3) array_like of float
        At least two, in the scene's units. Points that repeat the one before are left out.
    spline : bool
        A centripetal Catmull-Rom spline through the points instead of straight lines. It is kept as a polyline of 32
        chords a stretch.
    closed : bool
        Whether the last point leads back to the first.

    Attributes
    ----------
    points : (N, 3) ndarray
        As given.
    knots : (M, 3) ndarray
        The corners of the polyline.
    at_knots : (M,) ndarray
        Where they are, from 0 to 1.
    length : float

    Raises
    ------
    ValueError
        If there are fewer than two different points, or a coordinate isn't finite.

    Examples
    --------
    >>> track = Track([(0, 0, 0), (3, 0, 0), (3, 0, 1)])
    >>> track.length, track.at(0.5), track.direction(0.9)
    (4.0, array([2., 0., 0.]), array([0., 0., 1.]))
    """

    def __init__(self, points: npt.ArrayLike, *, spline: bool = False, closed: bool = False) -> None:
        array = checked_floats("points", points)
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"points must have shape (N, 3), got {array.shape}")
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if len(bad):
            raise ValueError(f"points[{bad[0]}] is {array[bad[0]].tolist()}: coordinates must be finite")
        array.flags.writeable = False
        self.points, self.spline, self.closed = array, bool(spline), bool(closed)
        moved = np.ones(len(array), np.bool_)
        moved[1:] = (np.diff(array, axis=0) != 0).any(axis=1)
        corners = array[moved]
        if closed and len(corners) > 1 and (corners[0] == corners[-1]).all():
            corners = corners[:-1]
        if len(corners) < 2:
            raise ValueError(f"a track needs two different points, got {array.tolist()}")
        knots = _spline(corners, self.closed) if spline else corners
        if closed and not spline:
            knots = np.concatenate([knots, knots[:1]])
        steps = np.linalg.norm(np.diff(knots, axis=0), axis=1)
        self.knots, self.length = knots, float(steps.sum())
        self.at_knots = np.concatenate([[0.0], np.cumsum(steps) / steps.sum()])
        self.at_knots[-1] = 1.0

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Track:
        """A track from a JSON file: a list of points, or what `to_json` gives.

        Raises
        ------
        ValueError
            If it is neither. The message begins with the path.
        """
        try:
            found = json.loads(Path(path).read_bytes())
            if isinstance(found, list):
                return cls(found)
            return cls(found["points"], spline=found.get("spline", False), closed=found.get("closed", False))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            said = f"it has no {error}" if isinstance(error, KeyError) else str(error)
            raise ValueError(f"{path}: not a track (a list of points, or points, spline and closed): {said}") from error

    def __repr__(self) -> str:
        return f"<Track: {len(self.points)} points, length {self.length:.6g}>"

    def at(self, t: npt.ArrayLike) -> Floats:
        """Positions, by share of the length.

        Parameters
        ----------
        t : (...,) array_like of float
            From 0 to 1.

        Returns
        -------
        (..., 3) ndarray

        Raises
        ------
        ValueError
            If one is outside [0, 1].
        """
        share = _shares(t)
        stretch = self._stretch(share)
        low, high = self.at_knots[stretch], self.at_knots[stretch + 1]
        along = np.where(high > low, (share - low) / np.where(high > low, high - low, 1.0), 0.0)[..., None]
        return np.asarray(self.knots[stretch] * (1 - along) + self.knots[stretch + 1] * along)

    def direction(self, t: npt.ArrayLike) -> Floats:
        """(..., 3) unit directions of travel; at a corner that of the stretch after it."""
        stretch = self._stretch(_shares(t))
        ahead = self.knots[stretch + 1] - self.knots[stretch]
        return np.asarray(ahead / np.linalg.norm(ahead, axis=-1, keepdims=True))

    def _stretch(self, share: Floats) -> npt.NDArray[np.intp]:
        return np.clip(np.searchsorted(self.at_knots, share, side="right") - 1, 0, len(self.knots) - 2)

    def between(self, start: float, end: float) -> Floats:
        """(M, 3) the corners of the track from one place to another, with both ends.

        Examples
        --------
        >>> Track([(0, 0, 0), (3, 0, 0), (3, 0, 1)]).between(0.5, 1.0)
        array([[2., 0., 0.],
               [3., 0., 0.],
               [3., 0., 1.]])
        """
        inside = (self.at_knots > start) & (self.at_knots < end)
        return self.at(np.concatenate([[start], self.at_knots[inside], [end]]))

    def spaced(self, spacing: float) -> Floats:
        """Places of reference viewpoints at a fixed spacing: both ends, the corners of a polyline, and so many between
        them that no two are farther apart than `spacing`, evenly.

        Parameters
        ----------
        spacing : float
            In the scene's units.

        Returns
        -------
        (R,) ndarray of float
            Ascending, from 0 to 1.

        Raises
        ------
        ValueError
            If `spacing` isn't positive, or so small that there would be more than 10,000 places.

        Examples
        --------
        >>> Track([(0, 0, 0), (3, 0, 0), (3, 0, 1)]).spaced(1.5)
        array([0.   , 0.375, 0.75 , 1.   ])
        """
        if not checked_number("spacing", spacing):
            raise ValueError(f"spacing must be above 0, got {spacing!r}")
        if self.length / spacing > _MOST_PLACES:
            raise ValueError(
                f"spacing={spacing:.6g} makes {self.length / spacing:.3g} viewpoints of a track of {self.length:.6g}: "
                f"more than {_MOST_PLACES:,}"
            )
        if self.spline:
            return np.linspace(0.0, 1.0, max(1, math.ceil(self.length / spacing - 1e-9)) + 1)
        places = [np.zeros(1)]
        for low, high in zip(self.at_knots[:-1], self.at_knots[1:], strict=True):
            count = max(1, math.ceil((high - low) * self.length / spacing - 1e-9))
            places.append(np.linspace(low, high, count + 1)[1:])
        return np.concatenate(places)

    def check(self, scene: Scene, *, allow_outside: bool = False) -> None:
        """Refuses a track that no eye can go.

        Parameters
        ----------
        scene : Scene
        allow_outside : bool
            Whether the track may leave the scene's bounds.

        Raises
        ------
        ValueError
            If the track passes through a face that is opaque, and where, or is outside the scene.
        """
        if not allow_outside:
            low, high = scene.bounds
            outside = ((self.knots < low) | (self.knots > high)).any(axis=1)
            if outside.any():
                knot = self.knots[np.flatnonzero(outside)[0]]
                raise ValueError(
                    f"the track is outside the scene at {knot.tolist()}: its bounds are {low.tolist()} to "
                    f"{high.tolist()}; allow_outside=True takes it all the same"
                )
        steps = np.diff(self.knots, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        ranges = _core.panorama_ranges(
            scene._mesh, np.ascontiguousarray(self.knots[:-1]), np.ascontiguousarray(steps / lengths[:, None])
        )
        for index in np.flatnonzero(ranges <= lengths):
            where = self.knots[index] + steps[index] / lengths[index] * ranges[index]
            raise ValueError(f"the track passes through a wall at {where.round(6).tolist()}: lead it round, or end it")

    def to_json(self) -> dict[str, Any]:
        """What the constructor takes, as JSON has it."""
        return {"points": self.points.tolist(), "spline": self.spline, "closed": self.closed}


def _shares(t: npt.ArrayLike) -> Floats:
    share = checked_floats("t", t)
    bad = share[~((share >= 0) & (share <= 1))]
    if bad.size:
        raise ValueError(f"t must be from 0 to 1, got {bad.flat[0]}")
    return share


def _spline(points: Floats, closed: bool) -> Floats:
    """Chords of the centripetal Catmull-Rom spline through points."""
    if len(points) == 2:
        return np.concatenate([points, points[:1]]) if closed else points
    if closed:
        ring = np.concatenate([points[-1:], points, points[:2]])
    else:
        ring = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(np.linalg.norm(np.diff(ring, axis=0), axis=1)))])
    chords = []
    for i in range(1, len(ring) - 2):
        a, b, c, d = knots[i - 1 : i + 3]
        t = np.linspace(b, c, _CHORDS + 1)[:-1, None]
        p, q, r, s = ring[i - 1 : i + 3]
        first = ((b - t) * p + (t - a) * q) / (b - a)
        middle = ((c - t) * q + (t - b) * r) / (c - b)
        last = ((d - t) * r + (t - c) * s) / (d - c)
        left = ((c - t) * first + (t - a) * middle) / (c - a)
        right = ((d - t) * middle + (t - b) * last) / (d - b)
        chords.append(((c - t) * left + (t - b) * right) / (c - b))
    return np.concatenate([*chords, ring[-2:-1]])
