"""A house of furnished rooms that knows its cells and portals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..scene import Scene
from .solids import Mesh, Points, box, cells, join, normals, turned

__all__ = ["House", "house"]

THICK, HEIGHT, SLAB = 0.2, 2.6, 0.2
DOOR_WIDTH, DOOR_TOP = 0.9, 2.1
WINDOW_WIDTH, SILL = 1.3, 0.9
MARGIN = 0.3  # between a door or window and the end of its wall

Colors = npt.NDArray[np.uint8]
Rgb = tuple[int, int, int]


class House(Scene):
    """What `house` returns: a scene with its cells and portals.

    Attributes
    ----------
    cells : list of dict
        A room each: ``name``, ``min`` (3,) and ``max`` (3,). Rooms reach to the middle of their walls, so that the
        cells fill the house without gaps, from the floor to the ceiling.
    portals : list of dict
        A door or window each: ``polygon`` (4, 3), a rectangle in the middle of the wall, and ``cells`` [a, b], the
        rooms on both sides, where b is None outdoors.
    """

    def __init__(self, mesh: Mesh, colors: Colors, cells: list[dict[str, Any]], portals: list[dict[str, Any]]) -> None:
        super().__init__(*mesh, colors)
        self.cells = cells
        self.portals = portals


@dataclass
class _Opening:
    """A door or window in a wall across `axis` (0: x, 2: z) at `at`, over [low, high] along it and [sill, top] in y."""

    axis: int
    at: float
    low: float
    high: float
    sill: float
    rooms: tuple[int, int | None]

    def span(self, across: float) -> tuple[Points, Points]:
        """The box of the opening, widened by `across` to both sides of the wall's middle."""
        low, high = np.array([self.low, self.sill, self.low]), np.array([self.high, DOOR_TOP, self.high])
        low[self.axis], high[self.axis] = self.at - across, self.at + across
        return low, high

    def portal(self) -> dict[str, Any]:
        along = 2 - self.axis
        polygon = np.empty((4, 3))
        polygon[:, self.axis] = self.at
        polygon[:, along] = [self.low, self.high, self.high, self.low]
        polygon[:, 1] = [self.sill, self.sill, DOOR_TOP, DOOR_TOP]
        return {"polygon": polygon, "cells": list(self.rooms)}


def house(rooms: int = 8, seed: int = 0) -> House:
    """A one-storey house of furnished rooms: indoors, what can be seen is what the doors let through.

    The plan is a rectangle cut again and again through its largest room. Walls are 0.2 thick, rooms 2.6 high; +y is
    up, the floor lies at 0, lengths are metres. Every room can be reached through doors; some doors close circles,
    one leads out, and outer walls have windows without panes. Walls, floor and ceiling are one closed solid; furniture
    stands free, clear of doors and windows.

    Parameters
    ----------
    rooms : int
        Number of rooms, from 1 to 100. The grid of the walls makes the faces grow with its square.
    seed : int
        Seed of the plan and the furniture.

    Returns
    -------
    House
        With ``cells`` and ``portals``.

    Raises
    ------
    ValueError
        If `rooms` is out of range.

    Examples
    --------
    >>> home = house(rooms=3, seed=1)
    >>> len(home.cells), sorted(home.cells[0])
    (3, ['max', 'min', 'name'])
    """
    if not 1 <= rooms <= 100:
        raise ValueError(f"rooms must be from 1 to 100, got {rooms}")
    random = np.random.default_rng(seed)
    plan = _plan(rooms, random)
    openings = _openings(plan, random)
    shell = _shell(plan, openings)
    pieces: list[tuple[Mesh, Colors]] = [(shell, _paint(shell))]
    names = []
    for room, (x0, z0, x1, z1) in enumerate(plan):
        kind = list(FURNITURE)[int(random.integers(len(FURNITURE)))]
        names.append(f"{kind} {room}")
        blocked = [opening.span(1.0 if opening.sill == 0.0 else 0.4) for opening in openings if room in opening.rooms]
        inside = np.array([x0, z0]) + THICK / 2, np.array([x1, z1]) - THICK / 2
        pieces += _furnish(FURNITURE[kind], inside, blocked, random)
    mesh = join([piece for piece, _ in pieces])
    rooms_as_cells = [
        {"name": name, "min": np.array([x0, 0.0, z0]), "max": np.array([x1, HEIGHT, z1])}
        for name, (x0, z0, x1, z1) in zip(names, plan, strict=True)
    ]
    colors = np.concatenate([paint for _, paint in pieces])
    return House(mesh, colors, rooms_as_cells, [opening.portal() for opening in openings])


