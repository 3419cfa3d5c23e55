"""Frames a second with and without culling: the papers' figure 6 (2001), figures 6 and 7 and table 1 (2002).

A model turns about its vertical axis. Each frame of the reconstruction selects the samples, joins them, lists the
faces, and draws those; the whole model is drawn from buffers that stay. Both go through pyrender (EGL) as the graphics
pipeline (the mesh and a new index buffer a frame) and through our own rasteriser. Samples are joined at the corners, as
in the papers. Colours are flat: what culling saves is work on faces, not on pixels.
The papers' machine had graphics hardware; here OpenGL may be Mesa's software rasteriser, whose name is printed.

Frame rates are medians of interleaved rounds. The chart goes to out/frame_rates.png.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab
from cyclorama.framing import Framing

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

#: The papers' own figures: model, patches, culling rate, frames a second of the whole and of the reconstruction.
TABLE_1 = {
    "bunny": ("50-1000", "15-60 %", 24.9, 36.0),
    "horse": ("400", "38 %", 19.8, 30.7),
    "brain_icbm152": ("1000", "66 %", 7.4, 18.0),
    "dragon_100k": ("600", "44 %", 2.2, 3.6),
}


class Pipeline:
    """A mesh in OpenGL buffers through pyrender, of which any faces can be drawn."""

    def __init__(self, scene: cyc.Scene, size: tuple[int, int]) -> None:
        import pyrender

        self.renderer = pyrender.OffscreenRenderer(*size)
        self.center = scene.center
        self.faces = scene.faces
        positions = (scene.vertices - scene.center).astype(np.float32)
        normals = np.zeros_like(positions)
        corners = positions[scene.faces]
        np.add.at(normals, scene.faces, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        material = pyrender.MetallicRoughnessMaterial(doubleSided=True)
        self.primitive = pyrender.Primitive(positions, normals, indices=scene.faces, material=material, mode=4)
        self.scene = pyrender.Scene(ambient_light=[0.3] * 3)
        self.scene.add(pyrender.Mesh([self.primitive]))
        self.light = self.scene.add(pyrender.DirectionalLight(intensity=3.0))
        self.lens = self.scene.add(pyrender.PerspectiveCamera(1.0))
        self.flags = pyrender.RenderFlags.FLAT | pyrender.RenderFlags.SKIP_CULL_FACES
        self.pyrender = pyrender

    def draw(self, camera: cyc.Camera, faces: np.ndarray | None, span: tuple[float, float] | None = None) -> np.ndarray:
        """(H, W) depths; the picture itself comes back from OpenGL too, in time, and is left.

        Depths are cut off at the ends of `span`, by default those of an eye that turns around the scene.
        """
        pose = camera.world_to_camera.copy()
        pose[:3, 3] += pose[:3, :3] @ self.center
        reach = float(np.linalg.norm(pose[:3, 3]))
        near, far = span or (0.05 * reach, 2 * reach)
        moved = camera.replace(world_to_camera=pose)
        view, _ = moved.to_opengl(near, far)
        (fx, _, cx), (_, fy, cy), _ = camera.K
        self.lens.camera = self.pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=near, zfar=far)
        self.scene.set_pose(self.lens, np.linalg.inv(view))
        self.scene.set_pose(self.light, np.linalg.inv(view))
        if self.primitive._in_context():
            self._upload(self.faces if faces is None else self.faces[faces], whole=faces is None)
        _, depth = self.renderer.render(self.scene, flags=self.flags)
        return depth

    def _upload(self, indices: np.ndarray, whole: bool) -> None:
        """Puts other faces into the index buffer that the primitive's vertex array holds."""
        from OpenGL import GL

        if whole and len(self.primitive.indices) == len(self.faces):
            return
        self.renderer._platform.make_current()
        GL.glBindVertexArray(self.primitive._vaid)
        flat = np.ascontiguousarray(indices, dtype=np.uint32)
        GL.glBufferSubData(GL.GL_ELEMENT_ARRAY_BUFFER, 0, flat.nbytes, flat)
        GL.glBindVertexArray(0)
        self.primitive._indices = flat

    def name(self) -> str:
        from OpenGL import GL

        self.renderer._platform.make_current()
        return GL.glGetString(GL.GL_RENDERER).decode()

    def close(self) -> None:
        self.renderer.delete()


