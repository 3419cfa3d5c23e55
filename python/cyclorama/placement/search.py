"""Finding the images of a plan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from .. import _core
from ..progress import Progress, reporter
from ..scene import Scene
from .plan import Directions, Plan, Proof

__all__ = ["place_images"]

# Images are aimed in steps of 5 degrees: half of what a quadrilateral exceeds the usual field of view by.
_AIMS = 72

# Degrees that images are wider than the frames: with 12, cells as large as those of 20,000 pipes straddle the borders
# of the quadrilaterals and the proof does not end; with 30, 1M pipes need as few images as with 12.
_WIDER = 30.0
_MOST_IMAGE = 150.0

# A share of the budget; measured: see benches/placement.py.
_TARGET = 0.9

# Frames beyond these have no use, and their images no room.
_LEAST_FOV, _MOST_FOV, _MOST_ASPECT = 5.0, 120.0, 10.0

# As in the kernel.
_MOST_LEVELS = 10

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
    leaf_depth: int = 5,
    image_fov: float | None = None,
    reach: float = 1.2,
    threads: int | None = None,
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
        How many faces images are chosen to leave, by default 90 % of the budget. Less asks for images nearer to the
        eyes, and leaves the proof more room.
    fov_x, aspect : float
        Of all frames: the horizontal angle of view in degrees, and width over height.
    up : (3,) array_like of float
        Of all frames.
    domain : (2, 3) array_like of float, optional
        Where eyes may be: lowest and highest coordinates. By default the scene's bounds and a little more.
    directions : {"yaw", "sphere"}
        Whether gazes are level, or any.
    leaf_depth : int
        Of the octree that faces are counted and culled in.
    image_fov : float, optional
        The horizontal angle of an image as seen from its viewpoint, in degrees; by default a little more than `fov_x`,
        so that neighbouring gazes share it.
    reach : float
        The greatest distance from an eye to the viewpoint of its image, in longest edges of the domain.
    threads : int, optional
        All cores by default; the plan doesn't depend on it.
    progress : bool or callable, optional
        See `cyclorama.progress`.

    Returns
    -------
    Plan

    Raises
    ------
    ValueError
        If an argument is out of its range, or the budget is smaller than what can't be put behind an image somewhere:
        the message says where, how much is needed there, and what budget would do.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.pipes(20_000)
    >>> plan = cyc.place_images(scene, budget=13_000, progress=False)
    >>> frame = plan.frame([0, 0, -0.95], [0, 0, 1])
    >>> len(frame.faces) <= 13_000, frame.image is None
    (True, False)
    """
    faces = len(scene)
    if not (isinstance(budget, (int, np.integer)) and budget >= 1):
        raise ValueError(f"budget must be an integer of at least 1, got {budget!r}")
    target = max(int(_TARGET * budget), 1) if optimize_to is None else optimize_to
    if not (isinstance(target, (int, np.integer)) and 1 <= target <= budget):
        raise ValueError(f"optimize_to must be an integer from 1 to the budget, {budget}, got {target!r}")
    if not _LEAST_FOV <= fov_x <= _MOST_FOV:
        raise ValueError(f"fov_x must be {_LEAST_FOV:g} to {_MOST_FOV:g} degrees, got {fov_x!r}")
    if not 1 / _MOST_ASPECT <= aspect <= _MOST_ASPECT:
        raise ValueError(f"aspect must be {1 / _MOST_ASPECT:g} to {_MOST_ASPECT:g}, got {aspect!r}")
    if directions != "yaw":
        raise ValueError(f"directions must be 'yaw', got {directions!r}: other pitches are not placed yet")
    if not (isinstance(leaf_depth, (int, np.integer)) and 0 <= leaf_depth <= _MOST_LEVELS):
        raise ValueError(f"leaf_depth must be an integer from 0 to {_MOST_LEVELS}, got {leaf_depth!r}")
    if not (np.isfinite(reach) and reach > 0):
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
    edge = float((where[1] - where[0]).max())
    tan_x = float(np.tan(np.radians(fov_x) / 2))
    wide = min(fov_x + _WIDER, _MOST_IMAGE) if image_fov is None else image_fov
    if not fov_x <= wide <= _MOST_IMAGE:
        raise ValueError(f"image_fov must be from fov_x, {fov_x:g}, to {_MOST_IMAGE:g} degrees, got {image_fov!r}")
    widening = float(np.tan(np.radians(wide) / 2)) / tan_x
    cells = _core.Cells(scene._mesh, leaf_depth)
    options = {
        "domain": where.tolist(),
        "up": axis.tolist(),
        "aims": [(2 * np.pi * i / _AIMS, 0.0) for i in range(_AIMS)],
        "tan_x": tan_x,
        "tan_y": tan_x / aspect,
        "image_tan_x": tan_x * widening,
        "image_tan_y": tan_x / aspect * widening,
        "budget": int(budget),
        "target": int(target),
        "pitch": (0.0, 0.0),
        "reach": reach * edge,
        "spacing": 1 / 8,
        "margin": 1 / 2,
        "state_edge": 1 / 12,
        "state_turns": 36,
    }
    report: Callable[[int], object]
    with reporter(progress, 100, "placing images") as report:
        (places, rest), (boxes, served) = cells.place(options, threads, report)
    viewpoints, rows = np.unique(places, axis=0, return_inverse=True)
    return Plan(
        scene=scene,
        budget=int(budget),
        optimize_to=int(target),
        fov_x=float(fov_x),
        aspect=float(aspect),
        up=axis,
        directions=directions,
        # The hull of the boxes: what was asked for, as it is after it went to the mesh's own units and back.
        domain=np.stack([boxes[:, :3].min(axis=0), boxes[:, 3:6].max(axis=0)]),
        leaf_depth=leaf_depth,
        viewpoints=viewpoints,
        parameters=np.column_stack([rows.reshape(-1).astype(np.float64), rest]),
        proof=Proof(boxes, served),
        _cells=cells,
    )