# The plan -------------------------------------------------------------------------------------------------------------


def _plan(rooms: int, random: np.random.Generator) -> list[Points]:
    """Rectangles (x0, z0, x1, z1) between the middles of the walls."""
    width = float((18.0 * rooms * 1.3) ** 0.5)
    plan = [np.array([0.0, 0.0, width, 18.0 * rooms / width])]
    while len(plan) < rooms:
        plan.sort(key=lambda room: float((room[2] - room[0]) * (room[3] - room[1])))
        room = plan.pop()
        along = 0 if room[2] - room[0] > room[3] - room[1] else 1
        cut = round(float(room[along] + (room[along + 2] - room[along]) * random.uniform(0.42, 0.58)), 2)
        low, high = room.copy(), room.copy()
        low[along + 2] = high[along] = cut
        plan += [low, high]
    return plan


def _shared(plan: list[Points], width: float) -> list[tuple[int, int, int, float, float, float]]:
    """Walls (axis, room, room, at, low, high) that two rooms share and that leave space for an opening."""
    walls = []
    for a in range(len(plan)):
        for b in range(len(plan)):
            for along in (0, 1):
                if a != b and plan[a][along + 2] == plan[b][along]:
                    low = max(plan[a][1 - along], plan[b][1 - along]) + THICK / 2 + MARGIN
                    high = min(plan[a][3 - along], plan[b][3 - along]) - THICK / 2 - MARGIN
                    if high - low >= width:
                        walls.append((2 * along, a, b, float(plan[b][along]), float(low), float(high)))
    return walls


def _outer(plan: list[Points], width: float) -> list[tuple[int, int, None, float, float, float]]:
    """The same for walls to the outside."""
    bounds = np.array([*np.min(plan, axis=0)[:2], *np.max(plan, axis=0)[2:]])
    walls = []
    for room, rectangle in enumerate(plan):
        for side in range(4):
            along = side % 2
            low, high = rectangle[1 - along] + THICK / 2 + MARGIN, rectangle[3 - along] - THICK / 2 - MARGIN
            if rectangle[side] == bounds[side] and high - low >= width:
                walls.append((2 * along, room, None, float(rectangle[side]), float(low), float(high)))
    return walls


def _openings(plan: list[Points], random: np.random.Generator) -> list[_Opening]:
    """Doors that join all rooms, a few more that close circles, one to the outside, and windows."""
    group = list(range(len(plan)))
    openings = []
    walls = _shared(plan, DOOR_WIDTH)
    for index in random.permutation(len(walls)):
        axis, a, b, at, low, high = walls[index]
        if group[a] != group[b] or random.uniform() < 0.25:
            group = [group[a] if member == group[b] else member for member in group]
            start = random.uniform(low, high - DOOR_WIDTH)
            openings.append(_Opening(axis, at, start, start + DOOR_WIDTH, 0.0, (a, b)))
    assert len(set(group)) == 1, "the first rooms on both sides of a cut start at one wall and share a door's width"
    outer = _outer(plan, DOOR_WIDTH)
    front = int(random.integers(len(outer)))
    for index, (axis, room, _, at, low, high) in enumerate(outer):
        width, sill = (DOOR_WIDTH, 0.0) if index == front else (WINDOW_WIDTH, SILL)
        if high - low >= width and (index == front or random.uniform() < 0.75):
            start = random.uniform(low, high - width)
            openings.append(_Opening(axis, at, start, start + width, sill, (room, None)))
    return openings


