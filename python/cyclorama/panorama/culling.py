"""Which tiles of a viewpoint's slabs the track never sees (2003 paper, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from ..arguments import checked_choice, checked_number
from .projection import Projection
from .track import Track

__all__ = ["Method", "check_culling", "eyes_around", "kept_tiles"]

Mask = npt.NDArray[np.bool_]

Method = Literal["exact", "paper"]

# Points between two references where the track bends.
_BEND = 16


def check_culling(method: Method | None, alpha: float) -> None:
    """Refuses a way to cull that isn't one.

    Raises
    ------
    ValueError
    """
    if method is not None:
        checked_choice("method", method, get_args(Method))
    if not checked_number("alpha", alpha, 1):
        raise ValueError(f"alpha must be above 0, got {alpha!r}")


def kept_tiles(
    panorama: Projection,
    disparities: Sequence[npt.NDArray[np.float32]],
    slabs: Sequence[tuple[float, float]],
    eyes: npt.NDArray[np.float64],
    *,
    tile: int = 32,
    method: Method | None = "exact",
    alpha: float = 1.0,
    closed: float = 0.0,
    error: float = 0.0,
    smallest: bool = False,
    threads: int | None = None,
) -> list[Mask]:
    """The tiles of each slab of a viewpoint that are kept.

    Slabs are taken front to back. An occlusion map holds what of the nearer ones is kept; a tile is dropped if a share
    of at least `alpha` of it is hidden by the map from the viewpoint and from its neighbours, or if nothing is in it.

    "paper" extends a tile's projection to the sides by equations (1) to (5) and asks whether the mean opacity of
    the map there is at least `alpha`, with occluders at their slab's end. That isn't conservative: near occluders
    move most, and views between move up and down, too. "exact" walks from each pixel along its epipolar line over
    the slabs in front and its own, with each occluder's own depth, and joins the shadows that their surfaces cast on
    the way to a neighbour: at `alpha` 1 no surface that can be seen from there is dropped.

    Parameters
    ----------
    panorama : Projection
        Of H x W pixels.
    disparities : sequence of (H, W) ndarray of float32
        1 / range of each slab, 0 where it is transparent.
    slabs : sequence of (float, float)
        Nearest and farthest range of each.
    eyes : (E, 3) ndarray of float
        Where straight ways from the viewpoint end, relative to it: see `eyes_around`.
    tile : int
    method : {"exact", "paper", None}
        None keeps all that isn't empty.
    alpha : float
    closed : float
        Neighbouring pixels are one surface if their disparities differ by at most this: the gap between them is closed.
    error : float
        How far, in disparity, a slab may be from what is drawn of it: occluders count as so much smaller.
    smallest : bool
        For "paper": takes a tile to be at its smallest range, as the paper's text says, not its largest, as its figure
        4 does.
    threads : int, optional

    Returns
    -------
    list of (H / tile, W / tile) ndarray of bool

    Raises
    ------
    ValueError
        If an argument is bad.

    Examples
    --------
    >>> panorama = Projection(size=(256, 64))
    >>> wall, behind = np.full((2, 64, 256), 0.5, np.float32)
    >>> behind *= 0.25
    >>> eyes = np.array([[0.1, 0, 0], [-0.1, 0, 0]])
    >>> [int(keep.sum()) for keep in kept_tiles(panorama, [wall, behind], [(0, 4), (4, 9)], eyes, tile=8)]
    [256, 64]
    """
    check_culling(method, alpha)
    shape = (panorama.height // tile, panorama.width // tile)
    arrays = [np.ascontiguousarray(disparity, dtype=np.float32) for disparity in disparities]
    if method is None:
        return [np.asarray((a > 0).reshape(shape[0], tile, shape[1], tile).any(axis=(1, 3))) for a in arrays]
    ends = [far for _, far in slabs] if method == "paper" else None
    way = np.ascontiguousarray(np.asarray(eyes, dtype=np.float64).reshape(-1, 3))
    found = panorama.kernel.kept(arrays, tile, way, alpha, closed, error, ends, smallest, threads)
    return [keep.reshape(shape) for keep in found]


def eyes_around(track: Track, places: npt.NDArray[np.float64], index: int) -> npt.NDArray[np.float64]:
    """(E, 3) where the eyes that use a reference may go, relative to it.

    The neighbouring references or the track's ends, and points between, a sixteenth of the way apart, where the track
    isn't straight.

    Examples
    --------
    >>> eyes_around(Track([(0, 0, 0), (3, 0, 0)]), np.array([0, 0.5, 1.0]), 1)
    array([[-1.5,  0. ,  0. ],
           [ 1.5,  0. ,  0. ]])
    """
    here = track.at(places[index])
    eyes = []
    bounds = [0.0, *(float(place) for place in places), 1.0]
    for other in (bounds[index], bounds[index + 2]):
        start, end = sorted((float(places[index]), other))
        if start == end:
            continue
        way = track.between(start, end)
        if np.linalg.norm(np.diff(way, axis=0), axis=1).sum() > np.linalg.norm(way[-1] - way[0]) * (1 + 1e-9):
            eyes.append(way[1:-1])
            eyes.append(track.at(np.linspace(start, end, _BEND + 1)[1:-1]))
        eyes.append(track.at([other]))
    return np.asarray(np.concatenate(eyes) - here)
