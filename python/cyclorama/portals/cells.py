"""Cells, the rooms of a building, and portals, the openings between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .. import _core
from .voxels import Rooms

__all__ = ["Cell", "Portal", "parse_cells", "parse_portals"]

Floats = npt.NDArray[np.float64]

# Shares of the building's size: boxes that overlap by less touch, and a polygon this far off its plane is flat. Files
# in float32 or with rounded metres are within it.
TOUCH = 1e-5


@dataclass(frozen=True, eq=False)
class Cell:
    """A room, or a passage between rooms.

    Attributes
    ----------
    name : str
        For people.
    low, high : (3,) ndarray of float64
        The box around it.
    triangles : (T, 3, 3) ndarray of float64 or None
        Its closed surface; None if it is the whole box.
    shut : bool
        Whether something in it, as the pane of a window, ends every view that comes in: only an eye in it looks out.
    rooms, label : Rooms or None, int
        The cubes it is made of, for a cell that was found in a mesh.
    """

    name: str
    low: Floats
    high: Floats
    triangles: Floats | None = None
    shut: bool = False
    rooms: Rooms | None = None
    label: int = 0

    @cached_property
    def _surface(self) -> _core.Solid | None:
        return None if self.triangles is None else _core.Solid(self.triangles.reshape(-1, 9))

    def holds(self, point: Floats, slack: float = 0.0) -> bool:
        """Whether a point lies inside, or in the box within `slack` of it."""
        if not ((point >= self.low - slack) & (point <= self.high + slack)).all():
            return False
        if self.rooms is not None:
            return self.rooms.at(point) == self.label
        return self._surface is None or abs(self._surface.winding(point.tolist())) > 0.5


@dataclass(frozen=True, eq=False)
class Portal:
    """An opening.

    Attributes
    ----------
    polygon : (N, 3) ndarray of float64
        Its convex outline.
    cells : tuple of (int, int or None)
        The cells on both sides; None is outdoors.
    """

    polygon: Floats
    cells: tuple[int, int | None]


def parse_cells(given: Sequence[Mapping[str, Any] | Cell]) -> list[Cell]:
    """Checks cells given as dictionaries: ``name``, and ``min`` and ``max`` (3,) or ``vertices`` and ``faces``;
    and ``shut``.

    Raises
    ------
    ValueError
        If one is empty, not finite or of neither kind, or two overlap.
    """
    cells = [cell if isinstance(cell, Cell) else _cell(index, cell) for index, cell in enumerate(given)]
    if not cells:
        raise ValueError("cells is empty: a building has at least one")
    for i, a in enumerate(cells):
        for j, b in enumerate(cells[:i]):
            low, high = np.maximum(a.low, b.low), np.minimum(a.high, b.high)
            size = float((np.maximum(a.high, b.high) - np.minimum(a.low, b.low)).max())
            if (high - low > TOUCH * size).all() and _share_inside(a, b, low, high):
                raise ValueError(
                    f"cells[{i}] ({a.name}) and cells[{j}] ({b.name}) overlap between {low.tolist()} "
                    f"and {high.tolist()}: a point would be in both"
                )
    return cells


def _share_inside(a: Cell, b: Cell, low: Floats, high: Floats) -> bool:
    """Whether some of the common box is in both; of two whole boxes all is."""
    if a.rooms is not None and a.rooms is b.rooms:
        return a.label == b.label
    if a.rooms is None and b.rooms is None and a.triangles is None and b.triangles is None:
        return True
    steps = (np.arange(5) + 0.5) / 5
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    return any(a.holds(p) and b.holds(p) for p in low + grid * (high - low))


def _cell(index: int, given: Mapping[str, Any]) -> Cell:
    name = str(given.get("name", index))
    where = f"cells[{index}] ({name})"
    shut = given.get("shut", False)
    if not isinstance(shut, bool):
        raise ValueError(f"{where}.shut must be true or false, got {shut!r}")
    if "min" in given and "max" in given:
        low, high = _numbers(f"{where}.min", given["min"], (3,)), _numbers(f"{where}.max", given["max"], (3,))
        for axis in np.flatnonzero(~(low < high)):
            raise ValueError(f"{where} is empty: min[{axis}] is {low[axis]}, max[{axis}] is {high[axis]}")
        return Cell(name, low, high, None, shut)
    if "vertices" in given and "faces" in given:
        vertices = _numbers(f"{where}.vertices", given["vertices"], (None, 3))
        faces = np.asarray(given["faces"])
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
            raise ValueError(f"{where}.faces must be (F, 3) integers, got {faces.shape} {faces.dtype}")
        for face, corner in np.argwhere((faces < 0) | (faces >= len(vertices))):
            raise ValueError(f"{where}.faces[{face}] names vertex {faces[face, corner]}, there are {len(vertices)}")
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, uses = np.unique(edges, axis=0, return_counts=True)
        if (uses % 2).any():
            raise ValueError(f"{where} is not closed: {int((uses % 2).sum())} of its edges end in the open")
        return Cell(name, vertices.min(0), vertices.max(0), vertices[faces], shut)
    raise ValueError(f"{where} needs min and max, or vertices and faces; it has {sorted(given)}")


def parse_portals(given: Sequence[Mapping[str, Any] | Portal], cells: Sequence[Cell]) -> list[Portal]:
    """Checks portals given as dictionaries: ``polygon`` (N, 3) and ``cells`` [a, b], where b may be None for outdoors.

    Raises
    ------
    ValueError
        If a portal names a cell that is not there, its polygon is not flat or not convex, or lies apart from its cells.
    """
    return [p if isinstance(p, Portal) else _portal(index, p, cells) for index, p in enumerate(given)]


def _portal(index: int, given: Mapping[str, Any], cells: Sequence[Cell]) -> Portal:
    where = f"portals[{index}]"
    try:
        sides, outline = list(given["cells"]), given["polygon"]
    except (KeyError, TypeError) as error:
        raise ValueError(f"{where} needs polygon and cells") from error
    if len(sides) != 2:
        raise ValueError(f"{where}.cells must name two sides, got {sides}")
    inner = [side for side in sides if side is not None]
    if not inner:
        raise ValueError(f"{where} belongs to no cell: both of its sides are outdoors")
    for side in inner:
        if not isinstance(side, (int, np.integer)) or not 0 <= side < len(cells):
            raise ValueError(f"{where} names cell {side!r}, there are {len(cells)}")
    if len(inner) == 2 and inner[0] == inner[1]:
        raise ValueError(f"{where} leads from cell {inner[0]} to itself")
    polygon = _numbers(f"{where}.polygon", outline, (None, 3))
    if len(polygon) < 3:
        raise ValueError(f"{where}.polygon needs at least 3 corners, got {len(polygon)}")
    middle = polygon.mean(0)
    size = float(np.linalg.norm(polygon - middle, axis=1).max())
    normal = np.cross(polygon - middle, np.roll(polygon, -1, 0) - middle).sum(0)
    length = float(np.linalg.norm(normal))
    if not length > 1e-9 * size**2:
        raise ValueError(f"{where}.polygon spans no area")
    normal /= length
    off = np.abs((polygon - middle) @ normal)
    if off.max() > TOUCH * size:
        raise ValueError(f"{where}.polygon is not flat: corner {int(off.argmax())} lies {off.max():.3g} off its plane")
    along, turn = np.roll(polygon, -1, 0) - polygon, np.roll(polygon, -2, 0) - np.roll(polygon, -1, 0)
    bends = np.cross(along, turn) @ normal
    if bends.min() < -(TOUCH * size) * size:
        raise ValueError(f"{where}.polygon is not convex at corner {(int(bends.argmin()) + 1) % len(polygon)}")
    for side in inner:
        cell = cells[side]
        slack = TOUCH * float((cell.high - cell.low).max()) + TOUCH * size
        gap = np.maximum(cell.low - polygon.max(0), polygon.min(0) - cell.high).max()
        if gap > slack:
            raise ValueError(f"{where} lies {gap:.3g} away from cells[{side}] ({cell.name}), which it names")
    first, second = (sides[0], sides[1]) if sides[0] is not None else (sides[1], None)
    return Portal(polygon, (int(first), None if second is None else int(second)))


def _numbers(name: str, value: Any, shape: tuple[int | None, ...]) -> Floats:
    array = np.array(value, dtype=np.float64)
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("N" if n is None else str(n) for n in shape)
        raise ValueError(f"{name} must have shape ({wanted}), got {array.shape}")
    for at in np.argwhere(~np.isfinite(array)):
        raise ValueError(f"{name}{at.tolist()} is {array[tuple(at)]}: coordinates must be finite")
    return array