def _shell(plan: list[Points], openings: list[_Opening]) -> Mesh:
    """Floor, ceiling and walls with their openings, as one closed solid on a grid."""
    half = THICK / 2
    walls = [np.array([-SLAB, 0.0, SILL, DOOR_TOP, HEIGHT, HEIGHT + SLAB])]
    spans = [opening.span(half) for opening in openings]
    for along in (0, 1):
        edges = np.array([rectangle[[along, along + 2]] for rectangle in plan]).ravel()
        ends = np.array([[low[2 * along], high[2 * along]] for low, high in spans]).ravel()
        walls.append(np.unique(np.concatenate([edges - half, edges + half, ends]).round(6)))
    lines = [walls[1], walls[0], walls[2]]
    solid = np.zeros([len(line) - 1 for line in lines], dtype=bool)

    def fill(low: npt.ArrayLike, high: npt.ArrayLike, value: bool) -> None:
        ranges = [
            slice(*np.searchsorted(line, np.round([start - 1e-9, end - 1e-9], 6)))
            for line, start, end in zip(lines, np.asarray(low), np.asarray(high), strict=True)
        ]
        solid[tuple(ranges)] = value

    for x0, z0, x1, z1 in plan:
        fill([x0 - half, -SLAB, z0 - half], [x1 + half, HEIGHT + SLAB, z1 + half], True)
    for x0, z0, x1, z1 in plan:
        fill([x0 + half, 0.0, z0 + half], [x1 - half, HEIGHT, z1 - half], False)
    for low, high in spans:
        fill(low, high, False)
    return cells(lines, solid)


def _paint(shell: Mesh) -> Colors:
    """Wooden floors, white ceilings, walls in warm light tones by the way they face."""
    facing = normals(shell)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    height = shell[0][shell[1]].mean(axis=1)[:, 1]
    colors = np.empty((len(facing), 3))
    colors[:] = [214, 204, 188]
    colors[np.abs(facing[:, 0]) > 0.5] = [196, 192, 186]
    colors[facing[:, 1] < -0.5] = [236, 234, 228]
    colors[(facing[:, 1] > 0.5) & (height < 1e-6)] = [158, 118, 82]
    colors[(facing[:, 1] > 0.5) & (height > HEIGHT)] = [150, 84, 66]
    return colors.astype(np.uint8)


# Furniture: pieces in their own frame, back to -z, standing on y = 0 around the origin -------------------------------

Piece = list[tuple[Mesh, Rgb]]
WOOD, DARK, CLOTH, WHITE, METAL, GREEN = (
    (164, 116, 72),
    (92, 64, 44),
    (92, 116, 148),
    (228, 226, 220),
    (150, 154, 160),
    (84, 132, 76),
)


def _table(random: np.random.Generator, width: float = 1.5, depth: float = 0.9) -> Piece:
    x, z = width / 2, depth / 2
    legs = [
        turned([i * (x - 0.08), 0.0, j * (z - 0.08)], [(0.025, 0.0), (0.04, 0.7)]) for i in (-1, 1) for j in (-1, 1)
    ]
    bowl = turned([0.0, 0.74, 0.0], [(0.06, 0.0), (0.12, 0.05), (0.16, 0.12), (0.15, 0.12), (0.1, 0.06)], 20)
    return [(join(legs), DARK), (box([-x, 0.7, -z], [x, 0.74, z]), WOOD), (bowl, (188, 92, 64))]


def _chair(random: np.random.Generator) -> Piece:
    legs = box(
        [[i - 0.02, 0.0, j - 0.02] for i in (-0.2, 0.2) for j in (-0.2, 0.2)],
        [[i + 0.02, 0.44, j + 0.02] for i in (-0.2, 0.2) for j in (-0.2, 0.2)],
    )
    bars = box(
        [[i - 0.015, 0.48, -0.215] for i in (-0.2, -0.1, 0.0, 0.1, 0.2)],
        [[i + 0.015, 0.9, -0.185] for i in (-0.2, -0.1, 0.0, 0.1, 0.2)],
    )
    seat = box([-0.23, 0.44, -0.23], [0.23, 0.48, 0.23])
    top = box([-0.23, 0.9, -0.22], [0.23, 0.98, -0.18])
    return [(join([legs, bars, top]), WOOD), (seat, CLOTH)]


def _bed(random: np.random.Generator) -> Piece:
    frame = box([[-0.85, 0.0, -1.05], [-0.85, 0.0, -1.1]], [[0.85, 0.28, 1.0], [0.85, 0.95, -1.05]])
    pillows = join([_cushion([i, 0.56, -0.78], [0.3, 0.09, 0.2]) for i in (-0.4, 0.4)])
    return [(frame, WOOD), (_cushion([0.0, 0.4, -0.02], [0.82, 0.13, 0.98]), WHITE), (pillows, CLOTH)]


