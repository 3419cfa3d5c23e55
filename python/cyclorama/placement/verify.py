"""A second opinion on the proof of a plan: plain NumPy that shares no code with what made it.

A certificate has cells (groups of faces), images, and boxes of eyes and gazes with the image that serves each. Checked
are: each face is in one cell; the boxes leave nothing of the domain out; and for each box, that its image lies beyond
all of its eyes, its viewpoint behind all of them along all gazes, and that the cells which any of them may see and
which are not wholly behind the image have no more faces than the budget.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..archives import read_archive
from ..fingerprint import fingerprint
from ..scene import Scene

__all__ = ["FORMAT", "ROUNDING", "cell_boxes", "check_proof", "verify"]

FORMAT = "cyclorama placement certificate 1"

Floats = npt.NDArray[np.float64]

# Roundings of lengths of a scene at its distance from zero: shares of the largest coordinate.
ROUNDING = 1e-13


def verify(certificate: str | os.PathLike[str], scene: Scene) -> int:
    """Checks a certificate that `Plan.certify` wrote against the scene; the number of boxes in it.

    Parameters
    ----------
    certificate : path
    scene : Scene
        `Plan.whole`: with its levels of detail, where it has any. What can be seen from where is believed.

    Raises
    ------
    ValueError
        If the file is not a whole certificate, is of another scene, or proves less than it says: the message names
        what fails first.
    FileNotFoundError
        If there is no such file.
    """
    with read_archive(certificate, FORMAT, "certificate of a placement") as (header, file):
        if header["scene"] != fingerprint(scene):
            raise ValueError("it is of another scene, or the scene has changed since")
        return check_proof(header, {name: file[name] for name in file.files if name != "header"}, scene)


def cell_boxes(order: npt.NDArray[np.uint32], starts: npt.NDArray[np.int64], scene: Scene) -> tuple[Floats, Floats]:
    """(C, 3) lowest and highest coordinates of the faces of each cell: those from its start to the next one's.

    Raises
    ------
    ValueError
        If a face is in no cell, or in two.
    """
    if not np.array_equal(np.sort(order), np.arange(len(scene.faces), dtype=np.uint32)):
        raise ValueError("a face is in no cell, or in two")
    if len(starts) == 0 or starts[0] != 0 or (np.diff(starts) <= 0).any() or starts[-1] >= len(order):
        raise ValueError("the cells are not in order, or one is empty")
    corners = scene.vertices.astype(np.float64)[scene.faces[order]]
    return np.minimum.reduceat(corners.min(axis=1), starts), np.maximum.reduceat(corners.max(axis=1), starts)


def details(
    header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]]
) -> tuple[Floats, Floats, npt.NDArray[np.uint32]]:
    """Of each cell, (C, 2), the distances from the eye between which it is drawn; boxes of eyes, (R, 2, 3), and how
    many faces of each cell can be seen from there, (R, C)."""
    order, starts = arrays["order"], arrays["starts"]
    levels = np.array(header["levels"], dtype=np.float64).reshape(-1, 3)
    if len(levels):
        level = np.searchsorted(levels[:, 0], order[starts], side="right")
        spans = np.ascontiguousarray(levels[level, 1:])
    else:
        spans = np.tile([0.0, np.inf], (len(starts), 1))
    regions = arrays.get("regions", np.zeros((0, 2, 3)))
    seen = np.zeros((len(regions), len(starts)), np.uint32)
    for row, words in zip(seen, arrays.get("visible", np.zeros((0, 0), np.uint64)), strict=True):
        bits = np.unpackbits(words.astype("<u8").view(np.uint8), bitorder="little")[: len(order)]
        row[:] = np.add.reduceat(bits[order].astype(np.uint32), starts)
    return spans, regions, seen


def check_proof(header: Mapping[str, Any], arrays: Mapping[str, npt.NDArray[Any]], scene: Scene) -> int:
    """Checks the parts of a certificate; see `verify`."""
    low, high = cell_boxes(arrays["order"], arrays["starts"], scene)
    faces = np.diff(np.append(arrays["starts"], len(scene.faces)))
    boxes, served = arrays["boxes"], arrays["served"]
    viewpoints, corners = arrays["viewpoints"], arrays["corners"]
    domain = np.asarray(header["domain"], dtype=np.float64)
    pitch = header["pitch"]
    region = np.array([*domain.T, [0.0, 2 * np.pi], pitch])
    spans = np.stack([boxes[:, [0, 1, 2, 6, 8]], boxes[:, [3, 4, 5, 7, 9]]], axis=2)
    if not np.isfinite(boxes).all() or len(served) != len(boxes) or not _covers(spans, region):
        raise ValueError("the boxes leave a part of the domain out")
    if ((served < -1) | (served >= len(viewpoints))).any():
        raise ValueError("a box names an image that is not there")
    axes = np.asarray(header["axes"], dtype=np.float64)
    if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-12) or np.linalg.det(axes) < 0:
        raise ValueError("its axes are no rotation")
    slack = ROUNDING * float(np.abs([low, high]).max() + np.abs(domain).max())
    planes = [_image_planes(v, c) for v, c in zip(viewpoints, corners, strict=True)]
    culled = np.array([_behind(low, high, p, slack) for p in planes]).reshape(len(planes), len(low))
    centers = np.hstack([(low + high) / 2, (high - low) / 2])
    spans, regions, seen = details(header, arrays)
    for index, (box, image) in enumerate(zip(boxes, served, strict=True)):
        eyes = box[:3], box[3:6]
        normals = _normals(box[6:8], box[8:10], axes, header["tangents"])
        flat = normals.reshape(-1, 3)
        nearest = np.where(flat > 0, eyes[0], eyes[1])
        least = (flat * nearest).sum(axis=1)
        reach = centers @ np.hstack([flat, np.abs(flat)]).T
        outside = (reach < least - slack).reshape(len(low), 4, -1).all(axis=2).any(axis=1)
        nearest_at = np.maximum(np.maximum(low - eyes[1], eyes[0] - high), 0)
        farthest_at = np.maximum(np.abs(high - eyes[0]), np.abs(eyes[1] - low))
        left = ~outside & (np.linalg.norm(nearest_at, axis=1) < spans[:, 1] + slack)
        left &= np.linalg.norm(farthest_at, axis=1) >= spans[:, 0] - slack
        if image >= 0:
            if (flat @ viewpoints[image] > least + slack).any():
                raise ValueError(f"box {index}: viewpoint {image} is not in the reverse frustum of all its eyes")
            normal, offset = planes[image][0][0], planes[image][1][0]
            if np.where(normal > 0, eyes[1], eyes[0]) @ normal >= offset:
                raise ValueError(f"box {index}: an eye lies past the plane of image {image}")
            left &= ~culled[image]
        counts = faces
        if len(regions):
            within = (regions[:, 0] <= eyes[0] + slack).all(axis=1) & (regions[:, 1] >= eyes[1] - slack).all(axis=1)
            if not within.any():
                raise ValueError(f"box {index}: it lies in none of the regions")
            counts = seen[int(np.argmax(within))]
        count = int(counts[left].sum())
        if count > header["budget"]:
            raise ValueError(f"box {index}: {count} faces are left by image {image}, the budget is {header['budget']}")
    return len(boxes)


def _covers(spans: Floats, region: Floats) -> bool:
    """Whether boxes, (L, 5, 2), leave nothing of a region, (5, 2), out; they must be parts of repeated cuts."""
    stack = [(np.arange(len(spans)), region)]
    while stack:
        rows, region = stack.pop()
        if len(rows) == 0:
            return False
        if len(rows) == 1:
            box = spans[rows[0]]
            if (box[:, 0] > region[:, 0]).any() or (box[:, 1] < region[:, 1]).any():
                return False
            continue
        for axis in range(5):
            by_low = rows[np.argsort(spans[rows, axis, 0], kind="stable")]
            ends = np.maximum.accumulate(spans[by_low, axis, 1])[:-1]
            starts = spans[by_low[1:], axis, 0]
            cuts = np.flatnonzero((ends <= starts) & (starts > spans[by_low[0], axis, 0]))
            if len(cuts):
                cut = int(cuts[len(cuts) // 2])
                below, above = region.copy(), region.copy()
                below[axis, 1] = above[axis, 0] = starts[cut]
                stack += [(by_low[: cut + 1], below), (by_low[cut + 1 :], above)]
                break
        else:
            return False
    return True


def _image_planes(viewpoint: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Unit normals, (5, 3), and offsets of the plane of a quadrilateral and of the sides of its pyramid, inward."""
    normal = np.cross(corners[2] - corners[0], corners[1] - corners[3])
    normal *= np.sign(normal @ (corners[0] - viewpoint))
    middle = corners.mean(axis=0) - viewpoint
    rays = corners - viewpoint
    sides = np.cross(rays, np.roll(rays, -1, axis=0))
    sides *= np.sign(sides @ middle)[:, None]
    normals = np.vstack([normal, sides])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # All corners lie in the plane; the nearest says where it is, whatever was rounded.
    offsets = normals @ viewpoint
    offsets[0] = (corners @ normals[0]).max()
    return normals, offsets