def measure(
    scene: cyc.Scene, bakes: dict[str, cyc.Visibility], frames: int, rounds: int, size: tuple[int, int]
) -> tuple[list[dict[str, Any]], str]:
    """Frames a second of the whole and of each bake, by both ways to draw."""
    turns = np.linspace(0, 2 * np.pi, frames, endpoint=False)
    directions = np.column_stack([np.cos(turns), np.full(frames, 0.3), np.sin(turns)])
    cameras = Framing.of(scene, size).cameras(directions)
    pipeline = Pipeline(scene, size)
    room = np.empty(len(scene), np.uint32)
    image = scene.render(cameras[0])
    ways = {
        "OpenGL": lambda camera, faces: pipeline.draw(camera, faces),
        "own rasteriser": lambda camera, faces: scene.render(camera, faces, out=image),
    }

    def timed(bake: str | None, way: str) -> Any:
        vis = bakes.get(bake or "")

        def job() -> None:
            for camera in cameras:
                ways[way](camera, None if vis is None else vis.visible_faces(camera.eye, out=room))

        return job

    def select(bake: str) -> Any:
        return lambda: [bakes[bake].visible_faces(camera.eye, out=room) for camera in cameras]

    try:
        rows = lab.sweep(
            {"bake": [None, *bakes], "way": list(ways)}, timed=timed, rounds=rounds, errors="raise", progress=False
        )
        selected = lab.sweep({"bake": list(bakes)}, timed=select, rounds=rounds, errors="raise", progress=False)
        name = pipeline.name()
    finally:
        pipeline.close()
    fps = {(row["bake"], row["way"]): frames / row["time"] for row in rows}
    table = []
    for bake, vis in bakes.items():
        row = {"bake": bake, "culled": vis.culling_rate()}
        row["select and join, ms"] = next(r["time"] for r in selected if r["bake"] == bake) / frames * 1e3
        for way in ways:
            row[f"{way}: whole, frames/s"] = fps[None, way]
            row[f"{way}: culled, frames/s"] = fps[bake, way]
            row[f"{way}: gain, %"] = 100 * (fps[bake, way] / fps[None, way] - 1)
        table.append(row)
    return table, name


def draw(charts: dict[str, dict[str, list[dict[str, Any]]]], path: Any) -> None:
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    colors = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
    for panel, kind in zip(panels, ("samples", "patches"), strict=True):
        for color, (name, tables) in zip(colors, charts.items(), strict=False):
            for way, style in (("OpenGL", "-o"), ("own rasteriser", "--s")):
                rows = tables[kind]
                x = [row[kind] for row in rows]
                panel.plot(x, [r[f"{way}: culled, frames/s"] for r in rows], style, color=color, label=f"{name}, {way}")
                panel.axhline(rows[0][f"{way}: whole, frames/s"], color=color, alpha=0.35, linestyle=style[:-1])
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter(ScalarFormatter())
        panel.yaxis.set_minor_formatter(NullFormatter())
        counts = sorted({row[kind] for tables in charts.values() for row in tables[kind]})
        panel.set_xticks(counts, [f"{count:,}" for count in counts], minor=False)
        panel.set_xticks([], minor=True)
        panel.set_xlabel(f"number of {kind}")
        panel.grid(True, which="major", color="#e4e4e4")
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("frames a second (faint: the whole model)")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    asked = bench.options(
        __doc__,
        names=["bunny", "horse", "brain_icbm152", "dragon_100k"],
        views=[6, 18, 66, 258],
        patches=[50, 200, 400, 600, 1000, 2000],
        frames=36,
        rounds=5,
    )
    if asked.quick:
        asked.names, asked.views, asked.patches, asked.frames, asked.rounds = ["horse"], [6, 18], [50, 400], 6, 2
    size = (510, 480)
    charts: dict[str, dict[str, list[dict[str, Any]]]] = {}
    summary = []
    for name in asked.names:
        scene = bench.scene(asked.meshes, name)
        by_views = {views: cyc.bake(scene, views, join="samples", progress=False) for views in asked.views}
        densest = by_views[max(asked.views)]
        bakes = {f"{views:,} samples, faces": vis for views, vis in by_views.items()}
        for count in asked.patches:
            labels = cyc.patches.tile(scene.vertices, scene.faces, count, progress=False)
            bakes[f"{max(asked.views):,} samples, {count:,} patches"] = densest.in_patches(labels)
        table, gl = measure(scene, bakes, asked.frames, asked.rounds, size)
        for row, views in zip(table, asked.views, strict=False):
            row["samples"] = views
        for row, count in zip(table[len(asked.views) :], asked.patches, strict=True):
            row["patches"] = count
        columns = [column for column in table[0] if column != "samples"]
        bench.show(f"{name}, {len(scene):,} faces, {asked.frames} frames at 510 x 480, {gl}", table, columns)
        charts[name] = {"samples": table[: len(asked.views)], "patches": table[len(asked.views) :]}
        best = max(charts[name]["patches"], key=lambda row: row["OpenGL: culled, frames/s"])
        patches, culled, before, after = TABLE_1.get(name, ("-", "-", None, None))
        summary.append(
            {
                "model": name,
                "faces": len(scene),
                "best patches": best["patches"],
                "culled": best["culled"],
                "whole, frames/s": best["OpenGL: whole, frames/s"],
                "culled, frames/s": best["OpenGL: culled, frames/s"],
                "gain, %": best["OpenGL: gain, %"],
                "paper: patches": patches,
                "paper: culled": culled,
                "paper: gain, %": None if before is None else 100 * (after / before - 1),
            }
        )
    bench.show("Table 1 of 2002, through OpenGL (the paper's dragon and brain have 871,414 and 288,334 faces)", summary)
    draw(charts, bench.picture_folder() / "frame_rates.png")
    print(f"\nchart: {bench.picture_folder() / 'frame_rates.png'}")


if __name__ == "__main__":
    main()
