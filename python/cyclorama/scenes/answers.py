"""Scenes whose answer is known by hand: boxes in boxes, a window, a notch, deep tubes, a grating, stacked layers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..scene import Scene
from .solids import Mesh, Points, box, cells, join, normals, refine

__all__ = ["KnownScene", "Sight", "grating", "layers", "nested_boxes", "notch", "tubes", "window_box"]

Ids = npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Sight:
    """What is certain from one eye.

    Attributes
    ----------
    eye : (3,) ndarray of float64
        Where the viewer stands.
    seen, hidden : (K,) and (L,) ndarray of uint32
        Faces of which some point is visible from the eye, and faces of which none is; ascending. Where a scene
        leaves no doubt, they are all its faces.
    """

    eye: Points
    seen: Ids
    hidden: Ids


class KnownScene(Scene):
    """A scene with some answers worked out by hand.

    Attributes
    ----------
    sights : list of Sight
        What is seen and what is hidden, from some eyes.
    """

    def __init__(self, mesh: Mesh, sights: list[Sight], colors: npt.NDArray[np.uint8] | None = None) -> None:
        super().__init__(*mesh, colors)
        self.sights = sights


class Notch(KnownScene):
    """What `notch` returns: a scene with the faces of its apex and the viewpoints about it.

    Attributes
    ----------
    apex_faces : (3,) ndarray of uint32
        The faces that the corner viewpoints miss.
    viewpoints : (3, 3) ndarray of float64
        The corners of the face of the view sphere: A, B and a third one.
    between : (3,) ndarray of float64
        The eye D between them, which sees the apex whole.
    level : int
        Level of the octahedral view sphere that misses the apex.
    """

    def __init__(self, mesh: Mesh, viewpoints: Points, between: Points, level: int) -> None:
        count = len(mesh[1])
        apex = np.arange(3, dtype=np.uint32)
        nothing = np.empty(0, dtype=np.uint32)
        sights = [Sight(between, apex, nothing), *(Sight(eye, nothing, apex) for eye in viewpoints)]
        colors = np.where(np.arange(count)[:, None] < 3, [[214, 64, 48]], [[176, 184, 196]]).astype(np.uint8)
        super().__init__(mesh, sights, colors)
        self.apex_faces = apex
        self.viewpoints = viewpoints
        self.between = between
        self.level = level


def nested_boxes(count: int = 5) -> KnownScene:
    """Closed boxes, each inside the next: of 12 faces each, only front-facing ones of the outermost (the first) show.

    From inside the innermost box nothing else can be seen either. `sights` holds eyes in front of a side, an edge
    and a corner: 2, 4 and 6 visible faces.

    Parameters
    ----------
    count : int
        Number of boxes, at least 1.

    Raises
    ------
    ValueError
        If `count` is below 1.

    Examples
    --------
    >>> scene = nested_boxes(3)
    >>> [len(sight.seen) for sight in scene.sights]
    [2, 4, 6]
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    size = np.linspace(1.0, 0.0, count, endpoint=False)[:, None] * np.ones(3)
    mesh = box(-size, size)
    sights = []
    for direction in ([0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 4.0, 4.0]):
        eye = np.array(direction)
        front = _front_facing(mesh, eye)
        front[12:] = False
        sights.append(_sight(eye, front))
    return KnownScene(mesh, sights)


def window_box() -> KnownScene:
    """A hollow box with a square window in its front (+z) wall, through which a smaller cube shows.

    The walls are 0.1 thick, the box reaches from -1 to 1, the window from -0.3 to 0.3, the cube from -0.1 to 0.1.
    From (0, 0, 4) one sees the frame, the reveal of the window, the front of the cube and the back of the hollow,
    and nothing else; from behind and from the side only the outside. Groups of faces: ``outside`` 0-9 (-x, +x,
    -y, +y, -z), ``frame`` 10-17, ``reveal`` 18-25, ``inside`` 26-35 (-x, +x, -y, +y, back), 36-43 the frame from
    inside, ``cube`` 44-55.

    Examples
    --------
    >>> window_box().sights[0].seen
    array([10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 34, 35, 54, 55], dtype=uint32)
    """
    outer, inner = box([-1.0] * 3, [1.0] * 3), box([-0.9] * 3, [0.9] * 3)
    turn = np.arange(4)
    after = (turn + 1) % 4
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])

    def ring(half: float, z: float) -> Points:
        return np.column_stack([half * square, np.full(4, z)])

    def band(first: int, second: int) -> npt.NDArray[np.int64]:
        a, b, c, d = first + turn, first + after, second + after, second + turn
        return np.stack([np.column_stack([a, b, c]), np.column_stack([a, c, d])], axis=1).reshape(-1, 3)

    rings = np.concatenate([ring(1.0, 1.0), ring(0.3, 1.0), ring(0.3, 0.9), ring(0.9, 0.9)])
    frame = (rings, np.concatenate([band(0, 4), band(4, 8)]))
    back_of_frame = (rings, band(8, 12))
    mesh = join(
        [
            (outer[0], outer[1][:10]),
            frame,
            (inner[0], inner[1][:10, ::-1]),
            back_of_frame,
            box([-0.1] * 3, [0.1] * 3),
        ]
    )
    vertices, faces = mesh
    _, first, welded = np.unique(vertices.round(9), axis=0, return_index=True, return_inverse=True)
    mesh = vertices[first], welded.reshape(-1)[faces]
    sights = []
    for eye, seen in (
        ([0.0, 0.0, 4.0], [*range(10, 26), 34, 35, 54, 55]),
        ([0.0, 0.0, -4.0], [8, 9]),
        ([4.0, 0.0, 0.0], [2, 3]),
    ):
        mask = np.zeros(len(faces), dtype=bool)
        mask[seen] = True
        sights.append(_sight(np.array(eye), mask))
    wall, reveal, inside, cube = [168, 174, 184], [236, 206, 120], [110, 118, 132], [206, 72, 56]
    colors = np.repeat([wall, reveal, inside, cube], [18, 8, 18, 12], axis=0).astype(np.uint8)
    return KnownScene(mesh, sights, colors)