def _sofa(random: np.random.Generator) -> Piece:
    body = box(
        [[-1.0, 0.08, -0.45], [-1.0, 0.38, -0.45], [-1.0, 0.38, -0.2], [0.82, 0.38, -0.2]],
        [[1.0, 0.38, 0.4], [1.0, 0.85, -0.2], [-0.82, 0.62, 0.4], [1.0, 0.62, 0.4]],
    )
    seats = join([_cushion([i, 0.45, 0.1], [0.39, 0.09, 0.29]) for i in (-0.41, 0.41)])
    feet = join([turned([i, 0.0, j], [(0.03, 0.0), (0.04, 0.08)], 8) for i in (-0.9, 0.9) for j in (-0.35, 0.3)])
    return [(body, (120, 92, 84)), (seats, (176, 120, 96)), (feet, DARK)]


def _shelf(random: np.random.Generator) -> Piece:
    sides = box(
        [[-0.6, 0.0, -0.17], [0.57, 0.0, -0.17], [-0.57, 0.0, -0.17]],
        [[-0.57, 1.95, 0.17], [0.6, 1.95, 0.17], [0.57, 1.95, -0.15]],
    )
    heights = np.array([0.05, 0.43, 0.81, 1.19, 1.57, 1.92])
    boards = box([[-0.57, y - 0.025, -0.15] for y in heights], [[0.57, y, 0.17] for y in heights])
    piece: Piece = [(join([sides, boards]), WOOD)]
    for y in heights[:-1]:
        x = -0.55 + random.uniform(0.0, 0.1)
        while x < 0.3 + random.uniform(0.0, 0.2):
            width, tall = random.uniform(0.02, 0.06), random.uniform(0.18, 0.31)
            color = tuple(int(channel) for channel in random.integers([60, 50, 50], [200, 150, 160]))
            piece.append((box([x, y, -0.12], [x + width, y + tall, 0.1]), (color[0], color[1], color[2])))
            x += width + 0.004
    return piece


def _lamp(random: np.random.Generator) -> Piece:
    foot = turned([0.0, 0.0, 0.0], [(0.15, 0.0), (0.15, 0.02), (0.015, 0.04), (0.012, 1.5)], 16)
    shade = turned([0.0, 1.4, 0.0], [(0.22, 0.0), (0.12, 0.32)], 24)
    return [(foot, METAL), (shade, (240, 220, 160))]


def _wardrobe(random: np.random.Generator) -> Piece:
    doors = box([[-0.78, 0.1, 0.29], [0.01, 0.1, 0.29]], [[-0.01, 1.98, 0.31], [0.78, 1.98, 0.31]])
    knobs = join([turned([i, 1.0, 0.335], [(0.008, 0.0), (0.018, 0.015), (0.008, 0.03)], 8) for i in (-0.06, 0.06)])
    return [(box([-0.8, 0.0, -0.29], [0.8, 2.05, 0.29]), WOOD), (doors, (184, 140, 94)), (knobs, METAL)]


def _counter(random: np.random.Generator) -> Piece:
    body = box([[-1.1, 0.0, -0.3], [-1.12, 0.88, -0.3]], [[1.1, 0.88, 0.28], [1.12, 0.92, 0.32]])
    fronts = np.linspace(-1.08, 1.08, 5)
    doors = box(
        np.column_stack([fronts[:-1] + 0.01, np.full(4, 0.1), np.full(4, 0.28)]),
        np.column_stack([fronts[1:] - 0.01, np.full(4, 0.86), np.full(4, 0.295)]),
    )
    pot = turned([-0.6, 0.92, 0.0], [(0.1, 0.0), (0.12, 0.02), (0.12, 0.14), (0.13, 0.15), (0.02, 0.2)], 20)
    tap = turned([0.5, 0.92, -0.2], [(0.03, 0.0), (0.015, 0.03), (0.015, 0.28)], 10)
    return [(body, WHITE), (doors, (150, 170, 160)), (pot, (176, 72, 60)), (tap, METAL)]


def _desk(random: np.random.Generator) -> Piece:
    desk = box(
        [[-0.7, 0.72, -0.35], [-0.68, 0.0, -0.33], [0.2, 0.0, -0.33]],
        [[0.7, 0.75, 0.35], [-0.65, 0.72, 0.33], [0.68, 0.72, 0.33]],
    )
    screen = box(
        [[-0.3, 0.85, -0.2], [-0.03, 0.77, -0.22], [-0.12, 0.75, -0.26]],
        [[0.3, 1.22, -0.17], [0.03, 0.95, -0.2], [0.12, 0.77, -0.1]],
    )
    return [(desk, WOOD), (screen, (56, 60, 68))]


