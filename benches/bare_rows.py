"""66 bare rows of bits at 510 x 480: `scene.visible(cameras, fill=None)` against Open3D doing the whole job.

Open3D casts a ray a pixel on all cores; NumPy scatters the hit faces and packs the bits. Rays come once from cached
directions in NumPy and once from `create_rays_pinhole`; the faster of the two is the one to beat. Building the
acceleration structure is left out on both sides. Rounds are interleaved; the median is kept.
"""

from __future__ import annotations

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab


class OpenedScene:
    """The mesh in Open3D's ray caster."""

    def __init__(self, scene: cyc.Scene, cameras: list[cyc.Camera]) -> None:
        import open3d

        self.tensor = open3d.core.Tensor
        self.caster = open3d.t.geometry.RaycastingScene()
        self.caster.add_triangles((scene.vertices - scene.center).astype(np.float32), scene.faces)
        self.center, self.cameras, self.count = scene.center, cameras, len(scene)
        first = cameras[0]
        pixels = np.stack(np.meshgrid(np.arange(first.width) + 0.5, np.arange(first.height) + 0.5), axis=-1)
        homogeneous = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
        self.directions = (homogeneous @ np.linalg.inv(first.K).T).astype(np.float32)

    def numpy_rays(self, camera: cyc.Camera) -> object:
        rays = np.empty((camera.height, camera.width, 6), np.float32)
        rays[..., :3] = camera.eye - self.center
        np.matmul(self.directions, camera.world_to_camera[:3, :3].astype(np.float32), out=rays[..., 3:])
        return self.tensor(rays)

    def own_rays(self, camera: cyc.Camera) -> object:
        pose = camera.world_to_camera.copy()
        pose[:3, 3] += pose[:3, :3] @ self.center
        matrices = self.tensor(camera.K), self.tensor(pose)
        return self.caster.create_rays_pinhole(*matrices, camera.width, camera.height)

    def rows(self, make_rays: str) -> list[np.ndarray]:
        rows = []
        for camera in self.cameras:
            hit = self.caster.cast_rays(getattr(self, make_rays)(camera))
            seen = np.zeros(self.count + 1, bool)
            seen[hit["primitive_ids"].numpy().view(np.int32).ravel()] = True
            rows.append(np.packbits(seen[: self.count], bitorder="little"))
        return rows


def main() -> None:
    asked = bench.options(__doc__, views=66, rounds=5)
    names = ["bunny"] if asked.quick else ["bunny", "horse", "igea", "kitchen", "engine_2cylinder"]
    table = []
    for name in names:
        scene = bench.scene(asked.meshes, name)
        cameras = bench.around(scene, 12 if asked.quick else asked.views)
        opened = OpenedScene(scene, cameras)
        jobs = {
            "ours": lambda scene=scene, cameras=cameras: scene.visible(cameras, fill=None, progress=False),
            "Open3D, NumPy rays": lambda opened=opened: opened.rows("numpy_rays"),
            "Open3D, own rays": lambda opened=opened: opened.rows("own_rays"),
        }
        rows = lab.sweep(
            {"job": jobs}, timed=lambda job, jobs=jobs: jobs[job], rounds=asked.rounds, errors="raise", progress=False
        )
        ms = {row["job"]: row["time"] / len(cameras) * 1e3 for row in rows}
        theirs = min(value for job, value in ms.items() if job != "ours")
        ours = jobs["ours"]().unpack()
        reference = np.array(
            [np.unpackbits(row, bitorder="little", count=len(scene)) for row in opened.rows("own_rays")]
        )
        differ = (ours != reference).sum() / (ours | (reference > 0)).sum()
        table.append(
            {"mesh": name, "faces": len(scene), **{f"{job}, ms a view": v for job, v in ms.items()}}
            | {"ratio": theirs / ms["ours"], "bits that differ, of all set": differ}
        )
    bench.show(f"{len(cameras)} bare rows at 510 x 480, medians of {asked.rounds} interleaved rounds", table)


if __name__ == "__main__":
    main()
