"""Rooms and doors found in meshes against the true ones, what culling by them loses, and how fast it is.

    python benches/buildings.py [--quick] [--eyes 1000] [--seed 0]

*House* is the one of `cyc.scenes` (true rooms, doors and windows), *fzk_haus* a real one (true rooms; its doors and
nothing else are openings, and rooms that join without a wall are one), *q3_20kdm2* a castle whose true rooms nobody
knows. *Precision* is the share of portals found that lie in a true opening, *recall* that of true openings with a
portal, *overlap* how much of their area the portals cover, *rooms* how many true ones have a cell of their own, or one
with the rooms they join. Eyes are in the open: indoors, every fourth outdoors; Embree says what a picture of 96 x 72
pixels shows, and *lost* are views with a face that is not answered, without probes and with them. *Drawn* is over all
faces, *of frustum* over those in the camera's frustum. The floor plans show the cut at the eye's height, portals in
black.
"""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import open3d as o3d

import bench
import cyclorama as cyc
from cyclorama import lab
from cyclorama.portals import Building
from cyclorama.portals.cones import Cone

#: Scenes, what is given of their doors, and the axis that is up.
SETTINGS = {
    "house": ("house", {}, 1),
    "fzk_haus": ("fzk_haus", {}, 2),
    "q3_20kdm2": ("q3_20kdm2", {}, 2),
    "q3_20kdm2, door=200": ("q3_20kdm2", {"door": 200.0}, 2),
}


def truth(name: str, folder: object, scene: cyc.Scene) -> tuple[list[np.ndarray], list[tuple[np.ndarray, np.ndarray]]]:
    """Middles of true rooms, and boxes of true openings."""
    if name == "house":
        middles = [room["min"] + (room["max"] - room["min"]) * (0.5, 0.9, 0.5) for room in scene.cells]
        return middles, [(portal["polygon"].min(0), portal["polygon"].max(0)) for portal in scene.portals]
    if name == "fzk_haus":
        known = json.loads((folder / "fzk_haus_cells.json").read_text())
        corners = [np.array(space["vertices"]) for space in known["spaces"]]
        doors = [(np.array(door["aabb_min"]), np.array(door["aabb_max"])) for door in known["doors"]]
        return [(points.min(0) + points.max(0)) / 2 for points in corners], doors
    return [], []


def compared(building: Building, doors: list[tuple[np.ndarray, np.ndarray]]) -> tuple[float, float, float]:
    """Precision, recall and overlap."""
    reach = 4 * building.cells[0].rooms.grid.step
    good, covered = 0, np.zeros(len(doors))
    for portal in building.portals:
        low, high = portal.polygon.min(0), portal.polygon.max(0)
        for index, (least, most) in enumerate(doors):
            flat = int(np.argmin(most - least))
            if flat == np.argmin(high - low) and (low <= most + reach).all() and (high >= least - reach).all():
                size = np.delete(most - least, flat)
                common = np.delete(np.minimum(high, most) - np.maximum(low, least), flat)
                covered[index] += float(np.clip(common / size, 0, 1).prod())
                good += 1
                break
    return good / len(building.portals), float((covered > 0.5).mean()), float(np.minimum(covered, 1).mean())


