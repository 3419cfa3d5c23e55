"""Layered images of interiors: what nine images become, how long that takes, and how fast and good they are.

    python benches/ldi.py [--quick]

One central image and the eight construction images of the 1998 dissertation's section 4.3.2, for eyes within 10 % of
the mean depth. Beside the dissertation's figures: built in 7 to 23 s, warped 7 to 11 times a second at 512 x 384 on 3
processors, 2 to 4 samples a pixel, compressed by gzip by 2.6, 4 and 5.8.
*At the centre* is the view of the central image's own eye, which that image shows without error.

Then quality and time in one of them against the number of construction images, the splat, the resolution and how far
of the way to the region's border the eye is (*moved*; beyond 1 it is outside), with samples near corners and without.
The chart goes to out/ldi_quality.png. Surfaces are painted with a solid texture whose shortest wave is `--grain` pixels
long at the mean depth; errors are over all pixels that show a surface, holes counted as black.
"""

from __future__ import annotations

import functools
import gzip
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

import bench
import cyclorama as cyc
from cyclorama import Camera, DepthImage, LayeredDepthImage, lab, quality
from cyclorama.ldi import construction_cameras, quadrilateral

Vector = tuple[float, float, float]
Size = tuple[int, int]

PLACES: dict[str, tuple[Vector, Vector, Vector]] = {
    "kitchen": ((0.84, 1.24, 0.06), (0.84, 1.24, 1), (0, 1, 0)),
    "fzk_haus": ((4.5, 2, 1.6), (5.42, 2.38, 1.6), (0, 0, 1)),
    "sibenik": ((6, 5, 0), (-1, 5, 0), (0, 1, 0)),
}
SIZES = [(256, 256), (512, 384), (512, 512), (1024, 768)]
SWEPT, SIZE = "fzk_haus", SIZES[1]

#: Orders in which construction images are added: neighbours last.
SPREAD = (0, 4, 2, 6, 1, 5, 3, 7)


@dataclass
class Interior:
    """A place in a scene, the nine images around it, and how far eyes may go from it."""

    scene: cyc.Scene
    inner: Camera
    images: list[DepthImage]
    wave: float
    extent: npt.NDArray[np.float64]
    #: Seconds that rendering the nine took.
    rendered: float

    def targets(self, views: int, moved: float | None = None) -> list[tuple[Camera, DepthImage]]:
        """Views within the region, or so far of the way to its border, and what they show."""
        turn, rng = self.inner.world_to_camera[:3, :3], np.random.default_rng(0)
        found = []
        for _ in range(views):
            step = rng.normal(size=3)
            step *= (rng.random() ** (1 / 3) if moved is None else moved) / np.linalg.norm(step)
            there = self.inner.eye + turn.T @ (self.extent * (step[0], step[1], abs(step[2])))
            pose = self.inner.world_to_camera.copy()
            pose[:3, 3] = -turn @ there
            camera = self.inner.replace(world_to_camera=pose)
            found.append((camera, quality.textured(self.scene, camera, grain=self.wave)))
        return found


def interior(scene: cyc.Scene, place: tuple[Vector, Vector, Vector], size: Size, grain: float) -> Interior:
    inner = Camera.look_at(*place, fov_y=35, width=size[0], height=size[1])
    depth = scene.render(inner).depth
    mean = float(depth[np.isfinite(depth)].mean())
    reach, wave = 0.1 * mean, grain * size[0] / SIZE[0] * mean / inner.K[0, 0]
    corners = quadrilateral(inner, max(reach, 0.9 * float(depth.min())))
    cameras = construction_cameras(inner.eye, corners, reach, size, margin=0.1)
    images, rendered = lab.elapsed(lambda: [quality.textured(scene, camera, grain=wave) for camera in cameras])
    turn = inner.world_to_camera[:3, :3]
    extent = 2 * np.abs([turn @ (camera.eye - inner.eye) for camera in cameras[1:]]).max(axis=0)
    return Interior(scene, inner, images, wave, extent, rendered)


