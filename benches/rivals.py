"""The same whole job done by others: from cameras to rows of bits, called from Python.

Every rival holds the scene around zero in float32, builds what it needs before it is timed, and answers `rows(cameras)`
with a row of bytes for each camera, packed as ours. One that is not here raises `peers.Missing`, which says why.
"""

from __future__ import annotations

import importlib
import math
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import peers

#: Where `make bench` puts the program of embree16/.
EMBREE16 = bench.CLONE / "target" / "embree16"


def pack(ids: np.ndarray, count: int) -> np.ndarray:
    """The row of bits of an id-buffer (int32); its background, -1, falls into a spare entry at the end."""
    seen = np.zeros(count + 1, bool)
    seen[ids.ravel()] = True
    return np.packbits(seen[:count], bitorder="little")


class Open3D:
    """Embree's single rays through Open3D: cast, scatter, pack."""

    def __init__(self, scene: cyc.Scene) -> None:
        o3d = peers.need("open3d")
        self._tensor = o3d.core.Tensor
        self._caster = o3d.t.geometry.RaycastingScene()
        self._caster.add_triangles((scene.vertices - scene.center).astype(np.float32), scene.faces)
        self._center, self._count = scene.center, len(scene)
        self._directions: tuple[bytes, np.ndarray] | None = None

    def rays(self, camera: cyc.Camera, own: bool) -> Any:
        """Rays of depth 1 through the pixel centres: Open3D's own, or NumPy's from directions made once."""
        if own:
            pose = camera.world_to_camera.copy()
            pose[:3, 3] += pose[:3, :3] @ self._center
            matrices = self._tensor(camera.K), self._tensor(pose)
            return self._caster.create_rays_pinhole(*matrices, camera.width, camera.height)
        if self._directions is None or self._directions[0] != camera.K.tobytes():
            pixels = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
            homogeneous = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
            self._directions = camera.K.tobytes(), (homogeneous @ np.linalg.inv(camera.K).T).astype(np.float32)
        rays = np.empty((camera.height, camera.width, 6), np.float32)
        rays[..., :3] = camera.eye - self._center
        np.matmul(self._directions[1], camera.world_to_camera[:3, :3].astype(np.float32), out=rays[..., 3:])
        return self._tensor(rays)

    def rows(self, cameras: list[cyc.Camera], own: bool = False, threads: int = 0) -> list[np.ndarray]:
        rows = []
        for camera in cameras:
            hit = self._caster.cast_rays(self.rays(camera, own), nthreads=threads)
            hit["t_hit"].numpy()
            rows.append(pack(hit["primitive_ids"].numpy().view(np.int32), self._count))
        return rows

    def depth_complexity(self, cameras: list[cyc.Camera]) -> float:
        """Faces crossed by the ray through a pixel's centre, the mean over the pixels that see any."""
        counts = np.stack([self._caster.count_intersections(self.rays(camera, False)).numpy() for camera in cameras])
        return float(counts.sum() / max(1, np.count_nonzero(counts)))


class Trimesh(peers.TrimeshEmbree):
    """embreex through trimesh, which gives no depth."""

    def __init__(self, scene: cyc.Scene) -> None:
        super().__init__(scene.vertices, scene.faces)
        self._count = len(scene)

    def rows(self, cameras: list[cyc.Camera]) -> list[np.ndarray]:
        rows = []
        for camera in cameras:
            rays = (np.broadcast_to(array, (camera.height, camera.width, 3)) for array in self.moved(camera).rays())
            ids = self._rays.intersects_first(*(array.reshape(-1, 3) for array in rays))
            rows.append(pack(ids, self._count))
        return rows


class Planes:
    """Clip planes found once for each camera, before the clock runs."""

    def __init__(self, peer: peers.Peer) -> None:
        self._peer = peer
        self._known: dict[int, tuple[float, float]] = {}

    def __call__(self, camera: cyc.Camera) -> tuple[float, float]:
        if id(camera) not in self._known:
            self._known[id(camera)] = peers.Peer.clip_planes(self._peer, camera)
        return self._known[id(camera)]


