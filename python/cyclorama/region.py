"""What can be seen from anywhere in a box: the from-region visible set, by sampling.

An eye sees in all directions through six images of 90 degrees, the sides of a cube around it. Eyes are put at the box's
corners first, which for a convex scene is enough (how far an eye lies in front of a face's plane is largest at a
corner). The others are on the box's edges and sides, where every line of sight leaves it; if a face reaches into the
box, every other one is inside. They follow a low-discrepancy sequence, on edges denser towards the corners: eyes there
found five times as many of the faces that others miss as eyes amid an edge. It ends when a run of eyes finds
few new faces, or when there are no more eyes to spend. With `guided=True` it is then looked closely where few eyes saw
a face (`cyclorama.gaps`): that finds most of what five times as many eyes would, for a third of what the eyes cost, and
costs the estimate, as what is left then has little to do with what was found.

The set is *aggressive*: every face in it is seen from somewhere, but one that is seen only from a small part of the
box may be missing. How many are, is estimated from how many faces were seen by one eye only, by two, and so on to
eight, once the corners have been looked from. Let a face be seen from a share p of the places that eyes are put at,
and let the faces have the density ``p^(a - 1)`` over that share. Then those that k of n eyes see are as
``Gamma(k + a) / k!``, whatever n is, and M times as many eyes more find ``Gamma(a) (1 - (1 + M)^-a)`` on that scale.
Which a it is the counts tell: 0.2 or so in castles and furnished houses, -0.3 in an engine, where faces show through
ever finer gaps. With few counts it is kept near 0.2. M = 5 is what the estimate is given for, as nothing tells how many
faces are left when nobody looks longer. Chao's estimate, from faces seen by one eye and by two, was a third of the
truth: it expects all faces to be about equally hard to see, and the hardest are not.

Whether to end is asked only after each 208 eyes. Asked more often, it ends when few new faces happen to have come, and
just then the estimate is too low; with fewer the density is not yet like that. Only where 64 eyes see nothing that the
corners have not, it ends at once.

After close looks only those faces are counted, seen by up to four eyes, that no look shows which another eye led to:
the others would have been found without the eyes that saw them, and what is like them has been found. One face more
is expected, as some that are missing have nothing beside them that eyes saw. How good an estimate can be is limited
by that faces come into view in groups, behind one gap: where some ten are missing, two or three groups decide, and
after close looks fewer still. Neither the size of the box, nor how many eyes saw the rarest faces, nor what larger
boxes show says more. Nothing knows of faces that no eye is likely to meet: a face behind a keyhole leaves no trace.

None of these made it better: eyes that skip faces seen five times or more (twice as fast, but then clutter is no
longer noticed and fine pictures are not drawn, so they see less); segments from random points of the box to random
points of unseen faces (ten million find fewer than as many seconds of eyes); the exact share of places that see each
face found, in place of a count; twice and three times the eyes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import bitfield
from .arguments import checked_whole
from .camera import Camera
from .gaps import look_closely
from .progress import Progress, reporter
from .render import Fill
from .scene import Scene
from .witnesses import witness

__all__ = ["Region", "cube_around", "visible_from"]

Floats = npt.NDArray[np.float64]

#: Eyes looked through in one call to the kernel.
_STEP = 8

#: Eyes after the corners after which it ends if they saw nothing new.
_EVENLY = 64

#: Close looks for each eye, about.
_LOOKS = 7

#: Faces are counted that so many eyes saw, at most.
_MOST_SIGHTINGS = 8

#: Of these close looks are taken.
_RARE = 4

#: What the shares of places that see faces may be distributed by: their density goes as p^(this - 1). 0 is not among
#: them, where the formulas have no value.
_TAILS = np.linspace(-0.79, 1.21, 101)

#: Where that lies before anything was counted, and how far from it. Measured, see above.
_USUAL, _SPREAD = 0.2, 0.3

#: Faces come into view in groups: so many tell as much as one that comes alone.
_GROUP = 4.0

#: The estimate is of what so many times as many eyes more would find.
_MORE = 5.0

#: Faces that are still missing after close looks though they left no trace, in the mean, where eyes saw more than the
#: corners did. Measured, see above.
_TRACELESS = 1.0

#: Steps of the sequence that fills a cube evenly: powers of the real root of x^4 = x + 1 (Roberts).
_CUBE_STEP = 1.2207440846057596 ** -np.arange(1.0, 4.0)

#: Turns from the world's axes to those of a camera that looks along each of them.
_SIDES = tuple(
    Camera.look_at(np.zeros(3), sign * axis).world_to_camera[:3, :3] for axis in np.eye(3) for sign in (1.0, -1.0)
)


@dataclass(frozen=True)
class Region:
    """What can be seen from a box.

    Parameters
    ----------
    faces : (K,) ndarray of uint32
        Faces that some eye saw, and the transparent ones; ascending.
    unseen : float
        How many more five times as many eyes again would find, estimated; see the module's text. 0 for a box that is a
        single point.
    eyes : (N, 3) ndarray of float64
        From where was looked: eyes that look all around, and then the places of those close looks that found something.
    first : (K,) ndarray of int64
        The eye that saw each face first.
    growth : (N,) ndarray of int64
        How many faces had been seen after each eye.
    """

    faces: npt.NDArray[np.uint32]
    unseen: float
    eyes: Floats
    first: npt.NDArray[np.int64]
    growth: npt.NDArray[np.int64]

    def __repr__(self) -> str:
        return f"<Region: {len(self.faces):,} faces from {len(self.eyes):,} eyes, about {self.unseen:.3g} unseen>"

    def witnesses(self, scene: Scene, *, resolution: int = 64, threads: int | None = None) -> tuple[Floats, Floats]:
        """For each face an eye in the box, and a point of the face that nothing hides from it.

        Parameters
        ----------
        scene : Scene
            What was looked at.
        resolution : int
            Pixels along each side of an image that a face fills; four times as many, of the face and then of parts of
            it, where none of them shows it.
        threads : int, optional
            As for `visible_from`.

        Returns
        -------
        eyes, points : (K, 3) ndarray of float64
            The point is NaN where no pixel showed the face, as of transparent ones.

        Raises
        ------
        ValueError
            If the scene lacks a face that was seen.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> ball = cyc.scenes.sphere(faces=320)
        >>> region = visible_from(ball, [-1, -1, 3], [1, 1, 4], resolution=64, progress=False)
        >>> eyes, points = region.witnesses(ball)
        >>> bool(np.linalg.norm(points, axis=1).max() < 1.001)
        True
        """
        checked_whole("resolution", resolution, 1)
        if len(self.faces) and self.faces[-1] >= len(scene):
            raise ValueError(f"face {self.faces[-1]} was seen, but the scene has {len(scene)} faces: it is another one")
        eyes = self.eyes[self.first]
        points = np.full(eyes.shape, np.nan)
        for index, (face, eye) in enumerate(zip(self.faces.tolist(), eyes, strict=True)):
            point = witness(scene, face, eye, resolution, threads)
            if point is not None:
                points[index] = point
        return eyes, points


def visible_from(
    scene: Scene,
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    *,
    resolution: int = 256,
    fill: Fill = "rays",
    max_eyes: int = 424,
    patience: int = 208,
    least: float = 0.15,
    guided: bool = False,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = None,
) -> Region:
    """The faces that can be seen from anywhere in a box.

    Parameters
    ----------
    scene : Scene
        F faces; the box may lie around, inside or outside of it.
    low, high : (3,) array_like of float
        Opposite corners of the box, in the user's units; it may be flat, or a point.
    resolution : int
        Pixels along each side of the six images of an eye.
    fill : {"rays", "neighbours", None}
        How visible faces that own no pixel are found; see `Scene.visible`.
    max_eyes : int
        Most eyes to look from.
    patience : int
        Eyes, after the corners, after which it is asked whether to end, each time. With fewer than the default the
        estimate is worse.
    least : float
        It ends when the next eye is expected to find at most so many new faces: those that one eye saw, over the eyes
        (Good and Turing).
    guided : bool
        Whether it is then looked closely where few eyes saw a face. Most of what was missing is found so; the estimate
        of what is left is worse then.
    seed : int
        Where the sequence of eyes begins.
    threads : int, optional
        All cores by default. The answer does not depend on it.
    progress : bool, callable or None
        See `cyclorama.progress`; units are eyes.

    Returns
    -------
    Region
        `.faces`, `.unseen` (an estimate of how many faces are still missing) and `.eyes`.

    Raises
    ------
    ValueError
        If the corners are not three finite numbers each, `low` is above `high`, or a count is not at least 1.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> ball = cyc.scenes.sphere(faces=320)
    >>> region = visible_from(ball, [-1, -1, 3], [1, 1, 4], resolution=64, progress=False)
    >>> 0 < len(region.faces) < len(ball), region.unseen < 10
    (True, True)
    """
    box = check_box(low, high)
    for name, value in (("resolution", resolution), ("max_eyes", max_eyes), ("patience", patience)):
        checked_whole(name, value, 1)
    checked_whole("seed", seed, 0)
    if not (np.isfinite(least) and least >= 0):
        raise ValueError(f"least must be a number of at least 0, got {least!r}")
    inside = _reached_into(scene, box)
    corners, even = _eyes(box, max_eyes, seed, inside)
    sightings = np.zeros(len(scene), dtype=np.int64)
    first = np.full(len(scene), -1, dtype=np.int64)
    looked: list[npt.NDArray[np.uint64]] = []
    growth: list[int] = []
    with reporter(progress, len(even), "eyes") as report:
        while len(growth) < len(even):
            spent = len(growth)
            # Not beyond where it may end.
            end = corners if spent < corners else spent + min(_STEP, patience - (spent - corners) % patience)
            words = _looked(scene, even[spent:end], resolution, fill, threads)
            looked.append(words)
            for eye, flags in enumerate(bitfield.unpack(words, len(scene)), spent):
                first[flags & (sightings == 0)] = eye
                sightings += flags
                growth.append(int(np.count_nonzero(sightings)))
            report(len(growth))
            beyond = len(growth) - corners
            if beyond > 0 and beyond % patience == 0:
                once = np.count_nonzero(sightings[first >= corners] == 1)
                if once <= least * beyond:
                    break
            if beyond == _EVENLY and not (first >= corners).any():
                break
        report(len(even))
    eyes, beyond = even[: len(growth)], len(growth) - corners
    # One eye after the corners says nothing of how seldom a face is seen.
    later = np.flatnonzero(first >= (corners if beyond > 1 else 0))
    unseen = _unseen(sightings[later], beyond if beyond > 1 else len(eyes))
    if guided and beyond > 1 and len(later):
        rare = later[sightings[later] <= _RARE]
        found = look_closely(
            scene,
            box,
            rare,
            eyes,
            _columns(np.concatenate(looked), rare),
            sightings > 0,
            _anywhere(box, seed, inside),
            most=_LOOKS * len(eyes),
            resolution=2 * resolution,
            fill=fill,
            seed=seed,
            threads=threads,
        )
        unseen = _unseen(sightings[rare[~found.again]], beyond, _RARE) + _TRACELESS
        for eye, new in enumerate(found.faces, len(eyes)):
            first[new] = eye
            growth.append(growth[-1] + len(new))
        eyes = np.concatenate([eyes, found.eyes])
    faces = np.flatnonzero(first >= 0).astype(np.uint32)
    return Region(faces, unseen, eyes, first[faces], np.array(growth))


def _looked(scene: Scene, eyes: Floats, resolution: int, fill: Fill, threads: int | None) -> npt.NDArray[np.uint64]:
    """(N, W) what each eye sees, as rows of bits."""
    cameras = [camera for eye in eyes for camera in cube_around(eye, resolution)]
    seen = scene.visible(cameras, fill, threads=threads, progress=False)
    whole: npt.NDArray[np.uint64] = np.bitwise_or.reduce(seen.words.reshape(len(eyes), len(_SIDES), -1), axis=1)
    return whole


def _columns(words: npt.NDArray[np.uint64], faces: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """(N, R) the bits of some faces in rows."""
    return (words[:, faces // 64] >> (faces % 64).astype(np.uint64) & np.uint64(1)).astype(bool)


def _unseen(sightings: npt.NDArray[np.int64], eyes: int, most: int = _MOST_SIGHTINGS) -> float:
    """How many faces more eyes would find, from how many eyes saw each of the others, where they were at most so many;
    see the module's text."""
    most = min(most, eyes)
    seen = np.bincount(sightings, minlength=most + 1)[1 : most + 1]
    if eyes < 2 or not seen.any():
        return 0.0
    times = np.arange(1, most + 1)
    # Gamma(k + a) / (k! Gamma(1 + a)) for k = 1, 2, ..., a row for each a.
    shares = np.cumprod((times - 1 + _TAILS[:, None]) / times, axis=1) / _TAILS[:, None]
    likelihood = np.log(shares / shares.sum(axis=1, keepdims=True)) @ seen / _GROUP
    best = int(np.argmax(likelihood - ((_TAILS - _USUAL) / _SPREAD) ** 2 / 2))
    tail = float(_TAILS[best])
    return float(seen.sum() / shares[best].sum() * (1 - (1 + _MORE) ** -tail) / tail)


