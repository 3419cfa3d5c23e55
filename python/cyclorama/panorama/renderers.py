"""Who draws the panoramas: a protocol of one call, and the renderers that are here.

A renderer is any object with a method ``render(eye, projection, near, far) -> Layer``: of what lies between two ranges
of the eye, it shows what is nearest in each pixel. ("Almost all renderers can be configured to pre-compute the image
layers", 2003 paper, section 6.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from .projection import Projection

if TYPE_CHECKING:
    from ..scene import Scene

__all__ = ["BuiltIn", "Layer", "Renderer", "checked_layer"]


@dataclass(frozen=True)
class Layer:
    """What a panorama shows between two ranges.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
    opacity : (H, W) ndarray of bool
        Whether there is anything.
    range : (H, W) ndarray of float32
        Distance from the eye, infinity where nothing is.
    """

    color: npt.NDArray[np.uint8]
    opacity: npt.NDArray[np.bool_]
    range: npt.NDArray[np.float32]


@runtime_checkable
class Renderer(Protocol):
    """Draws layers of panoramas."""

    def render(self, eye: npt.NDArray[np.float64], projection: Projection, near: float, far: float) -> Layer:
        """What is nearest in each pixel of what has a range of at least `near` and below `far`."""
        ...


class BuiltIn:
    """Rays through a `Scene`: diffuse, in the colours of vertices or faces, lit by a lamp that stays where it is.

    Parameters
    ----------
    scene : Scene
    texture : callable, optional
        Takes (N, 3) world positions and gives (N, 3) uint8 colours: `cyclorama.quality.paint`, say. They are shown as
        they are, without light.
    threads : int, optional
        All cores by default.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> layer = BuiltIn(cyc.scenes.sphere(600)).render((0, 0, 3), Projection(size=(64, 32)), 0.0, 2.5)
    >>> layer.range[16, 32].round(1), float(layer.opacity.mean())
    (np.float32(2.0), 0.015625)
    """

    def __init__(
        self,
        scene: Scene,
        *,
        texture: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.uint8]] | None = None,
        threads: int | None = None,
    ) -> None:
        self.scene, self.texture, self.threads = scene, texture, threads

    def render(self, eye: npt.ArrayLike, projection: Projection, near: float, far: float) -> Layer:
        """See `Renderer`."""
        shape = projection.shape
        color = np.empty((*shape, 3), np.uint8)
        ranges, ids = np.empty(shape, np.float32), np.empty(shape, np.uint32)
        x, y, z = (float(v) for v in np.asarray(eye, dtype=np.float64))
        projection.kernel.render(
            self.scene._mesh, (x, y, z), near, far, color, ranges, ids, self.scene.colors, self.threads
        )
        opacity = np.isfinite(ranges)
        if self.texture is not None:
            points = projection.directions()[opacity] * ranges[opacity, None] + (x, y, z)
            color[opacity] = self.texture(points)
        return Layer(color, opacity, ranges)


def checked_layer(layer: Layer, projection: Projection, near: float, far: float) -> Layer:
    """A layer that is what it says.

    Raises
    ------
    ValueError
        If a shape or type doesn't fit, or a range is outside the slab by more than a tenth.
    """
    shape = projection.shape
    for name, array, wanted, dtype in (
        ("color", layer.color, (*shape, 3), np.uint8),
        ("opacity", layer.opacity, shape, np.bool_),
        ("range", layer.range, shape, np.float32),
    ):
        if array.shape != wanted or array.dtype != dtype:
            raise ValueError(
                f"the renderer's {name} must be {wanted} {np.dtype(dtype).name}, got {array.shape} {array.dtype}"
            )
    seen = layer.range[layer.opacity]
    # Some renderers' slabs end at planes.
    bad = seen[~((seen >= near * 0.9) & (seen <= far * 1.1) & (seen > 0) & np.isfinite(seen))]
    if len(bad):
        raise ValueError(f"the renderer gave a range of {bad[0]:.6g} where {near:.6g} to {far:.6g} was asked for")
    return layer
