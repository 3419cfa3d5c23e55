"""Rooms and the openings between them, found in a mesh.

The scene is cut into cubes. Those that no face reaches into are free, and what of them can be reached from the border
is outdoors. How far a free cube is from everything that isn't, its *clearance*, has a peak in each room and a saddle in
each door; a peak becomes a room of its own if every way from it to a higher one is narrower than a door and clearly
narrower than the peak itself (a watershed that forgets shallow basins). Where two basins meet, the smallest planar
section of free space across the way becomes a portal: all its free cubes, and three more around them, as a convex
polygon. Rooms are what is still connected once all portals are closed. So a line of sight leaves a room only through a
portal, or through what faces leave free of the cubes farther around it, as through a grating.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .cells import Cell, Portal
from .voxels import FILLED, NEAR, OUTDOORS, Grid, Pairs, Rooms, pairs_of

if TYPE_CHECKING:
    from ..scene import Scene

__all__ = ["Found", "find"]

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]

#: Cubes of a grid whose size is not given.
_CUBES = 2_000_000

#: Cubes of the grid in which it is looked how high rooms are.
_COARSE = 500_000

#: Of the places in rooms so many per cent are at most as high or narrow as what is taken for a room's height; measured:
#: furniture stands in the others.
_MOST = 75.0

#: The widest opening that separates rooms, as a share of their height, where it isn't given: 2.2 of 2.6 m, more than
#: doors and windows have.
_DOOR = 0.85

#: And of how high eyes are: 2.2 of 1.6 m.
_DOOR_OF_EYES = 1.375

#: Bytes a cube takes while rooms are searched: masks, distances with the nearest cube's indices, labels.
_BYTES_A_CUBE = 48

#: Cubes of clearance by which each level is below the one before.
_LEVEL = 0.5

#: A door's clearance is at most this share of that of the smaller room.
_NARROW = 0.85

#: Peaks with less clearance than this share of a door are no rooms.
_SMALL = 0.3

#: A gate is across an axis along which the surface in which rooms meet casts at least this share of its largest shadow,
#: and holds at least that share of the shadow.
_FACING, _COVERED = 0.7, 0.5

#: Cubes around a gate that belong to its portal. A slanted face fills up to two of them side by side, and light passes
#: through what it leaves of them: with one 4 of 200 eyes in a castle lost a face, with two 2 of 500.
_SPARE = 3

#: Sides of a cube, in steps along an axis.
_AXES = range(3)


@dataclass(frozen=True, eq=False)
class Found:
    """Cells with the cubes they are made of, portals, and the faces that can be seen in each cell and outdoors."""

    cells: list[Cell]
    portals: list[Portal]
    rooms: Rooms
    faces: list[npt.NDArray[np.uint32]]


def find(
    scene: Scene,
    door: float | None,
    voxel: float | None,
    eye_height: float | None,
    max_bytes: float,
    report: Callable[[int], object],
) -> Found:
    """What `Building.find` documents."""
    grid, door = _grid(scene, door, voxel, eye_height, max_bytes)
    pairs = pairs_of(grid, np.asarray(scene.vertices, np.float64)[scene.faces], report)
    solid = np.zeros(grid.shape, bool)
    solid.reshape(-1)[pairs.voxels] = True
    basins = _basins(solid, door / grid.step)
    gates = list(_gates(solid, basins, door / grid.step))
    labels = _rooms(solid, basins, gates)
    count = int(labels.max()) + 1
    if count == 0:
        raise ValueError(_why_none(solid, grid, door))
    rooms = Rooms(grid, labels)
    cells = [_cell(rooms, label) for label in range(count)]
    portals = [Portal(_polygon(grid, gate), (b, None if a == OUTDOORS else a)) for gate, a, b in _openings(labels)]
    return Found(cells, portals, rooms, _faces(rooms, pairs, len(scene)))


def _grid(
    scene: Scene, door: float | None, voxel: float | None, eye_height: float | None, max_bytes: float
) -> tuple[Grid, float]:
    sides = scene.bounds[1] - scene.bounds[0]
    given = (("door", door), ("voxel", voxel), ("eye_height", eye_height), ("max_bytes", max_bytes))
    for name, value in given:
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be a positive number, got {value!r}")
    if door is None:
        door = _DOOR * _height(scene) if eye_height is None else _DOOR_OF_EYES * eye_height
    automatic = voxel is None
    if voxel is None:
        voxel = min(_cube(sides, _CUBES), door / 10)
    cubes = float((sides / voxel + door / voxel + 8).prod())
    if cubes * _BYTES_A_CUBE > max_bytes:
        least = voxel * (cubes * _BYTES_A_CUBE / max_bytes) ** (1 / 3)
        # What is added around the scene doesn't shrink with it: a little more than that.
        if automatic and 1.05 * least < door / 3:
            return _grid(scene, door, 1.05 * least, None, max_bytes)
        raise ValueError(
            f"voxels of {voxel:g} are {cubes:.3g} for this scene and would take {cubes * _BYTES_A_CUBE / 1e9:.1f} GB: "
            f"give a voxel= of {least:.3g} or more, or a larger max_bytes="
        )
    if door < 3 * voxel:
        raise ValueError(f"a door of {door:g} is less than three voxels of {voxel:g} wide: give a smaller voxel=")
    return Grid.around(scene.bounds, voxel, ceil(door / voxel / 2) + 3), door


def _cube(sides: Floats, count: int) -> float:
    """The side of so many cubes that fill a box."""
    return float((np.maximum(sides, sides.max() / 100).prod() / count) ** (1 / 3))


def _height(scene: Scene) -> float:
    """How high rooms are: the shortest way through them along an axis.

    Of free cubes that have faces on all six sides, however far, three in four are in places as low or narrow.
    """
    grid = Grid.around(scene.bounds, _cube(scene.bounds[1] - scene.bounds[0], _COARSE), 1)
    pairs = pairs_of(grid, np.asarray(scene.vertices, np.float64)[scene.faces], lambda _: None)
    solid = np.zeros(grid.shape, bool)
    solid.reshape(-1)[pairs.voxels] = True
    least = np.full(grid.shape, np.inf)
    for axis in _AXES:
        along = np.moveaxis(solid, axis, 0)
        at = np.arange(len(along))[:, None, None]
        before = np.maximum.accumulate(np.where(along, at, -(len(along) ** 2)), axis=0)
        after = np.minimum.accumulate(np.where(along, at, len(along) ** 2)[::-1], axis=0)[::-1]
        length = np.where(after - before < len(along), after - before - 1.0, np.nan)
        # NaN stays: beyond the last face there is no room.
        least = np.minimum(least, np.moveaxis(length, 0, axis))
    inside = least[~solid & np.isfinite(least)]
    if not len(inside):
        raise ValueError(
            "no place in the scene has faces all around it, so how large its rooms are cannot be told: give door=, "
            "the widest opening that separates rooms, or eye_height="
        )
    return float(np.percentile(inside, _MOST)) * grid.step


def _basins(solid: Flags, door: float) -> Labels:
    """Labels of free cubes, 1 outdoors: the peak of clearance that each is below. `door` is in cubes.

    Cubes are flooded from all peaks, the widest first. Where two floods meet is the saddle between their peaks.
    """
    from scipy import ndimage

    clearance = ndimage.distance_transform_edt(~solid)
    hollows, count = ndimage.label(~solid)
    highest = np.asarray(ndimage.maximum(clearance, hollows, np.arange(count + 1)))
    highest[0] = 0.0
    clearance[(highest < _SMALL * door)[hollows]] = 0.0
    labels = np.zeros(solid.shape, np.int32)
    # The border is wide open, however small the margin around the scene is; and labelled, so that all other cubes have
    # six neighbours.
    labels[_border(solid.shape)] = 1
    flat, heights = labels.reshape(-1), clearance.reshape(-1)
    steps = np.cumprod([1, solid.shape[2], solid.shape[1]])
    steps = np.concatenate([steps, -steps])
    free = np.flatnonzero((heights > 0) & (flat == 0))
    free = free[np.argsort(-heights[free], kind="stable")]
    levels = np.arange(float(heights[free].max(initial=0.0)) - _LEVEL, 0.0, -_LEVEL)
    ends = [*np.searchsorted(-heights[free], -levels, side="right").tolist(), len(free)]
    group, peaks = [0, 1], [0.0, np.inf]
    dry, begin = free[:0], 0
    for level, end in zip([*levels.tolist(), 0.0], ends, strict=True):
        dry, begin = np.concatenate([dry, free[begin:end]]), end
        wet = [np.empty(0, np.int64)]
        while len(dry):
            beside = flat[dry[:, None] + steps].max(axis=1)
            reached = beside > 0
            if not reached.any():
                break
            flat[dry[reached]] = beside[reached]
            wet.append(dry[reached])
            dry = dry[~reached]
        if len(dry) and level >= _SMALL * door:
            above = np.zeros(solid.shape, bool)
            above.reshape(-1)[dry] = True
            parts, count = ndimage.label(above)
            flat[dry] = parts.reshape(-1)[dry] + len(group) - 1
            group += range(len(group), len(group) + count)
            peaks += [level + _LEVEL] * count
            wet.append(dry)
            dry = dry[:0]
        _join(flat, np.concatenate(wet), steps, group, peaks, np.inf if 2 * level > door else level / _NARROW)
    roots = np.array([_root(group, seed) for seed in range(len(group))], np.int32)
    return roots[labels]


def _join(
    flat: Labels,
    wet: npt.NDArray[np.int64],
    steps: npt.NDArray[np.int64],
    group: list[int],
    peaks: list[float],
    below: float,
) -> None:
    """Joins the peaks whose floods meet at some cubes, if the lower of both is below a clearance."""
    around = flat[wet[:, None] + steps]
    cube, side = np.nonzero((around > 0) & (around != flat[wet, None]))
    meetings = np.unique(np.stack([flat[wet[cube]], around[cube, side]], axis=-1), axis=0)
    for seeds in meetings.tolist():
        lower, higher = sorted((_root(group, seed) for seed in seeds), key=lambda root: (peaks[root], -root))
        if lower != higher and peaks[lower] < below:
            group[lower] = higher


def _root(group: list[int], seed: int) -> int:
    while group[seed] != seed:
        seed = group[seed]
    return seed


def _border(shape: tuple[int, ...]) -> Flags:
    border = np.ones(shape, bool)
    border[1:-1, 1:-1, 1:-1] = False
    return border


@dataclass(frozen=True, eq=False)
class _Gate:
    """A planar section of free space: the flags of a layer of cubes, of which it is the lower side."""

    axis: int
    layer: int
    open: Flags


def _gates(solid: Flags, basins: Labels, door: float) -> Iterator[_Gate]:
    """The smallest sections across all ways from basin to basin."""
    from scipy import ndimage

    meets: dict[tuple[int, int], list[npt.NDArray[np.int64]]] = {}
    for axis in _AXES:
        a, b = _lower(basins, axis), _upper(basins, axis)
        at = np.argwhere((a != b) & (a > 0) & (b > 0))
        pair = np.stack([a[tuple(at.T)], b[tuple(at.T)]], axis=-1)
        pair.sort(axis=1)
        for first, second in np.unique(pair, axis=0).tolist():
            meets.setdefault((first, second), []).append(at[(pair == (first, second)).all(axis=1)])
    for places in meets.values():
        points = np.concatenate(places)
        low, high = np.maximum(points.min(0) - 1, 0), points.max(0) + 2
        box = np.zeros(high - low, bool)
        box[tuple((points - low).T)] = True
        parts, count = ndimage.label(box, np.ones((3, 3, 3), bool))
        for part in range(1, count + 1):
            gate = _narrowest(solid, np.argwhere(parts == part) + low, door)
            if gate is not None:
                yield gate


def _narrowest(solid: Flags, meeting: npt.NDArray[np.int64], door: float) -> _Gate | None:
    """The planar section with the fewest cubes near the surface in which two basins meet; of several, the middle one.

    None if it is larger than a door.
    """
    from scipy import ndimage

    best: list[_Gate] = []
    least = round(door * door)
    middle = meeting.mean(axis=0)
    shadows = [np.unique(np.delete(meeting, axis, axis=1), axis=0) for axis in _AXES]
    reach = max(2, round(door / 4))
    for axis, shadow in enumerate(shadows):
        if len(shadow) < _FACING * max(map(len, shadows)):
            continue
        low, high = int(meeting[:, axis].min()) - reach, int(meeting[:, axis].max()) + reach
        for layer in range(max(low, 1), min(high, solid.shape[axis] - 1) + 1):
            sections, _ = ndimage.label(~np.take(solid, layer, axis=axis))
            through = np.bincount(sections[tuple(shadow.T)])
            through[0] = 0
            if through.max() < _COVERED * len(shadow):
                continue
            section = sections == through.argmax()
            area = int(section.sum())
            if area < least:
                best, least = [], area
            if area == least:
                best.append(_Gate(axis, layer, section))
    return min(best, key=lambda gate: abs(gate.layer - middle[gate.axis]), default=None)


def _rooms(solid: Flags, basins: Labels, gates: list[_Gate]) -> Labels:
    """Labels of what is connected while all gates are closed.

    FILLED is what is not free, and what no peak is in.
    """
    from scipy import ndimage

    closed = solid.copy()
    for gate in gates:
        closed[_layer(gate.axis, gate.layer)] |= gate.open
    parts, count = ndimage.label(~closed)
    # What is cut off of all peaks stays a room if it is between gates.
    known = np.zeros(count + 1, bool)
    known[np.unique(parts[basins > 0])] = True
    known[0] = False
    names = np.full(count + 1, FILLED, np.int32)
    order = np.flatnonzero(known)
    order = order[order != parts[0, 0, 0]]
    names[order] = np.arange(len(order))
    names[parts[0, 0, 0]] = OUTDOORS
    labels: Labels = names[parts]
    # A gate's layer belongs to what is above it, as its plane is the layer's lower side.
    for gate in gates:
        if gate.layer + 1 < labels.shape[gate.axis]:
            here, above = labels[_layer(gate.axis, gate.layer)], labels[_layer(gate.axis, gate.layer + 1)]
            into = above[gate.open & (above != FILLED)]
            values, counts = np.unique(into, return_counts=True)
            here[gate.open] = np.where(
                above[gate.open] != FILLED, above[gate.open], values[counts.argmax()] if len(values) else FILLED
            )
    return labels


def _openings(labels: Labels) -> Iterator[tuple[_Gate, int, int]]:
    """Planar pieces of the surface between cells, and the labels on both sides, the lower first."""
    from scipy import ndimage

    for axis in _AXES:
        below, above = _lower(labels, axis), _upper(labels, axis)
        apart = (below != above) & (below != FILLED) & (above != FILLED)
        for layer in np.unique(np.nonzero(apart)[axis]).tolist():
            at = _layer(axis, layer)
            pairs = np.sort(np.stack([below[at], above[at]], axis=-1), axis=-1)
            for a, b in np.unique(pairs[apart[at]], axis=0).tolist():
                between = apart[at] & (pairs == (a, b)).all(axis=-1)
                parts, count = ndimage.label(between, np.ones((3, 3), bool))
                for part in range(1, count + 1):
                    yield _Gate(axis, layer + 1, parts == part), a, b


def _polygon(grid: Grid, gate: _Gate) -> Floats:
    """The convex outline of a gate's cubes and of those around them."""
    from scipy import ndimage
    from scipy.spatial import ConvexHull

    wide = np.argwhere(ndimage.binary_dilation(np.pad(gate.open, _SPARE), np.ones((3, 3), bool), _SPARE)) - _SPARE
    corners = np.concatenate([wide, wide + (0, 1), wide + (1, 0), wide + (1, 1)])
    hull = ConvexHull(corners.astype(np.float64))
    outline = corners[hull.vertices]
    across = [other for other in _AXES if other != gate.axis]
    polygon = np.empty((len(outline), 3))
    polygon[:, gate.axis] = gate.layer
    polygon[:, across] = outline
    return np.asarray(grid.low + polygon * grid.step)


