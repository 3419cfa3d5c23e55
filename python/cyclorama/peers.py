"""Renderers nobody here wrote, behind one face.

Each peer answers `render(camera)` with ids (H, W) uint32 and depth (H, W) float64, `BACKGROUND` and inf where it sees
nothing, for the same pixel centres and the same axes as ours. All of them compute in float32, so each keeps the scene
moved back to the origin; the camera is moved along in float64. A peer that is not installed, or does not work here,
raises `Missing`.
"""

from __future__ import annotations

import importlib
import math
import os
import shutil
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .render import BACKGROUND

__all__ = ["Embree", "Missing", "OpenCV", "Peer", "PyrenderIds", "TrimeshEmbree", "need"]

Ids = npt.NDArray[np.uint32]
Depths = npt.NDArray[np.float64]


class Missing(Exception):
    """A peer can't be asked here; the text says why."""


def need(name: str) -> ModuleType:
    """The module of this name.

    Raises
    ------
    Missing
        If it can't be imported.
    """
    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:
        raise Missing(f"needs {name}: {error}") from error


class Peer:
    """A scene as another renderer holds it: around the origin, in float32."""

    def __init__(self, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        points = np.asarray(vertices, dtype=np.float64)
        self.center = (points.min(axis=0) + points.max(axis=0)) / 2
        self.vertices = np.ascontiguousarray(points - self.center, dtype=np.float32)
        self.faces = np.ascontiguousarray(faces, dtype=np.uint32)
        self._setup()

    def _setup(self) -> None:
        raise NotImplementedError

    def render(self, camera: Camera) -> tuple[Ids, Depths]:
        """Nearest face and its depth at each pixel centre."""
        raise NotImplementedError

    def moved(self, camera: Camera) -> Camera:
        """The camera as it sees the scene that was moved to the origin."""
        pose = camera.world_to_camera.copy()
        pose[:3, 3] += pose[:3, :3] @ self.center
        return camera.replace(world_to_camera=pose)

    def clip_planes(self, camera: Camera) -> tuple[float, float]:
        """Near and far planes close about the scene: a z-buffer has 24 bits for what lies between them."""
        depth = self.moved(camera).project(self.vertices)[1]
        radius = float(np.linalg.norm(self.vertices, axis=1).max())
        return max(camera.near, 0.95 * float(depth.min()), 1e-3 * radius), 1.05 * float(depth.max()) + 1e-3 * radius


class Embree(Peer):
    """First hits of Open3D's `RaycastingScene`."""

    def _setup(self) -> None:
        self._o3d = need("open3d")
        self._scene = self._o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self.vertices, self.faces)

    def render(self, camera: Camera) -> tuple[Ids, Depths]:
        origins, directions = self.moved(camera).rays()
        ids, depth = self.cast(origins + camera.near * directions, directions)
        return ids, depth + camera.near

    def cast(self, origins: npt.NDArray[Any], directions: npt.NDArray[Any]) -> tuple[Ids, Depths]:
        """Nearest face along each ray from the moved origins, and how many of its directions away."""
        rays = np.concatenate([origins, directions], axis=-1).astype(np.float32)
        hits = self._scene.cast_rays(self._o3d.core.Tensor(rays))
        return hits["primitive_ids"].numpy(), hits["t_hit"].numpy().astype(np.float64)


class TrimeshEmbree(Peer):
    """First hits of trimesh's ray intersector on embreex."""

    def _setup(self) -> None:
        need("embreex")
        trimesh = need("trimesh")
        intersector = importlib.import_module("trimesh.ray.ray_pyembree").RayMeshIntersector
        self._rays = intersector(trimesh.Trimesh(self.vertices, self.faces.astype(np.int64), process=False))

    def render(self, camera: Camera) -> tuple[Ids, Depths]:
        moved = self.moved(camera)
        origins, directions = (array.reshape(-1, 3) for array in moved.rays())
        faces, rays, at = self._rays.intersects_id(
            origins + camera.near * directions, directions, multiple_hits=False, return_locations=True
        )
        ids = np.full(len(origins), BACKGROUND, dtype=np.uint32)
        depth = np.full(len(origins), np.inf)
        ids[rays], depth[rays] = faces, moved.project(at)[1]
        return ids.reshape(camera.height, camera.width), depth.reshape(camera.height, camera.width)


