"""All surfaces that the rays of a view meet, not only the nearest ones: depth peeling (Everitt 2001)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .arguments import check_threads, checked_number, checked_whole
from .camera import Camera, stack
from .render import BACKGROUND, View, face_ids

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["Hits", "hits"]


@dataclass(frozen=True, eq=False)
class Hits:
    """What the ray through each pixel centre meets, nearest first.

    Attributes
    ----------
    camera : Camera
    offsets : (H W + 1,) ndarray of uint32
        Pixel p, row by row, has the hits ``offsets[p]`` to ``offsets[p + 1]``.
    faces : (N,) ndarray of uint32
    depths : (N,) ndarray of float32
        Along the optical axis, in the user's units.
    """

    camera: Camera
    offsets: npt.NDArray[np.uint32]
    faces: npt.NDArray[np.uint32]
    depths: npt.NDArray[np.float32]
    _scene: Scene = field(repr=False)

    @cached_property
    def pixels(self) -> npt.NDArray[np.int64]:
        """(N,) the pixel of each."""
        counts = self.offsets[1:].astype(np.int64) - self.offsets[:-1]
        return np.repeat(np.arange(len(counts)), counts)

    def layers(self) -> Iterator[tuple[npt.NDArray[np.int64], View]]:
        """The nearest hits of all pixels as a view, then the second ones, and so on; with each, which hits they are."""
        shape = (self.camera.height, self.camera.width)
        starts = self.offsets[:-1].astype(np.int64)
        counts = self.offsets[1:] - starts
        for index in range(int(counts.max(initial=0))):
            there = counts > index
            own = starts[there] + index
            ids, depth = np.full(shape, BACKGROUND, np.uint32), np.full(shape, np.inf, np.float32)
            ids.reshape(-1)[there] = self.faces[own]
            depth.reshape(-1)[there] = self.depths[own]
            yield own, View(ids, depth, self.camera, self._scene)


def hits(
    scene: Scene,
    camera: Camera,
    faces: npt.ArrayLike | None = None,
    *,
    most: int | None = None,
    near: float = 0.0,
    threads: int | None = None,
) -> Hits:
    """Cast a ray through each pixel centre.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    faces : (K,) array_like of int, optional
        Meet only these. By default all but the transparent ones.
    most : int, optional
        At most so many hits a ray, the nearest ones. All by default.
    near : float
        A hit that is farther than the one before by at most this share of its depth is left out: with 0 all but one of
        those that are equally deep.
    threads : int, optional
        All cores by default.

    Raises
    ------
    ValueError
        If an entry of `faces` is not a face, or another argument is none of the above.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> sheets = cyc.scenes.layers(20, layers=5)
    >>> found = hits(sheets, cyc.Camera.look_at((0, 0, 9), (0, 0, 0), width=16, height=12))
    >>> len(list(found.layers()))
    5
    """
    if not isinstance(camera, Camera):
        raise ValueError(f"camera must be a Camera, got {type(camera).__name__}")
    limit = 2**32 - 1 if most is None else checked_whole("most", most, 1)
    near = checked_number("near", near)
    check_threads(threads)
    only = None if faces is None else face_ids(faces, len(scene))
    return Hits(camera, *scene._mesh.hits(stack(camera), only, limit, near, threads), scene)
