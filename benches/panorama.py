"""Walkthroughs on a rail beside the 2003 paper's tables.

Tiles and bytes that culling keeps, what it loses, and how good views between references are over spacing and slabs.

    python benches/panorama.py [--quick] [--views 500] [--part quality --chart docs/figures/walk-quality.png]
"""

from __future__ import annotations

import argparse
import gzip
import io
from functools import partial
from pathlib import Path

import numpy as np

import cyclorama as cyc
from cyclorama import lab
from cyclorama.panorama import BuiltIn, Survey, Track
from cyclorama.panorama.viewing import resample, seen_between

DATA = Path(__file__).parents[1].parent / "shared" / "data"

# The paper's reduction rates, percent of tiles of slabs 2 and 3 by alpha.
PAPER = {
    "dense": {1.0: (77.4, 72.2), 0.9: (80.7, 77.3), 0.8: (81.9, 79.8)},
    "open": {1.0: (2.5, 0.0), 0.9: (6.4, 1.2), 0.8: (10.0, 2.9)},
}


def castle():
    """A lane between houses, before the keep: the paper's dense scene was a castle, too."""
    scene = cyc.scenes.castle()
    ahead = scene.lane[1] - scene.lane[0]
    start = scene.lane[0] + 0.2 * ahead
    return scene, Track([start, start + 2.7 * ahead / np.linalg.norm(ahead)]), (0, 1, 0)


def level():
    """A level of a game, along a straight hall."""
    path = DATA / "q3_20kdm2.ply"
    if not path.exists():
        return None
    eye = np.array([1056.0, 1344.0, 112.0])
    return cyc.load(path), Track([eye, eye + [120.0, 0.0, 0.0]]), (0, 0, 1)


def meadow(seed=0):
    """Trees and stones far apart on a plain: nearly all that there is, is seen."""
    rng = np.random.default_rng(seed)
    tree = cyc.scenes.tree(2_000)
    vertices, faces, colors, count = [], [], [], 0
    for place in rng.uniform(-60, 60, (90, 2)):
        if np.abs(place[1]) < 4 and place[0] < 12:
            continue
        size = rng.uniform(1.0, 2.0) * 2.5 / tree.radius
        points = (tree.vertices - [tree.center[0], tree.bounds[0][1], tree.center[2]]) * size
        vertices.append(points + [place[0], 0, place[1]])
        faces.append(tree.faces + count)
        colors.append(tree.colors if tree.colors is not None else np.full((len(tree.faces), 3), 120, np.uint8))
        count += len(points)
    ground = np.array([(-90, 0, -90), (90, 0, -90), (90, 0, 90), (-90, 0, 90)], float)
    vertices.append(ground)
    faces.append(np.array([(0, 2, 1), (0, 3, 2)]) + count)
    shades = np.concatenate([c if len(c) == len(tree.faces) else c[tree.faces[:, 0]] for c in colors])
    colors = np.concatenate([shades, np.full((2, 3), (90, 120, 60), np.uint8)])
    return cyc.Scene(np.concatenate(vertices), np.concatenate(faces), colors)


def spacious():
    scene = meadow()
    return scene, Track([(-20.0, 1.7, 0.0), (-14.0, 1.7, 0.0)]), (0, 1, 0)


def plainly(survey):
    """Bytes of all tiles of all slabs, empty ones too, each by itself: a PNG of 8-bit RGBA, and its quads, 7 numbers of
    16 bits each, in a gzip file."""
    from PIL import Image

    def png(pixels):
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "PNG", compress_level=6)
        return len(file.getvalue())

    side, pictures, quads = survey.tile, 0, 0
    nothing = png(np.zeros((side, side, 4), np.uint8)), len(gzip.compress(b""))
    for reference in survey.references:
        for slab in reference.slabs:
            rows, columns = slab.tiles.shape
            owners = slab.quads[:, 1].astype(int) // side * columns + slab.quads[:, 0] // side
            order = np.argsort(owners, kind="stable")
            ends = np.searchsorted(owners[order], np.arange(rows * columns + 1))
            tiles = slab.pixels.reshape(rows, side, columns, side, 4).swapaxes(1, 2).reshape(-1, side, side, 4)
            for number, there in enumerate(slab.tiles.ravel()):
                own = slab.quads[order[ends[number] : ends[number + 1]]]
                pictures += png(np.ascontiguousarray(tiles[number])) if there else nothing[0]
                quads += len(gzip.compress(own.tobytes(), 6)) if there else nothing[1]
    return pictures, quads


