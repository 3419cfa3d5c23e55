"""Id-buffers, and the rows of bits that say which faces a view sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from .bitfield import Bitfields
from .camera import Camera, stack
from .progress import Progress, reporter

if TYPE_CHECKING:
    from .scene import Scene

__all__ = ["BACKGROUND", "View", "render", "visible"]

BACKGROUND = np.uint32(0xFFFFFFFF)
"""Id stored where a pixel's ray leaves the scene."""

Engine = Literal["auto", "raster", "raycast"]
Fill = Literal["rays", "neighbours"] | None


@dataclass(frozen=True)
class View:
    """What one camera sees.

    Attributes
    ----------
    ids : (H, W) ndarray of uint32
        The nearest face at each pixel centre, `BACKGROUND` where there is none.
    depth : (H, W) ndarray of float32
        Its distance along the optical axis, infinity where there is none.
    """

    ids: npt.NDArray[np.uint32]
    depth: npt.NDArray[np.float32]
    camera: Camera
    _scene: Scene = field(repr=False)


def render(
    scene: Scene,
    camera: Camera,
    faces: npt.ArrayLike | None = None,
    engine: Engine = "auto",
    *,
    out: View | None = None,
    threads: int | None = None,
) -> View:
    """Draw one view; see `Scene.render`."""
    shape = (camera.height, camera.width)
    if out is None:
        ids, depth = np.empty(shape, np.uint32), np.empty(shape, np.float32)
    else:
        ids, depth = out.ids, out.depth
    only = None if faces is None else _face_ids(faces)
    scene._mesh.render(stack([camera]), ids, depth, only, engine, threads)
    return View(ids, depth, camera, scene)


def visible(
    scene: Scene,
    cameras: Camera | Sequence[Camera],
    fill: Fill = "rays",
    *,
    rings: int = 1,
    engine: Engine = "auto",
    known: Bitfields | npt.NDArray[np.uint64] | None = None,
    out: npt.NDArray[np.uint64] | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> Bitfields:
    """The faces that each of S cameras sees, as rows of bits.

    Parameters
    ----------
    scene : Scene
        F faces. Transparent ones hide nothing and are set in every row (2001 paper, section 3.4).
    cameras : Camera or sequence of S Camera
        Of any sizes and kinds.
    """
    views = [cameras] if isinstance(cameras, Camera) else list(cameras)
    words = (len(scene) + 63) // 64
    rows = np.zeros((len(views), words), np.uint64) if out is None else out
    if known is not None:
        rows |= known.words if isinstance(known, Bitfields) else known
    if views:
        with reporter(progress, len(views), "views") as report:
            scene._mesh.visible(stack(views), rows, fill, engine, threads, report)
    return Bitfields(rows, len(scene))


def _face_ids(faces: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    array = np.asarray(faces)
    if array.ndim != 1 or (len(array) and array.dtype.kind not in "iu"):
        raise ValueError(f"faces must be (K,) integers, got {array.shape} {array.dtype}")
    if len(array) and array.min() < 0:
        index = int(array.argmin())
        raise ValueError(f"faces[{index}] is {array[index]}")
    return np.ascontiguousarray(array, dtype=np.uint32)
