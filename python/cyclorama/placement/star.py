"""Star-shapes: the eyes that have a viewpoint as the closest in their reverse frustum (1998, section 3.4.1)."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import _core
from . import _checks

__all__ = ["StarRadius", "lattice", "star_radius"]

Floats = npt.NDArray[np.float64]

#: Kinds of places of an odd level: a viewpoint of the coarser even level, middles of its edges, and a centre.
_ODD_PLACES = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1))


class StarRadius(NamedTuple):
    """The greatest distance of such an eye, between two bounds."""

    low: float
    high: float
    #: (3,) an eye at the lower bound, around the viewpoint, and its gaze: eyes as near to it as you like, on the way to
    #: the viewpoint, have it as their closest. A direction if the bounds are infinite, zero if there is no such eye.
    eye: Floats
    forward: Floats
    #: How many parts of the search were looked at.
    parts: int


def lattice(level: Literal["even", "odd"], reach: float, *, place: tuple[int, int, int] = (0, 0, 0)) -> Floats:
    """The viewpoints of an endless grid of spacing 1 around one of them.

    Parameters
    ----------
    level : {"even", "odd"}
        A cubic grid; or one that has every place but those with two odd coordinates.
    reach : float
        Those within this distance, at least 0.
    place : (int, int, int)
        Which place the one in the middle has: its parities matter at odd levels.

    Returns
    -------
    (N, 3) ndarray of float64
        Without the one in the middle.

    Raises
    ------
    ValueError
        If `level` is unknown, `reach` is negative or above 100, or `place` is none of an odd level.

    Examples
    --------
    >>> len(lattice("even", 1.8)), len(lattice("odd", 1.8))
    (26, 14)
    """
    if level not in ("even", "odd"):
        raise ValueError(f"level must be 'even' or 'odd', got {level!r}")
    if not 0 <= reach <= 100:
        raise ValueError(f"reach must be 0 to 100 spacings, got {reach}")
    if level == "odd" and sum(c % 2 for c in place) == 2:
        raise ValueError(f"place {place} has two odd coordinates: odd levels have no viewpoint there")
    return _core.placement_lattice(level == "odd", place, float(reach))


def star_radius(
    viewpoints: npt.ArrayLike | Literal["even", "odd"],
    *,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    up: npt.ArrayLike = (0, 1, 0),
    yaws: tuple[float, float] | None = (0.0, 360.0),
    domain: npt.ArrayLike | None = None,
    tolerance: float = 0.01,
    most: int = 1_000_000,
) -> StarRadius:
    """How far from a viewpoint an eye can be that has it as the closest viewpoint in its reverse frustum.

    An image of a viewpoint whose plane lies beyond that radius is before every eye that uses it.

    Parameters
    ----------
    viewpoints : (N, 3) array_like of float, "even" or "odd"
        The other viewpoints, around the one that is asked for; or an endless grid of spacing 1, the dissertation's even
        or odd level: for "odd", the greatest radius of its kinds of viewpoints.
    fov_x, aspect, up
        The field of view in degrees, width over height, and the upward axis.
    yaws : (float, float), optional
        Gazes are level, between these yaws in degrees; `None` for gazes in all directions. Yaw counts counter-clockwise
        about `up`, from the axis after it.
    domain : (2, 3) array_like of float, optional
        Lowest and highest corner of the box in which eyes are, around the viewpoint; by default they are anywhere.
    tolerance : float
        How near the bounds are to be, relatively.
    most : int
        How many parts are searched at most: beyond, the bounds are wider, and still bounds.

    Returns
    -------
    StarRadius
        In units of `viewpoints`; infinite where no other viewpoint takes the eyes over.

    Raises
    ------
    ValueError
        If an argument is out of range; the message names it.

    Notes
    -----
    The dissertation fits spheres of 2 spacings (even) and 3 (odd) for 54 degrees or more. With 60 by 46.8 degrees, eyes
    up to 2.27 spacings away use a viewpoint of an even level. Near the poles of ``yaws=None``, the gazes that take the
    next axis for `up` are searched too.

    Examples
    --------
    >>> r = star_radius("even", fov_x=60, aspect=4 / 3)
    >>> 2.25 < r.low <= r.high < 2.3
    True
    """
    tangents = _checks.tangents(fov_x, aspect)
    if not 0 < tolerance < 1:
        raise ValueError(f"tolerance must be above 0 and below 1, got {tolerance}")
    if most < 1:
        raise ValueError(f"most must be at least 1, got {most}")
    axis = _checks.axis("up", up)
    if yaws is not None:
        from_, to = (float(y) for y in yaws)
        if not from_ <= to <= from_ + 360:
            raise ValueError(f"yaws must ascend and span at most 360 degrees, got {yaws!r}")
        # A full turn in radians is one of the kernel's own, whatever rounding says.
        yaws = np.radians(from_), np.radians(from_) + (2 * np.pi if to - from_ == 360 else np.radians(to - from_))
    box = None
    if domain is not None:
        corners = np.asarray(domain, dtype=np.float64)
        if corners.shape != (2, 3) or not np.isfinite(corners).all() or (corners[0] > corners[1]).any():
            raise ValueError(f"domain must be a lowest and a highest corner, got {domain!r}")
        box = _checks.vector("domain[0]", corners[0]), _checks.vector("domain[1]", corners[1])
    if isinstance(viewpoints, str):
        if viewpoints not in ("even", "odd"):
            raise ValueError(f"viewpoints must be an array, 'even' or 'odd', got {viewpoints!r}")
        # A ball of the covering radius in the reverse frustum holds a viewpoint; others matter up to twice as far.
        covering = 1.0 if viewpoints == "odd" else 0.75**0.5
        reach = 2 * covering * (1 + 1 / np.sin(np.arctan(min(tangents))))
        if reach > 100:
            raise ValueError(f"fov_x {fov_x} with aspect {aspect} is too narrow for an endless grid: give viewpoints")
        places = _ODD_PLACES if viewpoints == "odd" else _ODD_PLACES[:1]
        sets = [lattice("odd" if viewpoints == "odd" else "even", reach, place=p) for p in places]
    else:
        others = np.ascontiguousarray(viewpoints, dtype=np.float64)
        if others.ndim != 2 or others.shape[1] != 3 or not np.isfinite(others).all():
            raise ValueError(f"viewpoints must be finite with shape (N, 3), got shape {others.shape}")
        if (others == 0).all(axis=1).any():
            raise ValueError("viewpoints must be the others: one of them is at zero, where the one asked for is")
        sets = [others]
    found = [_core.placement_star(s, tangents, axis, yaws, box, tolerance, most) for s in sets]
    low, _, eye, forward, _ = max(found, key=lambda f: f[0])
    return StarRadius(low, max(f[1] for f in found), np.array(eye), np.array(forward), sum(f[4] for f in found))
