"""Answers about faces, in the terms of other programs: masks, meshes of two colours, and glTF.

A mask of faces is what most libraries select by: ``mesh.submesh([mask])`` in trimesh, ``mesh.extract_cells(mask)`` in
PyVista, ``mesh.select_faces_by_mask(mask)`` in Open3D.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from .arguments import checked_floats
from .bitfield import Bitfields
from .files import whole_path
from .scene import Scene

__all__ = ["NEVER_SEEN", "SEEN", "face_mask", "save_gltf", "to_open3d", "to_pyvista", "to_trimesh"]

Mask = npt.NDArray[np.bool_]
Faces = npt.ArrayLike | Bitfields
Rgb = tuple[int, int, int]

#: Colours of faces that are seen and of those that aren't.
SEEN: Rgb = (205, 205, 200)
NEVER_SEEN: Rgb = (215, 25, 28)


def face_mask(scene: Scene, seen: Faces) -> Mask:
    """Which faces of a scene are among some.

    Parameters
    ----------
    scene : Scene
        Of F faces.
    seen : (K,) array_like of int, (F,) array_like of bool, or Bitfields
        Faces, a flag for each, or rows of which a face is in any: of `Scene.visible`, or a bake's without patches.

    Returns
    -------
    (F,) ndarray of bool

    Raises
    ------
    ValueError
        If a face is none of the scene's, or the length is not that of its faces.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]])
    >>> face_mask(scene, [1])
    array([False,  True])
    """
    mask = np.zeros(len(scene), np.bool_)
    if isinstance(seen, Bitfields):
        if seen.size != len(scene):
            raise ValueError(f"seen has rows of {seen.size} bits, the scene {len(scene)} faces: are they of patches?")
        for row in range(len(seen)):
            mask[seen.ids(row)] = True
        return mask
    array = np.asarray(seen)
    if array.dtype == np.bool_:
        if array.shape != mask.shape:
            raise ValueError(f"seen must be ({len(scene)},) bool, a flag a face, got {array.shape}")
        return array.copy()
    if array.size == 0:
        return mask
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise ValueError(f"seen must be (K,) integers or ({len(scene)},) bool, got {array.shape} {array.dtype}")
    for bad in np.flatnonzero((array < 0) | (array >= len(scene)))[:1]:
        raise ValueError(f"seen[{bad}] is {array[bad]}, the scene has {len(scene)} faces")
    mask[array] = True
    return mask


def to_trimesh(scene: Scene, seen: Faces, *, colors: tuple[Rgb, Rgb] = (SEEN, NEVER_SEEN)) -> Any:
    """A `trimesh.Trimesh` whose faces have one colour where they are seen and another where not.

    Parameters
    ----------
    scene : Scene
    seen
        As for `face_mask`.
    colors : (Rgb, Rgb)
        Red, green, blue from 0 to 255.

    Returns
    -------
    trimesh.Trimesh
        Its faces in the scene's order; ``face_attributes["seen"]`` is the mask.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> ball = cyc.scenes.sphere(80)
    >>> mesh = to_trimesh(ball, ball.visible(cyc.Camera.look_at((0, 0, 5), (0, 0, 0))))
    >>> len(mesh.faces), bool(mesh.face_attributes["seen"].any())
    (80, True)
    """
    trimesh: Any = import_module("trimesh")
    mask = face_mask(scene, seen)
    return trimesh.Trimesh(
        scene.vertices,
        scene.faces,
        face_colors=_colors(mask, colors),
        face_attributes={"seen": mask},
        process=False,
    )


def to_open3d(scene: Scene, seen: Faces, *, colors: tuple[Rgb, Rgb] = (SEEN, NEVER_SEEN)) -> Any:
    """An `open3d.t.geometry.TriangleMesh` with `triangle.seen` and `triangle.colors`; see `to_trimesh`."""
    open3d: Any = import_module("open3d")
    mask = face_mask(scene, seen)
    mesh = open3d.t.geometry.TriangleMesh(
        open3d.core.Tensor(np.asarray(scene.vertices, np.float32)), open3d.core.Tensor(scene.faces.astype(np.int64))
    )
    mesh.triangle["seen"] = open3d.core.Tensor(mask)
    mesh.triangle["colors"] = open3d.core.Tensor((_colors(mask, colors) / 255).astype(np.float32))
    return mesh


def to_pyvista(scene: Scene, seen: Faces, *, colors: tuple[Rgb, Rgb] = (SEEN, NEVER_SEEN)) -> Any:
    """A `pyvista.PolyData` with `cell_data` "seen" and "colors" (``plot(scalars="colors", rgb=True)``); see
    `to_trimesh`."""
    pyvista: Any = import_module("pyvista")
    mask = face_mask(scene, seen)
    mesh = pyvista.PolyData.from_regular_faces(np.asarray(scene.vertices), scene.faces.astype(np.int64))
    mesh.cell_data["seen"] = mask
    mesh.cell_data["colors"] = _colors(mask, colors)
    return mesh


def save_gltf(
    scene: Scene,
    path: str | os.PathLike[str],
    seen: Faces,
    *,
    labels: npt.ArrayLike | None = None,
    colors: tuple[Rgb, Rgb] = (SEEN, NEVER_SEEN),
) -> None:
    """Writes a scene as binary glTF that says what of it is seen, for viewers and other programs.

    Each part of the scene, or each patch, is a node with up to two meshes, named after it and "seen" or "never seen";
    these are the names of the two materials, too. A number follows a name that is taken. A mesh has in its ``extras``
    how many faces it has, and the part.

    Parameters
    ----------
    scene : Scene
        Of F faces.
    path : path
        Ending in ``.glb``.
    seen, colors
        As for `to_trimesh`.
    labels : (F,) array_like of int, optional
        The patch of each face; the scene's parts by default.

    Raises
    ------
    ValueError
        If the path ends otherwise, and as for `face_mask`.
    OSError
        If it can't be written.

    Examples
    --------
    >>> import tempfile
    >>> import cyclorama as cyc
    >>> boxes = cyc.scenes.nested_boxes(2)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_gltf(boxes, f"{folder}/boxes.glb", boxes.visible(cyc.Camera.look_at((5, 6, 7), (0, 0, 0))))
    ...     sorted(part.path for part in cyc.load(f"{folder}/boxes.glb").parts)
    ['scene/scene never seen', 'scene/scene seen']
    """
    trimesh: Any = import_module("trimesh")

    if os.path.splitext(os.fspath(path))[1].lower() != ".glb":
        raise ValueError(f"{os.fspath(path)} must end in .glb")
    mask = face_mask(scene, seen)
    materials = {
        name: trimesh.visual.material.PBRMaterial(name=name, baseColorFactor=[*color, 255], doubleSided=True)
        for name, color in zip(("seen", "never seen"), _checked(colors).tolist(), strict=True)
    }
    tree = trimesh.Scene()
    taken = {tree.graph.base_frame}
    # Groups first: a part may have the name that another one's mesh would have.
    for name, faces in [(_free(name, taken), faces) for name, faces in _groups(scene, labels)]:
        tree.graph.update(frame_to=name, frame_from=tree.graph.base_frame)
        for title, own in (("seen", faces[mask[faces]]), ("never seen", faces[~mask[faces]])):
            if not len(own):
                continue
            used, corners = np.unique(scene.faces[own], return_inverse=True)
            mesh = trimesh.Trimesh(
                scene.vertices[used],
                corners.reshape(-1, 3),
                visual=trimesh.visual.TextureVisuals(material=materials[title]),
                metadata={"part": name, "seen": title == "seen", "faces": len(own)},
                process=False,
            )
            node = _free(f"{name} {title}", taken)
            tree.add_geometry(mesh, node_name=node, geom_name=node, parent_node_name=name)
    with whole_path(path) as beside:
        beside.write_bytes(tree.export(file_type="glb"))


def _groups(scene: Scene, labels: npt.ArrayLike | None) -> Iterator[tuple[str, npt.NDArray[np.int64]]]:
    """Names and faces of patches or parts."""
    if labels is None:
        for part in scene.parts:
            yield part.path or part.name or "scene", np.arange(part.start, part.stop)
        return
    array = np.asarray(labels)
    if array.shape != (len(scene),) or array.dtype.kind not in "iu":
        raise ValueError(f"labels must be ({len(scene)},) integers, got {array.shape} {array.dtype}")
    for label in np.unique(array).tolist():
        yield f"patch {label}", np.flatnonzero(array == label)


def _free(name: str, taken: set[str]) -> str:
    """A name that is not taken, and is from now on."""
    numbered = (name if number == 1 else f"{name} {number}" for number in itertools.count(1))
    found = next(candidate for candidate in numbered if candidate not in taken)
    taken.add(found)
    return found


def _colors(mask: Mask, colors: tuple[Rgb, Rgb]) -> npt.NDArray[np.uint8]:
    seen, never = _checked(colors)
    return np.asarray(np.where(mask[:, None], seen, never))


def _checked(colors: tuple[Rgb, Rgb]) -> npt.NDArray[np.uint8]:
    found = checked_floats("colors", colors)
    if found.shape != (2, 3) or not ((found >= 0) & (found <= 255)).all():
        raise ValueError(f"colors must be red, green, blue from 0 to 255, twice, got {colors!r}")
    return found.astype(np.uint8)
