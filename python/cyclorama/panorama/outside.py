"""Renderers of other people as `Renderer`: pyrender, POV-Ray, and panoramas that are finished already."""

from __future__ import annotations

import importlib
import json
import math
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..archives import UNREADABLE
from ..camera import Camera
from .projection import Kind, Projection
from .renderers import Layer

if TYPE_CHECKING:
    from ..scene import Scene

__all__ = ["PanoramaFolder", "PovRay", "Pyrender"]

Floats = npt.NDArray[np.float64]

# Degrees that a pinhole image of pyrender's spans: a slab's ends are planes in it, not spheres.
_SPAN = 24.0
# The lamp of `BuiltIn`, as POV-Ray has it.
_LIGHT, _AMBIENT = (0.4, 0.8, 0.45), 0.35


class Pyrender:
    """OpenGL through pyrender: pinhole images of 24 degrees, with the slab's ends as clipping planes.

    Parameters
    ----------
    scene : pyrender.Scene, trimesh.Trimesh or Scene
        A pyrender scene is drawn with its own lights and materials, a mesh flat in its colours.

    Raises
    ------
    ImportError
        If pyrender isn't installed.

    Notes
    -----
    A slab ends at planes in each image, up to 4 % nearer than the range that was asked for where the image's corners
    are; neighbouring slabs meet all the same.
    """

    def __init__(self, scene: Any) -> None:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        self._pyrender = importlib.import_module("pyrender")
        if isinstance(scene, self._pyrender.Scene):
            self._scene, self._flags = scene, self._pyrender.RenderFlags.SKIP_CULL_FACES
        else:
            self._scene = self._pyrender.Scene(ambient_light=(1.0, 1.0, 1.0))
            self._scene.add(self._pyrender.Mesh.from_trimesh(_trimesh(scene), smooth=False))
            self._flags = self._pyrender.RenderFlags.SKIP_CULL_FACES | self._pyrender.RenderFlags.FLAT
        self._canvas: Any = None

    def render(self, eye: npt.ArrayLike, projection: Projection, near: float, far: float) -> Layer:
        """See `Renderer`."""
        origin = np.asarray(eye, dtype=np.float64)
        directions = projection.directions()
        local = directions @ projection.axes.T
        turn = np.arctan2(local[..., 0], -local[..., 2])
        tilt = np.arcsin(np.clip(local[..., 1], -1, 1))
        count = math.ceil(360 / _SPAN)
        rows = math.ceil(180 / _SPAN)
        column = np.clip(((turn / (2 * np.pi) + 0.5) * count).astype(int), 0, count - 1)
        row = np.clip(((tilt / np.pi + 0.5) * rows).astype(int), 0, rows - 1)
        # Twice as fine as the panorama is on the horizon: the nearest pixel is taken.
        side = max(8, math.ceil(4 * projection.focal * math.tan(math.radians(_SPAN / 2) * 1.05)))
        color = np.zeros((*projection.shape, 3), np.uint8)
        ranges = np.full(projection.shape, np.inf, np.float32)
        for j in np.unique(row):
            for i in np.unique(column[row == j]):
                self._face(
                    origin,
                    projection,
                    (column == i) & (row == j),
                    directions,
                    i / count,
                    j / rows,
                    (1 / count, 1 / rows),
                    side,
                    (near, far),
                    color,
                    ranges,
                )
        return Layer(color, np.isfinite(ranges), ranges)

    def _points(self) -> list[Floats]:
        """World positions of all vertices. (`pyrender.Mesh.bounds` doesn't work with NumPy 2.)"""
        found = []
        for node in self._scene.mesh_nodes:
            pose = self._scene.get_pose(node)
            for primitive in node.mesh.primitives:
                found.append(primitive.positions @ pose[:3, :3].T + pose[:3, 3])
        return found

    def _face(
        self,
        eye: Floats,
        projection: Projection,
        mine: npt.NDArray[np.bool_],
        directions: Floats,
        start: float,
        low: float,
        step: tuple[float, float],
        side: int,
        ends: tuple[float, float],
        color: npt.NDArray[np.uint8],
        ranges: npt.NDArray[np.float32],
    ) -> None:
        right, up, back = projection.axes
        turn, tilt = 2 * np.pi * (start + step[0] / 2 - 0.5), np.pi * (low + step[1] / 2 - 0.5)
        ahead = np.cos(tilt) * (np.sin(turn) * right - np.cos(turn) * back) + np.sin(tilt) * up
        span = 2 * math.degrees(math.atan(math.tan(math.radians(_SPAN / 2)) * 1.05))
        camera = Camera.look_at(eye, eye + ahead, up=up, fov_y=span, width=side, height=side)
        most = 1.01 * max(float(np.linalg.norm(points - eye, axis=1).max()) for points in self._points())
        znear, zfar = max(ends[0], 1e-4 * most), min(ends[1], most)
        if not znear < zfar:
            return
        view, _ = camera.to_opengl(znear, zfar)
        lens = self._pyrender.IntrinsicsCamera(
            camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2], znear=znear, zfar=zfar
        )
        if self._canvas is None:
            self._canvas = self._pyrender.OffscreenRenderer(side, side)
        self._canvas.viewport_width = self._canvas.viewport_height = side
        node = self._scene.add(lens, pose=np.linalg.inv(view))
        try:
            picture, depth = self._canvas.render(self._scene, flags=self._flags)
        finally:
            self._scene.remove_node(node)
        pixels, along = camera.project(eye + directions[mine])
        at = np.clip(np.floor(pixels).astype(int), 0, side - 1)
        found = depth[at[:, 1], at[:, 0]]
        color[mine] = np.where((found > 0)[:, None], picture[at[:, 1], at[:, 0], :3], 0)
        ranges[mine] = np.where(found > 0, found / along, np.inf)