def notch(level: int = 2, *, opening: float = 0.6, distance: float = 4.0) -> Notch:
    """A block with a pit whose apex no sample of an octahedral view sphere sees: the 2001 paper's figure 4, exact.

    In the figure the apex close to C is hidden from the precomputed viewpoints A and B, and a view from D between
    them misses it (section 3.3). Here A, B and a third viewpoint are the corners of the middle face of the octant
    (+, +, +) of the sphere of `level`, and D is above its centre, in the direction (1, 1, 1). The pit is a
    three-sided cone with its apex C at the centre of the scene, so that only the direction of an eye decides:
    the apex is seen from the directions inside the cone, at any distance. In the plane of the sphere's face, in
    units of the distance from its centre to a corner, the mouth of the cone is a triangle turned by 180 degrees
    whose corners lie at `opening` and whose sides lie at half of that. Hence

    * no corner sees the apex (they lie at 1, opposite to the sides), nor does any other sample of the level;
    * for `opening` above 0.5, the samples that level + 1 adds in the middles of the edges, at 0.5 exactly, lie inside
      and see it: higher sampling eliminates the problem, as the paper says (below 0.36 they see no part of the tip);
    * a probe at random in the face sees it with a chance of about `opening` squared.

    The apex is the tip of the cone, a fifth of its depth: faces 0-2. From a corner each of its points looks at the
    opposite wall of the pit.

    Parameters
    ----------
    level : int
        Level of the view sphere, 0 (6 samples) or more.
    opening : float
        Size of the pit's mouth, in (0, 1).
    distance : float
        Distance of the named viewpoints from the centre, in radii of the scene; above 1.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    Examples
    --------
    >>> scene = notch(level=2)
    >>> scene.apex_faces, scene.viewpoints.shape
    (array([0, 1, 2], dtype=uint32), (3, 3))
    """
    if not 0 <= level <= 12:
        raise ValueError(f"level must be from 0 to 12, got {level}")
    if not 0.0 < opening < 1.0:
        raise ValueError(f"opening must lie in (0, 1), got {opening}")
    if not distance > 1.0:
        raise ValueError(f"distance must be above 1, got {distance}")
    corners = np.eye(3)
    for _ in range(level):
        corners = corners + np.roll(corners, -1, axis=0)
        corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    axis = np.full(3, 3**-0.5)
    spread = corners / (corners @ axis)[:, None] - axis  # of the corners, on the plane at distance 1 along the axis
    reach = float(np.linalg.norm(spread[0]))
    # Top and bottom are hexagons; corner 2 i of the top lies above corner i of the mouth.
    side = max(2.5 * opening * reach, 0.4)
    towards = -spread / reach
    ring = np.empty((6, 3))
    ring[0::2] = towards
    ring[1::2] = towards + np.roll(towards, -1, axis=0)
    mouth = opening * reach * towards
    tip = 0.2
    vertices = np.concatenate(
        [np.zeros((1, 3)), tip * (axis + mouth), axis + mouth, axis + side * ring, -axis + side * ring]
    )
    i = np.arange(3)
    j = (i + 1) % 3
    six = np.arange(6)
    next_ = (six + 1) % 6
    inner, rim, top, bottom = 1, 4, 7, 13
    faces = np.concatenate(
        [
            np.column_stack([np.zeros(3, dtype=np.int64), inner + i, inner + j]),
            np.column_stack([inner + i, rim + i, rim + j]),
            np.column_stack([inner + i, rim + j, inner + j]),
            np.column_stack([rim + i, top + 2 * i, top + 2 * i + 1]),
            np.column_stack([rim + i, top + 2 * i + 1, rim + j]),
            np.column_stack([rim + j, top + 2 * i + 1, top + 2 * j]),
            np.column_stack([top + six, bottom + six, bottom + next_]),
            np.column_stack([top + six, bottom + next_, top + next_]),
            np.column_stack([np.full(4, bottom), bottom + np.arange(2, 6), bottom + np.arange(1, 5)]),
        ]
    )
    if normals((vertices, faces))[-1] @ axis > 0.0:
        faces = faces[:, ::-1]
    radius = float(np.linalg.norm(vertices, axis=1).max())
    return Notch((vertices, faces), distance * radius * corners, distance * radius * axis, level)


