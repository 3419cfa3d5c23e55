"""Finding the images of a plan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .. import _core
from ..arguments import checked_number, checked_whole
from ..executors import Executor, Team
from ..progress import Progress, reporter
from ..region import visible_from
from ..scene import Scene
from .grid import GridPlan, place_on_grid
from .optimising import WEIGHTS
from .plan import Directions, Plan, Proof, Sight, axes, cells_of, joined

__all__ = ["place_images"]

#: Lowest and highest coordinates of a box, and the faces that can be seen from it.
Region = tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]

Method = Literal["cover", "paper", "windows", "annealing"]

# What the kernel answers: viewpoints and the rest of images, boxes of the proof and what serves them.
Arrays = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
Placed = tuple[Arrays, tuple[npt.NDArray[np.float64], npt.NDArray[np.int32]]]

# A grid's viewpoints may be as far away as they are, and its proof ends at boxes of this share of the longest edge.
_ANYWHERE, _LEAST = 1e3, 1 / 128

# How images are searched for, none of which changes what is proved: aims in a turn; between viewpoints, and how far
# beyond the domain, in longest edges; boxes of eyes and gazes that are looked at together, in edges and parts of a
# turn; boxes of a proof that are too many, twenty times what even scenes take.
# Over the sphere there are so many more gazes that all steps are wider.
_STEPS = {
    "yaw": {
        "aims": 72,
        "spacing": 1 / 8,
        "margin": 1 / 2,
        "state_edge": 1 / 12,
        "state_turns": 36,
        "most_leaves": 200_000,
    },
    "sphere": {
        "aims": 36,
        "spacing": 1 / 6,
        "margin": 1 / 2,
        "state_edge": 1 / 8,
        "state_turns": 24,
        "most_leaves": 4_000_000,
    },
}

# Looking for what several images take away costs as much for each.
_MOST_IN_A_FRAME = 16

# Images of the shell to a side, along each of its edges.
_MOST_SHELL = 16

# Degrees that images are wider than the frames: with 12, cells as large as those of 20,000 pipes straddle the borders
# of the quadrilaterals and the proof does not end; with 30, 1M pipes need as few images as with 12.
_WIDER = 30.0
_MOST_IMAGE = 150.0

# A share of the budget; measured: see benches/placement.py.
_TARGET = 0.8

# Frames beyond these have no use, and their images no room.
_LEAST_FOV, _MOST_FOV, _MOST_ASPECT = 5.0, 120.0, 10.0

# As in the kernel.
_MOST_LEVELS = 10

# Where cells are large against the budget, the next smaller ones are tried, so many times: then a leaf has a 64th of
# the faces.
_DEEPER = 2

# Flatter than this share of its longest edge, a scene has no volume.
_FLAT = 1e-9

# Eyes on the model's faces are inside the domain, however they were rounded: a share of the longest edge.
_PAD = 1e-3


def place_images(
    scene: Scene,
    budget: int = 250_000,
    optimize_to: int | None = None,
    *,
    fov_x: float = 60.0,
    aspect: float = 4 / 3,
    up: npt.ArrayLike = (0, 1, 0),
    domain: npt.ArrayLike | None = None,
    directions: Directions = "yaw",
    method: Method = "cover",
    leaf_depth: int = 5,
    grid: Sequence[int] = (3, 3, 3),
    weights: Sequence[float] = WEIGHTS,
    star_shape: Literal["certified", "paper"] = "certified",
    subdivide: Literal["count", "solve"] = "solve",
    lookahead: int = 1,
    image_fov: float | None = None,
    reach: float = 1.2,
    shell: int = 1,
    visibility: int | Sequence[Region] | None = None,
    lod: Sequence[tuple[Scene, float]] = (),
    images_per_frame: int = 1,
    threads: int | None = None,
    executor: Executor | None = None,
    progress: Progress = None,
) -> Plan:
    """Images such that from any eye in the scene, along any gaze, no more than a budget of faces is drawn.

    Images for a sample of eyes and gazes are chosen greedily, then proved to serve all of them by dividing boxes of
    eyes and gazes; images are added where the proof finds gaps, and left out where others serve.

    Parameters
    ----------
    scene : Scene
    budget : int
        The most faces of any frame.
    optimize_to : int, optional
        How many faces images are chosen to leave, by default 80 % of the budget. Less asks for images nearer to the
        eyes, and leaves the proof more room.
    fov_x, aspect : float
        Of all frames: the horizontal angle of view in degrees, and width over height.
    up : (3,) array_like of float
        Of all frames.
    domain : (2, 3) array_like of float, optional
        Where eyes may be: lowest and highest coordinates. By default the scene's bounds and a little more.
    directions : {"yaw", "sphere"}
        Whether gazes are level, or any. Frames have no roll; straight up and down, where yaw turns the frame, they may
        be turned in any way.
    method : {"cover", "paper", "windows", "annealing"}
        How images are found: by the greedy cover above, or on the adaptive grid of the 1998 dissertation (chapter 3)
        with its search, a better one that never reaches less, or simulated annealing. A plan from a grid is for level
        gazes and the scene's bounds, is proved by the same division of boxes, and has its `grid`.
    leaf_depth : int
        Of the octree that faces are counted and culled in. Where the budget is too small for its leaves, up to two
        levels more are tried; `Plan.leaf_depth` says which it was.
    grid, weights, star_shape, subdivide, lookahead
        Of a grid's method; see `placement.place_on_grid`. With `star_shape="paper"` not all frames are served:
        `Plan.gaps` says how many are not proved to be.
    image_fov : float, optional
        The horizontal angle of an image as seen from its viewpoint, in degrees; by default 30 more than `fov_x`, so
        that neighbouring gazes share it. For a grid the angle of the views that it is made for, by default `fov_x`.
    reach : float
        The greatest distance from an eye to the viewpoint of its image, in longest edges of the domain.
    shell : int
        For eyes beyond the domain there are so many times so many images before each side of the scene, all of which
        lies behind each; 0 for none: then eyes beyond the domain are refused.
    visibility : int or sequence of (low, high, faces), optional
        What can be seen from where, so that only that counts and is drawn (figure 1-4): boxes that tile the domain with
        the faces that can be seen from each, from `cyc.visible_from` or a bake; or into how many boxes the domain is
        cut along each axis, for which `cyc.visible_from` is asked then. Those are sets from samples: what they missed
        is not drawn. Beyond the domain everything counts.
    lod : sequence of (Scene, float)
        Coarser levels of detail that are ready, and the distances from the eye from which each takes the place of the
        one before. A cell is drawn where any point of its box is between its level's distances: neighbouring levels
        overlap a little, and none of the scene is left out.
    images_per_frame : int
        The most images that stand for something in one frame (section 8.2). The budget is proved with one; of those
        that serve an eye as well the ones that leave the fewest faces are taken, too, and frames draw less than the
        proof says. Painted, they share the pixels of one.
    threads : int, optional
        All cores by default; the plan doesn't depend on it.
    executor : Executor, optional
        Finds what `visibility` boxes see, which is 80 to 97 % of the whole time (``benches/executors.py``); see
        `cyclorama.executors`. The cover and its proof are worked out here. The plan doesn't depend on it.
    progress : bool or callable, optional
        See `cyclorama.progress`.

    Returns
    -------
    Plan

    Raises
    ------
    ValueError
        If an argument is out of its range, the budget above the scene, or smaller than what can't be put behind an
        image somewhere: the message says where, how much is needed there, and what budget would do.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(20_000)
    >>> plan = cyc.place_images(scene, budget=13_000, progress=False)
    >>> frame = plan.frame([0, 0, -0.95], [0, 0, 1])
    >>> len(frame.faces) <= 13_000, frame.image is None
    (True, False)
    """
    pairs = lod if isinstance(lod, (tuple, list)) else [None]
    if not all(isinstance(pair, (tuple, list)) and len(pair) == 2 and isinstance(pair[0], Scene) for pair in pairs):
        raise ValueError(f"lod must be pairs of a Scene and the distance from which on it is drawn, got {lod!r}")
    whole = joined(scene, lod)
    faces = len(whole)
    budget = checked_whole("budget", budget, 1)
    if faces < 2:
        raise ValueError("the scene has fewer than two faces: nothing of it can be put behind an image")
    if budget > faces:
        raise ValueError(f"budget is {budget}, the scene has {faces} faces: a frame may draw all, and needs no plan")
    target = max(int(_TARGET * budget), 1) if optimize_to is None else optimize_to
    if not (isinstance(target, (int, np.integer)) and 1 <= target <= budget):
        raise ValueError(f"optimize_to must be an integer from 1 to the budget, {budget}, got {target!r}")
    fov_x, aspect, reach = (
        checked_number(name, value) for name, value in (("fov_x", fov_x), ("aspect", aspect), ("reach", reach))
    )
    if not _LEAST_FOV <= fov_x <= _MOST_FOV:
        raise ValueError(f"fov_x must be {_LEAST_FOV:g} to {_MOST_FOV:g} degrees, got {fov_x!r}")
    if not 1 / _MOST_ASPECT <= aspect <= _MOST_ASPECT:
        raise ValueError(f"aspect must be {1 / _MOST_ASPECT:g} to {_MOST_ASPECT:g}, got {aspect!r}")
    if directions not in ("yaw", "sphere"):
        raise ValueError(f"directions must be 'yaw' or 'sphere', got {directions!r}")
    if not (isinstance(shell, (int, np.integer)) and 0 <= shell <= _MOST_SHELL):
        raise ValueError(f"shell must be an integer from 0 to {_MOST_SHELL}, got {shell!r}")
    if method not in ("cover", "paper", "windows", "annealing"):
        raise ValueError(f"method must be 'cover', 'paper', 'windows' or 'annealing', got {method!r}")
    if not (isinstance(leaf_depth, (int, np.integer)) and 0 <= leaf_depth <= _MOST_LEVELS):
        raise ValueError(f"leaf_depth must be an integer from 0 to {_MOST_LEVELS}, got {leaf_depth!r}")
    if not (isinstance(images_per_frame, (int, np.integer)) and 1 <= images_per_frame <= _MOST_IN_A_FRAME):
        raise ValueError(f"images_per_frame must be an integer from 1 to {_MOST_IN_A_FRAME}, got {images_per_frame!r}")
    if reach == 0:
        raise ValueError(f"reach must be positive, got {reach!r}")
    axis = np.asarray(up, dtype=np.float64)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
        raise ValueError(f"up must be a direction, got {up!r}")
    size = scene.bounds[1] - scene.bounds[0]
    if budget < faces and size.min() <= _FLAT * size.max():
        raise ValueError(
            f"the scene is flat: its bounds are {size.tolist()} wide, and images need a volume to stand in"
        )
    where = scene.bounds + np.array([[-1], [1]]) * _PAD * size.max() if domain is None else np.asarray(domain, float)
    if where.shape != (2, 3) or not np.isfinite(where).all() or not (where[1] > where[0]).all():
        raise ValueError(f"domain must be lowest and highest coordinates, (2, 3), got {domain!r}")
    distances = [0.0, *(float(distance) for _, distance in lod)]
    if not (np.isfinite(distances).all() and (np.diff(distances) > 0).all()):
        raise ValueError(f"lod must have ascending distances above 0, got {distances[1:]}")
    sight = None
    if visibility is not None:
        if domain is None and not isinstance(visibility, (int, np.integer)):
            boxes = np.array([[low, high] for low, high, _ in visibility], dtype=np.float64).reshape(-1, 2, 3)
            where = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
        sight = _sight(scene, where, visibility, faces, threads, None if executor is None else Team(executor, scene))
    edge = float((where[1] - where[0]).max())
    tan_x = float(np.tan(np.radians(fov_x) / 2))
    wide = min(fov_x + _WIDER, _MOST_IMAGE) if image_fov is None else image_fov
    if not fov_x <= wide <= _MOST_IMAGE:
        raise ValueError(f"image_fov must be from fov_x, {fov_x:g}, to {_MOST_IMAGE:g} degrees, got {image_fov!r}")
    widening = float(np.tan(np.radians(wide) / 2)) / tan_x
    pitch = (0.0, 0.0) if directions == "yaw" else (-np.pi / 2, np.pi / 2)
    options = _STEPS[directions] | {
        "domain": where.tolist(),
        "up": axis.tolist(),
        "aims": _aims(int(_STEPS[directions]["aims"]), directions),
        "tan_x": tan_x,
        "tan_y": tan_x / aspect,
        "image_tan_x": tan_x * widening,
        "image_tan_y": tan_x / aspect * widening,
        "budget": int(budget),
        "target": int(target),
        "pitch": pitch,
        "reach": reach * edge,
    }
    if method != "cover":
        if directions != "yaw" or domain is not None:
            raise ValueError(
                f"method={method!r} places for level gazes in the scene's bounds: leave directions and domain"
            )
        found = place_on_grid(
            scene,
            int(budget),
            optimize_to=optimize_to,
            fov_x=fov_x,
            aspect=aspect,
            image_fov=image_fov,
            grid=grid,
            leaf_depth=leaf_depth,
            weights=weights,
            up=up,
            star_shape=star_shape,
            subdivide=subdivide,
            search=method,
            lookahead=lookahead,
            threads=threads,
            progress=progress,
        )
        cells, depth = _core.Cells(scene._mesh, leaf_depth), leaf_depth
        target = max(int(0.8 * budget), 1) if optimize_to is None else optimize_to
        places, rest = _of_grid(found, axis)
        options |= {"domain": found.domain.tolist(), "reach": _ANYWHERE * edge, "least": _LEAST}
        boxes, served = cells.prove(options, places, rest, threads, None)
    else:
        found = None
        cells, depth, ((places, rest), (boxes, served)) = _cover(
            scene, lod, sight, options, leaf_depth, threads, progress
        )
    # The hull of the boxes: what was asked for, as it is after it went to the mesh's own units and back.
    inside = np.stack([boxes[:, :3].min(axis=0), boxes[:, 3:6].max(axis=0)])
    around, outer = _shell(whole, inside, axis, (tan_x, tan_x / aspect), int(shell) if budget < faces else 0)
    places, rest = np.vstack([places, around]), np.vstack([rest, outer])
    viewpoints, rows = np.unique(places, axis=0, return_inverse=True)
    return Plan(
        scene=scene,
        budget=int(budget),
        optimize_to=int(target),
        fov_x=float(fov_x),
        aspect=float(aspect),
        up=axis,
        directions=directions,
        domain=inside,
        leaf_depth=depth,
        viewpoints=viewpoints,
        parameters=np.column_stack([rows.reshape(-1).astype(np.float64), rest]),
        proof=Proof(boxes, served),
        shell=len(around),
        grid=found,
        lod=tuple(lod),
        sight=sight,
        images_per_frame=int(images_per_frame),
        _cells=cells,
    )


def _cover(
    scene: Scene,
    lod: Sequence[tuple[Scene, float]],
    sight: Sight | None,
    options: dict[str, Any],
    leaf_depth: int,
    threads: int | None,
    progress: Progress,
) -> tuple[_core.Cells, int, Placed]:
    """Images and their proof, with the cells that they are of and the level of those."""
    deepest = max(leaf_depth, min(leaf_depth + _DEEPER, _MOST_LEVELS))
    report: Callable[[int], object]
    with reporter(progress, 100, "placing images") as report:
        for depth in range(leaf_depth, deepest + 1):
            cells = cells_of(scene, depth, lod, sight)
            placed, small = cells.place(options, threads, report)
            if placed is not None:
                return cells, depth, placed
    assert small is not None
    raise ValueError(_too_small(options["budget"], deepest, *small))


def _of_grid(found: GridPlan, up: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """A grid's images as viewpoints, (I, 3), and what `Plan.parameters` has of them."""
    ahead, beside, upright = axes(up)
    places, forward = found.viewpoints[found.images.viewpoint], found.images.forward
    rays = found.images.corners - places[:, None]
    yaw = np.arctan2(forward @ beside, forward @ ahead) % (2 * np.pi)
    # As the kernel has them, so that the plane is the same to the last rounding.
    level = np.cos(yaw)[:, None] * ahead + np.sin(yaw)[:, None] * beside
    right = np.cross(level, upright)
    distance = np.einsum("ikj,ij->ik", rays, level).min(axis=1)
    x, y = np.einsum("ikj,ij->ik", rays, right), rays @ upright
    ends = np.column_stack([x.min(axis=1), x.max(axis=1), y.min(axis=1), y.max(axis=1)]) / distance[:, None]
    return places, np.column_stack([yaw, np.zeros(len(yaw)), distance, ends])


