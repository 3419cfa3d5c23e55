"""Machine parts: a gear that hides its own flanks, and a tangle of pipes that hides most of itself."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..scene import Scene
from .solids import Mesh, Points, join, refine, sweep

__all__ = ["gear", "pipes"]

# The root of x^4 = x + 1: its inverse powers are steps that fill a cube evenly.
PLASTIC = 1.2207440846057596
PAINT = np.array([[200, 90, 70], [86, 140, 190], [220, 180, 90], [110, 165, 110], [170, 170, 178]], dtype=np.uint8)


def gear(faces: int = 74_634, *, teeth: int = 36, depth: float = 0.45) -> Scene:
    """A gear wheel with deep, narrow gaps between its teeth, closed, about the z axis.

    What a gap shows changes within a few degrees, so that samples which agree on the rest disagree here. The default
    has as many faces as the B-gear of the 2001 paper (section 4), whose own mesh is not public.

    Parameters
    ----------
    faces : int
        Number of faces, met exactly; odd numbers are rounded up, as a closed mesh has an even number of faces. At
        least ``64 * teeth``.
    teeth : int
        Number of teeth, at least 3.
    depth : float
        Depth of the gaps as a share of the outer radius, which is 1; in (0, 0.6).

    Raises
    ------
    ValueError
        If the faces are too few for the teeth, or `teeth` or `depth` is out of range.

    Examples
    --------
    >>> len(gear(10_000))
    10000
    """
    if teeth < 3:
        raise ValueError(f"a gear needs at least 3 teeth, got {teeth}")
    if not 0.0 < depth < 0.6:
        raise ValueError(f"depth must lie in (0, 0.6), got {depth}")
    if faces < 64 * teeth:
        raise ValueError(f"a gear of {teeth} teeth needs at least {64 * teeth} faces, got {faces}")
    faces += faces % 2
    # A torus of `around` by `loops` quadrilaterals; loops of the cross-section: rim, top, bore, bottom.
    around = teeth * 4 * max(1, round((faces / (2 * 4 * teeth)) ** 0.5 / 4))
    loops = faces // (2 * around)
    phase = np.arange(around) * teeth / around % 1.0
    tooth = 1.0 - depth * np.interp(phase, [0.0, 0.25, 0.5, 0.75, 1.0], [0.0, 0.0, 1.0, 1.0, 0.0])
    root = 1.0 - depth
    # (radius as a share of the root's, of which the last 0.12 follow the teeth; height) along the section
    section = np.array(
        [
            [1.00, -0.16],
            [1.00, 0.16],
            [0.88, 0.16],
            [0.80, 0.07],
            [0.45, 0.07],
            [0.40, 0.22],
            [0.22, 0.22],
            [0.22, -0.22],
            [0.40, -0.22],
            [0.45, -0.07],
            [0.80, -0.07],
            [0.88, -0.16],
        ]
    )
    closed = np.concatenate([section, section[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    lengths[[0, 1, 11]] += depth  # the flanks and the sides of the teeth get their share of loops
    knots = _knots(lengths, loops)
    share, height = (np.interp(np.arange(loops), knots, closed[:, column]) for column in range(2))
    toothed = np.clip((share - 0.88) / 0.12, 0.0, 1.0)
    radius = root * np.minimum(share, 0.88) + toothed * (tooth[:, None] - 0.88 * root)
    angle = 2.0 * np.pi * np.arange(around)[:, None] / around
    z = np.broadcast_to(height, radius.shape)
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1).reshape(-1, 3)
    here = np.arange(around * loops).reshape(around, loops)
    a, b = here, np.roll(here, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    quads = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2).reshape(-1, 3)
    vertices, triangles = refine((vertices, quads), (faces - len(quads)) // 2)
    metal, dark = np.array([196, 164, 92]), np.array([120, 96, 60])
    far = np.linalg.norm(vertices[triangles].mean(axis=1)[:, :2], axis=1)[:, None]
    colors = np.where(far > root, metal, dark + (metal - dark) * np.clip(far / root, 0.0, 1.0) * 0.8)
    return Scene(vertices, triangles, np.rint(colors).astype(np.uint8))


def _knots(lengths: Points, loops: int) -> npt.NDArray[np.int64]:
    """Loop at which each stretch of the section ends: at least one loop a stretch, the rest by length."""
    spare = loops - len(lengths)
    ends = np.rint(np.cumsum(lengths) / lengths.sum() * spare).astype(np.int64)
    return np.concatenate([[0], ends + np.arange(1, len(lengths) + 1)])


def pipes(primitives: int = 1_000_000, *, seed: int = 0, sides: int = 6, bends: int = 12) -> Scene:
    """A uniform tangle of bent pipes that fills the cube [-1, 1]^3: the pipes scene of the 1998 paper, of any size.

    Every place is as crowded as every other and most of the scene is hidden from everywhere: no cell of space is
    cheap, which is the hard case for budgets.

    Parameters
    ----------
    primitives : int
        Number of triangles, met exactly, at least 4. An odd number leaves the last solid open by one triangle.
    seed : int
        Seed of the tangle.
    sides : int
        Sides of a pipe, at least 3.
    bends : int
        Straight stretches of a pipe, at least 1; each turns by a right angle into the next.

    Notes
    -----
    Pipes are closed tubes of ``2 * sides * bends + 2 * (sides - 2)`` faces. What they leave of the asked number
    becomes one shorter pipe and a bead (a bipyramid or a tetrahedron).

    Raises
    ------
    ValueError
        If `primitives`, `sides` or `bends` is too small.

    Examples
    --------
    >>> len(pipes(5_000, seed=1))
    5000
    """
    if primitives < 4:
        raise ValueError(f"primitives must be at least 4, got {primitives}")
    if sides < 3 or bends < 1:
        raise ValueError(f"a pipe needs at least 3 sides and 1 bend, got {sides} and {bends}")
    random = np.random.default_rng(seed)
    even = primitives + primitives % 2
    stretch, caps = 2 * sides, 2 * (sides - 2)
    whole = even // (stretch * bends + caps)
    rest = even - whole * (stretch * bends + caps)
    short = max(0, (rest - caps) // stretch)
    bead = rest - (stretch * short + caps if short else 0)
    if bead == 2:  # no closed solid has two faces: take them from a stretch or a pipe
        if short:
            short, bead = short - 1, bead + stretch + (caps if short == 1 else 0)
        else:
            whole, bead = whole - 1, bead + stretch * bends + caps
    spacing = 2.0 / max(1.0, even / stretch) ** (1 / 3)  # of the stretches' midpoints, were they on a grid
    parts = [_tubes(random, number, length, sides, spacing) for number, length in ((whole, bends), (1, short))]
    parts.append([_bead(random, bead, spacing)] if bead else [])
    vertices, faces = join([mesh for part in parts for mesh in part])
    pipe = np.arange(len(faces)) // (stretch * bends + caps)
    colors = PAINT[random.integers(len(PAINT), size=pipe[-1] + 1)][pipe]
    return Scene(vertices, faces[:primitives], colors[:primitives])


def _tubes(random: np.random.Generator, number: int, bends: int, sides: int, spacing: float) -> list[Mesh]:
    """`number` pipes of `bends` stretches, all walked at once: a step and a right turn, kept inside the cube."""
    if number == 0 or bends == 0:
        return []
    rows, radius = np.arange(number), min(0.2 * spacing, 0.1)
    reach, limit = min(1.8 * spacing, 0.8), 1.0 - 2.0 * radius
    # Starts spread evenly (the R3 sequence, from a random place), or chance would crowd some places more than others.
    steps = PLASTIC ** -np.arange(1.0, 4.0)
    at = limit * (2.0 * ((random.uniform(size=3) + rows[:, None] * steps) % 1.0) - 1.0)

    def heading(axis: npt.NDArray[np.int64]) -> tuple[Points, Points]:
        """A direction along the axis and a length: at random, but inward where that step would leave the cube."""
        length, sign, here = (
            random.uniform(4.0 * radius, reach, number),
            random.choice([-1.0, 1.0], number),
            at[rows, axis],
        )
        direction = np.zeros((number, 3))
        direction[rows, axis] = np.where(np.abs(here + sign * length) > limit, -np.copysign(1.0, here), sign)
        return direction, length[:, None]

    axis = random.integers(3, size=number)
    direction, length = heading(axis)
    angle = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides
    offset = np.zeros((number, sides, 3))
    offset[rows, :, (axis + 1) % 3] = radius * np.cos(angle)
    offset[rows, :, (axis + 2) % 3] = radius * np.sin(angle) * direction[rows, axis][:, None]
    rings = [at[:, None] + offset]
    for bend in range(bends):
        at += direction * length
        axis = (axis + random.integers(1, 3, size=number)) % 3
        turn, length = heading(axis)
        # The ring lies on the plane that halves the bend; beyond it, it stands across the new direction.
        lean = np.einsum("nsk,nk->ns", offset, turn)[:, :, None] if bend + 1 < bends else np.zeros((number, sides, 1))
        rings.append(at[:, None] + offset - lean * direction[:, None])
        offset = offset - lean * (direction + turn)[:, None]
        direction = turn
    return [sweep(np.stack(rings, axis=1))]


def _bead(random: np.random.Generator, faces: int, spacing: float) -> Mesh:
    """A tetrahedron of 4 faces or a bipyramid of an even number from 6."""
    size = 0.1 * spacing
    center = random.uniform(size - 1.0, 1.0 - size, size=3)
    sides = max(3, faces // 2)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(sides)])
    vertices = center + size * np.concatenate([ring, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    here = np.arange(sides)
    after = np.roll(here, -1)
    upper = np.column_stack([here, after, np.full(sides, sides)])
    if faces == 4:
        return vertices[:4], np.concatenate([upper, [[0, 2, 1]]])
    return vertices, np.concatenate([upper, np.column_stack([after, here, np.full(sides, sides + 1)])])
