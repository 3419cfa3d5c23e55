"""Where to take the images from of which a layered image is built (1998 dissertation, section 4.3.2).

An image stands in for what lies behind a quadrilateral, for every eye of a star-shape whose frustum can contain that
quadrilateral: some hemi-ellipsoid before it. The dissertation takes one image at the star's center and eight at half
the vectors to the midpoints of the quadrilateral's edges, four before the center and four behind it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .camera import Camera

__all__ = ["camera_through", "construction_cameras", "quadrilateral"]

Floats = npt.NDArray[np.float64]


def quadrilateral(camera: Camera, distance: float) -> Floats:
    """The quadrilateral that fills a camera's image at some depth.

    Parameters
    ----------
    camera : Camera
        A pinhole camera.
    distance : float
        Depth of the quadrilateral, in scene units.

    Returns
    -------
    (4, 3) ndarray of float64
        Top-left, top-right, bottom-right, bottom-left as the camera sees them.

    Raises
    ------
    ValueError
        If `distance` isn't positive or the camera is orthographic.

    Examples
    --------
    >>> quadrilateral(Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=90, width=4, height=4), 2)[0]
    array([-2.,  2., -2.])
    """
    if camera.orthographic:
        raise ValueError("camera is orthographic: it has no center of projection")
    if not (np.isfinite(distance) and distance > 0):
        raise ValueError(f"distance must be positive and finite, got {distance}")
    w, h = camera.width, camera.height
    return camera.unproject([(0, 0), (w, 0), (w, h), (0, h)], np.full(4, float(distance)))


def camera_through(
    eye: npt.ArrayLike,
    corners: npt.ArrayLike,
    size: tuple[int, int] = (512, 384),
    *,
    margin: float = 0.0,
    clip: bool = False,
) -> Camera:
    """The camera at an eye whose image is the view through a quadrilateral.

    Parameters
    ----------
    eye : (3,) array_like of float
        Center of projection.
    corners : (4, 3) array_like of float
        Top-left, top-right, bottom-right, bottom-left as seen from the eye. The camera looks at a right angle to their
        plane; if they are no rectangle, through the smallest one along their top edge that contains them.
    size : (int, int)
        Width and height in pixels of what is seen through the quadrilateral.
    margin : float
        How much more than that the image holds on every side, as a share of the quadrilateral's side; the pixels keep
        their size, so the image grows.
    clip : bool
        Set the near plane to the quadrilateral: what lies before it is not in the image.

    Raises
    ------
    ValueError
        If the corners don't span a plane, or the eye isn't on the side from which they run clockwise.

    Examples
    --------
    >>> corners = [(-1, 1, -2), (1, 1, -2), (1, -1, -2), (-1, -1, -2)]
    >>> camera_through((0, 0, 0), corners, (100, 100)).fov_x
    53.13...
    >>> camera_through((0.5, 0, -1), corners, (100, 100)).project(corners)[0][2]
    array([100., 100.])
    """
    position, points = _point("eye", eye), _corners(corners)
    right = points[1] - points[0]
    forward = np.cross(points[2] - points[0], points[3] - points[1])
    # Twice the area is the length of the diagonals' cross product; of a rectangle it is the normal away from the eye.
    if not (np.linalg.norm(right) > 0 and np.linalg.norm(forward) > 1e-12 * np.ptp(points, axis=0).max() ** 2):
        raise ValueError(f"corners span no plane: {points.tolist()}")
    z = forward / np.linalg.norm(forward)
    x = right - z * (z @ right)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    rotation = np.stack([x, y, z])
    local = (points - position) @ rotation.T
    distance = local[:, 2].mean()
    if not local[:, 2].min() > 0:
        raise ValueError(f"eye {position.tolist()} is not before the quadrilateral {points.tolist()}")
    slopes = local[:, :2] / local[:, 2:]
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    pixels = np.asarray(size, dtype=np.float64)
    focal = pixels / (high - low)
    more = np.ceil(margin * pixels)
    K = np.diag([*focal, 1.0])
    K[:2, 2] = -focal * low + more
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ position
    width, height = (int(side) for side in pixels + 2 * more)
    return Camera(K, pose, width, height, near=float(distance) if clip else 0.0)


def construction_cameras(
    eye: npt.ArrayLike,
    corners: npt.ArrayLike,
    star_radius: float,
    size: tuple[int, int] = (512, 384),
    *,
    margin: float = 0.0,
    clip: bool = False,
) -> list[Camera]:
    """The nine cameras of a layered image: the central one, four before it, and four behind it.

    Parameters
    ----------
    eye : (3,) array_like of float
        The star's center: the grid viewpoint at which the central image is taken.
    corners : (4, 3) array_like of float
        The image quadrilateral: top-left, top-right, bottom-right, bottom-left as seen from `eye`.
    star_radius : float
        Radius of the star-shape around `eye`.
    size, margin, clip
        As for `camera_through`.

    Returns
    -------
    list of 9 Camera
        All look in the same direction, through the quadrilateral. The central one is first, and nearer ones come before
        farther ones: `LayeredDepthImage.build(images[0], images[1:])` gives the nearest precedence.

    Raises
    ------
    ValueError
        As for `camera_through`, and if `star_radius` isn't positive.

    Notes
    -----
    The dissertation places them at half the vectors from the eye to the midpoints of the quadrilateral's edges, which
    leaves the star-shape once the image is beyond about twice its radius (figure 4-7's image B). Here the vector is
    half that to an image just outside the star-shape, at most: there both rules are the same.

    Examples
    --------
    >>> camera = Camera.look_at((0, 0, 0), (0, 0, -1), fov_y=60)
    >>> cameras = construction_cameras(camera.eye, quadrilateral(camera, 4.0), star_radius=1.0)
    >>> len(cameras), max(float(np.linalg.norm(c.eye)) for c in cameras) < 1
    (9, True)
    """
    position, points = _point("eye", eye), _corners(corners)
    if not (np.isfinite(star_radius) and star_radius > 0):
        raise ValueError(f"star_radius must be positive and finite, got {star_radius}")
    central = camera_through(position, points, size, margin=margin, clip=clip)
    distance = float((central.project(points)[1]).mean())
    to_edges = (points + np.roll(points, -1, axis=0)) / 2 - position
    share = 0.5 * min(1.0, star_radius / distance)
    steps = to_edges * share
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    steps *= np.minimum(1.0, star_radius / lengths)
    others = [
        camera_through(position + sign * step, points, size, margin=margin, clip=clip)
        for sign in (1.0, -1.0)
        for step in steps
    ]
    return [central, *others]


def _point(name: str, value: npt.ArrayLike) -> Floats:
    point = np.asarray(value, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ValueError(f"{name} must be (3,) finite, got {value!r}")
    return point


def _corners(corners: npt.ArrayLike) -> Floats:
    points = np.asarray(corners, dtype=np.float64)
    if points.shape != (4, 3) or not np.isfinite(points).all():
        raise ValueError(f"corners must be (4, 3) finite, got {corners!r}")
    return points
