"""Geometry that bends to its backdrop (chapter 5 of the 1998 dissertation).

A flat picture of the far part of a scene is right only for the eye it was made for. Seen from another eye it still
looks whole if the geometry around it moves along: each point is first projected on the picture's plane as seen from the
picture's eye, and that is what the new eye sees (5.1.2, "double projection").

The dissertation infers a projective map of the image from the quadrilateral's four corners. In space that map is a
shear: the one that keeps the plane of the quadrilateral where it is and takes the picture's eye to the new eye. It
keeps straight lines straight and what is in front in front, and a pinhole camera at the picture's eye draws its result
(`bent_camera`): no vertex needs to be moved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .camera import Camera

__all__ = ["ImagePlane", "Plane", "bend", "bent_camera", "geometry_matrix"]

Floats = npt.NDArray[np.float64]

# A corner off the plane of the others by more than this share of the quadrilateral's size makes it no quadrilateral:
# float32 corners a thousand sizes from zero are within it.
_FLAT = 1e-4
# An eye nearer to the plane than this share of the picture's own distance sees nothing of it but its edge, and the
# shear has no inverse there.
_LEAST_DISTANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane before an eye, on which all that lies behind it is projected.

    Attributes
    ----------
    eye : (3,) ndarray of float64
        The center of projection.
    normal : (3,) ndarray of float64
        Unit vector that points away from the eye.
    height : float
        Distance of the eye from the plane.
    """

    eye: Floats
    normal: Floats
    height: float

    @property
    def offset(self) -> float:
        """``normal @ x`` of the plane's points."""
        return float(self.normal @ self.eye + self.height)

    def behind(self, points: npt.ArrayLike) -> Floats:
        """(...) signed distance of (..., 3) points behind the plane: negative on the eye's side."""
        return np.asarray((np.asarray(points, np.float64) - self.eye) @ self.normal - self.height)

    def distance(self, eye: npt.ArrayLike) -> float:
        """How far another eye is in front of the plane.

        Raises
        ------
        ValueError
            If it is not: on the plane or behind it the picture can't be seen, and has to give way to geometry first.
        """
        at = _points("eye", eye, (3,))
        distance = -float(self.behind(at))
        if not distance > _LEAST_DISTANCE * self.height:
            where = "on" if abs(distance) <= _LEAST_DISTANCE * self.height else "behind"
            raise ValueError(
                f"eye {at.tolist()} lies {where} the image's plane (distance {distance:.3g} of "
                f"{self.height:.3g}): return the image to geometry before it is reached"
            )
        return distance

    def seen_from(self, eye: Floats) -> Plane:
        """The same plane before another eye.

        Raises
        ------
        ValueError
            If the eye is not in front of it.
        """
        return Plane(eye, self.normal, self.distance(eye))

    def shear(self, eye: npt.ArrayLike) -> Floats:
        """(4, 4) the map of space that keeps the plane and takes the picture's eye to `eye`."""
        at = _points("eye", eye, (3,))
        self.distance(at)
        matrix = np.eye(4)
        move = (at - self.eye) / self.height
        matrix[:3, :3] -= np.outer(move, self.normal)
        matrix[:3, 3] = move * self.offset
        return matrix


