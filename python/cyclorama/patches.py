"""Cutting a mesh into compact, connected patches, so that a view needs a bit per patch instead of one per face.

Faces connect along edges, and edges join positions: corners with exactly equal coordinates are one point, whatever
vertex they name, since STL files always and PLY files often repeat a vertex for each face.
"""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt

from . import _core
from .progress import Progress, reporter
from .scene import _faces, _vertices

__all__ = ["adjacency", "tile"]


def tile(
    vertices: npt.ArrayLike, faces: npt.ArrayLike, count: int, *, progress: Progress = None
) -> npt.NDArray[np.uint32]:
    """Fuses faces to `count` patches: the smallest always joins the neighbour that stretches it least.

    Parameters
    ----------
    vertices : (V, 3) array_like of float
        Positions, in any unit.
    faces : (F, 3) array_like of int
        Vertex indices of each triangle. Zero-area, duplicate and non-manifold faces are welcome.
    count : int
        Patches to make, at least 1.
    progress : bool or callable, optional
        See `cyclorama.progress.reporter`; the units are fusions, F - `count` of them.

    Returns
    -------
    (F,) ndarray of uint32
        Patch of each face. Patches are connected along edges and numbered by their lowest face: a face with a
        new number has the next one. There are exactly `count` where the mesh has at least as many faces and at most
        as many connected components.

    Warns
    -----
    UserWarning
        If the mesh has more components than `count` (each becomes one patch: fusing them would make patches that
        are nowhere near compact) or fewer faces (each becomes one). A face whose corners are all at one point has no
        edge, so it is a component.

    Raises
    ------
    ValueError
        If `count` is not a positive integer, or the mesh is not one (see `Scene`).

    Notes
    -----
    The tiling of the 2002 paper, section 3.1: "in each iteration the smallest patch (by area) is fused with one of its
    neighbours such that the increase in the extension of the patch is minimized", the extension being the diagonal of
    the axis-aligned bounding box. We read "the patch" as the smallest one, so the increase is the fused
    diagonal less the smallest patch's own. Ties go to the lowest id, among the smallest patches and among the
    neighbours; a patch's id is its lowest face. The cost is O(F log F).

    Examples
    --------
    >>> vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [3, 0, 0], [3, 1, 0]]
    >>> tile(vertices, [[0, 1, 2], [1, 4, 3], [2, 1, 3], [3, 4, 5]], 2)
    array([0, 0, 0, 1], dtype=uint32)
    """
    if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
        raise ValueError(f"count must be an integer of at least 1, got {count!r}")
    points, corners = _mesh(vertices, faces)
    with reporter(progress, max(len(corners) - int(count), 0), "fusing patches") as report:
        labels, found = _core.tile(points, corners, min(int(count), len(corners) + 1), report)
    if found > count:
        warnings.warn(
            f"asked for {count} patches, made {found}: the mesh has {found} components without a common edge, "
            "and each is a patch of its own",
            UserWarning,
            stacklevel=2,
        )
    elif found < count:
        warnings.warn(f"asked for {count} patches, made {found}: the mesh has no more faces", UserWarning, stacklevel=2)
    return labels


def adjacency(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.uint32]]:
    """Faces that share an edge with each face, by position.

    Parameters
    ----------
    vertices : (V, 3) array_like of float
        Positions, in any unit.
    faces : (F, 3) array_like of int
        Vertex indices of each triangle.

    Returns
    -------
    offsets : (F + 1,) ndarray of uint64
        Where each face's list begins.
    neighbors : (K,) ndarray of uint32
        Face ``f`` has ``neighbors[offsets[f]:offsets[f + 1]]``: ascending, each once, never itself.

    Raises
    ------
    ValueError
        If the mesh is not one (see `Scene`), or edges have so many faces that K would reach 2^31: an edge of k faces
        makes k (k - 1) entries.

    Examples
    --------
    >>> adjacency([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]])
    (array([0, 1, 2], dtype=uint64), array([1, 0], dtype=uint32))
    """
    return _core.face_adjacency(*_mesh(vertices, faces))


def _mesh(vertices: npt.ArrayLike, faces: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]:
    points = np.asarray(_vertices(vertices), dtype=np.float64, order="C")
    return points, _faces(faces, len(points))