# How a region is looked at: pixels along each side of the six images of an eye, and the most eyes.
_SIGHT: dict[str, Any] = {"resolution": 192, "max_eyes": 32, "patience": 8}

# Regions along each axis: more than the proof starts from would only cost memory.
_MOST_REGIONS = 16


def _sight(
    scene: Scene,
    domain: npt.NDArray[np.float64],
    visibility: int | Sequence[Region],
    faces: int,
    threads: int | None,
    team: Team | None,
) -> Sight:
    """What can be seen from where, checked; coarser levels of detail can be seen from anywhere."""
    low, high = domain
    found: list[Region]
    if isinstance(visibility, (int, np.integer)):
        if not 1 <= visibility <= _MOST_REGIONS:
            raise ValueError(f"visibility must be 1 to {_MOST_REGIONS} boxes along each axis, got {visibility}")
        cuts = np.linspace(low, high, int(visibility) + 1)
        cuts[-1] = high
        boxes = []
        for place in np.ndindex((int(visibility),) * 3):
            near, far = (np.array([cuts[i + k][axis] for axis, i in enumerate(place)]) for k in (0, 1))
            boxes.append((near, far))
        if team is None:
            seen = [_seen_from(scene, *box, threads) for box in boxes]
        else:
            seen = [ids for _, ids in sorted(team.run(_seen_from, ((*box, threads or 1) for box in boxes)))]
        found = [(*box, ids) for box, ids in zip(boxes, seen, strict=True)]
    else:
        found = list(visibility)
    regions = np.array([[at, to] for at, to, _ in found], dtype=np.float64).reshape(-1, 2, 3)
    sizes = (regions[:, 1] - regions[:, 0]).prod(axis=1)
    inside = (regions[:, 0] >= low - 1e-9 * (high - low)).all() and (regions[:, 1] <= high + 1e-9 * (high - low)).all()
    if len(found) == 0 or not inside or abs(sizes.sum() / (high - low).prod() - 1) > 1e-6 or (sizes <= 0).any():
        raise ValueError(
            f"visibility must be boxes that tile the domain, {domain.tolist()}: these have "
            f"{sizes.sum() / (high - low).prod():.4g} of its volume"
        )
    # Inside and of the right volume, they leave something out only if two overlap.
    for a, b in enumerate(regions):
        overlap = np.minimum(b[1], regions[a + 1 :, 1]) - np.maximum(b[0], regions[a + 1 :, 0])
        bad = (overlap > 1e-9 * (high - low)).all(axis=1)
        if bad.any():
            raise ValueError(f"visibility must be boxes that tile the domain: {a} and {a + 1 + bad.argmax()} overlap")
    bits = np.zeros((len(found), -(-faces // 64) * 64), bool)
    bits[:, len(scene) : faces] = True
    for row, of in enumerate(found):
        ids = np.asarray(of[2])
        if ids.size and not (np.issubdtype(ids.dtype, np.integer) and 0 <= ids.min() and ids.max() < len(scene)):
            raise ValueError(f"visibility[{row}] must have faces from 0 to {len(scene) - 1}")
        bits[row, ids.astype(np.int64)] = True
    return Sight(regions, np.packbits(bits, axis=1, bitorder="little").view("<u8").astype(np.uint64))


def _seen_from(
    scene: Scene, near: npt.NDArray[np.float64], far: npt.NDArray[np.float64], threads: int | None
) -> npt.NDArray[np.uint32]:
    """The faces that can be seen from a box."""
    return visible_from(scene, near, far, **_SIGHT, threads=threads, progress=False).faces


def _too_small(budget: int, depth: int, needed: int, eye: list[float], yaw: float, pitch: float, images: int) -> str:
    """Where a budget is too small, how much is needed there, and what would do."""
    which = f"the best of {images} images" if images else "any image"
    where = (
        f"an eye at {[round(x, 6) for x in eye]} that looks along a yaw of {yaw:.4g} degrees, pitched by {pitch:.4g},"
    )
    if needed <= budget:
        return (
            f"no proof was found for budget {budget}: {where} can be served with {needed} faces, but not all eyes "
            f"about it by the {images} images that the search ended with, of cells of level {depth}; try a larger one"
        )
    return (
        f"budget {budget} is too small: {where} needs {needed} faces with {which}, those of cells of level {depth} "
        f"about it; a budget of {int(needed * 1.1) + 1} would do there, or a leaf_depth above {depth}"
    )


def _aims(turn: int, directions: Directions) -> list[tuple[float, float]]:
    """Yaws and pitches of images, `turn` to a turn."""
    step = 2 * np.pi / turn
    pitches = [0.0] if directions == "yaw" else [step * k for k in range(-(turn // 4), turn // 4 + 1)]
    return [(step * i, pitch) for pitch in pitches for i in range(turn)]


def _shell(
    scene: Scene, domain: npt.NDArray[np.float64], up: npt.NDArray[np.float64], tangents: tuple[float, float], n: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Images before the six sides of the scene, n x n to a side, all of which lies behind each: viewpoints, (6 n^2, 3),
    and what `Plan.parameters` has of them.

    Planes lie half way between the scene and the sides of the domain where that is larger, and viewpoints so far away
    that the whole scene fits a frame that is aimed at its middle.
    """
    low, high = scene.bounds
    pad = _PAD / 2 * (high - low).max()
    low, high = low - pad, high + pad
    corners = np.array([[(low, high)[b >> k & 1][k] for k in range(3)] for b in range(8)])
    ahead, beside, upright = axes(up)
    viewpoints, rows = [], []
    for side in range(6 if n else 0):
        axis, sign = side // 2, (1, -1)[side % 2]
        inward = -sign * np.eye(3)[axis]
        yaw = float(np.arctan2(inward @ beside, inward @ ahead)) % (2 * np.pi)
        pitch = float(np.arcsin(np.clip(inward @ upright, -1, 1)))
        level = np.cos(yaw) * ahead + np.sin(yaw) * beside
        frame = np.stack([np.cross(level, upright), upright * np.cos(pitch) - level * np.sin(pitch), inward])
        reach = np.abs(frame) @ (high - low) / 2
        away = float(max(reach[0] / tangents[0], reach[1] / tangents[1]))
        across = [k for k in range(3) if k != axis]
        for i in range(n * n):
            at = (high if sign > 0 else low) - away * inward
            at[across] = low[across] + (high - low)[across] * (np.array([i // n, i % n]) + 0.5) / n
            x, y, z = frame @ (corners - at).T
            ends = [float(e) for e in ((x / z).min(), (x / z).max(), (y / z).min(), (y / z).max())]
            viewpoints.append(at)
            rows.append([yaw, pitch, away, *ends])
    return np.array(viewpoints).reshape(-1, 3), np.array(rows).reshape(-1, 7)