@dataclass(frozen=True, eq=False)
class ImagePlane(Plane):
    """The plane of a picture, and the eye for which it was made.

    Attributes
    ----------
    corners : (4, 3) ndarray of float64
        Top-left, top-right, bottom-right, bottom-left as seen from the eye; made exactly planar.
    """

    corners: Floats

    @classmethod
    def of(cls, corners: npt.ArrayLike, image_eye: npt.ArrayLike) -> ImagePlane:
        """Checks a quadrilateral and the eye of its picture.

        Raises
        ------
        ValueError
            If a value is not finite, the four corners are not planar within 1e-4 of their extent, not convex or not in
            order, or the eye lies on their plane.
        """
        quad, eye = _points("corners", corners, (4, 3)), _points("image_eye", image_eye, (3,))
        across, down = quad[[1, 2]].sum(0) - quad[[0, 3]].sum(0), quad[[3, 2]].sum(0) - quad[[0, 1]].sum(0)
        normal = np.cross(across, down)
        size = float(np.linalg.norm(quad - quad.mean(0), axis=1).max())
        length = float(np.linalg.norm(normal))
        if not length > 1e-12 * size**2:
            raise ValueError(f"corners span no area: {quad.tolist()}")
        normal /= length
        middle = quad.mean(0)
        off = (quad - middle) @ normal
        worst = int(np.abs(off).argmax())
        if abs(off[worst]) > _FLAT * size:
            raise ValueError(
                f"corners[{worst}] lies {abs(off[worst]):.3g} off the plane of the others, of extent {size:.3g}"
            )
        quad = quad - off[:, None] * normal
        turns = np.cross(np.roll(quad, -1, 0) - quad, np.roll(quad, -2, 0) - np.roll(quad, -1, 0)) @ normal
        if not (turns > 0).all():
            raise ValueError(
                f"corners must be convex and in order around, corners[{int(turns.argmin() + 1) % 4}] is not"
            )
        height = float((middle - eye) @ normal)
        if abs(height) <= _LEAST_DISTANCE * size:
            raise ValueError(f"image_eye lies on the plane of the corners (distance {abs(height):.3g})")
        if height < 0:
            raise ValueError(
                "corners must be top-left, top-right, bottom-right, bottom-left as seen from image_eye: "
                "they run the other way round"
            )
        return cls(eye, normal, height, quad)

    def sides(self) -> Floats:
        """(4, 3) unit normals, inward, of the planes through the eye and the top, right, bottom and left edge."""
        rays = self.corners - self.eye
        normals = np.cross(rays, np.roll(rays, -1, 0))
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def geometry_matrix(corners: npt.ArrayLike, image_eye: npt.ArrayLike, camera: Camera) -> Floats:
    """The double projection as one matrix (section 5.1.2).

    Parameters
    ----------
    corners : (4, 3) array_like of float
        Top-left, top-right, bottom-right, bottom-left of the image's quadrilateral, as seen from `image_eye`.
    image_eye : (3,) array_like of float
        The center of projection of the image.
    camera : Camera
        The pinhole camera that looks at it.

    Returns
    -------
    (4, 4) ndarray of float64
        ``M @ (x, y, z, 1) = (u w, v w, d w, w)``: (u, v) is the pixel of `camera` at which the plane of the
        quadrilateral shows the point as seen from `image_eye`, and ``d w`` the signed distance of the point behind
        that plane. At one pixel ``d`` grows with depth; between pixels it is not comparable. ``w`` is positive for
        points in front of `image_eye` whose place on the plane lies in front of the camera; clip others first.

    Raises
    ------
    ValueError
        If the corners are no convex quadrilateral in that order, an eye lies on its plane or behind it, or the camera
        is orthographic.

    Notes
    -----
    The dissertation passes z through unchanged, which does not keep the order of depths between pixels of the plane
    (its 4 x 4 matrix, 5.1.2); here the third row is the distance behind the plane.

    Examples
    --------
    >>> camera = Camera.look_at((0, 0, 5), (0, 0, 0), width=64, height=48)
    >>> M = geometry_matrix([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], (0, 0, 4), camera)
    >>> u, v, d, w = M @ (1, 0, -4, 1)          # seen from (0, 0, 4) the plane shows it at (0.5, 0, 0)
    >>> np.allclose((u / w, v / w), camera.project((0.5, 0, 0))[0]), round(float(d), 3)
    (True, 4.0)
    """
    plane = ImagePlane.of(corners, image_eye)
    plane.distance(camera.eye)
    # A point's place on the plane, times how far the point is in front of the image's eye; then that number.
    ahead = np.append(plane.normal, -plane.normal @ plane.eye)
    place = np.vstack([np.outer(plane.eye, ahead), ahead])
    place[:3] += plane.height * np.column_stack([np.eye(3), -plane.eye])
    matrix = np.empty((4, 4))
    matrix[[0, 1, 3]] = camera.K @ camera.world_to_camera[:3] @ place
    matrix[2] = np.append(plane.normal, -plane.offset)
    return matrix