class Pyrender(peers.PyrenderIds):
    """OpenGL through pyrender: one copy of each face, and no culling of back faces, which its pass else asks for."""

    def __init__(self, scene: cyc.Scene) -> None:
        super().__init__(scene.vertices, scene.faces)
        self.clip_planes = Planes(self)
        self._count = len(scene)
        module = importlib.import_module("pyrender.renderer")
        if not hasattr(module, "_plain_enable"):
            module._plain_enable = module.glEnable
        module.glEnable = lambda what: None if what == module.GL_CULL_FACE else module._plain_enable(what)
        self._scene.remove_node(self._node)
        primitive = self._pyrender.Primitive(positions=self.vertices, indices=self.faces, mode=4)
        self._node = self._scene.add(self._pyrender.Mesh([primitive]))

    def rows(self, cameras: list[cyc.Camera]) -> list[np.ndarray]:
        return [pack(self.render(camera)[0].view(np.int32), self._count) for camera in cameras]


class OpenCV(peers.Peer):
    """OpenCV 5's `triangleRasterizeDepth`: depths only, so there are no rows to pack."""

    def __init__(self, scene: cyc.Scene) -> None:
        super().__init__(scene.vertices, scene.faces)
        self.clip_planes = Planes(self)

    def _setup(self) -> None:
        self._cv2 = peers.need("cv2")
        if not hasattr(self._cv2, "triangleRasterizeDepth"):
            raise peers.Missing(f"needs OpenCV 5 for triangleRasterizeDepth, this is {self._cv2.__version__}")
        self._corners, self._indices = self.vertices[:, None], self.faces[:, None].astype(np.int32)
        self._settings = self._cv2.TriangleRasterizeSettings()
        self._settings.setCullingMode(self._cv2.RASTERIZE_CULLING_NONE)

    def rows(self, cameras: list[cyc.Camera]) -> list[np.ndarray]:
        depths = []
        for camera in cameras:
            near, far = self.clip_planes(camera)
            view, _ = self.moved(camera).to_opengl(near, far)
            depth = np.full((camera.height, camera.width), far, np.float32)
            lens = view, math.radians(camera.fov_y), near, far, self._settings
            depths.append(self._cv2.triangleRasterizeDepth(self._corners, self._indices, depth, *lens))
        return depths


class Embree16:
    """The C++ program of embree16/, which draws the cameras that it was given at the start."""

    def __init__(self, scene: cyc.Scene, cameras: list[cyc.Camera]) -> None:
        if not EMBREE16.exists():
            raise peers.Missing(f"needs {EMBREE16.name}: `make bench` builds it where libembree-dev 3 is installed")
        self._words = (len(scene) + 63) // 64
        self._folder = tempfile.TemporaryDirectory()
        raw = Path(self._folder.name, "scene.raw")
        bench.write_raw(raw, scene, cameras)
        self._program = subprocess.Popen([EMBREE16, raw], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.version = self._answer()

    def _answer(self) -> str:
        assert self._program.stdout is not None
        line = self._program.stdout.readline()
        if not line:
            raise RuntimeError(f"{EMBREE16.name} ended with status {self._program.wait()}")
        return line.strip()

    def draw(self, lanes: int, threads: int, rows: Path | None = None) -> float:
        """Milliseconds a view by packets of so many lanes, 16 or 1."""
        assert self._program.stdin is not None
        self._program.stdin.write(f"{lanes} {threads} {rows or ''}\n")
        self._program.stdin.flush()
        return float(self._answer())

    def rows(self) -> list[np.ndarray]:
        path = Path(self._folder.name, "rows")
        self.draw(16, 1, path)
        return list(np.fromfile(path, np.uint8).reshape(-1, 8 * self._words))

    def close(self) -> None:
        self._program.communicate()
        self._folder.cleanup()
