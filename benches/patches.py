"""Time to tile meshes into patches, the asked counts against the made ones, and whether each patch is connected.

The last mesh is a scan of which every face is cut in four: a million faces, to be tiled in less time than 800,000 may
take.
"""

from __future__ import annotations

import warnings
from functools import partial

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab, patches


def subdivided(scene: cyc.Scene) -> cyc.Scene:
    """Every face in four, by the midpoints of its edges."""
    edges = np.sort(scene.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, which = np.unique(edges, axis=0, return_inverse=True)
    middle = (len(scene.vertices) + which.reshape(-1, 3)).astype(np.uint32)
    vertices = np.concatenate([scene.vertices, scene.vertices[unique].mean(axis=1)])
    (a, b, c), (ab, bc, ca) = scene.faces.T, middle.T
    faces = np.concatenate(
        [np.column_stack(corner) for corner in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )
    return cyc.Scene(vertices, faces)


def connected(scene: cyc.Scene, labels: np.ndarray) -> bool:
    """Whether each patch hangs together along edges, by SciPy's components of the graph of faces."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    offsets, neighbors = patches.adjacency(scene.vertices, scene.faces)
    ours = np.repeat(np.arange(len(scene)), np.diff(offsets.astype(np.int64)))
    same = labels[ours] == labels[neighbors]
    graph = coo_matrix((np.ones(same.sum()), (ours[same], neighbors[same])), shape=(len(scene), len(scene)))
    return connected_components(graph, directed=False)[0] == len(np.unique(labels))


def main() -> None:
    asked = bench.options(__doc__, rounds=3)
    jobs = [("bunny", 300, 2.0), ("bunny", 2000, None), ("horse", 400, None), ("engine_2cylinder", 1000, None)]
    jobs = jobs[:1] if asked.quick else [*jobs, ("dragon_100k", 600, None), ("igea, subdivided", 1000, 30.0)]
    rows = []
    for name, count, limit in jobs:
        scene = bench.scene(asked.meshes, name.split(",")[0])
        if name.endswith("subdivided"):
            scene = subdivided(scene)
        tile = partial(patches.tile, scene.vertices, scene.faces, count, progress=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            labels = tile()
            ms = lab.medians({name: tile}, asked.rounds, warm_up=0)[name]
        rows.append(
            {
                "mesh": name,
                "faces": len(scene),
                "asked": count,
                "made": len(np.unique(labels)),
                "seconds": ms / 1e3,
                "asked for, s": limit,
                "connected": "yes" if connected(scene, labels) else "NO",
            }
        )
    bench.show(f"Patches, medians of {asked.rounds} runs", rows)


if __name__ == "__main__":
    main()