def bend(points: npt.ArrayLike, corners: npt.ArrayLike, image_eye: npt.ArrayLike, eye: npt.ArrayLike) -> Floats:
    """Moves points so that `eye` sees them where the image's plane shows them as seen from `image_eye`.

    Parameters
    ----------
    points : (..., 3) array_like of float
        World positions.
    corners, image_eye
        As for `geometry_matrix`.
    eye : (3,) array_like of float
        The eye that looks; in front of the plane.

    Returns
    -------
    (..., 3) ndarray of float64
        Points of the plane stay; each other one moves parallel to ``eye - image_eye``, in proportion to its distance
        from the plane. Along a ray of `eye` the order of depths is that along the ray of `image_eye`.

    Raises
    ------
    ValueError
        As for `geometry_matrix`.

    Examples
    --------
    >>> quad = [[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]
    >>> bend([[0, 0, 0], [0, 0, 4], [1, 0, -4]], quad, (0, 0, 4), (2, 0, 4))
    array([[ 0.,  0.,  0.],
           [ 2.,  0.,  4.],
           [-1.,  0., -4.]])
    """
    matrix = ImagePlane.of(corners, image_eye).shear(eye)
    return np.asarray(np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3])


def bent_camera(plane: Plane, camera: Camera) -> tuple[Camera, float]:
    """A camera at the image's eye that draws all geometry as `camera` would draw it bent.

    Parameters
    ----------
    plane : Plane
        The image's plane and eye.
    camera : Camera
        The pinhole camera that looks.

    Returns
    -------
    bent : Camera
        Of the same size. Its pixel of any point is that of `geometry_matrix`.
    scale : float
        Its depths times this are the depths, for `camera`, of the bent points.

    Raises
    ------
    ValueError
        If the camera is orthographic, or its eye is not in front of the plane.

    Examples
    --------
    >>> quad = [[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]
    >>> camera = Camera.look_at((1, 0, 5), (0, 0, 0), width=64, height=48)
    >>> bent, scale = bent_camera(ImagePlane.of(quad, (0, 0, 4)), camera)
    >>> pixel, depth = bent.project((1, 0, -4))
    >>> np.allclose(pixel, camera.project((0.5, 0, 0))[0])
    True
    """
    shear = plane.shear(camera.eye)
    # From offsets to the image's eye to homogeneous pixels; depth is the last row.
    view = camera.K @ camera.world_to_camera[:3, :3] @ shear[:3, :3]
    intrinsics, rotation = _triangular(view)
    scale = float(intrinsics[2, 2])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ plane.eye
    near = camera.near / scale
    return Camera(intrinsics / scale, pose, camera.width, camera.height, near=near), scale


def _triangular(matrix: Floats) -> tuple[Floats, Floats]:
    """An upper triangle with positive diagonal, and a rotation, whose product is a matrix of positive determinant."""
    flipped = np.linalg.qr(matrix[::-1].T)
    upper, rotation = flipped.R.T[::-1, ::-1], flipped.Q.T[::-1]
    signs = np.sign(np.diag(upper))
    triangle = upper * signs
    triangle[np.tril_indices(3, -1)] = 0.0
    return np.asarray(triangle), np.asarray(rotation * signs[:, None])


def _points(name: str, value: npt.ArrayLike, shape: tuple[int, ...]) -> Floats:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    for index in np.argwhere(~np.isfinite(array)):
        raise ValueError(f"{name}{index.tolist()} is {array[tuple(index)]}: coordinates must be finite")
    return array
