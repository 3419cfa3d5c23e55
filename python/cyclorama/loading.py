"""Scenes from files, from the meshes of other libraries, and from arrays.

Other libraries' meshes are read by their attributes, so that nobody has to have all of them installed; files go
through trimesh, imported on the first file. Whatever comes in keeps its triangles in order, its vertices unmerged and
its precision: what the library answers can be used as an index into the caller's own arrays.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .parts import Part
from .scene import Scene

__all__ = ["describe", "load"]

Floats = npt.NDArray[np.floating]
Ints = npt.NDArray[np.integer]
Bytes = npt.NDArray[np.uint8]

FORMATS = (".ply", ".obj", ".stl", ".glb", ".gltf", ".off")
UNCOLORED = np.array([200, 200, 200], dtype=np.uint8)


@dataclass
class _Part:
    """One mesh of a source, with a colour for each vertex or for each face, or none, and its place among the nodes."""

    vertices: Floats
    faces: Ints
    vertex_colors: Bytes | None = None
    face_colors: Bytes | None = None
    transparent: bool = False
    name: str = ""
    path: str = ""


def load(source: Any) -> Scene:
    """A scene from a file, a mesh of another library, or a pair of arrays.

    Parameters
    ----------
    source : path, mesh, pair or Scene
        One of

        * the path of a PLY, OBJ, STL, GLB, GLTF or OFF file (read by trimesh: ``pip install cyclorama[mesh]``);
        * a trimesh ``Trimesh`` or ``Scene``, an Open3D ``TriangleMesh`` (legacy or tensor), a PyVista ``PolyData``;
        * any object with ``vertices`` (V, 3) and ``faces`` (F, 3);
        * a pair ``(vertices, faces)``;
        * a `Scene`, which comes back as it is.

    Returns
    -------
    Scene
        Faces in the order of the source. A scene graph is flattened node by node, each instance with its transform;
        a mirroring transform turns the winding, so that outward stays outward. `Scene.parts` says which faces each
        node has.

    Raises
    ------
    FileNotFoundError
        If there is no file of that name.
    ValueError
        If the file is of another kind, is cut off or holds no triangles, or the mesh is not one that `Scene` takes.
        The message begins with the path.
    ImportError
        If a file is given and trimesh is not installed.
    TypeError
        If the source is none of the above.

    Notes
    -----
    Vertex colours stay vertex colours. A texture becomes a colour per face, its texel at the centroid of the face's
    texture coordinates, and the base colour of a material becomes the colour of its faces; where a glTF mesh has
    several of them, they multiply. Colours are taken as they are stored, without a change of colour space. Where only
    some meshes of a file have colours, the others are light grey. A scene of as many vertices as faces would take face
    colours for vertex colours: then the last vertex is repeated once. Faces whose material blends (glTF ``BLEND`` with
    a base alpha below 1, OBJ ``d`` below 1) are marked `transparent`.

    Polygons of more than three corners are cut into triangles: in OFF files and PyVista meshes as a fan in place,
    which is right for convex polygons, others are refused; in other files by trimesh, which may put the pieces after
    the triangles of the file. Faces of an OBJ file come material by material, in the order of trimesh. OBJ, which says
    nowhere how much it holds, cannot be told from a shorter file when it was cut among its faces.

    Examples
    --------
    >>> scene = load(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    >>> len(scene)
    1
    """
    if isinstance(source, Scene):
        return source
    if isinstance(source, (str, os.PathLike)):
        return _load_path(Path(source))
    return _join(_parts(source))


def describe(scene: Scene) -> dict[str, int | bool]:
    """What a scene is made of, and what of it is broken.

    Vertices with exactly equal coordinates are welded first; edges, components and `watertight` are of the welded
    faces that still have three different corners.

    Returns
    -------
    dict
        ``vertices`` and ``faces`` as given; ``welded`` vertices; ``degenerate`` faces, of exactly no area;
        ``duplicate`` faces, whose three welded corners an earlier face has in any order; ``components``, pieces
        that share no vertex (a vertex without a face is one); ``boundary`` edges of one face and ``nonmanifold``
        edges of more than two; ``watertight``, where every edge has exactly two faces.

    Examples
    --------
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> about = describe(Scene(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2], [1, 2, 3]]))
    >>> about["duplicate"], about["watertight"]
    (1, False)
    """
    weld, welded = _weld(scene.vertices)
    faces = np.sort(weld[scene.faces], axis=1)
    whole = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])]
    edges = np.concatenate([whole[:, [0, 1]], whole[:, [1, 2]], whole[:, [0, 2]]])
    owners = _group(edges[:, 0] * welded + edges[:, 1])[1]
    duplicate = len(faces) - _group(_group(faces[:, 0] * welded + faces[:, 1])[0] * welded + faces[:, 2])[1].size
    return {
        "vertices": len(scene.vertices),
        "faces": len(scene.faces),
        "welded": welded,
        "degenerate": int(np.count_nonzero(_degenerate(scene))),
        "duplicate": int(duplicate),
        "components": _components(welded, edges),
        "boundary": int(np.count_nonzero(owners == 1)),
        "nonmanifold": int(np.count_nonzero(owners > 2)),
        "watertight": bool((owners == 2).all()) and len(owners) > 0,
    }


# Files ----------------------------------------------------------------------------------------------------------------


def _load_path(path: Path) -> Scene:
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file")
    if path.is_dir():
        raise ValueError(f"{path}: is a folder, not a mesh file")
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"{path}: {path.suffix or 'a name without an ending'} is not one of {' '.join(FORMATS)}")
    try:
        parts = [_read_off(path)] if path.suffix.lower() == ".off" else _parts(read_file(path))
        if not any(len(part.faces) for part in parts):
            raise ValueError("it holds no triangles, or is cut off")
        if len(parts) == 1 and not parts[0].name:
            parts[0].name = parts[0].path = path.stem
        return _join(parts)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_file(path: Path) -> Any:
    """What trimesh makes of a mesh file: a ``Trimesh`` or ``Scene`` whose faces are in the order of `load`'s.

    Raises
    ------
    ValueError
        If the file is of another kind or cut off.
    ImportError
        If trimesh is not installed.
    """
    try:
        import trimesh
    except ImportError as error:
        raise ImportError(f"{path}: reading mesh files needs trimesh: pip install cyclorama[mesh]") from error
    if path.suffix.lower() == ".ply":
        _check_ply(path)
    try:
        mesh = trimesh.load(path, process=False)
    except Exception as error:
        raise ValueError(f"not a readable {path.suffix[1:].upper()} file, or cut off: {error}") from error
    if not (hasattr(mesh, "faces") or hasattr(mesh, "geometry")):
        raise ValueError(f"it holds no triangles, but a {type(mesh).__name__}, or is cut off")
    return mesh


def _check_ply(path: Path) -> None:
    """Refuses a PLY file in text that ends before its last face: trimesh would read the faces that are there."""
    with path.open("rb") as file:
        if file.readline().strip() != b"ply":
            raise ValueError("not a PLY file")
        promised, text = 0, False
        for line in file:
            words = line.split()
            text = text or words[:2] == [b"format", b"ascii"]
            if words[:1] == [b"element"] and len(words) == 3 and words[2].isdigit():
                promised += int(words[2])
            if words[:1] == [b"end_header"]:
                break
        else:
            raise ValueError("a PLY file cut off in its header")
        if not text:
            return
        found, last = 0, b""
        for line in file:
            if line.strip():
                found, last = found + 1, line
        words = last.split()
        if found < promised or (words and words[0].isdigit() and len(words) <= int(words[0])):
            raise ValueError(f"cut off: its header promises {promised} lines, {found} are there")


def _read_off(path: Path) -> _Part:
    """An OFF file in text. (trimesh's reader drops the faces a cut file lacks, and stops at pentagons.)"""
    try:
        text = path.read_text(encoding="ascii")
    except UnicodeDecodeError as error:
        raise ValueError(f"not an OFF file in text: {error}") from error
    lines = [words for line in text.splitlines() if (words := line.split("#")[0].split())]
    if not lines or not lines[0][0].endswith("OFF"):
        raise ValueError("not an OFF file")
    kind = lines[0].pop(0)[:-3]
    if kind not in ("", "C", "N", "CN"):
        raise ValueError(f"OFF files of kind {kind}OFF are not read")
    body = lines if lines[0] else lines[1:]
    try:
        vertex_count, face_count = int(body[0][0]), int(body[0][1])
        rows, corners = body[1 : 1 + vertex_count], body[1 + vertex_count : 1 + vertex_count + face_count]
        if len(rows) < vertex_count or len(corners) < face_count:
            raise ValueError(
                f"{vertex_count} vertices and {face_count} faces promised, {len(body) - 1} lines are there"
            )
        vertices = np.array([row[:3] for row in rows], dtype=np.float64).reshape(-1, 3)
        padded = np.array([word for row in corners for word in row[: 1 + int(row[0])]], dtype=np.int64)
        faces, polygon = _fan(padded, vertices)
    except (IndexError, ValueError) as error:
        raise ValueError(f"not a readable OFF file, or cut off: {error}") from error
    part = _Part(vertices, faces)
    tails = [row[1 + int(row[0]) :] for row in corners]
    if "C" in kind:
        part.vertex_colors = _off_colors([row[3 if kind == "C" else 6 :] for row in rows])
    elif tails and all(len(tail) >= 3 for tail in tails):
        part.face_colors = _off_colors(tails)[polygon]
    return part


def _off_colors(rows: list[list[str]]) -> Bytes:
    """Colours in bytes where all are whole numbers, of [0, 1] where one has a point."""
    whole = not any("." in word for row in rows for word in row[:3])
    return _unit_bytes(np.array([row[:3] for row in rows], dtype=np.float64) / (255.0 if whole else 1.0))


# The meshes of other libraries ----------------------------------------------------------------------------------------


def _parts(source: Any) -> list[_Part]:
    if isinstance(source, (tuple, list)):
        if len(source) != 2:
            raise TypeError(f"a scene from arrays takes a pair (vertices, faces), got {len(source)} of them")
        return [_Part(np.asarray(source[0]), np.asarray(source[1]))]
    for fits, read in _READERS:
        if fits(source):
            return list(read(source))
    raise TypeError(
        f"cannot make a scene of {type(source).__module__}.{type(source).__name__}: give a path, a trimesh, Open3D or "
        "PyVista mesh, or a pair (vertices, faces)"
    )


def _has(*names: str) -> Callable[[Any], bool]:
    return lambda source: all(hasattr(source, name) for name in names)


def _read_trimesh_scene(scene: Any) -> Iterable[_Part]:
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not _has("vertices", "faces")(mesh):
            continue
        matrix = np.asarray(matrix, dtype=np.float64)
        path = _node_path(scene.graph, node)
        for part in _read_trimesh(mesh):
            part.name, part.path = str(node), path
            if not np.array_equal(matrix, np.eye(4)):
                part.vertices = part.vertices.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
                if np.linalg.det(matrix[:3, :3]) < 0:
                    part.faces = part.faces[:, ::-1]
            yield part


def _node_path(graph: Any, node: Any) -> str:
    """Names from below the root down to a node."""
    parents, names = graph.transforms.parents, []
    while node is not None and node != graph.base_frame:
        names.append(str(node))
        node = parents.get(node)
    return "/".join(reversed(names))


def _read_trimesh(mesh: Any) -> Iterable[_Part]:
    part = _Part(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    visual: Any = getattr(mesh, "visual", None)
    kind = getattr(visual, "kind", None)
    if kind == "vertex":
        part.vertex_colors = np.asarray(visual.vertex_colors, dtype=np.uint8)[:, :3]
    elif kind == "face":
        part.face_colors = np.asarray(visual.face_colors, dtype=np.uint8)[:, :3]
    elif kind == "texture" and len(part.faces):
        tint = getattr(visual, "vertex_attributes", {}).get("color")
        if tint is not None and _image(visual) is None:
            part.vertex_colors = _times(_unit_bytes(np.asarray(tint)), _factor(visual.material))
        else:
            part.face_colors = _material_colors(visual, part.faces)
            if tint is not None:
                part.face_colors = _times(part.face_colors, _unit_bytes(np.asarray(tint))[part.faces].mean(axis=1))
        part.transparent = _blends(visual.material)
    yield part


def _image(visual: Any) -> Any:
    """The texture of a trimesh visual that has coordinates for it, or None."""
    physical = getattr(visual.material, "baseColorTexture", None)
    image = getattr(visual.material, "image", None) if physical is None else physical
    return None if visual.uv is None else image


def _factor(material: Any) -> Floats:
    """(3,) base colour of a glTF material, of which 255 changes nothing."""
    factor = getattr(material, "baseColorFactor", None)
    return np.full(3, 255.0) if factor is None else np.asarray(factor, dtype=np.float64)[:3]


def _times(colors: Bytes, factor: Floats) -> Bytes:
    return np.asarray(np.rint(colors * (factor / 255.0)), dtype=np.uint8)


def _material_colors(visual: Any, faces: Ints) -> Bytes:
    image = _image(visual)
    if image is None:
        return np.tile(np.asarray(visual.material.main_color, dtype=np.uint8)[:3], (len(faces), 1))
    texels = _texels(np.asarray(image.convert("RGB")), np.asarray(visual.uv)[faces], from_top=False)
    return _times(texels, _factor(visual.material))


def _blends(material: Any) -> bool:
    factor = getattr(material, "baseColorFactor", None)
    if factor is not None:
        return bool(material.alphaMode == "BLEND" and factor[3] < 255)
    opacity = getattr(material, "kwargs", {}).get("d")
    return opacity is not None and float(np.ravel(opacity)[0]) < 1.0


def _texels(image: Bytes, uv: Floats, *, from_top: bool) -> Bytes:
    """(F, 3) colours of an (H, W, 3) image at the mean of each face's (F, 3, 2) texture coordinates, repeating."""
    height, width = image.shape[:2]
    centroid = uv.mean(axis=1, dtype=np.float64)
    centroid[~np.isfinite(centroid).all(axis=1)] = 0.0
    u, v = centroid[:, 0] % 1.0, centroid[:, 1] % 1.0
    column = np.minimum((u * width).astype(np.intp), width - 1)
    row = np.minimum(((v if from_top else 1.0 - v) * height).astype(np.intp), height - 1)
    return np.ascontiguousarray(image[row, column, :3])


def _read_open3d(mesh: Any) -> Iterable[_Part]:
    part = _Part(np.array(mesh.vertices), np.array(mesh.triangles))
    if mesh.has_vertex_colors():
        part.vertex_colors = _unit_bytes(np.asarray(mesh.vertex_colors))
    elif mesh.has_triangle_uvs() and any(not image.is_empty() for image in mesh.textures):
        uv = np.asarray(mesh.triangle_uvs).reshape(-1, 3, 2)
        material = np.asarray(mesh.triangle_material_ids) if mesh.has_triangle_material_ids() else np.zeros(len(uv))
        part.face_colors = np.tile(UNCOLORED, (len(uv), 1))
        for index, image in enumerate(mesh.textures):
            mine = material == index
            if mine.any() and not image.is_empty():  # Open3D keeps the images of legacy meshes upside down
                part.face_colors[mine] = _texels(_rgb(np.asarray(image)), uv[mine], from_top=True)
    yield part


def _read_open3d_tensor(mesh: Any) -> Iterable[_Part]:
    if "indices" not in mesh.triangle:
        raise ValueError("the Open3D mesh has no triangles")

    def array(tensor: Any) -> npt.NDArray[Any]:
        return np.array(tensor.cpu().numpy())

    part = _Part(array(mesh.vertex["positions"]), array(mesh.triangle["indices"]))
    if "colors" in mesh.vertex:
        part.vertex_colors = _unit_bytes(array(mesh.vertex["colors"]))
    elif "colors" in mesh.triangle:
        part.face_colors = _unit_bytes(array(mesh.triangle["colors"]))
    elif "texture_uvs" in mesh.triangle and mesh.has_valid_material() and "albedo" in mesh.material.texture_maps:
        image = _rgb(array(mesh.material.texture_maps["albedo"].as_tensor()))
        part.face_colors = _texels(image, array(mesh.triangle["texture_uvs"]), from_top=False)
    yield part


def _read_polydata(mesh: Any) -> Iterable[_Part]:
    padded = np.asarray(mesh.faces)
    if getattr(mesh, "n_strips", 0):
        raise ValueError("the PyVista mesh has triangle strips: call .triangulate() on it first")
    points = np.asarray(mesh.points)
    faces, polygon = _fan(padded, points)
    part = _Part(points, faces)
    for name in ("RGB", "RGBA", "rgb", "rgba", "colors", "Colors"):
        if name in mesh.point_data:
            part.vertex_colors = _unit_bytes(np.asarray(mesh.point_data[name]))
            break
        if name in mesh.cell_data:
            cell = polygon + (mesh.n_verts + mesh.n_lines)  # VTK numbers loose points and lines before polygons
            part.face_colors = _unit_bytes(np.asarray(mesh.cell_data[name])[cell])
            break
    yield part


def _fan(padded: Ints, points: Floats) -> tuple[Ints, npt.NDArray[np.intp]]:
    """Triangles of padded polygons (n, v0 ... vn-1, n, ...), and the polygon of each."""
    if len(padded) % 4 == 0 and (padded[::4] == 3).all():
        return padded.reshape(-1, 4)[:, 1:], np.arange(len(padded) // 4)
    faces, polygon, at, count = [], [], 0, 0
    while at < len(padded):
        size = int(padded[at])
        corners = padded[at + 1 : at + 1 + size]
        if size < 3 or len(corners) != size:
            raise ValueError(f"polygon {count} has {len(corners)} corners")
        fan = np.column_stack([np.full(size - 2, corners[0]), corners[1:-1], corners[2:]])
        if size > 3:
            a, b, c = (points[fan[:, i]].astype(np.float64) for i in range(3))
            normals = np.cross(b - a, c - a)
            if (normals @ normals.sum(axis=0) < 0).any():
                raise ValueError(f"polygon {count} is not convex: cut it into triangles first")
        faces.append(fan)
        polygon.append(np.full(size - 2, count))
        at += size + 1
        count += 1
    if not faces:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.intp)
    return np.concatenate(faces), np.concatenate(polygon)


def _refuse_blocks(mesh: Any) -> Iterable[_Part]:
    raise ValueError(
        f"a PyVista {type(mesh).__name__} is not a surface: give .extract_surface().triangulate() of it "
        "(for blocks: of .combine())"
    )


def _read_vertices_and_faces(mesh: Any) -> Iterable[_Part]:
    yield _Part(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def _unit_bytes(colors: npt.NDArray[Any]) -> Bytes:
    """The first three channels as bytes; real numbers are of [0, 1]."""
    colors = colors[:, :3]
    if colors.dtype == np.uint8:
        return np.ascontiguousarray(colors)
    if colors.dtype.kind == "f":
        colors = np.rint(np.clip(np.nan_to_num(colors), 0.0, 1.0) * 255.0)
    return np.asarray(np.clip(colors, 0, 255), dtype=np.uint8)


def _rgb(image: npt.NDArray[Any]) -> Bytes:
    image = image.reshape(*image.shape[:2], -1)
    image = np.repeat(image[:, :, :1], 3, axis=2) if image.shape[2] < 3 else image[:, :, :3]
    return _unit_bytes(image.reshape(-1, 3)).reshape(image.shape)


# What tells each kind of mesh from the others, asked in this order.
_READERS: Sequence[tuple[Callable[[Any], bool], Callable[[Any], Iterable[_Part]]]] = (
    (_has("geometry", "graph"), _read_trimesh_scene),
    (_has("vertices", "faces", "visual"), _read_trimesh),
    (_has("vertices", "triangles", "has_vertex_colors"), _read_open3d),
    (_has("vertex", "triangle"), _read_open3d_tensor),
    (_has("points", "faces", "n_strips"), _read_polydata),
    (_has("n_blocks"), _refuse_blocks),
    (_has("points", "cells"), _refuse_blocks),
    (_has("points", "extract_surface"), _refuse_blocks),
    (_has("vertices", "faces"), _read_vertices_and_faces),
)


# Joining and counting -------------------------------------------------------------------------------------------------


def _join(parts: list[_Part]) -> Scene:
    parts = [part for part in parts if len(part.faces)] or parts[:1]
    if not parts:
        raise ValueError("it holds no triangles")
    if len(parts) == 1:
        vertices, faces = parts[0].vertices, parts[0].faces
    else:
        starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
        vertices = np.concatenate([part.vertices for part in parts])
        faces = np.concatenate([part.faces.astype(np.int64) + start for part, start in zip(parts, starts, strict=True)])
    transparent = None
    if any(part.transparent for part in parts):
        transparent = np.concatenate([np.full(len(part.faces), part.transparent) for part in parts])
    colors = _join_colors(parts)
    if colors is not None and len(vertices) == len(faces) and all(part.vertex_colors is None for part in parts):
        vertices = np.concatenate([vertices, vertices[-1:]])
    ends = np.cumsum([len(part.faces) for part in parts]).tolist()
    nodes = [Part(p.name, p.path, end - len(p.faces), end) for p, end in zip(parts, ends, strict=True)]
    return Scene(vertices, faces, colors, transparent=transparent, parts=nodes)


def _join_colors(parts: list[_Part]) -> Bytes | None:
    if all(part.vertex_colors is None and part.face_colors is None for part in parts):
        return None

    def of_vertices(part: _Part) -> Bytes:
        return np.tile(UNCOLORED, (len(part.vertices), 1)) if part.vertex_colors is None else part.vertex_colors

    def of_faces(part: _Part) -> Bytes:
        if part.face_colors is not None:
            return part.face_colors
        if part.vertex_colors is None:
            return np.tile(UNCOLORED, (len(part.faces), 1))
        return np.asarray(np.rint(part.vertex_colors[part.faces].mean(axis=1)), dtype=np.uint8)

    of = of_vertices if all(part.face_colors is None for part in parts) else of_faces
    return np.concatenate([of(part) for part in parts])


def _group(keys: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """The rank of each key among the different keys, and how often each of those occurs."""
    _, rank, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return rank.astype(np.int64), counts.astype(np.int64)


def _weld(vertices: Floats) -> tuple[npt.NDArray[np.int64], int]:
    """The welded vertex of each vertex, and how many welded ones there are. Equal means equal coordinates."""
    weld = np.zeros(len(vertices), dtype=np.int64)
    for axis in range(3):
        _, rank = np.unique(vertices[:, axis], return_inverse=True)
        weld, counts = _group(weld * len(vertices) + rank)
    return weld, len(counts)


def _degenerate(scene: Scene) -> npt.NDArray[np.bool_]:
    a, b, c = (scene.vertices[scene.faces[:, corner]].astype(np.float64) for corner in range(3))
    return np.asarray(~np.cross(b - a, c - a).any(axis=1))


def _components(nodes: int, edges: npt.NDArray[np.int64]) -> int:
    """Connected pieces of a graph of `nodes` nodes: each round every node takes the lowest name next to it."""
    a, b = edges[:, 0], edges[:, 1]
    name = np.arange(nodes)
    while True:
        before = name.copy()
        low = np.minimum(before[a], before[b])
        np.minimum.at(name, before[a], low)
        np.minimum.at(name, before[b], low)
        while not np.array_equal(name, name[name]):
            name = name[name]
        if np.array_equal(name, before):
            return len(np.unique(name))
