"""Panoramas: which direction each pixel looks in."""

from __future__ import annotations

import math
import operator
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from .. import _core
from ..arguments import checked_choice, checked_floats

__all__ = ["Kind", "Projection"]

Floats = npt.NDArray[np.float64]

Kind = Literal["cylinder", "equirect"]


class Projection:
    """The pixels of a panorama, all round.

    Columns are angles about the up axis. The middle column looks along `-back`; columns to the right of it turn to the
    right.

    Parameters
    ----------
    kind : {"cylinder", "equirect"}
        Rows are heights on a cylinder, whose pixels are square on the horizon (4096 x 1024 see 76 degrees of height),
        or angles from straight up to straight down (4096 x 2048: all directions, square on the horizon).
    size : (int, int)
        Columns and rows, 8 to 32768 each.
    up : (3,) array_like of float
        The world's up direction.

    Attributes
    ----------
    kind, width, height
    axes : (3, 3) ndarray
        Rows right, up and back, in the world's coordinates.
    focal : float
        Pixels a radian on the horizon.

    Raises
    ------
    ValueError
        If the kind is no such thing, a side is too small or too large, or `up` is zero.

    Examples
    --------
    >>> panorama = Projection("cylinder", (4096, 1024))
    >>> panorama.directions()[512, 2048].round(3)
    array([ 0.001, -0.001, -1.   ])
    >>> panorama.places([[1.0, 0.0, 0.0]])
    array([[3072.,  512.]])
    """

    def __init__(
        self, kind: Kind = "cylinder", size: tuple[int, int] = (4096, 1024), *, up: npt.ArrayLike = (0.0, 1.0, 0.0)
    ) -> None:
        checked_choice("projection", kind, get_args(Kind))
        try:
            width, height = (operator.index(side) for side in size)
        except (TypeError, ValueError):
            raise ValueError(f"size must be (columns, rows), whole numbers, got {size!r}") from None
        self.kind: Kind = kind
        self.width, self.height = width, height
        self.axes = _axes(up)
        if not (8 <= width <= 32768 and 8 <= height <= 32768):
            raise ValueError(f"size must be 8 to 32768 pixels a side, got {width} x {height}")
        self.kernel = _core.Panorama(kind == "cylinder", width, height, self.axes)

    def __repr__(self) -> str:
        return f"<Projection: {self.kind}, {self.width} x {self.height}>"

    @property
    def focal(self) -> float:
        return self.width / (2 * math.pi)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    def resized(self, width: int, height: int) -> Projection:
        """The same directions in other pixels."""
        return Projection(self.kind, (width, height), up=self.axes[1])

    def directions(self) -> Floats:
        """(H, W, 3) unit directions through the middles of pixels, in the world's coordinates."""
        return self.kernel.directions()

    def places(self, directions: npt.ArrayLike) -> Floats:
        """(N, 2) column and row of (N, 3) directions; the middle of pixel (x, y) is (x + 0.5, y + 0.5). Rows may be
        beyond the panorama."""
        return self.kernel.places(np.ascontiguousarray(directions, dtype=np.float64))

    def solid_angles(self) -> Floats:
        """(H, 1) solid angle of the pixels of each row, in steradians."""
        y = np.arange(self.height + 1)
        if self.kind == "cylinder":
            tangent = (0.5 * self.height - y) / self.focal
            sine = tangent / np.hypot(1.0, tangent)
        else:
            sine = np.cos(np.pi * y / self.height)
        return np.asarray(-np.diff(sine)[:, None] * 2 * np.pi / self.width)

    def to_json(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"projection": self.kind, "size": [self.width, self.height], "axes": self.axes.tolist()}


def _axes(up: npt.ArrayLike) -> Floats:
    upward = checked_floats("up", up)
    if upward.shape != (3,) or not np.isfinite(upward).all() or not upward.any():
        raise ValueError(f"up must be a direction, got {up!r}")
    upward /= np.linalg.norm(upward)
    # The world's axis that is least along `up`, after z: back is close to it.
    back = np.eye(3)[2 if abs(upward[2]) < 0.9 else 1] * (1.0 if abs(upward[2]) < 0.9 else -1.0)
    right = np.cross(upward, back)
    right /= np.linalg.norm(right)
    return np.stack([right, upward, np.cross(right, upward)])
