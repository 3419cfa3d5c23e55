"""What an eye on the track sees, from the references beside it."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..arguments import check_threads
from ..camera import Camera, stack
from .projection import Projection
from .store import Reference, Store

__all__ = ["Seen", "resample", "view"]

Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Seen:
    """A view of a walkthrough.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
        The store's background where nothing is, and in holes.
    hole : (H, W) ndarray of bool
        Where neither reference knows what is there. Where one of them sees past everything, nothing is there, and
        that is known.
    depth : (H, W) ndarray of float32
        Along the camera's axis, infinity where nothing is drawn. At a reference viewpoint itself it isn't known: NaN.
    exact : bool
        Whether the eye is at a reference viewpoint: then the view is a plain resampling of its panorama.
    """

    color: Pixels
    hole: npt.NDArray[np.bool_]
    depth: npt.NDArray[np.float32]
    exact: bool

    def __repr__(self) -> str:
        height, width = self.hole.shape
        return f"<Seen: {width} x {height}, {self.hole.mean():.1%} hole{', exact' if self.exact else ''}>"


def view(store: Store | str | os.PathLike[str], t: float, camera: Camera, *, threads: int | None = None) -> Seen:
    """What is seen from a place of the track.

    The slabs of the references before and after it are seen as quads from the eye, front to back, and the two pictures
    are mixed with weights that grow as the square of nearness. At a reference viewpoint its panorama alone counts.

    Parameters
    ----------
    store : Store, path or address
    t : float
        Where on the track: 0 to 1.
    camera : Camera
        A pinhole camera, of which rotation, `K` and size count; its eye is `store.track.at(t)`.
    threads : int, optional
        All cores by default. The answer doesn't depend on it.

    Returns
    -------
    Seen

    Raises
    ------
    ValueError
        If `t` is outside [0, 1], the camera is orthographic, or a file is missing, cut off or damaged.

    Examples
    --------
    >>> import tempfile, cyclorama as cyc
    >>> house = cyc.scenes.house(rooms=2)
    >>> eye = (house.cells[0]["min"] + house.cells[0]["max"]) / 2
    >>> camera = cyc.Camera.look_at(eye, eye + [1, 0, 0], width=64, height=48)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     track = [eye, eye + [0.2, 0, 0]]
    ...     store = cyc.panorama.bake(house, track, 2, (256, 64), spacing=0.2, out=folder, progress=False)
    ...     there, between = view(store, 0.0, camera), view(store, 0.5, camera)
    >>> there.exact, between.exact, float(between.hole.mean()) < 0.01
    (True, False, True)
    """
    walk = store if isinstance(store, Store) else Store(store)
    if not isinstance(camera, Camera):
        raise ValueError(f"camera must be a Camera, got {type(camera).__name__}")
    if camera.orthographic:
        raise ValueError("a view needs a pinhole camera, got an orthographic one")
    check_threads(threads)
    first, second, between = walk.beside(t)
    walk.expect(t)
    here = moved(camera, walk.track.at(t))
    if t == walk.references[first].t:
        color, known = resample(walk.panorama(first), walk.projection, here)
        color[~known] = walk.background
        nothing = np.full(known.shape, np.nan, np.float32)
        return Seen(color, _beyond(walk.projection, here), nothing, exact=True)
    references = [walk.reference(index) for index in dict.fromkeys((first, second))]
    return seen_between(references, between, walk.projection, here, walk.background, threads)


def seen_between(
    references: list[Reference],
    between: float,
    projection: Projection,
    camera: Camera,
    background: tuple[int, ...],
    threads: int | None = None,
) -> Seen:
    """`view` of references in memory, for a camera that is where its eye is."""
    shape = (camera.height, camera.width)
    color, disparity = np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32)
    arrays = [
        (
            (float(reference.eye[0]), float(reference.eye[1]), float(reference.eye[2])),
            [(slab.pixels, slab.quads, slab.disparity, slab.error) for slab in reference.slabs],
        )
        for reference in references
    ]
    projection.kernel.view(arrays, between, stack([camera]), color, disparity, threads)
    drawn = disparity > 0
    hole = ~drawn
    rays = _rays(camera)
    for reference in references:
        x, y = _pixels(projection, rays[hole])
        inside = (y >= 0) & (y < projection.height)
        open_sky = inside.copy()
        for slab in reference.slabs:
            open_sky[inside] &= slab.pixels[y[inside], x[inside], 3] == 0
        hole[hole] = ~open_sky
    color[~drawn] = background
    depth = np.full(shape, np.inf, np.float32)
    np.divide(1.0, disparity, out=depth, where=drawn)
    return Seen(color, hole, depth, exact=False)


def moved(camera: Camera, eye: npt.NDArray[np.float64]) -> Camera:
    """The same camera at another eye."""
    pose = camera.world_to_camera.copy()
    pose[:3, 3] = -pose[:3, :3] @ eye
    return Camera(camera.K, pose, camera.width, camera.height, near=camera.near)


def _rays(camera: Camera) -> npt.NDArray[np.float64]:
    """(H, W, 3) directions of a camera's pixel centres, in the world's coordinates."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.K).T
    return np.asarray(rays @ camera.world_to_camera[:3, :3])


def _pixels(
    projection: Projection, rays: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Columns and rows that directions fall in; rows may be beyond the panorama."""
    at = np.floor(projection.places(rays)).astype(np.int64)
    return at[:, 0] % projection.width, at[:, 1]


def _beyond(projection: Projection, camera: Camera) -> npt.NDArray[np.bool_]:
    """The pixels of a camera that look above or below a panorama."""
    rays = _rays(camera)
    y = projection.places(rays.reshape(-1, 3))[:, 1].reshape(rays.shape[:2])
    return np.asarray((y < 0) | (y > projection.height))


def resample(
    panorama: Pixels, projection: Projection, camera: Camera
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.bool_]]:
    """A camera's picture of a panorama from its own viewpoint, bilinear among opaque pixels.

    Parameters
    ----------
    panorama : (H, W, 4) ndarray of uint8
    projection : Projection
    camera : Camera
        Where it is doesn't count.

    Returns
    -------
    (H', W', 3) ndarray of uint8, (H', W') ndarray of bool
        Colours, and where opaque pixels outweigh transparent ones.
    """
    rays = _rays(camera)
    at = projection.places(rays.reshape(-1, 3)) - 0.5
    corner = np.floor(at).astype(np.int64)
    share = (at - corner).astype(np.float32)
    total = np.zeros((len(at), 3), np.float32)
    opaque = np.zeros(len(at), np.float32)
    for right in (0, 1):
        for down in (0, 1):
            weight = (share[:, 0] if right else 1 - share[:, 0]) * (share[:, 1] if down else 1 - share[:, 1])
            y = np.clip(corner[:, 1] + down, 0, projection.height - 1)
            found = panorama[y, (corner[:, 0] + right) % projection.width]
            weight = np.where(found[:, 3] > 0, weight, 0)
            opaque += weight
            total += weight[:, None] * found[:, :3]
    known = (opaque >= 0.5) & ((at[:, 1] >= -0.5) & (at[:, 1] <= projection.height - 0.5))
    color = np.zeros((len(at), 3), np.uint8)
    color[known] = np.rint(total[known] / opaque[known, None])
    shape = rays.shape[:2]
    return color.reshape(*shape, 3), known.reshape(shape)