def check_box(low: npt.ArrayLike, high: npt.ArrayLike) -> Floats:
    """(2, 3) corners, checked."""
    corners = []
    for name, value in (("low", low), ("high", high)):
        try:
            corner = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"{name} must be three numbers, got {value!r}") from None
        if corner.shape != (3,) or not np.isfinite(corner).all():
            raise ValueError(f"{name} must be three finite numbers, got {value!r}")
        corners.append(corner)
    for axis in np.flatnonzero(corners[0] > corners[1]):
        raise ValueError(f"low[{axis}] is {corners[0][axis]}, above high[{axis}], {corners[1][axis]}")
    return np.stack(corners)


def _eyes(box: Floats, most: int, seed: int, inside: bool) -> tuple[int, Floats]:
    """How many of the eyes are corners, and all of them: each place once."""
    corners = np.unique([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)], axis=0)
    corners = corners[:most]
    count = most - len(corners) if len(corners) > 1 else 0
    begin = np.random.default_rng(seed).random(3)
    shares = (begin + np.arange(count)[:, None] * _CUBE_STEP) % 1
    return len(corners), np.concatenate([corners, _spread(shares, box, inside)])


def _anywhere(box: Floats, seed: int, inside: bool) -> Callable[[int], Floats]:
    """Gives random places, distributed as eyes are."""
    rng = np.random.default_rng([seed, 2])
    return lambda count: _spread(rng.random((count, 3)), box, inside)


