"""The steps before a walkthrough: where references are, where slabs are cut, and rendering them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..arguments import checked_floats
from .projection import Projection
from .renderers import Layer, Renderer, checked_layer
from .slabs import checked_slabs, find_slabs
from .store import Slab
from .track import Track

__all__ = [
    "OVERLAP",
    "closed_step",
    "disparity_of",
    "filled",
    "mesh_error",
    "places_of",
    "ranges_between",
    "reach_of",
    "slabs_of",
]

#: Slabs are rendered beyond their ends by this share of their range.
OVERLAP = 0.02
# A gap between neighbouring pixels that opens by so many pixels at most, seen from the next reference, is closed.
_CLOSED = 1.0
# The panoramas that slabs are found in have a pixel for so many of the others, each way.
_COARSE = 8


def slabs_of(
    renderer: Renderer,
    panorama: Projection,
    eye: npt.NDArray[np.float64],
    cuts: Sequence[tuple[float, float]],
    tile: int,
    mesh_pixels: float,
    reach: float,
) -> tuple[list[Slab], list[npt.NDArray[np.float32]]]:
    """Renders the slabs of a viewpoint and finds their quads, for eyes up to `reach` away; with disparities."""
    slabs, disparities = [], []
    for near, far in cuts:
        start, end = near * (1 - OVERLAP), far * (1 + OVERLAP)
        layer = checked_layer(renderer.render(eye, panorama, start, end), panorama, start, end)
        pixels = np.zeros((*panorama.shape, 4), np.uint8)
        pixels[layer.opacity, :3] = layer.color[layer.opacity]
        pixels[layer.opacity, 3] = 255
        disparity = disparity_of(layer)
        step = closed_step(panorama, reach)
        quads, limits, error = panorama.kernel.quads(disparity, tile, mesh_error(panorama, reach, mesh_pixels), step)
        slabs.append(Slab(pixels, quads, limits, error, filled(layer.opacity, tile)))
        disparities.append(disparity)
    return slabs, disparities


def closed_step(panorama: Projection, reach: float) -> float:
    """The step of disparity that opens a gap which is closed, for an eye `reach` away."""
    return _CLOSED / (panorama.focal * max(reach, 1e-300))


def mesh_error(panorama: Projection, reach: float, pixels: float) -> float:
    """The disparity that moves a quad by so many pixels, for an eye `reach` away."""
    return pixels / _CLOSED * closed_step(panorama, reach)


def disparity_of(layer: Layer) -> npt.NDArray[np.float32]:
    """(H, W) 1 / range, 0 where nothing is."""
    disparity = np.zeros(layer.range.shape, np.float32)
    np.divide(1.0, layer.range, out=disparity, where=layer.opacity)
    return disparity


def filled(opacity: npt.NDArray[np.bool_], tile: int) -> npt.NDArray[np.bool_]:
    """The tiles that have something in them."""
    height, width = opacity.shape
    return np.asarray(opacity.reshape(height // tile, tile, width // tile, tile).any(axis=(1, 3)))


def _coarse(panorama: Projection) -> Projection:
    return panorama.resized(max(8, panorama.width // _COARSE), max(8, panorama.height // _COARSE))


def _seen(
    renderer: Renderer, panorama: Projection, eyes: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Ranges of all that is seen from some eyes, and solid angles."""
    coarse = _coarse(panorama)
    weights = np.broadcast_to(coarse.solid_angles(), coarse.shape)
    ranges, masses = [], []
    for eye in eyes:
        layer = renderer.render(eye, coarse, 0.0, math.inf)
        ranges.append(layer.range[layer.opacity].astype(np.float64))
        masses.append(weights[layer.opacity])
    return np.concatenate(ranges), np.concatenate(masses)


def places_of(
    rail: Track,
    renderer: Renderer,
    panorama: Projection,
    spacing: float | None,
    places: npt.ArrayLike | None,
) -> npt.NDArray[np.float64]:
    if places is not None:
        if spacing is not None:
            raise ValueError("give spacing or places, not both")
        where = checked_floats("places", places)
        if where.ndim != 1 or not len(where) or not (where[0] >= 0 and where[-1] <= 1 and (np.diff(where) > 0).all()):
            raise ValueError(f"places must ascend within 0 to 1, got {where.tolist()}")
        return where
    if spacing is None:
        ranges, masses = _seen(renderer, panorama, rail.at([0.0, 0.5, 1.0]))
        if not len(ranges):
            raise ValueError("nothing is seen from the track: is it outside the scene?")
        order = np.argsort(ranges)
        total = np.cumsum(masses[order])
        spacing = 0.05 * float(ranges[order][np.searchsorted(total, 0.5 * total[-1])])
    return rail.spaced(spacing)


def ranges_between(
    slabs: int | Sequence[float], renderer: Renderer, panorama: Projection, eyes: npt.NDArray[np.float64]
) -> list[tuple[float, float]]:
    if isinstance(slabs, (int, np.integer)):
        if slabs == 1:
            return checked_slabs([])
        ranges, masses = _seen(renderer, panorama, eyes)
        return checked_slabs(find_slabs(ranges, slabs, masses))
    if isinstance(slabs, str) or not isinstance(slabs, (Sequence, np.ndarray)):
        raise ValueError(f"slabs must be a number of slabs or the ranges between them, got {slabs!r}")
    return checked_slabs(slabs)


def reach_of(rail: Track, where: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """How far from each reference an eye is that uses it."""
    eyes = rail.at(where)
    bounds = [0.0, *where, 1.0]
    return np.array(
        [
            np.linalg.norm(rail.between(float(bounds[i]), float(bounds[i + 2])) - eye, axis=1).max()
            for i, eye in enumerate(eyes)
        ]
    )
