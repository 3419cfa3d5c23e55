"""References where they are needed: the 2003 paper's future work.

Section 7: "controlled by the maximum mean squared errors allowed for the reconstructed scenes along the track".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ..arguments import checked_number
from ..camera import Camera
from ..quality import psnr
from .projection import Projection
from .renderers import Renderer
from .slicing import ranges_between, slabs_of
from .store import Reference
from .track import Track
from .viewing import resample, seen_between

__all__ = ["fewer", "middle_error", "places_by_error"]

# Views that a stretch is judged by: looking along the horizon, all round.
_VIEWS, _FOV = 4, 100.0
# Columns that errors are measured in, about.
_COLUMNS = 1024
# Pixels a side of tiles there.
_TILE = 16
# A stretch isn't halved more often than this.
_HALVINGS = 12


def places_by_error(
    renderer: Renderer,
    track: Track,
    max_error: float,
    *,
    slabs: int | Sequence[float] = 3,
    panorama: Projection | None = None,
    mesh_pixels: float = 0.25,
) -> npt.NDArray[np.float64]:
    """Places of references such that the view half-way between two of them is wrong by at most `max_error`.

    A stretch between two references is halved until the view from its middle, put together from both, has at most that
    root of the mean squared error against what the renderer shows there; stretches begin at the track's ends and at the
    corners of a polyline. The middle is where both references count alike and are farthest: it is looked at, not
    every place, so other places may be a little worse.

    Parameters
    ----------
    renderer : Renderer
    track : Track
    max_error : float
        Grey levels, 0 to 255: 8 is 30 dB.
    slabs, mesh_pixels
        As for `bake`.
    panorama : Projection, optional
        What errors are measured in; the smaller, the faster, but errors grow as pixels do. 1024 x 256 by default.

    Returns
    -------
    (R,) ndarray of float
        For `bake`'s `places`.

    Raises
    ------
    ValueError
        If `max_error` isn't positive, or a stretch still is worse after twelve halvings.
    """
    if not checked_number("max_error", max_error):
        raise ValueError(f"max_error must be above 0, got {max_error!r}")
    grid = Projection(size=(1024, 256)) if panorama is None else panorama
    starts = [0.0, 1.0] if track.spline else track.at_knots.tolist()
    cuts = ranges_between(slabs, renderer, grid, track.at(np.linspace(0, 1, 9)))

    def error(low: float, high: float) -> float:
        eyes = track.at([low, high])
        reach = float(np.linalg.norm(np.diff(track.between(low, high), axis=0), axis=1).sum())
        pair = []
        for eye in eyes:
            made, _ = slabs_of(renderer, grid, eye, cuts, _TILE, mesh_pixels, reach)
            pair.append(Reference(eye, tuple(made)))
        return middle_error(renderer, pair, grid, track.at(0.5 * (low + high)))

    places = [0.0]
    for low, high in pairwise(starts):
        waiting = [(low, high, 0)]
        while waiting:
            a, b, halvings = waiting.pop()
            if error(a, b) <= max_error:
                places.append(b)
            elif halvings == _HALVINGS:
                raise ValueError(
                    f"between {a:.6g} and {b:.6g} of the track views still differ by more than max_error={max_error}: "
                    "pixels that show edges always do; allow more, or give larger panoramas"
                )
            else:
                middle = 0.5 * (a + b)
                waiting += [(middle, b, halvings + 1), (a, middle, halvings + 1)]
    return np.array(places)


def fewer(panorama: Projection) -> Projection:
    """The same directions in fewer pixels, for errors to be measured in quickly."""
    share = max(1, panorama.width // _COLUMNS)
    sides = (max(_TILE, side // share // _TILE * _TILE) for side in (panorama.width, panorama.height))
    return panorama.resized(*sides)


def middle_error(
    renderer: Renderer, pair: list[Reference], panorama: Projection, eye: npt.NDArray[np.float64]
) -> float:
    """Root of the mean squared error of the view half-way between two references, against the renderer's panorama
    there, in grey levels."""
    layer = renderer.render(eye, panorama, 0.0, math.inf)
    truth = np.dstack([layer.color, np.where(layer.opacity, 255, 0).astype(np.uint8)])
    right, up, back = panorama.axes
    squares = []
    for index in range(_VIEWS):
        turn = 2 * np.pi * index / _VIEWS
        ahead = np.sin(turn) * right - np.cos(turn) * back
        side = max(8, round(2 * panorama.focal * math.tan(math.radians(_FOV / 2))))
        fov_y = 2 * math.degrees(math.atan(0.45 * panorama.height / panorama.focal))
        camera = Camera.look_at(eye, eye + ahead, up=up, fov_y=min(fov_y, _FOV), width=side, height=panorama.height)
        expected, known = resample(truth, panorama, camera)
        seen = seen_between(pair, 0.5, panorama, camera, (0, 0, 0))
        decibels = psnr(seen.color, expected, where=known)
        squares.append(0.0 if math.isinf(decibels) or math.isnan(decibels) else 255**2 / 10 ** (decibels / 10))
    return math.sqrt(float(np.mean(squares)))