class PyrenderIds(Peer):
    """OpenGL through pyrender and EGL, with a fragment shader that writes the primitive's number.

    The segmentation pass draws without multisampling but culls back faces, so every face is there twice, once turned
    over; the numbers start again with the second lot.
    """

    def _setup(self) -> None:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        pyrender = need("pyrender")
        programs = importlib.import_module("pyrender.shader_program")
        self._pyrender = pyrender
        try:
            self._renderer = pyrender.OffscreenRenderer(8, 8)
        except Exception as error:
            raise Missing(f"needs an OpenGL that pyrender can use: {error}") from error
        self._shaders = tempfile.TemporaryDirectory()
        shutil.copytree(Path(str(pyrender.__file__)).parent / "shaders", self._shaders.name, dirs_exist_ok=True)
        Path(self._shaders.name, "segmentation.frag").write_text(
            f"""#version 330 core
            uniform vec3 color;
            out vec4 picture;
            void main() {{
                int number = gl_PrimitiveID % {len(self.faces)} + 1;
                picture = vec4(vec3(number & 255, (number >> 8) & 255, number >> 16) / 255.0 + 0.0 * color, 1.0);
            }}
            """
        )
        self._renderer._renderer._program_cache = programs.ShaderProgramCache(shader_dir=self._shaders.name)
        both_sides = np.vstack([self.faces, self.faces[:, ::-1]])
        self._scene = pyrender.Scene()
        self._node = self._scene.add(
            pyrender.Mesh([pyrender.Primitive(positions=self.vertices, indices=both_sides, mode=4)])
        )

    def render(self, camera: Camera) -> tuple[Ids, Depths]:
        near, far = self.clip_planes(camera)
        view, _ = self.moved(camera).to_opengl(near, far)
        (fx, _, cx), (_, fy, cy), _ = camera.K
        if camera.orthographic:
            size = camera.width / fx / 2, camera.height / fy / 2
            lens = self._pyrender.OrthographicCamera(*size, znear=near, zfar=far)
        else:
            lens = self._pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=near, zfar=far)
        self._renderer.viewport_width, self._renderer.viewport_height = camera.width, camera.height
        node = self._scene.add(lens, pose=np.linalg.inv(view))
        color, depth = self._renderer.render(
            self._scene, flags=self._pyrender.RenderFlags.SEG, seg_node_map={self._node: (1, 1, 1)}
        )
        self._scene.remove_node(node)
        channels = color.astype(np.uint32)
        number = channels[..., 0] | channels[..., 1] << 8 | channels[..., 2] << 16
        ids = np.where(number == 0, np.uint32(BACKGROUND), number - 1).astype(np.uint32)
        if camera.orthographic:
            # pyrender reads every z-buffer as a perspective one: back to the z-buffer, and on to depth.
            with np.errstate(divide="ignore"):
                ndc = (far + near - 2 * far * near / depth) / (far - near)
            depth = ((far - near) * ndc + far + near) / 2
        return ids, np.where(number == 0, np.inf, depth)

    def close(self) -> None:
        self._renderer.delete()
        self._shaders.cleanup()


class OpenCV(Peer):
    """OpenCV 5's `triangleRasterize`, each face in a flat colour of its own; cameras with a centred axis only."""

    def _setup(self) -> None:
        self._cv2 = need("cv2")
        if not hasattr(self._cv2, "triangleRasterizeColor"):
            raise Missing(f"needs OpenCV 5 for triangleRasterize, this is {self._cv2.__version__}")
        self._corners = np.ascontiguousarray(self.vertices[self.faces].reshape(-1, 1, 3))
        self._indices = np.arange(len(self._corners), dtype=np.int32).reshape(-1, 1, 3)
        number = np.repeat(np.arange(1, len(self.faces) + 1), 3)
        # Whole numbers below 256 over 256 are exact in float32.
        self._colors = np.stack([number & 255, number >> 8 & 255, number >> 16], axis=-1)[:, None] / np.float32(256)
        self._settings = self._cv2.TriangleRasterizeSettings()
        self._settings.setShadingType(self._cv2.RASTERIZE_SHADING_FLAT)
        self._settings.setCullingMode(self._cv2.RASTERIZE_CULLING_NONE)

    def render(self, camera: Camera) -> tuple[Ids, Depths]:
        near, far = self.clip_planes(camera)
        view, _ = self.moved(camera).to_opengl(near, far)
        lens = view, math.radians(camera.fov_y), near, far, self._settings
        color = np.zeros((camera.height, camera.width, 3), dtype=np.float32)
        depth = np.full((camera.height, camera.width), far, dtype=np.float32)
        self._cv2.triangleRasterize(self._corners, self._indices, self._colors.astype(np.float32), color, depth, *lens)
        channels = np.rint(color * 256).astype(np.uint32)
        number = channels[..., 0] | channels[..., 1] << 8 | channels[..., 2] << 16
        ids = np.where(number == 0, np.uint32(BACKGROUND), number - 1).astype(np.uint32)
        return ids, np.where(number == 0, np.inf, depth.astype(np.float64))