def _cell(rooms: Rooms, label: int) -> Cell:
    at = np.argwhere(rooms.labels == label)
    grid = rooms.grid
    low, high = grid.low + at.min(0) * grid.step, grid.low + (at.max(0) + 1) * grid.step
    return Cell(f"room {label}", low, high, rooms=rooms, label=label)


def _faces(rooms: Rooms, pairs: Pairs, count: int) -> list[npt.NDArray[np.uint32]]:
    """The faces that reach into the cubes of each room, or into others near to them; outdoors is last."""
    from scipy import ndimage

    labels = rooms.labels
    filled = labels == FILLED
    assigned = []
    for label in [*range(int(labels.max()) + 1), OUTDOORS]:
        near = labels == label
        reached = ndimage.binary_dilation(near, np.ones((3, 3, 3), bool), NEAR, mask=filled | near)
        flags = np.zeros(count, bool)
        flags[pairs.faces[reached.reshape(-1)[pairs.voxels]]] = True
        assigned.append(np.flatnonzero(flags).astype(np.uint32))
    return assigned


def _why_none(solid: Flags, grid: Grid, door: float) -> str:
    from scipy import ndimage

    parts, count = ndimage.label(~solid)
    inside = int((parts != parts[0, 0, 0]).sum()) - int(solid.sum())
    found = f"{count - 1} hollows with {inside} voxels of {grid.step:g} are cut off from outdoors"
    if count == 1:
        found = f"all free space is connected to outdoors by openings wider than voxels of {grid.step:g}"
    return (
        f"no closed space found: {found}, and nothing narrower than a door of {door:g} leads to a wider room. "
        "If its doors are wider give a larger door=, if its walls have gaps a larger voxel=, if its rooms are small "
        "both smaller"
    )


def _lower(array: npt.NDArray[Any], axis: int) -> npt.NDArray[Any]:
    return array[tuple(slice(None, -1) if a == axis else slice(None) for a in _AXES)]


def _upper(array: npt.NDArray[Any], axis: int) -> npt.NDArray[Any]:
    return array[tuple(slice(1, None) if a == axis else slice(None) for a in _AXES)]


def _layer(axis: int, at: int) -> tuple[slice | int, ...]:
    return tuple(at if a == axis else slice(None) for a in _AXES)
