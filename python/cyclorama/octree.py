"""Octrees of faces, and culling them to one view or to several at once (chapter 7 of the 1998 dissertation).

An image in a scene tiles what an eye sees: the geometry to its left, to its right, above it, below it and before it is
drawn, each part warped in its own way perhaps, and what lies behind it is not (figure 7-1, `tiles`). So a frame is
culled to several regions. A face that reaches across cells of the tree is the trouble: the *conventional* tree keeps it
in their parent, and draws it for every region that comes by. The *efficient* tree has it in each cell that it
intersects, and draws it once.

A *region* is a convex part of space: rows of planes `(a, b, c, d)`, inside where ``a x + b y + c z + d >= 0`` for all
of them. `planes` has those of a camera.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _core
from .arguments import checked_whole
from .camera import Camera
from .progress import Progress, reporter
from .scene import Scene

__all__ = ["Culled", "Octree", "planes", "storage", "tiles"]

Floats = npt.NDArray[np.float64]
Ids = npt.NDArray[np.uint32]

#: What `Octree.cull` takes as one region.
Region = Camera | npt.ArrayLike

#: The deepest level; the same bound as the kernel's.
MOST_LEVELS = 20

# Passed down without end: no tree is as deep.
_ENDLESS = 2**32 - 1


class Culled(NamedTuple):
    """What one frame draws."""

    #: (K,) the faces, region after region, in the order of the tree.
    faces: Ids
    #: For each region, how many faces it and those before it draw.
    ends: list[int]

    @property
    def drawn(self) -> int:
        """How many faces are drawn, those that are drawn several times counted so often."""
        return len(self.faces)

    def of(self, region: int) -> Ids:
        """The faces of one region: what it needs, less what an earlier one has drawn already, if that is drawn once."""
        return self.faces[self.ends[region - 1] if region else 0 : self.ends[region]]


class Octree:
    """The cells of a scene, and the faces of each.

    Parameters
    ----------
    scene : Scene
    kind : {"efficient", "conventional"}
        Whether a face that intersects several cells of a level is passed down to all of them, or kept in their parent.
    leaf_faces : int
        A cell of at most so many faces is not divided.
    depth : int
        No cell is below this level; the root has level 0, 20 is the deepest.
    stop : int, optional
        For how many levels the efficient tree passes such a face down: where it stops, it is kept, and drawn whenever
        that cell may be seen. By default it reaches the leaves.
    threads : int, optional
        All cores by default. The tree doesn't depend on it.
    progress : bool or callable, optional
        See `cyclorama.progress.reporter`; one unit is one face.

    Attributes
    ----------
    nodes : int
        Cells that hold faces, themselves or below.
    references : int
        Faces of all cells together: F where none is in two.
    crossing : int
        Faces that intersect several cells of a level: c of section 7.1.2.

    Raises
    ------
    ValueError
        If a parameter is out of range, or there were 2^32 references or more.

    Notes
    -----
    A cell is not divided where its parts would have more than twice its faces together: dividing never parts faces that
    all lie in one place, and each level would have four times as many. The box of a cell is the part of it that the
    boxes of its faces reach.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(2000)
    >>> tree = Octree(scene, leaf_faces=32)
    >>> camera = cyc.Camera.look_at((0, 0, 0), (1, 0, 0))
    >>> culled = tree.cull(camera)
    >>> set(scene.visible(camera).ids(0)) <= set(culled.faces)
    True
    >>> culled.drawn < 400
    True
    """

    def __init__(
        self,
        scene: Scene,
        kind: Literal["efficient", "conventional"] = "efficient",
        *,
        leaf_faces: int = 32,
        depth: int = 12,
        stop: int | None = None,
        threads: int | None = None,
        progress: Progress = None,
    ) -> None:
        if kind not in ("efficient", "conventional"):
            raise ValueError(f"kind must be 'efficient' or 'conventional', got {kind!r}")
        leaf_faces, depth = checked_whole("leaf_faces", leaf_faces, 1), checked_whole("depth", depth, 0, MOST_LEVELS)
        if stop is not None:
            stop = checked_whole("stop", stop, 0, MOST_LEVELS)
            if kind == "conventional":
                raise ValueError(f"a conventional tree passes nothing down: leave stop out, got {stop}")
        self.kind = kind
        self.stop = 0 if kind == "conventional" else stop
        with reporter(progress, len(scene), "dividing") as report:
            levels = _ENDLESS if self.stop is None else self.stop
            self._tree = _core.Octree(scene._mesh, leaf_faces, depth, levels, threads, report)
        self.faces = len(scene)
        self.nodes, self.references, self.crossing, self._by_level = self._tree.counts()

    def __repr__(self) -> str:
        return f"<Octree: {self.kind}, {self.nodes:,} cells, {self.faces:,} faces, {self.references:,} references>"

    def cull(self, regions: Region | Sequence[Region], *, out: Ids | None = None) -> Culled:
        """Faces to draw for one region or several.

        Parameters
        ----------
        regions : Camera, (P, 4) array_like, or a sequence of those
            Planes are in the user's units, at most 32 a region. A region may be empty or open.
        out : (N,) ndarray of uint32, optional
            Room for the answer. N = F is always enough for the efficient tree, regions times F for the other.

        Returns
        -------
        Culled
            `.faces` (K,) uint32: each face that reaches into a region, and others near it; the front of `out`, if
            given. The efficient tree has each face once, for the first region that needs it. The conventional one has
            what is kept above the leaves once for each region. `.ends`, `.of(region)` say which region it is for.

        Raises
        ------
        ValueError
            If planes are not finite or not (P, 4), a normal is zero, or `out` is too small.

        Examples
        --------
        >>> import cyclorama as cyc
        >>> tree = Octree(cyc.scenes.sphere(2000))
        >>> above, right = [[0, 1, 0, 0]], [[1, 0, 0, 0]]
        >>> culled = tree.cull([above, right])
        >>> len(culled.of(0)) > 1000 > len(culled.of(1))
        True
        """
        if out is not None and not (isinstance(out, np.ndarray) and out.dtype == np.uint32 and out.ndim == 1):
            raise ValueError("out must be a one-dimensional array of uint32")
        arrays = [_planes(f"regions[{k}]", region) for k, region in enumerate(_regions(regions))]
        counts = [len(array) for array in arrays]
        every = np.concatenate([np.empty((0, 4)), *arrays])
        faces, ends = self._tree.cull(every, counts, self.kind == "conventional")
        if out is not None:
            if len(out) < len(faces):
                raise ValueError(f"out has room for {len(out)} faces, the answer has {len(faces)}")
            out[: len(faces)] = faces
            faces = out[: len(faces)]
        return Culled(faces, ends)

    def cells(self) -> dict[str, npt.NDArray[Any]]:
        """The tree as arrays.

        Returns
        -------
        dict
            For each node, in the order of a walk: `low` and `high` (N, 3) of its box, `level` (N,), `next` (N,) the
            next node that isn't below it, and where in `references` its own faces begin and end (`first`, `own_end`),
            and those of everything below it (`end`). `references` (R,) uint32.
        """
        boxes, numbers, references = self._tree.nodes()
        names = ("level", "next", "first", "own_end", "end")
        return {
            "low": boxes[:, :3],
            "high": boxes[:, 3:],
            **dict(zip(names, numbers.T, strict=True)),
            "references": references,
        }


def planes(camera: Camera, *, near: float | None = None, far: float | None = None) -> Floats:
    """What a camera sees, as planes.

    Parameters
    ----------
    camera : Camera
        Perspective or orthographic.
    near, far : float, optional
        Depths where the region begins and ends; by default the camera's own near plane, and nowhere.

    Returns
    -------
    (5, 4) or (6, 4) ndarray of float64
        Left, right, top, bottom, near, far; normals have unit length and point inward.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> camera = cyc.Camera.look_at((0, 0, 5), (0, 0, 0), fov_y=90, width=2, height=2)
    >>> planes(camera)[4]
    array([ 0.,  0., -1.,  5.])
    """
    right, down, _ = camera.K
    last = np.array([0.0, 0.0, 1.0])
    rows = np.stack([right, camera.width * last - right, down, camera.height * last - down])
    if camera.orthographic:
        rows = np.column_stack([rows[:, :2], np.zeros(4), rows[:, 2]])
    else:
        rows = np.column_stack([rows, np.zeros(4)])
    rows = np.vstack([rows, [0, 0, 1, -(camera.near if near is None else near)]])
    if far is not None:
        rows = np.vstack([rows, [0, 0, -1, far]])
    return _unit(rows @ camera.world_to_camera) + 0.0


def tiles(camera: Camera, corners: npt.ArrayLike) -> list[Floats]:
    """How a quadrilateral tiles what a camera sees (figure 7-1).

    Parameters
    ----------
    camera : Camera
        Perspective.
    corners : (4, 3) array_like of float
        The quadrilateral: top-left, top-right, bottom-right, bottom-left, as the camera sees it. It is convex, in one
        plane, and in front of the camera; it may reach beyond its picture.

    Returns
    -------
    list of (P, 4) ndarray
        Regions to the left and to the right of it, above and below it (between those two), and before it. Together they
        are all that the camera sees but what is behind the quadrilateral.

    Raises
    ------
    ValueError
        If the camera is orthographic, or the quadrilateral is behind it, edge-on or not convex.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> camera = cyc.Camera.look_at((0, 0, 5), (0, 0, 0), fov_y=90, width=2, height=2)
    >>> regions = tiles(camera, [[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    >>> point = np.array([0, 3, -1, 1])  # above it
    >>> [bool((region @ point >= 0).all()) for region in regions]
    [False, False, True, False, False]
    """
    if camera.orthographic:
        raise ValueError("an orthographic camera has no eye to see a quadrilateral from: its picture has no tiles")
    quad = np.asarray(corners, dtype=np.float64)
    if quad.shape != (4, 3) or not np.isfinite(quad).all():
        raise ValueError(f"corners must be four finite points, (4, 3), got {quad.tolist()}")
    eye, seen = camera.eye, planes(camera)
    away = quad - eye
    if not (away @ camera.forward > 0).all():
        raise ValueError(f"corners must be in front of the camera, their depths are {(away @ camera.forward).tolist()}")
    normals = np.cross(away, np.roll(away, -1, axis=0))
    sides = normals @ away.T
    # Two corners lie on each edge's plane, by its making; the other two are on its inner side.
    others = np.stack([np.roll(sides[k], -k)[2:] for k in range(4)])
    if not (others > 0).all():
        raise ValueError(
            "corners must go around a convex quadrilateral clockwise as the camera sees it, from the top-left"
        )
    top, right, bottom, left = _unit(np.column_stack([normals, -normals @ eye]))
    normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
    face = np.append(normal, -normal @ quad.mean(axis=0))
    face = _unit(face[None])[0] * (1.0 if normal @ (eye - quad[0]) > 0 else -1.0)
    return [
        np.vstack([seen, -left]),
        np.vstack([seen, left, -right]),
        np.vstack([seen, left, right, -top]),
        np.vstack([seen, left, right, top, -bottom]),
        np.vstack([seen, left, right, top, bottom, face]),
    ]


def storage(
    scene: Scene,
    stops: Iterable[int | None] = (0, 1, 2, 3, 4, 6, 8, None),
    *,
    leaf_faces: int = 32,
    depth: int = 12,
    progress: Progress = None,
) -> list[dict[str, Any]]:
    """What passing faces down costs, against the level at which it stops.

    Parameters
    ----------
    scene : Scene
    stops : iterable of int or None
        0 is what the conventional tree stores, None the efficient one.
    leaf_faces, depth
        As for `Octree`.
    progress : bool or callable, optional
        One unit is one tree.

    Returns
    -------
    list of dict
        For each: `stop`; `cells`; `crossing`, the faces c that intersect several cells of a level; `copies`, references
        beyond the one of each face; `by_level`, references to crossing faces if every cell of every level had a set of
        its own, as the dissertation has it; `per_crossing`, the latter over c, which it puts at up to the depth d, or
        s; `bytes` of cells and references.

    Notes
    -----
    The dissertation's O(c d) and O(c s) (section 7.1.2) hold where a face touches few cells of a level, so for faces
    that are not much larger than the leaves. A face as large as the scene touches 4^l cells of level l, and
    `per_crossing` is far beyond d.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> rows = storage(cyc.scenes.sphere(2000), [0, 1, None], progress=False)
    >>> [row["copies"] for row in rows][0], rows[1]["copies"] < rows[2]["copies"]
    (0, True)
    """
    rows = []
    asked = list(stops)
    with reporter(progress, len(asked), "trees") as report:
        for done, stop in enumerate(asked, 1):
            tree = Octree(scene, leaf_faces=leaf_faces, depth=depth, stop=stop, progress=False)
            rows.append(
                {
                    "stop": stop,
                    "cells": tree.nodes,
                    "crossing": tree.crossing,
                    "copies": tree.references - tree.faces,
                    "by_level": tree._by_level,
                    "per_crossing": tree._by_level / max(1, tree.crossing),
                    "bytes": 4 * tree.references + _NODE_BYTES * tree.nodes,
                }
            )
            report(done)
    return rows


# Two corners of three float64, five uint32, padded to eight bytes.
_NODE_BYTES = 72


def _regions(regions: Any) -> list[Region]:
    if isinstance(regions, Camera) or (isinstance(regions, np.ndarray) and regions.ndim == 2):
        return [regions]
    items = list(regions)
    return [regions] if items and not isinstance(items[0], Camera) and np.ndim(items[0]) < 2 else items


def _planes(name: str, region: Region) -> Floats:
    if isinstance(region, Camera):
        return planes(region)
    try:
        array = np.asarray(region, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a camera or (P, 4) planes, got {type(region).__name__}") from None
    if array.ndim != 2 or array.shape[1] != 4:
        raise ValueError(f"{name} must be a camera or (P, 4) planes, got shape {array.shape}")
    return array


def _unit(rows: Floats) -> Floats:
    return np.asarray(rows / np.linalg.norm(rows[:, :3], axis=1, keepdims=True))
