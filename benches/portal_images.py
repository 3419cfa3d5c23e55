"""Paths through buildings whose doors are pictures: figures 6-5, 6-6, 6-8 of the 1998 dissertation, and their errors.

    python benches/portal_images.py [--quick] [--frames 200] [--scenes house fzk_haus q3_20kdm2] [--charts FOLDER]

A seeded path goes from room to room at eye height. Each way to draw it has a row: faces and milliseconds a frame, how
many images it needed and what all of them take in memory (the dissertation: 676 images of 52 portals, 127 MB), and how
the pixels that show images differ from the whole scene drawn from the same eyes. `ms` has the culling, which is Python;
`drawing` doesn't. Cold: images are painted by the frames that need them; warm: a second walk.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import bench
import cyclorama as cyc
from cyclorama.lab import Row
from cyclorama.portals import Building, PortalImages, figures

# Up, eye height and the path's first cell. The level's found portals reach 38 units into the floor.
SETTINGS = {"house": ((0, 1, 0), 1.6, 0), "fzk_haus": ((0, 0, 1), 1.6, "Flur"), "q3_20kdm2": ((0, 0, 1), 94.0, 13)}

KINDS: dict[str, dict[str, object]] = {
    "static, 1 degree": {"kind": "static"},
    "static, one image": {"kind": "static", "strategy": "single"},
    "one warped image": {"kind": "warped", "references": 1},
    "two warped images": {"kind": "warped", "references": 2},
    "layered images": {"kind": "layered"},
}


def building(folder: Path, name: str) -> Building:
    if name == "house":
        home = cyc.scenes.house(rooms=8, seed=0)
        return Building(home, home.cells, home.portals)
    scene = bench.scene(folder, name)
    if name == "fzk_haus":
        return Building.load(folder / "fzk_haus_cells.json", scene)
    return Building.find(scene, door=200.0, progress=False)


def main() -> None:
    options = bench.options(
        __doc__,
        frames=200,
        scenes=list(SETTINGS),
        charts="",
        width=510,
        height=480,
        degrees=[60.0, 30.0, 10.0, 5.0, 2.0],
    )
    size = (160, 120) if options.quick else (options.width, options.height)
    frames = 30 if options.quick else options.frames
    charts = Path(options.charts) if options.charts else None
    if charts is not None:
        charts.mkdir(parents=True, exist_ok=True)
    for name in options.scenes[:1] if options.quick else options.scenes:
        rooms = building(options.meshes, name)
        up, height, first = SETTINGS[name]
        start = [cell.name for cell in rooms.cells].index(first) if isinstance(first, str) else first
        eyes, gazes = figures.route(rooms, frames, height=height, up=up, start=start, seed=1)
        cameras = figures.cameras_of(eyes, gazes, up, size)
        paths = {
            "frustum culling": figures.culling(rooms, cameras, "frustum"),
            "portal culling": figures.culling(rooms, cameras, "portals"),
        }
        cold: dict[str, list[Row]] = {}
        rows = [{"drawn by": key, **figures.summary(found)} for key, found in paths.items()]
        popping: dict[str, list[tuple[float, float]]] = {}
        for key, settings in KINDS.items():
            images = PortalImages(rooms, up=up, memory=1 << 30, **settings)  # type: ignore[arg-type]
            cold[key] = figures.walk(images, cameras, truth=False, progress=False)
            paths[key] = figures.walk(images, cameras, progress=False)
            row = {**figures.summary(paths[key]), "painted": figures.summary(cold[key])["painted"]}
            rows.append({"drawn by": key, **row, "images of all": len(images), "MB": images.nbytes() / 2**20})
            if settings["kind"] == "static":
                popping.setdefault("static", []).append((len(images) / len(images.sides), row["popping"]))
        for step in options.degrees:
            for kind in ("static", "warped"):
                if kind == "warped" and step < 10:
                    continue
                images = PortalImages(rooms, kind, up=up, step=step, memory=1 << 30)
                found = figures.summary(figures.walk(images, cameras, progress=False))
                popping.setdefault(kind, []).append((len(images) / len(images.sides), found["popping"]))
        title = f"{name}: {rooms!r}, {len(cameras)} frames of {size[0]} x {size[1]}"
        bench.show(title, [shown(row) for row in rows])
        pairs = [
            {"kind": kind, "images a side": f"{count:.1f}", "popping": f"{value:.2f}"}
            for kind, pairs in popping.items()
            for count, value in sorted(pairs)
        ]
        bench.show(f"{name}: popping against images", pairs)
        if charts is not None:
            draw(charts, name, paths, cold, popping)


def draw(
    folder: Path,
    name: str,
    paths: dict[str, list[Row]],
    cold: dict[str, list[Row]],
    popping: dict[str, list[tuple[float, float]]],
) -> None:
    """Writes the four charts."""
    culled = ("frustum culling", "portal culling")
    few = {key: paths[key] for key in (*culled, "static, 1 degree", "layered images")}
    figures.chart_path(few, "faces", title=f"{name}: primitives (figure 6-5)", path=folder / f"{name}-primitives.png")
    figures.chart_path(few, title=f"{name}: drawing (figure 6-5)", path=folder / f"{name}-times.png")
    warped = {key: paths[key] for key in ("portal culling", "one warped image", "two warped images")}
    figures.chart_path(warped, title=f"{name}: warped images (figure 6-8)", path=folder / f"{name}-warped.png")
    caches = {"static, cold": cold["static, 1 degree"], "static, warm": paths["static, 1 degree"]}
    caches |= {"layered, cold": cold["layered images"], "layered, warm": paths["layered images"]}
    figures.chart_cache(caches, title=f"{name}: cold and warm (figure 6-6)", path=folder / f"{name}-cache.png")
    figures.chart_popping(popping, title=f"{name}: popping", path=folder / f"{name}-popping.png")


def shown(row: Row) -> Row:
    """A row as the table has it."""
    nothing = np.nan
    return {
        "drawn by": row["drawn by"],
        "faces": f"{row['faces']:,.0f}",
        "most": f"{row['most faces']:,.0f}",
        "ms": f"{row['ms']:.1f}",
        "drawing": f"{row['drawing']:.1f}",
        "most ms": f"{row['most drawing']:.1f}",
        "images": f"{row.get('images', 0):.1f}",
        "painted": row.get("painted", 0),
        "of": row.get("images of all", 0),
        "MB": f"{row.get('MB', 0):.0f}",
        "PSNR, dB": f"{row.get('psnr', nothing):.1f}",
        "holes": f"{row.get('holes', nothing):.2%}",
        "popping": f"{row.get('popping', nothing):.1f}",
    }


if __name__ == "__main__":
    main()