def _trimesh(scene: Any) -> Any:
    """A mesh as trimesh has it."""
    if not hasattr(scene, "_mesh"):
        return scene
    trimesh = importlib.import_module("trimesh")
    mesh = trimesh.Trimesh(scene.vertices, scene.faces.astype(np.int64), process=False)
    if scene.colors is not None:
        if len(scene.colors) == len(scene.vertices):
            mesh.visual.vertex_colors = scene.colors
        else:
            mesh.visual.face_colors = scene.colors
    return mesh


class PovRay:
    """POV-Ray, the paper's renderer, as a program of its own: Debian's package `povray`.

    Each layer is two runs: one in colours, one whose pigment is the logarithm of the range, in 16 bits. Slabs are cut
    by spheres around the eye (`clipped_by`), so their ends are exact.

    Parameters
    ----------
    scene : Scene
        Written as a `mesh2`; lit as `BuiltIn` lights it, with shadows if `shadows` says so.
    program : str
    shadows : bool

    Raises
    ------
    FileNotFoundError
        If the program isn't there.
    """

    def __init__(self, scene: Scene, *, program: str = "povray", shadows: bool = False) -> None:
        if shutil.which(program) is None:
            raise FileNotFoundError(f"{program} is not installed: apt-get install povray")
        self._program, self._shadows = program, shadows
        self._scene = scene
        self._reach = float(np.linalg.norm(scene.bounds[1] - scene.bounds[0]))

    def render(self, eye: npt.ArrayLike, projection: Projection, near: float, far: float) -> Layer:
        """See `Renderer`."""
        from PIL import Image

        origin = np.asarray(eye, dtype=np.float64)
        low, high = self._scene.bounds
        most = float(np.linalg.norm(np.maximum(np.abs(low - origin), np.abs(high - origin)))) * 1.001
        end, start = min(far, most), max(near, 1e-5 * most)
        shape = projection.shape
        if not start < end:
            return Layer(np.zeros((*shape, 3), np.uint8), np.zeros(shape, np.bool_), np.full(shape, np.inf, np.float32))
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "mesh.inc").write_text(_mesh2(self._scene, origin))
            pictures = []
            for kind in ("color", "range"):
                source = _pov(kind, projection, near, far, start, end, self._shadows)
                (Path(folder) / f"{kind}.pov").write_text(source)
                self._run(folder, kind, projection)
                with Image.open(Path(folder) / f"{kind}.png") as image:
                    picture = np.asarray(image if kind == "range" else image.convert("RGBA"))
                # POV-Ray's spherical camera turns the other way round, in columns and rows.
                pictures.append(picture[::-1, ::-1] if projection.kind == "equirect" else picture)
        color, coded = pictures
        opacity = color[..., 3] > 127
        share = coded.astype(np.float64) / 65535
        ranges = np.full(shape, np.inf, np.float32)
        ranges[opacity] = start * (end / start) ** share[opacity]
        return Layer(np.where(opacity[..., None], color[..., :3], 0).astype(np.uint8), opacity, ranges)

    def _run(self, folder: str, name: str, projection: Projection) -> None:
        done = subprocess.run(
            [
                self._program,
                f"+I{name}.pov",
                f"+O{name}.png",
                f"+W{projection.width}",
                f"+H{projection.height}",
                "-D",
                "-A",
                "-P",
                "File_Gamma=1.0",
                "Output_File_Type=N",
                *(("Grayscale_Output=on", "Bits_Per_Color=16") if name == "range" else ("+UA",)),
            ],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode or not (Path(folder) / f"{name}.png").exists():
            raise RuntimeError(f"povray ended with {done.returncode}: {done.stderr.strip()[-500:]}")


def _vector(v: npt.ArrayLike) -> str:
    x, y, z = (float(c) for c in np.asarray(v, dtype=np.float64))
    return f"<{x:.9g},{y:.9g},{z:.9g}>"


def _mesh2(scene: Scene, origin: Floats) -> str:
    """The scene around an eye, in POV-Ray's words."""
    colors = np.full((1, 3), 200, np.uint8) if scene.colors is None else scene.colors
    palette, which = np.unique(colors, axis=0, return_inverse=True)
    which = which.ravel()
    textures = ",".join(f"texture{{pigment{{rgb {_vector(color / 255)}}}finish{{F}}}}" for color in palette)
    vertices = ",".join(_vector(vertex) for vertex in scene.vertices.astype(np.float64) - origin)
    if scene.colors is None:
        own = np.zeros((len(scene.faces), 1), int)
    elif len(scene.colors) == len(scene.vertices):
        own = which[scene.faces]
    else:
        own = which[:, None]
    faces = ",".join(
        f"<{a},{b},{c}>," + ",".join(map(str, texture))
        for (a, b, c), texture in zip(scene.faces.tolist(), own.tolist(), strict=True)
    )
    return (
        f"vertex_vectors{{{len(scene.vertices)},{vertices}}}\n"
        f"#if (COLORED) texture_list{{{len(palette)},{textures}}} #end\n"
        f"#if (COLORED) face_indices{{{len(scene.faces)},{faces}}}\n"
        f"#else face_indices{{{len(scene.faces)},{_bare(scene.faces)}}} #end\n"
    )


def _bare(faces: npt.NDArray[np.uint32]) -> str:
    return ",".join(f"<{a},{b},{c}>" for a, b, c in faces.tolist())


def _pov(kind: str, projection: Projection, near: float, far: float, start: float, end: float, shadows: bool) -> str:
    """A scene file: the eye is at zero."""
    right, up, back = projection.axes
    if projection.kind == "cylinder":
        camera = f"cylinder 1 right {_vector(right)} up {_vector(up * projection.height / projection.focal)} angle 360"
    else:
        camera = f"spherical right {_vector(right)} up {_vector(up)} angle 360 180"
    clips = ([] if math.isinf(far) else [f"sphere{{0,{far:.12g}}}"]) + (
        [] if near == 0 else [f"sphere{{0,{near:.12g} inverse}}"]
    )
    clipped = f"clipped_by{{{' '.join(clips)}}}" if clips else ""
    light = np.array(_LIGHT) / np.linalg.norm(_LIGHT) @ projection.axes * 1e6
    shadow = "" if shadows else "shadowless"
    lamps = "".join(
        f"light_source{{{_vector(place)} rgb 1 parallel point_at 0 {shadow}}}\n" for place in (light, -light)
    )
    if kind == "range":
        coded = f"min(0.999999,max(0,ln(sqrt(x*x+y*y+z*z)/{start:.12g})/{math.log(end / start):.12g}))"
        look = f"pigment{{function{{{coded}}}color_map{{[0 rgb 0][1 rgb 1]}}}}finish{{emission 1 ambient 0 diffuse 0}}"
        lamps = ""
    else:
        look = ""
    return (
        "#version 3.7;\nglobal_settings{assumed_gamma 1.0}\n"
        f"#declare COLORED={int(kind == 'color')};\n"
        f"#declare F=finish{{ambient {_AMBIENT} diffuse {1 - _AMBIENT} emission 0}};\n"
        f"camera{{{camera} location 0 direction {_vector(-back)}}}\n{lamps}"
        f'mesh2{{\n#include "mesh.inc"\n{look}\n{clipped}}}\n'
    )


class PanoramaFolder:
    """Panoramas that are finished: photographs, or what any program rendered.

    The folder has a file ``panoramas.json``: a list of ``{"eye": [x, y, z], "color": "a.jpg", "depth": "a.png",
    "unit": 0.001, "projection": "equirect"}``. Depths are ranges in pictures of one channel, times `unit`; 0 is
    nothing. A panorama's middle column looks along the `-back` of the projection that is asked for.

    Parameters
    ----------
    folder : path

    Attributes
    ----------
    eyes : (N, 3) ndarray
        Where there is a panorama: what `bake` may be asked for.

    Raises
    ------
    ValueError
        If the list or a picture is not what it should be.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self._folder = Path(folder)
        path = self._folder / "panoramas.json"
        try:
            self._entries = json.loads(path.read_bytes())
            self.eyes = np.array([entry["eye"] for entry in self._entries], np.float64).reshape(-1, 3)
            for entry in self._entries:
                entry["color"], entry["depth"], float(entry["unit"]), entry["projection"]
        except UNREADABLE as error:
            raise ValueError(f"{path} is not a list of panoramas: {error}") from error
        if not len(self.eyes):
            raise ValueError(f"{path} lists no panorama")

    def render(self, eye: npt.ArrayLike, projection: Projection, near: float, far: float) -> Layer:
        """See `Renderer`. Raises ValueError where no panorama is."""
        origin = np.asarray(eye, dtype=np.float64)
        away = np.linalg.norm(self.eyes - origin, axis=1)
        index = int(np.argmin(away))
        if away[index] > 1e-6 * (1 + np.abs(origin).max()):
            raise ValueError(
                f"no panorama is at {origin.tolist()}: the nearest is at {self.eyes[index].tolist()}; give bake the "
                "places of those that are there"
            )
        color, ranges = self._load(index)
        kind: Kind = self._entries[index]["projection"]
        own = Projection(kind, (color.shape[1], color.shape[0]), up=projection.axes[1])
        places = own.places(projection.directions().reshape(-1, 3))
        x, y = (np.floor(axis).astype(np.int64) for axis in places.T)
        inside = (y >= 0) & (y < own.height)
        y = np.clip(y, 0, own.height - 1)
        found = ranges[y, x % own.width]
        opacity = (inside & (found > 0) & (found >= near) & (found < far)).reshape(projection.shape)
        picture = np.where(opacity[..., None], color[y, x % own.width].reshape(*projection.shape, 3), 0)
        return Layer(
            picture.astype(np.uint8),
            opacity,
            np.where(opacity, found.reshape(projection.shape), np.inf).astype(np.float32),
        )

    def _load(self, index: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
        from PIL import Image

        entry = self._entries[index]
        try:
            with Image.open(self._folder / entry["color"]) as image:
                color = np.asarray(image.convert("RGB"))
            with Image.open(self._folder / entry["depth"]) as image:
                depth = np.asarray(image).astype(np.float32) * float(entry["unit"])
        except (OSError, ValueError, SyntaxError) as error:
            raise ValueError(f"{self._folder}: panorama {index} can't be read: {error}") from error
        if depth.shape != color.shape[:2]:
            raise ValueError(f"{self._folder}: panorama {index} has colours {color.shape}, depths {depth.shape}")
        return color, depth