def _pot_plant(random: np.random.Generator) -> Piece:
    pot = turned([0.0, 0.0, 0.0], [(0.12, 0.0), (0.18, 0.34), (0.16, 0.34)], 20)
    crown = [
        _cushion(random.uniform([-0.16, 0.55, -0.16], [0.16, 1.1, 0.16]), random.uniform(0.05, 0.16, 3))
        for _ in range(14)
    ]
    return [
        (pot, (176, 98, 70)),
        (turned([0.0, 0.34, 0.0], [(0.02, 0.0), (0.012, 0.6)], 8), DARK),
        (join(crown), GREEN),
    ]


Maker = Callable[[np.random.Generator], Piece]
# (piece, half width, half depth, stands at a wall)
FURNITURE: dict[str, list[tuple[Maker, float, float, bool]]] = {
    "living": [
        (_sofa, 1.0, 0.45, True),
        (_shelf, 0.6, 0.17, True),
        (_table, 0.75, 0.45, False),
        (_lamp, 0.22, 0.22, True),
        (_pot_plant, 0.32, 0.32, True),
    ],
    "bedroom": [
        (_bed, 0.85, 1.1, True),
        (_wardrobe, 0.8, 0.32, True),
        (_lamp, 0.22, 0.22, True),
        (_chair, 0.23, 0.23, False),
    ],
    "dining": [
        (_table, 0.75, 0.45, False),
        *[(_chair, 0.23, 0.23, False)] * 4,
        (_shelf, 0.6, 0.17, True),
        (_pot_plant, 0.32, 0.32, True),
    ],
    "study": [
        (_desk, 0.7, 0.35, True),
        (_shelf, 0.6, 0.17, True),
        (_shelf, 0.6, 0.17, True),
        (_chair, 0.23, 0.23, False),
        (_lamp, 0.22, 0.22, True),
    ],
    "kitchen": [
        (_counter, 1.12, 0.32, True),
        (_counter, 1.12, 0.32, True),
        (_table, 0.75, 0.45, False),
        (_chair, 0.23, 0.23, False),
        (_chair, 0.23, 0.23, False),
    ],
}


def _furnish(
    pieces: list[tuple[Maker, float, float, bool]],
    inside: tuple[Points, Points],
    blocked: list[tuple[Points, Points]],
    random: np.random.Generator,
) -> list[tuple[Mesh, Colors]]:
    """Places each piece where it touches nothing, or leaves it out after 80 tries."""
    low, high = inside
    taken = [(start[[0, 2]], end[[0, 2]]) for start, end in blocked]
    placed = []
    for make, half_width, half_depth, at_wall in pieces:
        for _ in range(80):
            quarter = int(random.integers(4))
            half = np.array([half_width, half_depth] if quarter % 2 == 0 else [half_depth, half_width]) + 0.03
            if (high - low < 2.0 * half).any():
                continue
            center = random.uniform(low + half, high - half)
            if at_wall:  # quarter turns carry the back from -z to -x, +z, +x
                along, end = [(1, low), (0, low), (1, high), (0, high)][quarter]
                center[along] = end[along] + (half[along] if quarter < 2 else -half[along])
            first, last = center - half, center + half
            if all((last <= start).any() or (first >= end).any() for start, end in taken):
                taken.append((first, last))
                placed += [_place(part, quarter, center, color) for part, color in make(random)]
                break
    return placed


def _place(mesh: Mesh, quarter: int, center: Points, color: Rgb) -> tuple[Mesh, Colors]:
    """A piece turned by quarters about +y and moved to (x, z)."""
    cos, sin = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    vertices = mesh[0] @ turn.T + np.array([center[0], 0.0, center[1]])
    return (vertices, mesh[1]), np.tile(np.array(color, dtype=np.uint8), (len(mesh[1]), 1))


def _cushion(center: npt.ArrayLike, half: npt.ArrayLike) -> Mesh:
    """A box with rounded corners: a cube of 4 x 4 tiles a side, swollen to a superellipsoid."""
    line = np.linspace(-1.0, 1.0, 5)
    vertices, faces = cells([line, line, line], np.ones((4, 4, 4), dtype=bool))
    swollen = vertices / (np.abs(vertices) ** 6).sum(axis=1, keepdims=True) ** (1 / 6)
    return np.asarray(center) + swollen * np.asarray(half), faces