def judged(out: cyc.warp.Warped, truth: DepthImage) -> tuple[float, float]:
    """Mean squared error and share of holes over what shows a surface."""
    seen = ~truth.missing
    error = np.square(out.color[seen].astype(float) - truth.color[seen]).mean()
    return float(error), float(out.hole[seen].mean())


def decibels(errors: npt.ArrayLike) -> npt.NDArray[np.float64]:
    return np.asarray(10 * np.log10(255**2 / np.mean(errors, axis=0)))


def compressed(layered: LayeredDepthImage) -> str:
    """How many times smaller gzip and zstd make the samples and the number of samples of each pixel."""
    counts = layered.counts.astype(np.uint8)
    arrays = (counts, layered.color, layered.place, layered.disparity)
    data = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)
    ratios = [f"{len(data) / len(gzip.compress(data, 6)):.2f}"]
    if find_spec("zstandard"):
        import zstandard

        ratios.append(f"{len(data) / len(zstandard.compress(data, 9)):.2f}")
    return " / ".join(ratios)


def row(name: str, at: Interior, rounds: int, views: int) -> dict[str, Any]:
    """What becomes of the nine images of a place."""
    images = at.images
    layered, built = lab.elapsed(functools.partial(LayeredDepthImage.build, images[0], images[1:]))

    def against_nine(targets: list[tuple[Camera, DepthImage]]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Errors and holes of one image, the layered one and all nine, in each of some views."""
        found = []
        for camera, truth in targets:
            order = sorted(images, key=lambda image: -np.linalg.norm(image.camera.eye - camera.eye))
            one, nine = cyc.warp.forward(images[0], camera), cyc.warp.forward(order, camera, order="zbuffer")
            found.append([judged(out, truth) for out in (one, layered.warp(camera), nine)])
        errors, holes = np.moveaxis(np.array(found), -1, 0)
        return errors, holes

    errors, holes = against_nine(at.targets(views))
    centre = decibels(against_nine(at.targets(1, moved=0.0))[0][:, 1:])
    camera = at.inner
    out, out_1 = cyc.warp.Warped.empty(camera), cyc.warp.Warped.empty(camera)
    ms = lab.medians(
        {
            "one": lambda: cyc.warp.forward(images[0], camera, out=out_1, threads=1),
            "layered": lambda: layered.warp(camera, out=out, threads=1),
            "all": lambda: layered.warp(camera, out=out),
        },
        rounds,
    )
    known = sum(int((~image.missing).sum()) for image in images)
    pixels = images[0].missing.size
    return {
        "scene, size": name,
        "render 9, s": f"{at.rendered:.2f}",
        "build, s": f"{built:.3f}",
        "samples a pixel": f"{layered.samples / pixels:.2f}",
        "of the nine": f"{layered.samples / known:.1%}",
        "bytes a pixel": f"{layered.nbytes / pixels:.1f}",
        "gzip / zstd": compressed(layered),
        "holes: one, layered, nine": ", ".join(f"{share:.3%}" for share in holes.mean(axis=0)),
        "PSNR: one, layered, nine (dB)": ", ".join(f"{value:.2f}" for value in decibels(errors)),
        "at the centre: layered, nine (dB)": ", ".join(f"{value:.2f}" for value in centre),
        "one image, ns a pixel": f"{1e6 * ms['one'] / pixels:.2f}",
        "layered, ns a sample": f"{1e6 * ms['layered'] / layered.samples:.2f}",
        "warps a second: 1 thread, all": f"{1e3 / ms['layered']:.0f}, {1e3 / ms['all']:.0f}",
    }


def sweep(scene: cyc.Scene, sizes: list[Size], grain: float, rounds: int, views: int) -> list[dict[str, Any]]:
    """A row for each number of construction images, splat, resolution and distance moved, all else as usual."""
    place = interior(scene, PLACES[SWEPT], SIZE, grain)
    cases: list[tuple[str, float, Interior, int, int, float]] = []
    cases += [("construction images", count, place, count, 3, 1.0) for count in (0, 1, 2, 4, 6, 8)]
    cases += [("splat", splat, place, 8, splat, 1.0) for splat in (1, 3, 5, 7)]
    cases += [("moved", moved, place, 8, 3, moved) for moved in (0.0, 0.25, 0.5, 1.0, 1.5, 2.0)]
    places = {size: place if size == SIZE else interior(scene, PLACES[SWEPT], size, grain) for size in sizes}
    cases += [("megapixels", size[0] * size[1] / 1e6, at, 8, 3, 1.0) for size, at in places.items()]
    rows = []
    for against, value, at, count, splat, moved in cases:
        targets = at.targets(views, moved)
        for corners in (True, False):
            chosen = [at.images[1 + index] for index in SPREAD[:count]]
            layered = LayeredDepthImage.build(at.images[0], chosen, corners=corners)
            found = [judged(layered.warp(camera, splat), truth) for camera, truth in targets]
            out = cyc.warp.Warped.empty(targets[0][0])
            warp = functools.partial(layered.warp, targets[0][0], splat, out=out, threads=1)
            errors, holes = np.array(found).T
            rows.append(
                {
                    "against": against,
                    "value": value,
                    "corners": corners,
                    "dB": float(decibels(errors)),
                    "holes, %": 100 * float(holes.mean()),
                    "samples a pixel": layered.samples / at.images[0].missing.size,
                    "ms": lab.medians({"warp": warp}, rounds)["warp"],
                }
            )
    return rows


def draw(rows: list[dict[str, Any]]) -> None:
    """Quality, holes and time against each, and against one another."""
    from matplotlib.figure import Figure

    swept = list(dict.fromkeys(row["against"] for row in rows))
    figure = Figure(figsize=(4 * len(swept), 13), layout="constrained")
    panels = figure.subplots(4, len(swept), squeeze=False)
    for column, against in enumerate(swept):
        for corners, style in ((True, "-"), (False, "--")):
            some = [row for row in rows if row["against"] == against and row["corners"] == corners]
            label = "samples near corners" if corners else "none there"
            for number, key in enumerate(("dB", "holes, %", "ms")):
                panel = panels[number][column]
                panel.plot([row["value"] for row in some], [row[key] for row in some], style, marker=".", label=label)
                panel.set_xlabel(against)
                panel.set_ylabel(key)
            panel = panels[3][column]
            panel.plot([row["ms"] for row in some], [row["dB"] for row in some], style, marker="o", label=label)
            for entry in some:
                panel.annotate(f"{entry['value']:.3g}", (entry["ms"], entry["dB"]), fontsize=7)
            panel.set_xlabel("ms a warp, one thread")
            panel.set_ylabel(f"dB, by {against}")
    panels[0][0].legend(fontsize=8)
    figure.savefig(bench.picture_folder() / "ldi_quality.png", dpi=110)


def main() -> None:
    options = bench.options(__doc__, grain=4.0)
    rounds, views = (3, 2) if options.quick else (9, 8)
    sizes = [SIZE] if options.quick else SIZES
    table = []
    for name, place in PLACES.items():
        scene = bench.scene(options.meshes, name)
        for size in sizes if name == SWEPT or options.quick else [SIZE, SIZES[-1]]:
            at = interior(scene, place, size, options.grain)
            table.append(row(f"{name}, {size[0]} x {size[1]}", at, rounds, views))
    bench.show("Nine images as one", table)
    rows = sweep(bench.scene(options.meshes, SWEPT), sizes, options.grain, rounds, views)
    bench.show(f"{SWEPT}, {SIZE[0]} x {SIZE[1]}, all nine and 3 x 3 splats where nothing else is said", rows)
    draw(rows)


if __name__ == "__main__":
    main()