def tubes(count: int = 9, *, length: float = 2.0, wall: float = 0.3, distance: float = 3.0) -> KnownScene:
    """A plate with `count` by `count` deep blind tubes, all parallel to z and open towards +z.

    It breaks the assumption that eyes beyond the sampling sphere see no more than the sphere's face that they look
    through (2002 paper, section 4.3). An eye far away on the axis sees the bottom of every tube. On the sphere, the
    sample on the axis sees only the bottoms near the axis; the others are seen, one by one, by samples straight above
    them, up to ``asin(r / R)`` away. `sights` has both eyes: the near one at `distance` radii, the far one at a
    million, which tell of the bottoms only: faces 0 to ``2 * count**2 - 1``.

    Parameters
    ----------
    count : int
        Tubes along each side, odd, at least 3; the plate reaches from -1 to 1.
    length : float
        Depth of the tubes, positive.
    wall : float
        Share of the pitch that is wall, in (0, 1).
    distance : float
        Distance of the near eye from the centre, in radii of the scene, above 1.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    Examples
    --------
    >>> near, far = tubes().sights
    >>> len(near.seen), len(far.seen)
    (18, 162)
    """
    if count < 3 or count % 2 == 0:
        raise ValueError(f"count must be odd and at least 3, got {count}")
    if not (length > 0.0 and 0.0 < wall < 1.0 and distance > 1.0):
        raise ValueError(f"length, wall or distance is out of range: {length}, {wall}, {distance}")
    pitch = 2.0 / (count + wall)
    edges = -1.0 + pitch * np.arange(count + 1)
    lines = np.sort(np.concatenate([edges, edges + pitch * wall]))
    solid = np.ones((2 * count + 1, 2 * count + 1, 2), dtype=bool)
    solid[1::2, 1::2, 1] = False
    half = (length + 0.2) / 2.0
    vertices, faces = cells((lines, lines, np.array([-half, -half + 0.2, half])), solid)
    middle = vertices[faces].mean(axis=1)
    bottom = (np.abs(middle[:, 2] + half - 0.2) < 1e-9) & (normals((vertices, faces))[:, 2] > 0.0)
    order = np.argsort(~bottom, kind="stable")
    faces, bottoms = faces[order], int(np.count_nonzero(bottom))
    # From (0, 0, z) the inner sides of a tube's mouth hide its bottom up to `shade`; the rest is a rectangle. A half of
    # the bottom is seen where the rectangle's corner next to the half's right angle lies on its side of the diagonal.
    radius = float(np.linalg.norm([1.0, 1.0, half]))
    corner = vertices[faces[:bottoms], :2]
    center = np.repeat(corner.reshape(-1, 6, 2).mean(axis=1), 2, axis=0)
    inner, outer = np.abs(center) - pitch * (1.0 - wall) / 2.0, np.abs(center) + pitch * (1.0 - wall) / 2.0
    halves, right = np.arange(bottoms), 1 + np.arange(bottoms) % 2
    angle, start, end = corner[halves, right], corner[:, 0], corner[halves, 3 - right]
    along = end - start

    def side(point: Points) -> Points:
        offset = point - start
        return np.asarray(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0])

    sights = []
    for z in (distance * radius, 1e6 * radius):
        shade = np.where(inner > 0.0, inner * (1.0 + length / (z - half)), inner)
        nearest = np.where(np.abs(angle) > outer - 1e-9, angle, np.where(inner > 0.0, np.sign(angle) * shade, angle))
        seen = (shade < outer).all(axis=1) & (side(nearest) * side(angle) > 0.0)
        sights.append(_sight(np.array([0.0, 0.0, z]), seen))
    colors = np.where(np.arange(len(faces))[:, None] < bottoms, [[214, 96, 56]], [[150, 160, 176]]).astype(np.uint8)
    return KnownScene((vertices, faces), sights, colors)