def _spread(shares: Floats, box: Floats, inside: bool) -> Floats:
    """Places in a box for points of the unit cube: every other one inside if that is asked for, the others on the
    surface."""
    outer = np.arange(len(shares)) % 2 == 0 if inside else np.ones(len(shares), bool)
    shares = shares.copy()
    shares[outer] = _onto_surface(shares[outer])
    return np.asarray(box[0] + shares * (box[1] - box[0]))


def _onto_surface(shares: Floats) -> Floats:
    """Points of the unit cube moved along an axis to its surface; every other one along the two other axes to an edge,
    and there towards the corners."""
    rows = np.arange(len(shares))
    moved = rows[:, None] // 2 % 3 == np.arange(3)
    moved[::2] = ~moved[::2]
    shares = shares.copy()
    shares[::2] = (1 - np.cos(np.pi * shares[::2])) / 2
    return np.where(moved, np.round(shares), shares)


def _reached_into(scene: Scene, box: Floats) -> bool:
    """Whether the box of a face reaches into a box."""
    corners = scene.vertices[scene.faces]
    return bool(((corners.min(axis=1) < box[1]) & (corners.max(axis=1) > box[0])).all(axis=1).any())


def cube_around(eye: Floats, resolution: int) -> list[Camera]:
    """Six square images around an eye, that meet at their borders."""
    half = resolution / 2
    K = np.array([[half, 0, half], [0, half, half], [0, 0, 1]])
    cameras = []
    for turn in _SIDES:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, -turn @ eye
        cameras.append(Camera(K, pose, resolution, resolution))
    return cameras
