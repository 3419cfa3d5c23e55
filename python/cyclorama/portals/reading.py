"""Cells and portals from files."""

from __future__ import annotations

import json
import os
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..archives import check_format
from .cells import TOUCH, Cell, Portal, parse_cells, parse_portals

__all__ = ["read_building"]

Floats = npt.NDArray[np.float64]
Box = tuple[Floats, Floats]

FORMAT = "cyclorama building 1"


def read_building(path: str | os.PathLike[str]) -> tuple[list[Cell], list[Portal]]:
    """Cells and portals of a JSON file, as `Building.load` documents it."""
    try:
        with Path(path).open(encoding="utf-8") as file:
            content = json.load(file)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not JSON: {error}") from error
    if isinstance(content, dict) and "format" in content:
        try:
            check_format(content, FORMAT)
        except ValueError as error:
            raise ValueError(f"{path} is not a building: {error}") from error
    if isinstance(content, dict) and {"cells", "portals"} <= content.keys():
        cells = parse_cells(content["cells"])
        return cells, parse_portals(content["portals"], cells)
    if isinstance(content, dict) and {"spaces", "doors", "opening_boxes"} <= content.keys():
        return _from_spaces(content)
    raise ValueError(f"{path} has neither cells and portals, nor spaces, doors and opening_boxes")


def _from_spaces(content: dict[str, Any]) -> tuple[list[Cell], list[Portal]]:
    """Rooms, doors and openings of a building model.

    An opening in a wall or slab is a cell of its own, with a portal at each end that leads to a room. Outdoors it leads
    through the door that stands in it, or through a window, which is shut: a cell of its own from its inner side to the
    opening's outer end. An opening with neither ends there. Rooms that touch without a wall have a portal there.
    """
    cells = [_room(index, space) for index, space in enumerate(content["spaces"])]
    rooms = len(cells)
    doors, windows = ([_box(entry) for entry in content.get(kind, [])] for kind in ("doors", "windows"))
    portals: list[Portal] = []
    for opening in map(_box, content["opening_boxes"]):
        door = next((index for index, box in enumerate(doors) if _overlap(box, opening)), None)
        sides = [_side(cells[:rooms], opening, axis, end) for axis in range(3) for end in range(2)]
        touched = {cell for cell, _ in sides if cell is not None}
        if not touched:
            continue
        name = f"passage {content['doors'][door]['name']}" if door is not None else f"opening {len(cells)}"
        axis = int(np.argmin(opening[1] - opening[0]))
        passage = len(cells)
        cells.append(Cell(name, *opening))
        for end in range(2):
            cell, polygon = sides[2 * axis + end]
            if cell is not None or door is not None:
                portals.append(Portal(polygon, (passage, cell)))
                continue
            window = next((box for box in windows if _overlap(box, opening)), None)
            if window is not None:
                pane = opening[0].copy(), opening[1].copy()
                opening[end][axis] = pane[1 - end][axis] = window[1 - end][axis]
                cells[passage] = Cell(name, *opening)
                portals.append(Portal(_rectangle(opening, axis, float(opening[end][axis])), (passage, len(cells))))
                portals.append(Portal(polygon, (len(cells), None)))
                cells.append(Cell(f"window {name}", *pane, shut=True))
    for i, j in combinations(range(rooms), 2):
        portals += [Portal(polygon, (i, j)) for polygon in _joins(cells[i], cells[j])]
    cells = parse_cells(cells)
    return cells, portals


def _room(index: int, space: dict[str, Any]) -> Cell:
    cell = parse_cells([{**space, "name": space.get("long_name", space.get("name", index))}])[0]
    assert cell.triangles is not None
    edges = cell.triangles - np.roll(cell.triangles, 1, axis=1)
    volume = float((cell.triangles[:, 0] * np.cross(edges[:, 1], edges[:, 2])).sum()) / 6
    is_box = np.isclose(abs(volume), np.prod(cell.high - cell.low), rtol=1e-4)
    return Cell(cell.name, cell.low, cell.high) if is_box else cell


def _box(entry: dict[str, Any]) -> Box:
    return np.array(entry["aabb_min"], np.float64), np.array(entry["aabb_max"], np.float64)


def _overlap(a: Box, b: Box) -> bool:
    return bool((np.minimum(a[1], b[1]) - np.maximum(a[0], b[0]) > 0).all())


def _side(cells: list[Cell], box: Box, axis: int, end: int) -> tuple[int | None, Floats]:
    """The cell that a side of a box touches, None for outdoors, and the side as a polygon."""
    polygon = _rectangle(box, axis, box[end][axis])
    slack = TOUCH * float((box[1] - box[0]).max())
    beyond = polygon.mean(0)
    beyond[axis] += (2 * end - 1) * 100 * slack
    return next((index for index, cell in enumerate(cells) if cell.holds(beyond)), None), polygon


def _rectangle(box: Box, axis: int, at: float) -> Floats:
    """The section of a box across an axis."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    polygon = np.empty((4, 3))
    polygon[:, axis] = at
    polygon[:, u] = np.array([box[0][u], box[1][u]])[[0, 1, 1, 0]]
    polygon[:, v] = np.array([box[0][v], box[1][v]])[[0, 0, 1, 1]]
    return polygon


def _joins(a: Cell, b: Cell) -> list[Floats]:
    """Rectangles in which two rooms touch."""
    size = float((np.maximum(a.high, b.high) - np.minimum(a.low, b.low)).max())
    joins = []
    for axis in range(3):
        for first, second in ((a, b), (b, a)):
            at = float(first.high[axis])
            if abs(second.low[axis] - at) > TOUCH * size:
                continue
            p, q = _walls(first, axis, at, TOUCH * size), _walls(second, axis, at, TOUCH * size)
            box = np.maximum(p[0], q[0]), np.minimum(p[1], q[1])
            if (np.delete(box[1] - box[0], axis) > 100 * TOUCH * size).all():
                joins.append(_rectangle(box, axis, at))
    return joins


def _walls(cell: Cell, axis: int, at: float, slack: float) -> Box:
    """The box around those faces of a cell that lie in a plane across an axis."""
    if cell.triangles is None:
        return cell.low, cell.high
    flat = cell.triangles[(np.abs(cell.triangles[..., axis] - at) <= slack).all(axis=1)].reshape(-1, 3)
    return (flat.min(0), flat.max(0)) if len(flat) else (np.full(3, np.inf), np.full(3, -np.inf))
