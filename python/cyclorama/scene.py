"""Scenes: triangles to look at, with colours and a mask of transparent faces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _core
from . import parts as scene_parts
from .arguments import as_numpy
from .bitfield import Bitfields
from .camera import Camera
from .depth_image import DepthImage
from .parts import Part
from .progress import Progress
from .render import Engine, Fill, View, render, visible

__all__ = ["Scene"]

# Areas are products of two lengths, and their squares are summed: beyond these float64 has no place for them.
_LEAST_SIZE, _MOST_SIZE = 1e-70, 1e70


class Scene:
    """A triangle mesh, checked once and owned by the kernels; its arrays are read-only copies.

    Parameters
    ----------
    vertices : (V, 3) array_like of float
        Positions in any unit. Float64 is kept, relative to the centre of the bounds.
    faces : (F, 3) array_like of int
        Vertex indices of each triangle; their order is kept in every answer.
    colors : (V, 3) or (F, 3) array_like of uint8, optional
        A colour for each vertex or each face (where V equals F: for each vertex).
    transparent : (F,) array_like of bool, optional
        Faces that hide nothing and are always answered as visible.
    parts : sequence of Part, optional
        Names for ranges of faces, one after the other, all of them together: the nodes of a file. One without a name by
        default. See `cyclorama.parts`.

    Raises
    ------
    ValueError
        If a vertex is not finite, a face names a vertex that is not there, the mesh is empty, no face has an area,
        the scene is smaller than 1e-70 or larger than 1e70, or colours, mask or parts do not fit. The message names the
        array, the index and the value.

    Examples
    --------
    >>> scene = Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> scene.radius
    0.707...
    """

    def __init__(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        colors: npt.ArrayLike | None = None,
        *,
        transparent: npt.ArrayLike | None = None,
        parts: Sequence[Part] | None = None,
    ) -> None:
        self.vertices = _vertices(vertices)
        self.faces = _faces(faces, len(self.vertices))
        self.colors = None if colors is None else _colors(colors, len(self.vertices), len(self.faces))
        self.transparent = None if transparent is None else _mask(transparent, len(self.faces))
        self.parts = scene_parts.check(parts, len(self.faces))
        vertices64 = np.asarray(self.vertices, dtype=np.float64, order="C")
        self._mesh = _core.Mesh(vertices64, self.faces, self.transparent)
        with np.errstate(over="ignore"):
            size = float((self.bounds[1] - self.bounds[0]).max())
        if not _LEAST_SIZE <= size <= _MOST_SIZE:
            raise ValueError(f"vertices span {size:.3g}: sizes from {_LEAST_SIZE:g} to {_MOST_SIZE:g} can be measured")

    def __reduce__(self) -> tuple[object, ...]:
        """Copies and other processes make the same scene of its arrays."""
        return _restore, (self.vertices, self.faces, self.colors, self.transparent, self.parts)

    def __len__(self) -> int:
        """Number of faces."""
        return len(self.faces)

    def __repr__(self) -> str:
        return f"<Scene: {len(self.vertices):,} vertices, {len(self.faces):,} faces>"

    @cached_property
    def bounds(self) -> npt.NDArray[np.float64]:
        """(2, 3) lowest and highest coordinates."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)]).astype(np.float64)

    @cached_property
    def center(self) -> npt.NDArray[np.float64]:
        """(3,) centre of the bounds."""
        low, high = self.bounds
        return np.asarray(low * 0.5 + high * 0.5)

    @cached_property
    def radius(self) -> float:
        """Distance of the farthest vertex from the centre."""
        return float(np.sqrt(((self.vertices - self.center) ** 2).sum(axis=1).max()))

    def render(
        self,
        camera: Camera,
        faces: npt.ArrayLike | None = None,
        engine: Engine = "auto",
        *,
        out: View | None = None,
        threads: int | None = None,
    ) -> View:
        """The nearest face and its depth at each pixel centre, and a plain shaded picture.

        Parameters
        ----------
        camera : Camera
            Perspective or orthographic.
        faces : (K,) array_like of int, optional
            Draw only these. By default all but the transparent ones.
        engine : {"auto", "raster", "raycast"}
            Both engines give the same bits; "auto" takes the one expected to be faster, by costs that are measured at
            first use, which takes some milliseconds.
        out : View, optional
            An earlier answer of the same size whose memory is reused.
        threads : int, optional
            All cores by default, each drawing some rows of the image. The answer doesn't depend on it.

        Returns
        -------
        View
            `.ids` (H, W) uint32 with `BACKGROUND` where nothing is seen, `.depth` (H, W) float32 along the optical
            axis with infinity there, `.color` (H, W, 3) uint8, shaded when first asked for.

        Raises
        ------
        ValueError
            If an entry of `faces` is not a face, or `out` has another size.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> scene = Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> camera = cyc.Camera.look_at([0.3, 0.3, 2], [0.3, 0.3, 0], width=3, height=3)
        >>> view = scene.render(camera)
        >>> int(view.ids[1, 1]), round(float(view.depth[1, 1]), 3)
        (0, 2.0)
        """
        return render(self, camera, faces, engine, out=out, threads=threads)

    def depth_image(
        self, camera: Camera, faces: npt.ArrayLike | None = None, *, threads: int | None = None
    ) -> DepthImage:
        """What `render` draws as an image with depth and ids.

        Parameters
        ----------
        camera : Camera
            A pinhole camera.
        faces, threads
            As for `render`.

        Returns
        -------
        DepthImage
            In the plain shaded colours; pixels that see nothing are missing.

        Raises
        ------
        ValueError
            If the camera is orthographic, and as for `render`.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> scene = Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> image = scene.depth_image(cyc.Camera.look_at([0.3, 0.3, 2], [0.3, 0.3, 0], width=3, height=3))
        >>> image.disparity[1]
        array([0. , 0.5, 0. ], dtype=float32)
        """
        return DepthImage.from_view(self.render(camera, faces, threads=threads))

    def visible(
        self,
        cameras: Camera | Sequence[Camera],
        fill: Fill = "rays",
        *,
        rings: int = 1,
        supersampling: int = 3,
        points: int = 24,
        engine: Engine = "auto",
        known: Bitfields | npt.NDArray[np.uint64] | None = None,
        out: npt.NDArray[np.uint64] | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> Bitfields:
        """The faces that each camera sees, without keeping the images; see `cyclorama.render.visible`.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> scene = Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> camera = cyc.Camera.look_at([0.3, 0.3, 2], [0.3, 0.3, 0])
        >>> scene.visible([camera]).ids(0)
        array([0], dtype=uint32)
        """
        return visible(
            self,
            cameras,
            fill,
            rings=rings,
            supersampling=supersampling,
            points=points,
            engine=engine,
            known=known,
            out=out,
            threads=threads,
            progress=progress,
        )


def _restore(
    vertices: npt.NDArray[np.floating],
    faces: npt.NDArray[np.uint32],
    colors: npt.NDArray[np.uint8] | None,
    transparent: npt.NDArray[np.bool_] | None,
    parts: tuple[Part, ...],
) -> Scene:
    return Scene(vertices, faces, colors, transparent=transparent, parts=parts)


def _own(array: npt.NDArray[Any], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """A copy that never changes, whatever happens to the caller's array."""
    copy = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


def _vertices(vertices: npt.ArrayLike) -> npt.NDArray[np.floating]:
    array = np.asarray(as_numpy(vertices))
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"vertices must have shape (V, 3), got {array.shape}")
    if array.dtype.kind == "c":
        raise ValueError(f"vertices must be real numbers, got dtype {array.dtype}")
    if array.dtype not in (np.float32, np.float64):
        try:
            array = array.astype(np.float64)
        except (TypeError, ValueError) as error:
            raise ValueError(f"vertices must be numbers, got dtype {array.dtype}") from error
    return _own(array, array.dtype)


def _faces(faces: npt.ArrayLike, vertex_count: int) -> npt.NDArray[np.uint32]:
    array = np.asarray(as_numpy(faces))
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"faces must have shape (F, 3), got {array.shape}")
    if len(array) == 0:
        return np.empty((0, 3), dtype=np.uint32)
    if array.dtype.kind not in "iu":
        raise ValueError(f"faces must be integers, got dtype {array.dtype}")
    if array.min() < 0 or array.max() >= vertex_count:
        face = int(np.flatnonzero(((array < 0) | (array >= vertex_count)).any(axis=1))[0])
        raise ValueError(f"faces[{face}] is {array[face].tolist()}, but the mesh has {vertex_count} vertices")
    return _own(array, np.uint32)


def _colors(colors: npt.ArrayLike, vertex_count: int, face_count: int) -> npt.NDArray[np.uint8]:
    array = np.asarray(as_numpy(colors))
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype != np.uint8:
        raise ValueError(f"colors must be (V, 3) or (F, 3) uint8, got {array.shape} {array.dtype}")
    if len(array) not in (vertex_count, face_count):
        raise ValueError(f"colors has {len(array)} rows, the scene {vertex_count} vertices and {face_count} faces")
    return _own(array, array.dtype)


def _mask(mask: npt.ArrayLike, face_count: int) -> npt.NDArray[np.bool_]:
    array = np.asarray(as_numpy(mask))
    if array.shape != (face_count,) or array.dtype != np.bool_:
        raise ValueError(f"transparent must be ({face_count},) bool, got {array.shape} {array.dtype}")
    return _own(array, array.dtype)
