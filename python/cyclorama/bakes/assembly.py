"""Scenes made of baked objects, each asked in its own frame (the selection node: 2001 and 2002, section 5)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from .visibility import Visibility

__all__ = ["Assembly", "Placed"]

Floats = npt.NDArray[np.float64]
Ids = npt.NDArray[np.uint32]


@dataclass(frozen=True)
class Placed:
    """An object of an assembly.

    Attributes
    ----------
    visibility : Visibility
        Its bake, which instances share.
    to_world : (4, 4) ndarray of float64
        From its frame to the world's.
    center : (3,) ndarray of float64
        Middle of its bounding sphere, in the world.
    radius : float
        Radius of a sphere around `center` that holds it, in the world.
    """

    visibility: Visibility
    to_world: Floats
    to_own: Floats
    center: Floats
    radius: float


class Assembly:
    """Objects with a bake each, placed in one world.

    Parameters
    ----------
    objects : iterable of (Visibility, (4, 4) array_like of float)
        A bake, and the affine map from its frame to the world's, acting on columns. What hides what does not change
        under such a map, so it may scale and shear. The same bake may be placed many times.

    Raises
    ------
    ValueError
        If a transform is not finite, not affine, or flattens space; the message names its index.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> vis = cyc.bake(cyc.scenes.sphere(faces=320), 18, resolution=(64, 64), progress=False)
    >>> aside = np.eye(4)
    >>> aside[0, 3] = 3
    >>> camera = cyc.Camera.look_at((0, 0, 9), (0, 0, 0), fov_y=15)
    >>> here, there = Assembly([(vis, np.eye(4)), (vis, aside)]).visible(camera)
    >>> len(here) > 0, len(there)
    (True, 0)
    """

    def __init__(self, objects: Iterable[tuple[Visibility, npt.ArrayLike]]) -> None:
        self.objects = [_placed(index, vis, transform) for index, (vis, transform) in enumerate(objects)]

    def __len__(self) -> int:
        """Number of objects."""
        return len(self.objects)

    def __repr__(self) -> str:
        bakes = len({id(placed.visibility) for placed in self.objects})
        return f"<Assembly: {len(self)} objects, {bakes} bakes>"

    def in_view(self, camera: Camera) -> npt.NDArray[np.bool_]:
        """(N,) objects whose bounding sphere is not wholly outside one side of the camera's frustum."""
        if not self.objects:
            return np.zeros(0, dtype=bool)
        centers = np.array([placed.center for placed in self.objects])
        radii = np.array([placed.radius for placed in self.objects])
        local = centers @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
        normals, offsets = _frustum(camera)
        distances = local @ normals.T + offsets
        return np.asarray((distances >= -radii[:, None]).all(axis=1))

    def visible(self, camera: Camera) -> list[Ids]:
        """Faces to draw of each object.

        Parameters
        ----------
        camera : Camera
            Perspective or orthographic.

        Returns
        -------
        list of (K,) ndarray of uint32
            One array an object, in the order given: its own face numbers, ascending; empty for an object out of view.
            Objects do not hide one another here.
        """
        shown = self.in_view(camera)
        nothing = np.empty(0, dtype=np.uint32)
        return [
            self._ask(placed, camera) if seen else nothing for placed, seen in zip(self.objects, shown, strict=True)
        ]

    def _ask(self, placed: Placed, camera: Camera) -> Ids:
        linear = placed.to_own[:3, :3]
        if camera.orthographic:
            return placed.visibility.visible_along(linear @ -camera.forward)
        return placed.visibility.visible_faces(linear @ camera.eye + placed.to_own[:3, 3])


def _placed(index: int, vis: Visibility, transform: npt.ArrayLike) -> Placed:
    to_world = np.array(transform, dtype=np.float64)
    if to_world.shape != (4, 4) or not np.isfinite(to_world).all():
        raise ValueError(f"objects[{index}]: the transform must be (4, 4) finite numbers, got shape {to_world.shape}")
    if to_world[3].tolist() != [0, 0, 0, 1]:
        raise ValueError(f"objects[{index}]: the transform's last row must be (0, 0, 0, 1), got {to_world[3].tolist()}")
    stretch = np.linalg.svd(to_world[:3, :3], compute_uv=False)
    if not stretch[-1] > 1e-12 * stretch[0]:
        raise ValueError(f"objects[{index}]: the transform flattens space, its stretches are {stretch.tolist()}")
    center = to_world[:3, :3] @ vis.sphere.center + to_world[:3, 3]
    inverse = np.asarray(np.linalg.inv(to_world), dtype=np.float64)
    return Placed(vis, to_world, inverse, center, float(stretch[0]) * vis.model_radius)


def _frustum(camera: Camera) -> tuple[Floats, Floats]:
    """Inward unit normals (5, 3) and offsets (5,) of the image's sides and of the near plane, in the camera's axes."""
    across, down = camera.K[0], camera.K[1]
    sides = np.array([across, -across, down, -down])
    # A side says a x + b y + c z >= 0, or a x + b y + c >= 0 where the rays are parallel.
    sides[1, 2] += camera.width
    sides[3, 2] += camera.height
    normals, offsets = sides.copy(), np.zeros(4)
    if camera.orthographic:
        normals[:, 2], offsets = 0.0, sides[:, 2]
    length = np.linalg.norm(normals, axis=1)
    return np.vstack([normals / length[:, None], [0, 0, 1]]), np.append(offsets / length, -camera.near)