def tables(name, scene, track, up, size, views, references, alphas, view_size):
    places = np.linspace(0, 1, references)
    # As far apart whatever their number.
    track = Track([track.at(0.0), track.at((references - 1) / 9)])
    survey, seconds = lab.elapsed(partial(Survey, scene, track, 3, size, places=places, up=up, progress=False))
    paper = PAPER["open" if name == "open" else "dense"]
    print(
        f"\n{name}: {len(scene):,} faces, {references} references over {track.length:.4g}, slabs cut at",
        ", ".join(f"{far:.4g}" for _, far in survey.cuts[:-1]),
        f"({seconds:.0f} s)",
    )
    plain = plainly(survey)
    print("method  alpha  slab   tiles    kept  culled    paper    bytes     kept")
    for method in ("exact", "paper"):
        rows = survey.table(method, alphas)
        for row in rows:
            theirs = f"{paper[row.alpha][row.slab - 2]:5.1f} %" if row.slab > 1 else "      -"
            print(
                f"{method:6s}  {row.alpha:5.1f}  {row.slab:4d} {row.tiles:7d} {row.kept:7d} {row.reduction:6.1%}  "
                f"{theirs} {row.bytes / 1e6:7.2f}M {row.kept_bytes / 1e6:7.2f}M"
            )
        strict = rows[: len(survey.cuts)]
        every = sum(row.all for row in strict)
        raw = every * survey.tile**2 * 4
        kept_raw, stored = sum(row.kept_raw for row in strict), sum(row.kept_bytes for row in strict)
        before, before_raw = sum(row.bytes for row in strict), sum(row.raw for row in strict)
        pictures = sum(row.kept_pictures for row in strict)
        kept = sum(row.kept for row in strict) / every
        print(
            f"{method}: tiles {every}, {sum(row.tiles for row in strict) / every:.1%} not empty, {kept:.1%} kept "
            f"({1 / kept:.2f} times fewer)\n"
            f"  4 bytes a pixel, 14 a quad: every tile {raw / 1e6:.1f} MB, not empty {before_raw / 1e6:.1f}, kept "
            f"{kept_raw / 1e6:.1f} ({raw / kept_raw:.2f} times fewer)\n"
            f"  each tile a PNG and a gzip file: every tile {sum(plain) / 1e6:.2f} MB (pictures {plain[0] / 1e6:.2f}, "
            f"quads {plain[1] / 1e6:.2f})\n"
            f"  as stored: not empty {before / 1e6:.2f} MB, kept {stored / 1e6:.2f} (pictures {pictures / 1e6:.2f}, "
            f"quads {(stored - pictures) / 1e6:.2f}): {sum(plain) / stored:.1f} times fewer than every tile\n"
            f"  viewpoints in 64 MB of stored files: {64e6 * references / before:.0f} unculled, "
            f"{64e6 * references / stored:.0f} culled; in 512 MB of decoded tiles and quads: "
            f"{512e6 * references / before_raw:.0f} and {512e6 * references / kept_raw:.0f}"
        )
        for alpha in alphas if views else ():
            lost = survey.losses(
                method, alpha, views=views, size=view_size, counts_tiles=method == "paper", progress=False
            )
            wrong = (
                "" if lost.tiles_wrong is None else f", {lost.tiles_wrong} of {lost.tiles_dropped} dropped tiles seen"
            )
            print(
                f"{method} {alpha}: {lost.lost} of {lost.pixels:,} pixels of {views} views lost, "
                f"{lost.changed} changed, in {lost.views_hit} views, worst {lost.worst:.3%}{wrong}",
                flush=True,
            )


