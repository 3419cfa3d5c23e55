"""Greedy fusion of patches, the slow and obvious way."""

import numpy as np


def shared_edges(vertices, faces):
    """Pairs of faces with two common positions that are ends of a side of both."""
    sides = []
    for face in faces:
        corners = [tuple(vertices[v] + 0.0) for v in face]
        sides.append({frozenset(pair) for pair in zip(corners, corners[1:] + corners[:1], strict=True)})
    proper = [{side for side in s if len(side) == 2} for s in sides]
    return {(a, b) for a in range(len(faces)) for b in range(len(faces)) if a != b and proper[a] & proper[b]}


def tile(vertices, faces, count):
    """Labels of `cyclorama.patches.tile`, from the definition: O(n) patches looked at for each fusion."""
    vertices = np.asarray(vertices, dtype=np.float64)
    triangles = vertices[np.asarray(faces)]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = dict(enumerate(0.5 * np.sqrt((normals**2).sum(axis=1))))
    low, high = dict(enumerate(triangles.min(axis=1))), dict(enumerate(triangles.max(axis=1)))
    members = {face: {face} for face in area}
    neighbors = {face: set() for face in area}
    for a, b in shared_edges(vertices, faces):
        neighbors[a].add(b)

    def diagonal(patches):
        extent = np.max([high[p] for p in patches], axis=0) - np.min([low[p] for p in patches], axis=0)
        return np.sqrt((extent**2).sum())

    while len(members) > count:
        able = [p for p in members if neighbors[p]]
        if not able:
            break
        smallest = min(able, key=lambda p: (area[p], p))
        other = min(neighbors[smallest], key=lambda n: (diagonal([smallest, n]) - diagonal([smallest]), n))
        keep, gone = min(smallest, other), max(smallest, other)
        area[keep] += area.pop(gone)
        low[keep] = np.minimum(low[keep], low.pop(gone))
        high[keep] = np.maximum(high[keep], high.pop(gone))
        members[keep] |= members.pop(gone)
        for n in neighbors.pop(gone) - {keep}:
            neighbors[n] = neighbors[n] - {gone} | {keep}
            neighbors[keep].add(n)
        neighbors[keep] -= {keep, gone}
    labels = np.empty(len(faces), dtype=np.uint32)
    for label, patch in enumerate(sorted(members)):
        labels[list(members[patch])] = label
    return labels
