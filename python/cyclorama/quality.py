"""How good a warped picture is: against pictures of the scene itself, drawn where the eye really is.

The truth has to be the same from everywhere. So surfaces are painted with a *solid texture*, a colour for each point of
space (`paint`), without light: a pixel of the truth is the colour of the point that it shows.

A hole in a warped picture is one of two things. Where the surface behind it was hidden from all references, nothing
could have been there: a *disocclusion*. Where a reference saw that surface, something should be: a *crack*. `seen`
tells them apart by drawing the references finely and asking what is before each point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .arguments import as_numpy
from .camera import Camera
from .depth_image import DepthImage

if TYPE_CHECKING:
    from .scene import Scene
    from .warp import Warped

__all__ = ["Quality", "compare", "paint", "psnr", "seen", "ssim", "textured"]

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

# Waves of the texture, and by how many octaves the longest is longer than the shortest.
_WAVES, _OCTAVES = 24, 3.0
# Standard deviation of each channel, in grey levels: three of them stay within 0 to 255.
_CONTRAST = 42.0

# Pixels along each side of a window of `ssim`.
_WINDOW = 7


def paint(points: npt.ArrayLike, grain: float, *, seed: int = 0) -> Bytes:
    """The colours of a solid texture: a sum of waves in all directions.

    Parameters
    ----------
    points : (..., 3) array_like of float
        World positions.
    grain : float
        Length of the shortest wave, in the user's units; the longest is 8 times as long, and none is stronger.
    seed : int
        Another texture for each.

    Returns
    -------
    (..., 3) ndarray of uint8
        Black where a position isn't finite.

    Raises
    ------
    ValueError
        If `grain` isn't positive or the last axis is not 3.

    Examples
    --------
    >>> paint([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [np.nan, 0.0, 0.0]], grain=1.0).shape
    (3, 3)
    """
    if not (math.isfinite(grain) and grain > 0):
        raise ValueError(f"grain must be positive and finite, got {grain}")
    world = np.asarray(points, dtype=np.float64)
    if world.ndim == 0 or world.shape[-1] != 3:
        raise ValueError(f"points must have shape (..., 3), got {world.shape}")
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((_WAVES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = grain * 2 ** rng.uniform(0, _OCTAVES, _WAVES)
    phases = rng.uniform(0, 2 * np.pi, _WAVES)
    strengths = rng.standard_normal((_WAVES, 3))
    strengths *= _CONTRAST / np.sqrt((strengths**2).sum(axis=0) / 2)
    flat = world.reshape(-1, 3)
    colors = np.zeros((len(flat), 3), np.uint8)
    known = np.flatnonzero(np.isfinite(flat).all(axis=1))
    frequencies = (directions * (2 * np.pi / lengths)[:, None]).T
    for part in np.array_split(known, max(1, len(known) // 65536)):
        turns = flat[part] @ frequencies + phases
        turns -= 2 * np.pi * np.rint(turns / (2 * np.pi))
        # Sines of float32 are vectorised, and a millionth of a grey level off.
        levels = 127.5 + np.sin(turns.astype(np.float32)) @ strengths.astype(np.float32)
        colors[part] = np.clip(np.rint(levels), 0, 255)
    return colors.reshape(world.shape)


def textured(scene: Scene, camera: Camera, seed: int = 0, *, grain: float | None = None) -> DepthImage:
    """A picture of a scene with depth, painted with a solid texture: what a warp is measured by, and against.

    Parameters
    ----------
    scene : Scene
    camera : Camera
        A pinhole camera.
    seed : int
        Another texture for each.
    grain : float, optional
        Length of the shortest wave, in the user's units; a hundredth of the scene's radius by default. Waves below two
        pixels can't be told from longer ones, in the truth as in a warp.

    Returns
    -------
    DepthImage
        With ids; pixels that see nothing are missing, and black.

    Raises
    ------
    ValueError
        If the camera is orthographic or `grain` isn't positive.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(600)
    >>> image = textured(scene, Camera.look_at((0, 0, 3), (0, 0, 0), width=32, height=32))
    >>> bool(image.color.std() > 30), image.color[0, 0]
    (True, array([0, 0, 0], dtype=uint8))
    """
    view = scene.render(camera)
    bare = DepthImage(np.zeros((*view.depth.shape, 3), np.uint8), view.depth, camera, ids=view.ids)
    color = paint(bare.points(), scene.radius / 100 if grain is None else grain, seed=seed)
    return DepthImage.from_view(view, color=color)


def seen(
    scene: Scene,
    image: DepthImage,
    references: Camera | Sequence[Camera],
    *,
    tolerance: float = 1e-3,
    supersampling: int = 4,
) -> Mask:
    """Which pixels of a picture show a surface that some reference camera saw.

    Parameters
    ----------
    scene : Scene
        What `image` shows.
    image : DepthImage
        The picture of the scene from the new eye, with ids.
    references : Camera or sequence of Camera
        Where the references were taken.
    tolerance : float
        A point is seen where nothing is nearer than it by more than this share of its depth.
    supersampling : int
        The references are drawn with so many samples along each side of a pixel. What is nearer is asked at the sample
        next to where the point lies, and for the plane of the point's face there.

    Returns
    -------
    (H, W) ndarray of bool
        False also where `image` is missing, and where a point is outside of all references.

    Raises
    ------
    ValueError
        If `image` has no ids.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(600)
    >>> front, back = (Camera.look_at((0, 0, z), (0, 0, 0), width=32, height=32) for z in (3, -3))
    >>> image = textured(scene, front)
    >>> bool(seen(scene, image, front)[~image.missing].all()), bool(seen(scene, image, back).any())
    (True, False)
    """
    if image.ids is None:
        raise ValueError("image has no ids: they say which plane each point lies in")
    known = np.flatnonzero(~image.missing)
    points = image.points().reshape(-1, 3)[known]
    corners = scene.vertices.astype(np.float64)[scene.faces[image.ids.ravel()[known]]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    found = np.zeros(len(known), np.bool_)
    for camera in [references] if isinstance(references, Camera) else references:
        pixels, depth = camera.project(points)
        size = np.array((camera.width, camera.height))
        with np.errstate(invalid="ignore"):
            inside = (depth > camera.near) & ((pixels >= 0) & (pixels < size)).all(axis=1)
        fine = camera.with_size(camera.width * supersampling, camera.height * supersampling)
        nearest = scene.render(fine).depth
        at = np.floor(pixels[inside] * supersampling).astype(np.int64)
        at = np.minimum(at, size * supersampling - 1)
        before = nearest[at[:, 1], at[:, 0]]
        there = _depth_of_plane(camera, (at + 0.5) / supersampling, points[inside], normals[inside], depth[inside])
        found[inside] |= before >= there * (1 - tolerance)
    answer = np.zeros(image.missing.size, np.bool_)
    answer[known] = found
    return answer.reshape(image.shape)


def psnr(picture: npt.ArrayLike, truth: npt.ArrayLike, *, where: npt.ArrayLike | None = None) -> float:
    """Peak signal-to-noise ratio.

    Parameters
    ----------
    picture, truth : (H, W) or (H, W, C) array_like of uint8
    where : (H, W) array_like of bool, optional
        The pixels that count; all by default.

    Returns
    -------
    float
        ``10 log10(255^2 / mean squared difference)`` in decibels over all channels; infinity where nothing differs, NaN
        where no pixel counts.

    Raises
    ------
    ValueError
        If the pictures are not uint8 or a shape doesn't fit.

    Examples
    --------
    >>> round(psnr(np.full((2, 2, 3), 100, np.uint8), np.full((2, 2, 3), 110, np.uint8)), 2)
    28.13
    """
    a, b, counts = _pair(picture, truth, where)
    if not counts.any():
        return math.nan
    error = float(np.mean(np.square(a[counts] - b[counts])))
    return 10 * math.log10(255**2 / error) if error else math.inf


def ssim(picture: npt.ArrayLike, truth: npt.ArrayLike, *, where: npt.ArrayLike | None = None) -> float:
    """Structural similarity (Wang, Bovik, Sheikh and Simoncelli, 2004) with windows of 7 x 7 pixels.

    Parameters
    ----------
    picture, truth : (H, W) or (H, W, C) array_like of uint8
        At least 7 pixels a side.
    where : (H, W) array_like of bool, optional
        The windows that count, by their middles; all by default. What else lies in them is looked at all the same.

    Returns
    -------
    float
        Mean over windows that lie wholly in the image and over channels, 1 where nothing differs; NaN where no window
        counts. The same as ``skimage.metrics.structural_similarity(..., channel_axis=-1)``.

    Raises
    ------
    ValueError
        If the pictures are not uint8, are smaller than a window, or a shape doesn't fit.

    Examples
    --------
    >>> round(ssim(np.full((8, 8), 100, np.uint8), np.full((8, 8), 110, np.uint8)), 4)
    0.9955
    """
    a, b, counts = _pair(picture, truth, where)
    if min(a.shape[:2]) < _WINDOW:
        raise ValueError(f"picture must have at least {_WINDOW} pixels a side, got {a.shape[:2]}")
    half = _WINDOW // 2
    counts = counts[half:-half, half:-half]
    if not counts.any():
        return math.nan
    mean_a, mean_b = _windows(a), _windows(b)
    # Of n samples of which the mean is known: divided by n - 1.
    unbiased = _WINDOW**2 / (_WINDOW**2 - 1)
    spread_a = unbiased * (_windows(a * a) - mean_a**2)
    spread_b = unbiased * (_windows(b * b) - mean_b**2)
    common = unbiased * (_windows(a * b) - mean_a * mean_b)
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    like = (2 * mean_a * mean_b + c1) * (2 * common + c2)
    unlike = (mean_a**2 + mean_b**2 + c1) * (spread_a + spread_b + c2)
    return float((like / unlike)[counts].mean())


@dataclass(frozen=True)
class Quality:
    """How good a warped picture is.

    Attributes
    ----------
    psnr, ssim : float
        Over the pixels whose surface a reference saw; holes count as they are coloured, black by default. Decibels,
        and at most 1.
    known_psnr : float
        Over those of them that are no holes.
    cracks : float
        Share of the pixels whose surface a reference saw that are holes.
    disoccluded : float
        Share of the pixels that show a surface which no reference saw: those are rightly holes.
    guessed : float
        Share of the disoccluded pixels that are covered all the same.
    """

    psnr: float
    ssim: float
    known_psnr: float
    cracks: float
    disoccluded: float
    guessed: float


def compare(warped: Warped, truth: DepthImage, known: npt.ArrayLike) -> Quality:
    """Measures a warped picture against one of the scene itself.

    Parameters
    ----------
    warped : Warped
        What `cyclorama.warp.forward` made, of H x W pixels.
    truth : DepthImage
        The scene from the same camera: see `textured`.
    known : (H, W) array_like of bool
        The pixels whose surface a reference saw: see `seen`.

    Raises
    ------
    ValueError
        If a shape doesn't fit.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(600)
    >>> here, there = (cyc.Camera.look_at((x, 0, 3), (0, 0, 0), width=64, height=64) for x in (0, 0.1))
    >>> truth = textured(scene, there)
    >>> warped = cyc.warp.forward(textured(scene, here), there, splat="mesh")
    >>> compare(warped, truth, seen(scene, truth, here)).cracks
    0.0
    """
    mask = np.asarray(as_numpy(known))
    if mask.shape != truth.shape or mask.dtype != np.bool_:
        raise ValueError(f"known must be {truth.shape} bool, as the truth has, got {mask.shape} {mask.dtype}")
    hidden = ~mask & ~truth.missing
    colors = truth.color[..., :3]
    return Quality(
        psnr(warped.color, colors, where=mask),
        ssim(warped.color, colors, where=mask) if min(truth.shape) >= _WINDOW else math.nan,
        psnr(warped.color, colors, where=mask & ~warped.hole),
        _share(warped.hole, mask),
        _share(hidden, ~truth.missing),
        _share(~warped.hole, hidden),
    )


def _share(of: Mask, among: Mask) -> float:
    count = np.count_nonzero(among)
    return int(np.count_nonzero(of & among)) / int(count) if count else 0.0


def _pair(picture: npt.ArrayLike, truth: npt.ArrayLike, where: npt.ArrayLike | None) -> tuple[Floats, Floats, Mask]:
    """Both as (H, W, C) float64, and the pixels that count."""
    a, b = np.asarray(as_numpy(picture)), np.asarray(as_numpy(truth))
    if a.dtype != np.uint8 or b.dtype != np.uint8:
        raise ValueError(f"picture and truth must be uint8, got {a.dtype} and {b.dtype}")
    if a.shape != b.shape or a.ndim not in (2, 3):
        raise ValueError(f"picture and truth must have one shape, (H, W) or (H, W, C), got {a.shape} and {b.shape}")
    counts = np.ones(a.shape[:2], np.bool_) if where is None else np.asarray(as_numpy(where))
    if counts.shape != a.shape[:2] or counts.dtype != np.bool_:
        raise ValueError(f"where must be {a.shape[:2]} bool, as the pictures have, got {counts.shape} {counts.dtype}")
    shape = (*a.shape[:2], -1)
    return a.reshape(shape).astype(np.float64), b.reshape(shape).astype(np.float64), counts


def _windows(values: Floats) -> Floats:
    """Means over all windows that lie wholly in an image."""
    sums = np.zeros((values.shape[0] + 1, values.shape[1] + 1, values.shape[2]))
    np.cumsum(np.cumsum(values, axis=0), axis=1, out=sums[1:, 1:])
    n = _WINDOW
    return np.asarray((sums[n:, n:] - sums[:-n, n:] - sums[n:, :-n] + sums[:-n, :-n]) / n**2)


def _depth_of_plane(camera: Camera, pixels: Floats, points: Floats, normals: Floats, depth: Floats) -> Floats:
    """Depth at which the rays through some pixels meet the planes through some points near there; no more than twice
    as near or far as the points themselves, which planes seen edge-on would be."""
    rays = camera.unproject(pixels, np.ones(len(pixels))) - camera.eye
    with np.errstate(divide="ignore", invalid="ignore"):
        there = ((points - camera.eye) * normals).sum(axis=1) / (rays * normals).sum(axis=1)
    return np.where(np.isfinite(there), np.clip(there, depth / 2, depth * 2), depth)
