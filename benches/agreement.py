"""Id-buffers at 510 x 480 against Embree, embreex, OpenGL and OpenCV, mesh by mesh.

*differ*: covered pixels with another face at another depth (more than 1e-4 away, relatively); *other id*: those and
the pixels where another face is seen at the same depth (ties, and edges between neighbours). *crossed*: pixels within
whose reach Embree sees another face to some side: 1/256 pixel for OpenGL, which snaps corners to that, 1/4096 for the
others, which compute in float32. *far*: the same against Embree, the scene 10^4 of its sizes from zero in float64.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import peers

NAMES = [
    "bamboo_truss", "brain_icbm152", "bunny", "chair_duplicated_faces", "dragon_100k", "engine_2cylinder", "horse",
    "igea", "kitchen", "legocar", "scorpion", "tray_plate", "tree", "x_wing",
]  # fmt: skip

PEERS = {
    "Embree (Open3D)": (peers.Embree, 1 / 4096),
    "embreex (trimesh)": (peers.TrimeshEmbree, 1 / 4096),
    "OpenGL (pyrender)": (peers.PyrenderIds, 1 / 256),
    "OpenCV 5": (peers.OpenCV, 1 / 4096),
}


def crossed(embree: peers.Embree, camera: cyc.Camera, reach: float) -> np.ndarray:
    """Pixels within `reach` of whose centre, to one of eight sides, another face is nearest."""
    middle = embree.render(camera)[0]
    changes = np.zeros(middle.shape, dtype=bool)
    for dx, dy in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        K = camera.K.copy()
        K[:2, 2] += reach * dx, reach * dy
        changes |= embree.render(camera.replace(K=K))[0] != middle
    return changes


def compare(scene: cyc.Scene, cameras: list[cyc.Camera], peer: peers.Peer) -> tuple[int, int, int]:
    """Covered pixels, those with another id, those of them at another depth."""
    covered = other = differ = 0
    for camera in cameras:
        view = scene.render(camera)
        ids, depth = peer.render(camera)
        seen = (ids != cyc.BACKGROUND) | (view.ids != cyc.BACKGROUND)
        with np.errstate(invalid="ignore"):
            close = np.abs(depth - view.depth) <= 1e-4 * np.minimum(depth, view.depth)
        change = seen & (ids != view.ids)
        covered, other, differ = covered + seen.sum(), other + change.sum(), differ + (change & ~close).sum()
    return int(covered), int(other), int(differ)


def main() -> None:
    asked = bench.options(__doc__, views=3)
    table: list[dict[str, Any]] = []
    for name in ["bunny", "tree"] if asked.quick else NAMES:
        scene = bench.scene(asked.meshes, name)
        cameras = bench.around(scene, asked.views)
        embree = peers.Embree(scene.vertices, scene.faces)
        crossings = {
            reach: sum(int(crossed(embree, camera, reach).sum()) for camera in cameras) for reach in (1 / 4096, 1 / 256)
        }
        for title, (kind, reach) in PEERS.items():
            row: dict[str, Any] = {"mesh": name, "peer": title}
            try:
                peer = kind(scene.vertices, scene.faces)
            except peers.Missing as missing:
                table.append(row | {"agree": str(missing)})
                continue
            covered, other, differ = compare(scene, cameras, peer)
            if isinstance(peer, peers.PyrenderIds):
                peer.close()
            counts = {"covered": covered, "crossed": crossings[reach], "other id": other, "differ": differ}
            table.append(row | counts | {"agree": f"{1 - differ / covered:.6f}"})
        offset = 1e4 * scene.radius * np.array((0.7, -0.5, 0.6))
        there = cyc.Scene(scene.vertices.astype(np.float64) + offset, scene.faces)
        covered, other, differ = compare(
            there, bench.around(there, asked.views), peers.Embree(there.vertices, there.faces)
        )
        row = {"mesh": name, "peer": "Embree, far", "covered": covered, "crossed": crossings[1 / 4096]}
        table.append(row | {"other id": other, "differ": differ, "agree": f"{1 - differ / covered:.6f}"})
    bench.show(
        f"Agreement of id-buffers, {asked.views} views a mesh",
        table,
        ["mesh", "peer", "covered", "crossed", "other id", "differ", "agree"],
    )


if __name__ == "__main__":
    main()
