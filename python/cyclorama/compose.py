"""Pictures with depth laid over one another (1998 dissertation, sections 1.4.1 and 4.4.3).

Geometry, backdrops and the images of portals make one picture: depth decides, pixel by pixel, and where two are equally
deep what was there first stays. A pixel of which a layer knows nothing is a *hole* only where something unknown may be
nearer than what is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import _core
from .camera import Camera
from .render import BACKGROUND

__all__ = ["Canvas", "entered"]

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture that layers are laid over; it shares the memory of its arrays.

    Attributes
    ----------
    color : (H, W, 3) ndarray of uint8
    depth : (H, W) ndarray of float32
        Along the camera's axis; infinity where nothing is.
    ids : (H, W) ndarray of uint32
        The face of each pixel, `BACKGROUND` where none is.
    layer : (H, W) ndarray of int32
        What each pixel shows: the label of the layer that was laid last of those shown there.
    hole : (H, W) ndarray of bool, optional
        Where it is not known what is seen.
    """

    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    ids: npt.NDArray[np.uint32]
    layer: npt.NDArray[np.int32]
    hole: Mask | None = None

    @classmethod
    def empty(cls, height: int, width: int, layer: int = 0) -> Canvas:
        """Nothing: white, infinitely far, without holes.

        Parameters
        ----------
        height, width : int
        layer : int
            What its pixels are said to show.

        Examples
        --------
        >>> Canvas.empty(2, 3).depth.min()
        np.float32(inf)
        """
        shape = (height, width)
        return cls(
            np.full((*shape, 3), 255, np.uint8),
            np.full(shape, np.inf, np.float32),
            np.full(shape, BACKGROUND, np.uint32),
            np.full(shape, layer, np.int32),
            np.zeros(shape, np.bool_),
        )

    def lay(
        self,
        depth: npt.NDArray[np.float32],
        label: int,
        *,
        color: npt.NDArray[np.uint8] | None = None,
        ids: npt.NDArray[np.uint32] | None = None,
        hole: Mask | None = None,
        before: npt.NDArray[np.float32] | None = None,
        within: Mask | None = None,
        at: tuple[int, int] = (0, 0),
        scale: float = 1.0,
        names: npt.NDArray[np.uint32] | None = None,
        twice: Mask | None = None,
    ) -> int:
        """Lays a layer over a rectangle of the picture: it is shown where it is nearer than what is there.

        Parameters
        ----------
        depth : (h, w) ndarray of float32
            Of the layer; infinity where it has nothing.
        label : int
            What `layer` says of the pixels that show it.
        color : (h, w, 3) ndarray of uint8, optional
            Pixels keep their colours without.
        ids : (h, w) ndarray of uint32, optional
            Its faces; `BACKGROUND` everywhere without.
        hole : (h, w) ndarray of bool, optional
            Pixels of which the layer knows nothing. A pixel that shows the layer is a hole if the layer's is.
        before : (h, w) ndarray of float32, optional
            Depths to compare instead of the layer's own: those of a window through which it is seen.
        within : (h, w) ndarray of bool, optional
            Where rays come into the space that the layer stands for before they come to what is there (`entered`): it
            is not shown elsewhere. Those of its holes are holes of the picture, though it is not shown there.
        at : (int, int)
            The picture's row and column of the layer's first pixel.
        scale : float
            What the layer's depths are multiplied by.
        names : (F,) ndarray of uint32, optional
            What the picture calls the layer's faces.
        twice : (F,) ndarray of bool, optional
            The picture's faces that are in the layer, too. Both have been rounded to different pixels: such a face is
            hidden only by what is nearer by half a percent.

        Returns
        -------
        int
            Pixels that show it.

        Raises
        ------
        ValueError
            If an array is not of the layer's size, the layer not inside of the picture, or a face has no name.

        Examples
        --------
        >>> canvas = Canvas.empty(1, 2)
        >>> canvas.lay(np.array([[1.0, np.inf]], np.float32), 7)
        1
        >>> canvas.layer
        array([[7, 0]], dtype=int32)
        """
        arrays = (self.color, self.depth, self.ids, self.hole, self.layer)
        layer = (depth, before, color, ids, hole, within)
        return _core.compose(arrays, layer, at, int(label), float(scale), names, twice)


def entered(
    space: npt.NDArray[np.float64],
    camera: Camera,
    depth: npt.NDArray[np.float32],
    near: float = 0.0,
    out: Mask | None = None,
) -> Mask:
    """Where the rays of a camera's pixels come into a convex space, beyond a depth and before what is seen.

    Parameters
    ----------
    space : (P, 4) ndarray of float64
        Half-spaces ``n . x + d >= 0`` whose common part it is.
    camera : Camera
        A pinhole camera, W x H pixels.
    depth : (H, W) ndarray of float32
        Of what is seen, along the camera's axis.
    near : float
        Nothing of the space counts before this depth.
    out : (H, W) ndarray of bool, optional
        Memory for the answer.

    Returns
    -------
    (H, W) ndarray of bool

    Raises
    ------
    ValueError
        If an array has another shape.

    Examples
    --------
    >>> camera = Camera.look_at((0, 0, 2), (0, 0, 0), width=4, height=1)
    >>> right = np.array([[1.0, 0.0, 0.0, -0.1]])
    >>> entered(right, camera, np.full((1, 4), 5, np.float32))
    array([[False, False,  True,  True]])
    """
    # Along a ray, depth t is at eye + t ray, and the ray is linear in the pixel's coordinates.
    back = camera.camera_to_world[:3, :3] @ np.linalg.inv(camera.K)
    sides = np.column_stack([space[:, :3] @ back, space[:, :3] @ camera.eye + space[:, 3]])
    found = np.empty(depth.shape, np.bool_) if out is None else out
    _core.rays_enter(np.ascontiguousarray(sides), float(near), depth, found)
    return found
