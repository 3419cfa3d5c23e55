"""What is seen along a walk that is known beforehand (2001, section 5: walkthroughs whose path is replayed)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .. import bitfield
from ..bitfield import Bitfields
from ..camera import Camera, stack
from ..progress import Progress, reporter
from ..render import Fill
from ..scene import Scene
from .learning import TOLERANCE, probe

__all__ = ["PathVisibility", "bake_path"]

Ids = npt.NDArray[np.uint32]

#: So many views in a row that find nothing new end the probing between two cameras.
QUIET = 3

#: Step of the sequence that fills the way between two cameras evenly: the golden ratio.
_STEP = 0.6180339887498949


class PathVisibility:
    """What is seen along a walk, segment by segment; made by `bake_path`.

    Attributes
    ----------
    bitfields : Bitfields
        A row per segment.
    starts : (S + 1,) ndarray of int64
        Segment k goes from camera ``starts[k]`` to camera ``starts[k + 1]``, both included.
    probes : (S,) ndarray of int64
        Views taken between the cameras of each segment.
    """

    def __init__(self, bitfields: Bitfields, starts: npt.NDArray[np.int64], probes: npt.NDArray[np.int64]) -> None:
        self.bitfields = bitfields
        self.starts = starts
        self.probes = probes

    def __len__(self) -> int:
        """Number of segments, S."""
        return len(self.bitfields)

    def __repr__(self) -> str:
        return (
            f"<PathVisibility: {self.starts[-1] + 1} cameras, {len(self)} segments, {self.culling_rate():.1%} culled>"
        )

    def segment(self, position: float) -> int:
        """The segment of a place on the walk: 3 is at camera 3, 3.5 half way to camera 4.

        Raises
        ------
        ValueError
            If it is not between the first camera and the last.
        """
        last = int(self.starts[-1])
        if not (math.isfinite(position) and 0 <= position <= last):
            raise ValueError(f"position must lie between camera 0 and camera {last}, got {position}")
        return min(int(np.searchsorted(self.starts, position, side="right")) - 1, len(self) - 1)

    def visible_faces(self, position: float, out: Ids | None = None) -> Ids:
        """(K,) faces to draw at a place on the walk, ascending; see `segment`.

        Raises
        ------
        ValueError
            If the place is not on the walk, or `out` is too small.
        """
        return self.bitfields.ids(self.segment(position), out=out)

    def culling_rate(self) -> float:
        """Share of the scene's faces that need not be drawn, averaged over the walk."""
        culled = 1 - self.bitfields.count() / self.bitfields.size
        return float(np.average(culled, weights=np.maximum(np.diff(self.starts), 1)))


