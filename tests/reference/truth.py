"""What one view truly sees, by Embree (through Open3D), dense enough to judge a sampler by.

A face is visible if some point of it, inside the image, is the nearest surface on its ray. The truth looks for such a
point with `supersample` x `supersample` rays a pixel, and then with `points` uniformly random points on every face
that no such ray has hit. It never reports a face that is hidden; it may miss one of which only a speck can be seen.

Embree computes in float32, so what it says near a tie is decided again in float64: a ray aimed at a point of a face
that ends on another face at that same place sees both, if the two lie in one plane (coincident faces are ties). Faces
without an area are no faces here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

#: Share of the distance within which Embree's float32 hit may be the point that was aimed at.
REACH = 1e-5

#: Faces are coincident if their planes agree this well over the smaller one, in scene radii (float32 coordinates
#: within a few radii of zero are rounded by up to 2e-7 of one).
SAME_PLANE = 1e-6

#: Height over longest edge below which float32 coordinates say nothing of a face's area.
NO_AREA = 1e-7

#: Random points that decide whether an unreported face is seen anywhere but under a reported, coincident one.
EXCUSES = 64


@dataclass(frozen=True)
class Judgement:
    """How an answer compares with the truth, exact duplicates counted once and faces without an area not at all."""

    visible: int  #: truly visible faces
    reported: int  #: faces of the answer that have an area
    missed_faces: np.ndarray  #: visible, and neither reported nor coincident with what is
    false_faces: np.ndarray  #: reported, and confirmed neither by the truth nor by further random points

    @property
    def missed(self) -> float:
        """Share of the visible faces."""
        return len(self.missed_faces) / max(self.visible, 1)

    @property
    def false(self) -> float:
        """Share of the reported faces."""
        return len(self.false_faces) / max(self.reported, 1)


class Truth:
    """The scene as Embree holds it, around zero and of radius one."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        vertices = np.asarray(vertices, dtype=np.float64)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        self.center = (low + high) / 2
        self.radius = float(np.linalg.norm(vertices - self.center, axis=1).max())
        self.faces = np.ascontiguousarray(faces, dtype=np.uint32)
        self.corners = ((vertices - self.center) / self.radius)[self.faces]
        first, second = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        normals = np.cross(first, second)
        doubled = np.linalg.norm(normals, axis=1)
        longest = np.linalg.norm(self.corners - np.roll(self.corners, 1, axis=1), axis=2).max(axis=1)
        self.has_area = doubled > NO_AREA * longest**2
        self.normals = np.divide(normals, doubled[:, None], out=np.zeros_like(normals), where=self.has_area[:, None])
        #: The lowest face with the same three corners: exact duplicates count as one.
        self.original = _first_of_equals(self.corners)
        self._embree = _embree(self.corners)

    def view(self, camera: Any, *, supersample: int = 3, points: int = 16, seed: int = 0) -> View:
        """What `camera` (perspective) truly sees; random points are drawn from `seed`."""
        if getattr(camera, "orthographic", False):
            raise ValueError("the truth casts its rays from an eye, which an orthographic camera has not")
        return View(self, camera, supersample, points, np.random.default_rng(seed))

    def points_on(self, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """(len(faces), count, 3) uniformly random points."""
        u, v = rng.random((2, len(faces), count))
        over = u + v > 1
        u, v = np.where(over, 1 - u, u)[..., None], np.where(over, 1 - v, v)[..., None]
        a, b, c = (self.corners[faces, k][:, None] for k in range(3))
        return a + u * (b - a) + v * (c - a)

    def coincide(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """(N,) whether faces `one` and `other`, which meet at some point, lie in one plane there."""
        distances = [
            np.abs(np.einsum("nkc,nc->nk", self.corners[a] - self.corners[b][:, :1], self.normals[b])).max(axis=1)
            for a, b in ((one, other), (other, one))
        ]
        return (np.minimum(*distances) <= SAME_PLANE) & self.has_area[one] & self.has_area[other]

    def in_front(self, eye: np.ndarray, points: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """(N,) whether, in float64, each face crosses the segment from `eye` to the point, short of the point."""
        a, b, c = (self.corners[faces, k] for k in range(3))
        ray = points - eye
        # The volumes spanned by the ray and each edge as seen from the eye have one sign inside the triangle.
        edges = [np.einsum("nc,nc->n", np.cross(p - eye, q - eye), ray) for p, q in ((a, b), (b, c), (c, a))]
        inside = np.all([e >= 0 for e in edges], axis=0) | np.all([e <= 0 for e in edges], axis=0)
        slope = np.einsum("nc,nc->n", ray, self.normals[faces])
        height = np.einsum("nc,nc->n", a - eye, self.normals[faces])
        t = np.divide(height, slope, out=np.full_like(slope, np.inf), where=slope != 0)
        return inside & (t > 0) & (t < 1 - 1e-9)


class View:
    """The truth of one camera."""

    def __init__(self, truth: Truth, camera: Any, supersample: int, points: int, rng: np.random.Generator) -> None:
        self.truth = truth
        self.width, self.height = camera.width, camera.height
        self._rng = rng
        self._rotation = np.asarray(camera.world_to_camera)[:3, :3]
        self._matrix = np.asarray(camera.K, dtype=np.float64)
        self.eye = (np.asarray(camera.eye) - truth.center) / truth.radius
        #: (F,) bool
        self.visible = np.zeros(len(truth.faces), dtype=bool)
        self._witness = np.zeros((len(truth.faces), 3))
        self._look_through_pixels(supersample)
        self._look_at_faces(points)

    def judge(self, reported: np.ndarray, points: int = 500) -> Judgement:
        """Compares an answer, (F,) bool or ids, with the truth.

        A reported face outside the truth is false if none of `points` further random points on it can be seen.
        """
        answer = np.zeros(len(self.visible), dtype=bool)
        answer[reported] = True
        answer &= self.truth.has_area
        missed = np.flatnonzero(self.visible & ~answer)
        false = np.flatnonzero(answer & ~self.visible)
        original = self.truth.original
        return Judgement(
            len(np.unique(original[self.visible])),
            len(np.unique(original[answer])),
            np.unique(original[missed[~self._excused(missed, answer)]]) if len(missed) else missed,
            np.unique(original[false[~self._confirmed(false, points)]]) if len(false) else false,
        )

    def _look_through_pixels(self, supersample: int) -> None:
        x = (np.arange(self.width * supersample) + 0.5) / supersample
        y = (np.arange(self.height * supersample) + 0.5) / supersample
        inverse = np.linalg.inv(self._matrix)
        rows = max(1, 2**20 // len(x))
        for start in range(0, len(y), rows):
            pixels = np.stack(np.meshgrid(x, y[start : start + rows]), axis=-1).reshape(-1, 2)
            rays = (np.column_stack([pixels, np.ones(len(pixels))]) @ inverse.T) @ self._rotation
            ids, _ = _cast(self.truth._embree, self.eye, rays)
            hit = np.flatnonzero(ids >= 0)
            seen, first = np.unique(ids[hit], return_index=True)
            new = ~self.visible[seen] & self.truth.has_area[seen]
            seen, rays = seen[new], rays[hit[first[new]]]
            height = np.einsum("nc,nc->n", self.truth.corners[seen, 0] - self.eye, self.truth.normals[seen])
            slope = np.einsum("nc,nc->n", rays, self.truth.normals[seen])
            self.visible[seen] = True
            self._witness[seen] = self.eye + rays * (height / np.where(slope == 0, 1, slope))[:, None]

    def _look_at_faces(self, points: int) -> None:
        unseen = np.flatnonzero(~self.visible & self.truth.has_area & self._may_be_in_image)
        for count in _batches(points, first=2):
            aimed = self.truth.points_on(unseen, count, self._rng)
            seen = self.sees(aimed.reshape(-1, 3), np.repeat(unseen, count)).reshape(-1, count)
            found = seen.any(axis=1)
            self.visible[unseen[found]] = True
            self._witness[unseen[found]] = aimed[found, seen[found].argmax(axis=1)]
            unseen = unseen[~found]

    def _confirmed(self, faces: np.ndarray, points: int) -> np.ndarray:
        confirmed = np.zeros(len(faces), dtype=bool)
        for count in _batches(points, first=20):
            left = np.flatnonzero(~confirmed)
            aimed = self.truth.points_on(faces[left], count, self._rng).reshape(-1, 3)
            seen = self.sees(aimed, np.repeat(faces[left], count), lenient=True)
            confirmed[left] = seen.reshape(-1, count).any(axis=1)
        return confirmed

    def _excused(self, faces: np.ndarray, answer: np.ndarray) -> np.ndarray:
        """(N,) whether a coincident face of the answer lies wherever each face can be seen."""
        kept = np.flatnonzero(answer)
        if len(kept) == 0:
            return np.zeros(len(faces), dtype=bool)
        owners = np.repeat(faces, EXCUSES)
        aimed = self.truth.points_on(faces, EXCUSES, self._rng)
        aimed[:, 0] = self._witness[faces]
        aimed = aimed.reshape(-1, 3)
        seen = self.sees(aimed, owners)
        seen[::EXCUSES] = True
        ids, t = _cast(_embree(self.truth.corners[kept]), self.eye, aimed - self.eye)
        covered = (ids >= 0) & (np.abs(t - 1) <= REACH)
        covered[covered] = self.truth.coincide(owners[covered], kept[ids[covered]])
        return (covered | ~seen).reshape(-1, EXCUSES).all(axis=1)

    def sees(self, points: np.ndarray, faces: np.ndarray, *, lenient: bool = False) -> np.ndarray:
        """(N,) whether each point of a face is inside the image and the nearest surface on its ray.

        Embree must hit that face first, or one that coincides with it there. `lenient` also takes a point where it
        hits, within its reach, a face that in float64 is not in front of the point.
        """
        seen = self._in_image(points)
        inside = np.flatnonzero(seen)
        points, faces = points[inside], faces[inside]
        ids, t = _cast(self.truth._embree, self.eye, points - self.eye)
        own = ids == faces
        tie = np.flatnonzero(~own & (ids >= 0) & (np.abs(t - 1) <= REACH))
        own[tie] = self.truth.coincide(faces[tie], ids[tie])
        if lenient:
            tie = tie[~own[tie]]
            own[tie] = ~self.truth.in_front(self.eye, points[tie], ids[tie])
        seen[inside] = own
        return seen

    def _in_image(self, points: np.ndarray) -> np.ndarray:
        x, y, z = ((points - self.eye) @ self._rotation.T @ self._matrix.T).T
        return (z > 0) & (x >= 0) & (y >= 0) & (x <= self.width * z) & (y <= self.height * z)

    @cached_property
    def _may_be_in_image(self) -> np.ndarray:
        """(F,) not wholly outside one of the planes that bound the image."""
        x, y, z = np.moveaxis((self.truth.corners - self.eye) @ self._rotation.T @ self._matrix.T, -1, 0)
        beyond = [z <= 0, x < 0, y < 0, x > self.width * z, y > self.height * z]
        return ~np.any([outside.all(axis=1) for outside in beyond], axis=0)


def _batches(total: int, first: int) -> list[int]:
    """`total` in growing batches, so that what is found early is not looked for again."""
    batches = []
    while total > 0:
        batches.append(min(first, total))
        total -= first
        first *= 2
    return batches


def _first_of_equals(corners: np.ndarray) -> np.ndarray:
    _, welded = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    _, first, group = np.unique(np.sort(welded.reshape(-1, 3), axis=1), axis=0, return_index=True, return_inverse=True)
    return first[group.ravel()]


def _embree(corners: np.ndarray) -> Any:
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        np.ascontiguousarray(corners.reshape(-1, 3), dtype=np.float32),
        np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3),
    )
    return scene


def _cast(scene: Any, eye: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First hits: (N,) ids, -1 where there is none, and (N,) distances in lengths of the rays."""
    import open3d

    packed = np.empty((len(rays), 6), dtype=np.float32)
    packed[:, :3], packed[:, 3:] = eye, rays
    hit = scene.cast_rays(open3d.core.Tensor(packed))
    return hit["primitive_ids"].numpy().view(np.int32), hit["t_hit"].numpy()