def eyes_of(building: Building, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points in the open, three of four of them indoors."""
    rooms = building.cells[0].rooms
    indoors, outdoors = np.argwhere(rooms.labels >= 0), np.argwhere(rooms.labels == -1)
    chosen = np.concatenate([rng.choice(indoors, count - count // 4), rng.choice(outdoors, count // 4)])
    return rooms.grid.low + (chosen + rng.random(chosen.shape)) * rooms.grid.step


def walked(building: Building, eyes: np.ndarray, up: int, rng: np.random.Generator) -> dict[str, object]:
    """What is lost and drawn from some eyes, and milliseconds a call."""
    scene = building.scene
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(scene.vertices.astype(np.float32), scene.faces)
    corners = np.asarray(scene.vertices, np.float64)[scene.faces]
    lost, drawn, share, times = 0, [], [], []
    for eye in eyes:
        gaze = rng.normal(size=3) * np.where(np.arange(3) == up, 0.3, 1.0)
        camera = cyc.Camera.look_at(eye, eye + gaze, np.eye(3)[up], fov_y=50, width=96, height=72)
        rays = np.concatenate(camera.rays(), axis=-1).astype(np.float32)
        seen = np.unique(caster.cast_rays(o3d.core.Tensor(rays))["primitive_ids"].numpy())
        answer, seconds = lab.elapsed(partial(building.visible, camera))
        times.append(seconds)
        lost += not np.isin(seen[seen != cyc.BACKGROUND], answer).all()
        drawn.append(len(answer) / len(scene))
        share.append(len(answer) / max(int((~Cone.of(camera).misses(corners)).sum()), 1))
    return {
        "eyes": len(eyes),
        "lost": lost,
        "drawn": f"{np.mean(drawn):.1%}",
        "of frustum": f"{np.mean(share):.0%}",
        "ms": round(1e3 * float(np.median(times)), 2),
    }


def plan(building: Building, up: int, height: float, panel: object, title: str) -> None:
    """A floor plan."""
    rooms = building.cells[0].rooms
    grid = rooms.grid
    layer = int((height - grid.low[up]) / grid.step)
    cut = np.take(rooms.labels, layer, axis=up)
    across = [axis for axis in range(3) if axis != up]
    colours = np.random.default_rng(3).uniform(0.35, 0.95, (len(building.cells) + 2, 3))
    colours[0], colours[1] = 0.25, 1.0
    low, high = grid.low[across], grid.low[across] + np.array(cut.shape) * grid.step
    panel.imshow(colours[cut.T + 2], origin="lower", extent=(low[0], high[0], low[1], high[1]), interpolation="nearest")
    for portal in building.portals:
        least, most = portal.polygon.min(0), portal.polygon.max(0)
        if least[up] <= height <= most[up]:
            panel.plot([least[across[0]], most[across[0]]], [least[across[1]], most[across[1]]], "k-", lw=2.5)
    for index in range(len(building.cells)):
        places = np.argwhere(cut == index)
        if len(places) > 40:
            middle = places[np.abs(places - np.median(places, axis=0)).sum(axis=1).argmin()]
            panel.text(*(low + (middle + 0.5) * grid.step), str(index), ha="center", va="center")
    panel.set_title(title)


def main() -> None:
    from matplotlib import pyplot

    options = bench.options(__doc__, eyes=1000, seed=0)
    eyes = 40 if options.quick else options.eyes
    rows = []
    figure, panels = pyplot.subplots(1, len(SETTINGS), figsize=(6 * len(SETTINGS), 6))
    heights = {"house": 1.3, "fzk_haus": 1.4, "q3_20kdm2": 240.0}
    for panel, (title, (name, given, up)) in zip(panels, SETTINGS.items(), strict=True):
        scene = cyc.scenes.house(rooms=8, seed=0) if name == "house" else bench.scene(options.meshes, name)
        bare, seconds = lab.elapsed(partial(Building.find, scene, **given, probes=0, progress=False))
        building, probing = lab.elapsed(partial(bare.completed, progress=False))
        middles, doors = truth(name, options.meshes, scene)
        row = {
            "scene": title,
            "seconds": round(seconds, 1),
            "of probes": round(probing, 1),
            "cells": len(building.cells),
        }
        row["portals"] = len(building.portals)
        if doors:
            own = {building.cell(middle) for middle in middles} - {None}
            row["rooms"] = f"{len(middles)} in {len(own)}"
            row["precision"], row["recall"], row["overlap"] = (round(x, 3) for x in compared(building, doors))
        for kind, drawn in (("without", bare), ("with", building)):
            rng = np.random.default_rng(options.seed)
            rows.append({**row, "probes": kind, **walked(drawn, eyes_of(bare, eyes, rng), up, rng)})
        plan(
            building, up, heights[name], panel, f"{title}: {len(building.cells)} cells, {len(building.portals)} portals"
        )
    columns = list(dict.fromkeys(key for row in rows for key in row))
    bench.show("Rooms and doors found in meshes", [{key: row.get(key, "") for key in columns} for row in rows], columns)
    path = bench.picture_folder() / "buildings.png"
    figure.tight_layout()
    figure.savefig(path, dpi=70)
    print(path)


if __name__ == "__main__":
    main()
