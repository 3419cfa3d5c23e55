"""Octrees as chapter 7 tells them: lists of faces, cut in eight, with every separating axis tried by name."""

import itertools

import numpy as np


def overlaps(triangles, low, high):
    """Whether each triangle (..., 3, 3) and box (..., 3) have a point in common: no axis of thirteen separates them."""
    triangles, low, high = (np.asarray(a, dtype=float) for a in (triangles, low, high))
    corners = np.stack([np.where(pick, high, low) for pick in itertools.product([False, True], repeat=3)], axis=-2)
    edges = np.roll(triangles, -1, axis=-2) - triangles
    axes = [np.broadcast_to(axis, triangles[..., 0, :].shape) for axis in np.eye(3)]
    axes.append(np.cross(edges[..., 0, :], edges[..., 1, :]))
    axes += [np.cross(axis, edges[..., k, :]) for axis in np.eye(3) for k in range(3)]
    apart = np.zeros(triangles.shape[:-2], dtype=bool)
    for axis in axes:
        t, b = (np.einsum("...ij,...j->...i", points, axis) for points in (triangles, corners))
        apart |= (t.max(axis=-1) < b.min(axis=-1)) | (b.max(axis=-1) < t.min(axis=-1))
    return ~apart


def leaves(triangles, leaf_faces, depth, stop):
    """(level, faces) of what each cell keeps for itself, in no order; `stop` is None for the efficient tree."""
    middle = (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1))) / 2
    half = (triangles.max(axis=(0, 1)) - triangles.min(axis=(0, 1))).max() / 2
    kept = []

    def divide(ages, middle, half, level):
        faces = list(ages)
        parts = [middle + half / 2 * np.array(signs) for signs in itertools.product([-1, 1], repeat=3)]
        touched = np.array([overlaps(triangles[faces], part - half / 2, part + half / 2) for part in parts])
        crossing = touched.sum(axis=0) > 1
        ages = {
            f: 0 if age is None and crosses else age for (f, age), crosses in zip(ages.items(), crossing, strict=True)
        }
        down = [f for f, age in ages.items() if age is None or stop is None or age < stop]
        copies = sum(touched[:, faces.index(f)].sum() for f in down)
        if len(faces) <= leaf_faces or level == depth or not down or copies > 2 * len(down):
            kept.append((level, frozenset(faces)))
            return
        if set(faces) - set(down):
            kept.append((level, frozenset(faces) - frozenset(down)))
        for part, inside in zip(parts, touched, strict=True):
            below = {
                f: ages[f] if ages[f] is None else ages[f] + 1
                for f, here in zip(faces, inside, strict=True)
                if here and f in down
            }
            if below:
                divide(below, part, half / 2, level + 1)

    divide(dict.fromkeys(range(len(triangles))), middle, half, 0)
    return kept