def _behind(low: Floats, high: Floats, planes: tuple[Floats, Floats], slack: float) -> npt.NDArray[np.bool_]:
    """Whether boxes lie wholly on the inner side of all planes."""
    normals, offsets = planes
    least = np.maximum(normals, 0) @ low.T + np.minimum(normals, 0) @ high.T
    return np.asarray((least >= offsets[:, None] - slack).all(axis=0))


def _arc(low: float, high: float) -> Floats:
    """(3, 2) cosines and sines of the corners of a triangle around an arc, (1, 2) if it is a point."""
    if low == high:
        return np.array([[np.cos(low), np.sin(low)]])
    middle, half = (low + high) / 2, (high - low) / 2
    angles = np.array([low, middle, high])
    corners = np.column_stack([np.cos(angles), np.sin(angles)])
    corners[1] /= np.cos(half)
    return corners


def _normals(yaw: Floats, pitch: Floats, axes: Floats, tangents: tuple[float, float]) -> Floats:
    """(4, up to 9, 3) corners of hulls of the inward unit normals of the side planes, over all the gazes."""
    ahead, beside, up = axes
    tan_x, tan_y = tangents
    # To the right, forward, up.
    sides = np.array([[1, tan_x, 0], [-1, tan_x, 0], [0, tan_y, 1], [0, tan_y, -1]])
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    level = np.stack([ahead, beside])
    rights = np.cross(level, up)
    normals = []
    for cos_p, sin_p in _arc(*pitch):
        along = (sides[:, 1] * cos_p - sides[:, 2] * sin_p)[:, None]
        rise = (sides[:, 1] * sin_p + sides[:, 2] * cos_p)[:, None] * up
        for turn in _arc(*yaw):
            normals.append(sides[:, :1] * (turn @ rights) + along * (turn @ level) + rise)
    return np.stack(normals, axis=1)