def grating(bars: int = 24, *, panel: int = 48, gap: float = 0.35) -> Scene:
    """A fence of crossed bars in front of a panel of coloured tiles: everything behind is seen through gaps.

    Each step of the eye shows other tiles, and no few samples hold them all: the case of the 2001 paper's "models
    containing holes, grids" (section 3.1).

    Parameters
    ----------
    bars : int
        Upright bars, and as many level ones, at least 2. The fence has ``20 * bars**2 - 8 * bars`` faces.
    panel : int
        Tiles along each side of the panel, at least 1. It has ``4 * panel**2 + 8 * panel`` faces.
    gap : float
        Distance of the panel behind the fence, positive. Both reach from -1 to 1 in x and y; the fence faces +z.

    Raises
    ------
    ValueError
        If a parameter is out of range.

    Examples
    --------
    >>> len(grating(10, panel=20))
    3680
    """
    if bars < 2 or panel < 1 or not gap > 0.0:
        raise ValueError(f"bars, panel or gap is out of range: {bars}, {panel}, {gap}")
    pitch = 2.0 / (bars - 0.5)  # half of it bar, half of it gap
    lines = -1.0 + 0.5 * pitch * np.arange(2 * bars)
    void = np.arange(2 * bars - 1) % 2 == 1
    fence = cells((lines, lines, np.array([-0.25, 0.25]) * pitch), ~(void[:, None] & void)[:, :, None])
    tiles = np.linspace(-1.0, 1.0, panel + 1, dtype=np.float64)
    back = -0.25 * pitch - gap
    board = cells((tiles, tiles, np.array([back - 0.05, back])), np.ones((panel, panel, 1), dtype=bool))
    tile = np.floor((board[0][board[1]].mean(axis=1)[:, :2] + 1.0) / 2.0 * panel - 1e-6).astype(np.int64)
    even = tile.sum(axis=1) % 2 == 0
    warm = np.stack([np.full(len(tile), 210), 90 + 120 * tile[:, 0] // panel, 60 + 120 * tile[:, 1] // panel], axis=1)
    cool = warm[:, ::-1]
    colors = np.concatenate([np.full((len(fence[1]), 3), 96), np.where(even[:, None], warm, cool)])
    return Scene(*join([fence, board]), np.clip(colors, 0, 255).astype(np.uint8))


def layers(faces: int = 100_000, layers: int = 10) -> KnownScene:
    """Square sheets stacked along z, each as large as the others: whatever the eye above, only the first is seen.

    The depth complexity is `layers` while the visible part stays one sheet: for charts of time against depth
    complexity. The sheets are open, face +z, and reach from -1 to 1 in x and y and over the same in z.

    Parameters
    ----------
    faces : int
        Number of faces, shared out evenly and met exactly; odd numbers are rounded up. At least two a layer.
    layers : int
        Number of sheets, at least 1. Faces of the first, the top, come first.

    Raises
    ------
    ValueError
        If `layers` is below 1 or the faces are too few.

    Examples
    --------
    >>> scene = layers(1_000, layers=4)
    >>> len(scene), len(scene.sights[0].seen)
    (1000, 250)
    """
    faces += faces % 2
    if layers < 1 or faces < 2 * layers:
        raise ValueError(f"{layers} layers need at least {max(2, 2 * layers)} faces, got {faces}")
    sheets = []
    for layer in range(layers):
        pairs = faces // 2 * (layer + 1) // layers - faces // 2 * layer // layers
        height = 1.0 - 2.0 * layer / max(1, layers - 1)
        across = int(pairs**0.5)
        along = pairs // across
        x, y = np.meshgrid(np.linspace(-1.0, 1.0, along + 1), np.linspace(-1.0, 1.0, across + 1), indexing="ij")
        here = np.arange(x.size).reshape(x.shape)
        a, b, c, d = here[:-1, :-1].ravel(), here[1:, :-1].ravel(), here[1:, 1:].ravel(), here[:-1, 1:].ravel()
        quads = np.stack([np.column_stack([a, b, c]), np.column_stack([a, c, d])], axis=1).reshape(-1, 3)
        flat = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
        sheets.append(refine((flat, quads), pairs - across * along))
    top = np.zeros(faces, dtype=bool)
    top[: len(sheets[0][1])] = True
    return KnownScene(join(sheets), [_sight(np.array([0.0, 0.0, 6.0]), top)])


def _sight(eye: Points, seen: npt.NDArray[np.bool_]) -> Sight:
    return Sight(eye, np.flatnonzero(seen).astype(np.uint32), np.flatnonzero(~seen).astype(np.uint32))


def _front_facing(mesh: Mesh, eye: Points) -> npt.NDArray[np.bool_]:
    """Faces whose front the eye is strictly before."""
    return np.asarray(np.einsum("fk,fk->f", normals(mesh), eye - mesh[0][mesh[1][:, 0]]) > 1e-12)
