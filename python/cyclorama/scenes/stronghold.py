"""A castle: walls, towers and a keep around a town of narrow lanes, more of it hidden from any place than seen."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scene import Scene
from .solids import Mesh, Points, box, join, sweep, turned

__all__ = ["Castle", "castle"]

Colors = npt.NDArray[np.uint8]

#: Half the side of the square that the walls are built on, their height and thickness, and the gate's width.
HALF, WALL, THICK, GATE = 40.0, 9.0, 2.4, 5.0
#: Half the keep's side, and its height. It stands at the middle.
KEEP, KEEP_TOP = 7.0, 22.0
#: The eye's height on the lane.
EYE = 1.7

STONE, ROOF, TIMBER, GRASS = (150, 145, 135), (150, 70, 50), (95, 70, 50), (105, 120, 75)


class Castle(Scene):
    """What `castle` returns: a scene with a way through it.

    Attributes
    ----------
    lane : (N, 3) ndarray of float64
        From inside the gate to the keep's foot and round its corner, at an eye's height.
    """

    def __init__(self, mesh: Mesh, colors: Colors, lane: Points) -> None:
        super().__init__(*mesh, colors)
        self.lane = lane


def castle(houses: int = 90, seed: int = 0) -> Castle:
    """A walled town with a keep, and a village outside that its walls hide.

    The walls are a square with battlements, a tower at each corner and in the middle of each side, and a gate with two
    towers in the side at +z. Inside, houses with steep roofs stand close along lanes around the keep, barrels and
    crates along their walls. Outside is a village of as many houses again. +y is up, the ground lies at 0,
    lengths are metres. All pieces are closed; houses stand in the ground a little.

    Parameters
    ----------
    houses : int
        Houses inside at most, from 1 to 400: where the town is full, there are fewer.
    seed : int

    Returns
    -------
    Castle
        With ``lane``.

    Raises
    ------
    ValueError
        If `houses` is out of range.

    Examples
    --------
    >>> town = castle(houses=20)
    >>> town.lane.shape, len(town) > 5_000
    ((4, 3), True)
    """
    if not 1 <= houses <= 400:
        raise ValueError(f"houses must be from 1 to 400, got {houses}")
    random = np.random.default_rng(seed)
    pieces = [
        (box((-160, -2, -160), (160, 0, 160)), GRASS),
        *_walls(),
        *_keep(),
        *_town(houses, random),
        *_village(houses, random),
    ]
    colors = np.concatenate([np.tile(np.array(color, np.uint8), (len(mesh[1]), 1)) for mesh, color in pieces])
    lane = np.array([(0.0, EYE, 34.0), (0.0, EYE, 13.0), (-10.0, EYE, 9.5), (-10.0, EYE, -8.0)])
    return Castle(join([mesh for mesh, _ in pieces]), colors, lane)


Piece = tuple[Mesh, tuple[int, int, int]]


def _battlement(start: Points, along: Points, length: float, height: float, thick: float) -> list[Piece]:
    """A wall from `start` along a horizontal unit axis, with merlons on its outer and inner edge."""
    across = np.abs(np.array([along[2], 0.0, along[0]]))
    end = start + along * length
    pieces: list[Piece] = [(box(start - across * thick / 2, end + across * thick / 2 + [0, height, 0]), STONE)]
    for place in np.arange(0.4, length - 1.0, 1.8):
        for side in (-1, 1):
            foot = start + along * place + across * side * (thick / 2 - 0.25) + [0, height - 0.05, 0]
            pieces.append((box(foot - across * 0.25, foot + along + across * 0.25 + [0, 1.1, 0]), STONE))
    return pieces


def _tower(place: tuple[float, float], radius: float, height: float) -> list[Piece]:
    center = (place[0], -0.5, place[1])
    shaft = [(radius * 1.1, 0.0), (radius, 2.0), (radius, height), (radius * 1.15, height + 0.5)]
    crown = [(radius * 1.15, height + 2.0), (radius, height + 2.0)]
    roof = [(radius * 1.3, height + 1.9), (radius * 0.5, height + 5.5), (0.02, height + 8.5)]
    return [(turned(center, [*shaft, *crown], 24), STONE), (turned(center, roof, 24), ROOF)]


def _walls() -> list[Piece]:
    pieces: list[Piece] = []
    x, z = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    for side in (-1, 1):
        pieces += _battlement(np.array([side * HALF, -0.5, -HALF]), z, 2 * HALF, WALL, THICK)
        pieces += _battlement(np.array([GATE / 2 if side > 0 else -HALF, -0.5, HALF]), x, HALF - GATE / 2, WALL, THICK)
    pieces += _battlement(np.array([-HALF, -0.5, -HALF]), x, 2 * HALF, WALL, THICK)
    pieces += _battlement(np.array([-GATE / 2, 5.0, HALF]), x, GATE, WALL - 4.0, THICK)
    for a in (-HALF, 0.0, HALF):
        for b in (-HALF, 0.0, HALF):
            if (a, b) != (0.0, 0.0) and (a, b) != (0.0, HALF):
                pieces += _tower((a, b), 4.0, 14.0)
    for side in (-1, 1):
        pieces += _tower((side * (GATE / 2 + 3.0), HALF), 3.0, 13.0)
    return pieces


def _keep() -> list[Piece]:
    body: Piece = (box((-KEEP, -0.5, -KEEP), (KEEP, KEEP_TOP, KEEP)), STONE)
    pieces = [body]
    x, z = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    for side in (-1, 1):
        edge = side * (KEEP - 0.4)
        pieces += _battlement(np.array([edge, KEEP_TOP - 0.3, -KEEP]), z, 2 * KEEP, 0.6, 1.0)
        pieces += _battlement(np.array([-KEEP, KEEP_TOP - 0.3, edge]), x, 2 * KEEP, 0.6, 1.0)
        for other in (-1, 1):
            pieces += _tower((side * KEEP, other * KEEP), 1.8, KEEP_TOP + 2.0)
    for row in np.arange(4.0, KEEP_TOP - 2, 4.0):
        for place in (-4.0, 0.0, 4.0):
            for side in (-1, 1):
                face = side * KEEP
                low, high = sorted((face - 0.05 * side, face + 0.08 * side))
                pieces.append((box((place - 0.4, row, low), (place + 0.4, row + 1.6, high)), TIMBER))
                pieces.append((box((low, row, place - 0.4), (high, row + 1.6, place + 0.4)), TIMBER))
    return pieces


def _house(low: Points, high: Points, random: np.random.Generator) -> list[Piece]:
    """A house over [low, high] of x and z: its ridge goes along the longer side, its roof sticks out."""
    wide = high - low
    along = int(wide[1] > wide[0])
    eaves, rise = random.uniform(3.0, 6.5), 0.55 * wide[1 - along]
    shade = int(random.integers(-30, 25))
    plaster = (205 + shade, 190 + shade, 160 + shade)
    middle = (low + high) / 2
    half = wide / 2

    def prism(outline: list[tuple[float, float]], reach: float) -> Mesh:
        """Of an outline (across, up), extruded both ways along the ridge; counter-clockwise seen from its end."""
        corners = np.array(outline)
        ends = []
        for side in (-1, 1):
            ring = np.zeros((len(corners), 3))
            ring[:, 1] = corners[:, 1]
            # Across the ridge: z for one along x, x for one along z, whichever keeps the turn.
            ring[:, 2 if along == 0 else 0] = middle[1 - along] + (-corners[:, 0] if along == 0 else corners[:, 0])
            ring[:, 0 if along == 0 else 2] = middle[along] + side * reach
            ends.append(ring)
        return sweep(np.stack(ends))

    across = float(half[1 - along])
    reach = float(half[along])
    gable = [(-across, -0.3), (across, -0.3), (across, eaves), (0.0, eaves + rise), (-across, eaves)]
    slope = rise / across
    out, up = across + 0.35, eaves - 0.35 * slope
    roof = [(-out, up), (0.0, eaves + rise), (out, up), (out, up + 0.25), (0.0, eaves + rise + 0.25), (-out, up + 0.25)]
    pieces: list[Piece] = [(prism(gable, reach), plaster)]
    pieces.append((prism(roof[:2] + [roof[4], roof[5]], reach + 0.3), ROOF))
    pieces.append((prism([roof[1], roof[2], roof[3], roof[4]], reach + 0.3), ROOF))
    chimney = middle.copy()
    chimney[along] += random.uniform(-0.6, 0.6) * reach
    foot = np.array([chimney[0], eaves + 0.3 * rise, chimney[1]])
    pieces.append((box(foot - [0.35, 0, 0.35], foot + [0.35, rise + 1.0, 0.35]), STONE))
    for side in (-1, 1):
        face = low[0] if side < 0 else high[0]
        for z in np.arange(low[1] + 0.8, high[1] - 0.8, 1.6):
            for sill in (1.0, 3.6):
                if sill + 1.1 < eaves:
                    pieces.append((box((face - 0.06, sill, z - 0.4), (face + 0.06, sill + 1.0, z + 0.4)), TIMBER))
        face = low[1] if side < 0 else high[1]
        pieces.append((box((middle[0] - 0.5, -0.2, face - 0.08), (middle[0] + 0.5, 2.0, face + 0.08)), TIMBER))
    return pieces


def _goods(low: Points, high: Points, random: np.random.Generator) -> list[Piece]:
    """Barrels and crates before the long walls of a house."""
    pieces: list[Piece] = []
    for _ in range(int(random.integers(1, 4))):
        side = random.integers(2)
        place = np.array([low[0] - 0.5 if side else high[0] + 0.5, random.uniform(low[1] + 0.5, high[1] - 0.5)])
        if random.uniform() < 0.5:
            belly = [(0.28, 0.0), (0.36, 0.25), (0.38, 0.5), (0.36, 0.75), (0.28, 1.0)]
            pieces.append((turned((place[0], -0.05, place[1]), belly, 14), TIMBER))
        else:
            size = random.uniform(0.25, 0.4)
            foot = np.array([place[0], -0.05, place[1]])
            pieces.append((box(foot - [size, 0, size], foot + [size, 2 * size, size]), (140, 110, 70)))
    return pieces


def _town(houses: int, random: np.random.Generator) -> list[Piece]:
    """Rows of houses along lanes that run in z, the middle one to the keep, which stands in a yard."""
    pieces: list[Piece] = []
    inside = HALF - THICK - 4.5
    count = 0
    for side in (1, -1, 2, -2, 3, -3):
        # Rows alternate with lanes of 3 to 5 m.
        start = 2.4 + (abs(side) - 1) * 11.0
        z = inside - 1.0
        while z > -inside + 5.0 and count < houses:
            depth = random.uniform(4.5, 7.5)
            near = start + random.uniform(0.0, 0.6)
            far = near + random.uniform(6.0, 7.2)
            low = np.array([near if side > 0 else -far, z - depth])
            high = np.array([far if side > 0 else -near, z])
            z -= depth + random.choice([0.3, 0.5, 0.5, 2.2])
            yard = KEEP + 5.5
            if (low < yard).all() and (high > -yard).all():
                continue
            pieces += _house(low, high, random) + _goods(low, high, random)
            count += 1
    return pieces


def _village(houses: int, random: np.random.Generator) -> list[Piece]:
    pieces: list[Piece] = []
    for number in range(houses):
        turn = 2 * np.pi * (number + random.uniform(0, 0.5)) / houses
        place = random.uniform(70, 140) * np.array([np.cos(turn), np.sin(turn)])
        size = random.uniform(2.5, 5.0, 2)
        pieces += _house(place - size, place + size, random)
    return pieces