def quality(name, scene, track, up, size, shares, counts):
    """PSNR and holes of views half-way between two references; the PSNR that the reference's own view has, too."""
    print(f"\n{name}: views half-way between references; spacing in shares of the median range")
    renderer = BuiltIn(scene, texture=partial(cyc.quality.paint, grain=scene.radius / 40))
    panorama = cyc.panorama.Projection(size=size, up=up)
    layer = renderer.render(track.at(0.0), panorama, 0.0, np.inf)
    median = float(np.median(layer.range[layer.opacity]))
    whole = np.dstack([layer.color, np.where(layer.opacity, 255, 0).astype(np.uint8)])
    right, _, back = panorama.axes

    def compared(eye, draw):
        """Decibels and holes of six views around an eye."""
        decibels, holes = [], []
        for turn in np.arange(6) * np.pi / 3:
            ahead = np.sin(turn) * right - np.cos(turn) * back
            camera = cyc.Camera.look_at(eye, eye + ahead, up=up, fov_y=55, width=480, height=360)
            color, hole = draw(camera)
            points = cyc.DepthImage.from_view(scene.render(camera)).points()
            known = np.isfinite(points).all(axis=-1)
            if known.any():
                truth = renderer.texture(points.reshape(-1, 3)).reshape(*known.shape, 3)
                decibels.append(cyc.quality.psnr(color, truth, where=known))
                holes.append(hole.mean())
        return decibels, holes

    def own(camera):
        color, known = resample(whole, panorama, camera)
        return color, ~known

    decibels, _ = compared(track.at(0.0), own)
    there = float(np.mean(decibels))
    print(f"the unsplit panorama itself, from its viewpoint: {there:.1f} dB, worst {min(decibels):.1f}")
    survey = Survey(renderer, track, 3, size, places=[0.0, 1.0], up=up, progress=False)
    off = np.mean((survey.references[0].panorama().astype(float) - whole) ** 2)
    print(f"composed slabs differ from it by {off:.3g} levels, mean square", flush=True)
    print("spacing  slabs    dB   worst   holes")
    lines = {}
    for share in shares:
        step = share * median
        if step > track.length:
            continue
        stretch = Track(track.at([0.0, step / track.length]))
        for slabs in counts:
            survey = Survey(renderer, stretch, slabs, size, places=[0.0, 1.0], up=up, progress=False)

            def between(camera, references=survey.references):
                seen = seen_between(references, 0.5, panorama, camera, (0, 0, 0))
                return seen.color, seen.hole

            decibels, holes = compared(stretch.at(0.5), between)
            lines.setdefault(slabs, []).append((share, np.mean(decibels)))
            print(
                f"{share:7.3f}  {slabs:5d} {np.mean(decibels):5.1f} {min(decibels):7.1f} {np.mean(holes):7.3%}",
                flush=True,
            )
    return lines, there


def chart(found, path):
    """Decibels over spacing, a line for each number of slabs, a panel for each scene with its own scale."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, len(found), figsize=(4.8 * len(found), 3.4), squeeze=False)
    for panel, (name, (lines, there)) in zip(panels[0], found.items(), strict=True):
        for slabs, points in lines.items():
            shares, decibels = np.transpose(sorted(points))
            # Where more slabs change nothing, their smaller dots lie on those of fewer.
            size = 4 + 1.5 * (max(lines) - slabs)
            label = f"{slabs} slab{'s' * (slabs > 1)}"
            panel.plot(100 * shares, decibels, marker="o", markersize=size, linewidth=1, label=label)
        panel.axhline(there, color="black", linewidth=1, linestyle=":", label="at a reference")
        panel.set(title=name, xscale="log", xlabel="spacing, % of the median range")
        panel.set_xticks([2.5, 5, 10, 20], ["2.5", "5", "10", "20"])
        panel.minorticks_off()
        panel.margins(y=0.1)
    panels[0][0].set_ylabel("PSNR half-way, dB")
    panels[0][0].legend(fontsize=7, ncols=2)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="panoramas of 1024 x 256, few references")
    parser.add_argument("--views", type=int, default=500, help="drawn with and without culling; 0 counts no losses")
    parser.add_argument("--view-size", type=int, nargs=2, default=(320, 240), help="of those views")
    parser.add_argument("--references", type=int)
    parser.add_argument("--alphas", type=float, nargs="+", default=[1.0, 0.9, 0.8])
    parser.add_argument("--scene", choices=("castle", "open", "level"), nargs="+", default=["castle", "open", "level"])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.025, 0.05, 0.1, 0.2], help="spacings")
    parser.add_argument("--slabs", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--chart", type=Path, help="where to draw what --part quality finds")
    parser.add_argument("--size", type=int, help="columns of the panoramas; rows are a quarter")
    parser.add_argument("--part", choices=("tables", "quality"))
    given = parser.parse_args()
    columns = given.size or (1024 if given.quick else 4096)
    size, references = (columns, columns // 4), given.references or (4 if given.quick else 10)
    found = {}
    for name, make in (("castle", castle), ("open", spacious), ("level", level)):
        if name not in given.scene or (made := make()) is None:
            continue
        scene, track, up = made
        if given.part in (None, "tables"):
            tables(name, scene, track, up, size, given.views, references, given.alphas, tuple(given.view_size))
        if given.part in (None, "quality"):
            found[name] = quality(name, scene, track, up, size, given.shares, given.slabs)
    if given.chart and found:
        chart(found, given.chart)


if __name__ == "__main__":
    main()