def bake_path(
    scene: Scene,
    cameras: Sequence[Camera],
    segments: int | npt.ArrayLike | None = None,
    *,
    fill: Fill = "rays",
    probes: int = 16,
    threads: int | None = None,
    progress: Progress = None,
) -> PathVisibility:
    """Finds out what is seen along a walk.

    Parameters
    ----------
    scene : Scene
        F faces.
    cameras : sequence of T Camera
        The walk, in its order; at least one. Neighbours are of one kind and size.
    segments : int or (S + 1,) array_like of int, optional
        Number of segments of about as many cameras each, or the cameras at their ends, from 0 to T - 1. By default one
        for each pair of neighbours.
    fill : {"rays", "neighbours", None}
        As in `Scene.visible`.
    probes : int
        Most views between two neighbouring cameras (eye and lens on the straight line, the turn shared out evenly);
        fewer where they find nothing new.
    threads : int, optional
        All cores by default.
    progress : bool, callable or None
        See `cyclorama.progress`; units are views.

    Returns
    -------
    PathVisibility

    Raises
    ------
    ValueError
        If there are no cameras, neighbours are of different kinds or sizes, or segments do not rise from 0 to T - 1.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> eyes = [(3 * np.sin(a), 0, 3 * np.cos(a)) for a in np.linspace(0, 1, 5)]
    >>> walk = [cyc.Camera.look_at(eye, (0, 0, 0), width=64, height=64) for eye in eyes]
    >>> path = bake_path(cyc.scenes.sphere(faces=320), walk, segments=2, progress=False)
    >>> len(path), path.segment(1.5), path.segment(2)
    (2, 0, 1)
    """
    walk = list(cameras)
    for index, (a, b) in enumerate(pairwise(walk)):
        if (a.width, a.height, a.orthographic) != (b.width, b.height, b.orthographic):
            raise ValueError(f"cameras[{index}] and cameras[{index + 1}] are of different sizes or kinds")
    if isinstance(probes, bool) or not isinstance(probes, int | np.integer) or probes < 0:
        raise ValueError(f"probes must be a count of at least 0, got {probes!r}")
    starts = _starts(len(walk), segments)
    rows = np.zeros((len(starts) - 1, bitfield.width(len(scene))), dtype=np.uint64)
    pairs = np.arange(len(walk) - 1)
    home = np.minimum(np.searchsorted(starts, pairs, side="right") - 1, len(rows) - 1)
    spent = np.zeros(len(rows), dtype=np.int64)
    with reporter(progress, len(walk) + len(pairs) * probes, "views") as report:
        seen = scene.visible(walk, fill, threads=threads, progress=report).words
        for segment, (first, last) in enumerate(pairwise(starts.tolist())):
            rows[segment] = np.bitwise_or.reduce(seen[first : last + 1], axis=0)
        quiet = np.zeros(len(pairs), dtype=np.int64)
        for k in range(probes):
            if len(pairs) == 0:
                break
            between = [_between(walk[p], walk[p + 1], (0.5 + k * _STEP) % 1) for p in pairs]
            found, missed = probe(scene, stack(between), rows, home[pairs], threads=threads)
            np.bitwise_or.at(rows, home[pairs], found)
            np.add.at(spent, home[pairs], 1)
            report(len(walk) + int(spent.sum()))
            quiet = np.where(missed <= TOLERANCE, quiet + 1, 0)
            pairs, quiet = pairs[quiet < QUIET], quiet[quiet < QUIET]
    return PathVisibility(Bitfields(rows, len(scene)), starts, spent)


def _starts(count: int, segments: int | npt.ArrayLike | None) -> npt.NDArray[np.int64]:
    """Cameras at the ends of the segments of a walk of `count` cameras."""
    if count == 0:
        raise ValueError("cameras is empty: a walk has at least one")
    last = count - 1
    if segments is None:
        return np.arange(count) if last else np.zeros(2, dtype=np.int64)
    array = np.asarray(segments)
    if array.dtype.kind not in "iu":
        raise ValueError(f"segments must be a count or camera numbers, got {segments!r}")
    if array.ndim == 0:
        if not 1 <= array <= max(last, 1):
            raise ValueError(f"segments must be 1 to {max(last, 1)} for {count} cameras, got {array}")
        return np.linspace(0, last, int(array) + 1).round().astype(np.int64)
    if (
        array.ndim != 1
        or len(array) < 2
        or array[0] != 0
        or array[-1] != last
        or (np.diff(array.astype(int)) <= 0).any()
    ):
        raise ValueError(f"segments must rise from 0 to {last}, got {array.tolist()}")
    return array.astype(np.int64)


def _between(a: Camera, b: Camera, t: float) -> Camera:
    """A camera on the way from one to the next: eye and lens on the straight line, the turn shared out evenly."""
    turn = b.world_to_camera[:3, :3] @ a.world_to_camera[:3, :3].T
    pose = np.eye(4)
    pose[:3, :3] = _share_of_turn(turn, t) @ a.world_to_camera[:3, :3]
    place = (1 - t) * a.camera_to_world[:3, 3] + t * b.camera_to_world[:3, 3]
    pose[:3, 3] = -pose[:3, :3] @ place
    return a.replace(K=(1 - t) * a.K + t * b.K, world_to_camera=pose, near=(1 - t) * a.near + t * b.near)


def _share_of_turn(turn: npt.NDArray[np.float64], t: float) -> npt.NDArray[np.float64]:
    """The rotation by a share of the angle of `turn` about its axis."""
    # The axis is the direction that the turn leaves alone: exact for half turns, too.
    axis = np.linalg.svd(turn - np.eye(3))[2][-1]
    across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    angle = t * math.atan2(-float(np.trace(across @ turn)) / 2, (float(np.trace(turn)) - 1) / 2)
    rotation = np.eye(3) + math.sin(angle) * across + (1 - math.cos(angle)) * across @ across
    u, _, v = np.linalg.svd(rotation)
    return np.asarray(u @ v)
