"""Images that hold a walk to a budget: how many, how far away, how long it takes to place them (table 3-1).

For each scene and budget: images, viewpoints, seconds, frames checked one by one with what was wrong in them, the
distance from eye to viewpoint over those frames in edges of the scene, and milliseconds of a frame. Then the same
budget optimized to less and to more, and pipes from 10^5 to 5 x 10^6 faces. The dissertation's pipes (893, 331 and 282
images in 4.6, 2.8 and 2.4 hours) are another scene on another machine: beside these, not their measure.
"""

from __future__ import annotations

import resource
from functools import partial

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import lab, placement, sweeps

SHARES = (0.15, 0.20, 0.25)
#: Which way is up, and the shares of the faces that a frame may have: what their density allows.
REAL = {
    "sibenik": ((0, 1, 0), (0.25, 0.30, 0.40)),
    "kitchen": ((0, 1, 0), (0.30, 0.40, 0.50)),
    "engine_2cylinder": ((0, 1, 0), (0.40, 0.50, 0.60)),
    "fzk_haus": ((0, 0, 1), (0.30, 0.40, 0.50)),
    "q3_20kdm2": ((0, 0, 1), (0.30, 0.40, 0.50)),
}
PARTS = ["pipes", "targets", "real", "sizes", "sphere", "wide", "ready", "grid", "optimisers", "methods", "proof"]


def attempted(scene: cyc.Scene, budget: int, **options: object) -> placement.Plan | str:
    """A plan, or why there is none."""
    try:
        return cyc.place_images(scene, budget, progress=False, **options)
    except ValueError as error:
        return str(error)


def placed(name: str, scene: cyc.Scene, share: float, frames: int, **options: object) -> dict[str, object]:
    """A row: a plan, and what was seen of it."""
    budget = int(share * len(scene))
    row: dict[str, object] = {"scene": name, "faces": len(scene), "budget": budget}
    plan, seconds = lab.elapsed(partial(attempted, scene, budget, **options))
    if isinstance(plan, str):
        return row | {"s": seconds, "why not": plan[:100]}
    row |= {
        "s": seconds,
        "images": len(plan.images) - plan.shell,
        "viewpoints": len(plan.viewpoints) - plan.shell,
        "depth": plan.leaf_depth,
        "boxes": len(plan.proof),
    }
    found = plan.check(frames, progress=False)
    eyes = np.random.default_rng(0).uniform(*plan.domain, (200, 3))
    out = np.empty(plan.budget, np.uint32)
    times = []
    for eye, yaw in zip(eyes, np.linspace(0, 2 * np.pi, 200), strict=True):
        gaze = np.cos(yaw) * plan.axes[0] + np.sin(yaw) * plan.axes[1]
        times.append(lab.elapsed(partial(plan.frame, eye, gaze, out=out))[1])
    return row | {
        "sound": found.is_sound,
        "most": found.most,
        "distance, median": found.median_distance,
        "greatest": found.greatest_distance,
        "ms a frame": 1e3 * float(np.median(times)),
        "MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def coarser(scene: cyc.Scene, size: float) -> cyc.Scene:
    """A level of detail: vertices rounded to a grid, without the faces that this leaves flat."""
    cells, vertices = np.unique(np.round(scene.vertices / size), axis=0, return_inverse=True)
    faces = vertices.reshape(-1)[scene.faces]
    return cyc.Scene(cells * size, faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)])


def ready(scene: cyc.Scene, share: float, frames: int) -> list[dict[str, object]]:
    """Rows of what visibility and levels of detail save (figure 1-4)."""
    edge = float((scene.bounds[1] - scene.bounds[0]).max())
    level = coarser(scene, 0.03 * edge)
    kinds: list[tuple[str, dict[str, object]]] = [
        ("all faces", {}),
        ("visible from 2 x 2 x 2 boxes", {"visibility": 2}),
        (f"{len(level):,} faces beyond 0.4 edges", {"lod": [(level, 0.4 * edge)]}),
    ]
    return [{"counted": name} | placed("pipes", scene, share, frames, **options) for name, options in kinds]


def grids(scene: cyc.Scene, share: float, frames: int) -> list[dict[str, object]]:
    """Rows of the dissertation's grid: what its star-shapes leave unproved, and frames aimed at that."""
    rows = []
    for star_shape in ("paper", "certified"):
        options: dict[str, object] = {"method": "paper", "star_shape": star_shape, "lookahead": 0, "leaf_depth": 4}
        place = partial(cyc.place_images, scene, int(share * len(scene)), progress=False, **options)
        plan, seconds = lab.elapsed(place)
        assert plan.grid is not None
        aimed = plan.grid.check(frames, aimed=True)
        away = plan.grid.aimed_frames(2000)
        far = plan.grid.away(*away)
        rows.append(
            {
                "star-shapes": star_shape,
                "faces": len(scene),
                "s": seconds,
                "images": len(plan.images) - plan.shell,
                "not proved": plan.gaps,
                "climbs that leave one": f"{(far > 1).sum()} of {len(far)}",
                "greatest, in radii": float(far.max()),
                "need an image there": aimed["with image"],
                "of them outside": aimed["outside the star-shape"],
                "past or over": aimed["past the image"] + aimed["over budget"],
                "violations": plan.check(frames, progress=False).violations,
            }
        )
    return rows


def proof(scene: cyc.Scene, share: float, frames: int, directions: placement.plan.Directions) -> dict[str, object]:
    """A row of the whole proof, and of frames half of which are near the model's faces, edges and corners."""
    plan = cyc.place_images(scene, int(share * len(scene)), directions=directions, progress=False)
    row: dict[str, object] = {"gazes": directions, "faces": len(scene), "images": len(plan.images) - plan.shell}
    row["boxes"], row["s"] = lab.elapsed(plan.certify)
    found, seconds = lab.elapsed(partial(plan.check, frames, progress=False))
    return row | vars(found) | {"frames, s": seconds}


def methods(scene: cyc.Scene, share: float) -> list[dict[str, object]]:
    """Rows of the images that each way to find them needs, and of wider images on the dissertation's grid."""
    rows = []
    ways: list[dict[str, object]] = [
        {"method": "cover"},
        *({"method": "paper", "lookahead": q} for q in (0, 1, 2)),
        {"method": "annealing"},
        {"method": "windows"},
        *({"method": "paper", "image_fov": fov} for fov in (66.0, 72.0, 84.0)),
    ]
    for way in ways:
        place = partial(cyc.place_images, scene, int(share * len(scene)), leaf_depth=4, progress=False, **way)
        plan, seconds = lab.elapsed(place)
        row = {"method": way["method"], "look-ahead": way.get("lookahead"), "image_fov": way.get("image_fov")}
        ends = plan.parameters[: len(plan.images) - plan.shell, 4:]
        # As many pixels as a frame of 512 x 384 has, at the same angle each.
        shares = ((ends[:, 1::2] - ends[:, ::2]) / (2 * np.array(plan.tangents))).prod(axis=1)
        row |= {"s": seconds, "viewpoints": len(plan.viewpoints) - plan.shell, "images": len(shares)}
        rows.append(row | {"megapixels": 512 * 384 * shares.sum() / 1e6, "not proved": plan.gaps})
    return rows


def main() -> None:
    options = bench.options(__doc__, frames=200, faces=1_000_000, parts=PARTS)
    faces = 100_000 if options.quick else options.faces
    pipes = cyc.scenes.pipes(faces)
    small = cyc.scenes.pipes(20_000 if options.quick else 100_000)
    frames = options.frames
    if "pipes" in options.parts:
        bench.show("Pipes", [placed("pipes", pipes, share, frames) for share in SHARES])
    if "targets" in options.parts:
        rows = [
            {"optimized to": f"{share} P"}
            | placed("pipes", pipes, 0.20, frames, optimize_to=int(share * 0.20 * len(pipes)))
            for share in (0.8, 0.9, 0.95)
        ]
        bench.show("Pipes, 20 %, by what is optimized to", rows)
    if "real" in options.parts:
        rows = [
            placed(name, bench.scene(options.meshes, name), share, frames, up=up)
            for name, (up, shares) in list(REAL.items())[: 2 if options.quick else None]
            for share in shares
        ]
        tree = cyc.scenes.tree()
        bench.show(
            "Real scenes, and a plant", rows + [placed("tree", tree, share, frames) for share in (0.4, 0.5, 0.6)]
        )
    if "sizes" in options.parts:
        sizes = (30_000, 100_000) if options.quick else (100_000, 1_000_000, 5_000_000)
        rows = [placed("pipes", cyc.scenes.pipes(size), 0.20, frames // 4) for size in sizes]
        bench.show("Pipes, 20 %, by size", rows)
    if "sphere" in options.parts:
        rows = [{"gazes": kind} | placed("pipes", small, 0.4, frames, directions=kind) for kind in ("yaw", "sphere")]
        bench.show("Gazes up and down too, 40 %", rows)
    if "wide" in options.parts:
        rows = []
        for fov in (72.0, 80.0, 90.0, 100.0, 110.0):
            row = {"image_fov": fov} | placed("pipes", small, 0.25, frames, image_fov=fov)
            # As many pixels as a frame of 512 x 384 has, at the same angle each.
            wider = np.tan(np.radians(fov) / 2) / np.tan(np.radians(30.0))
            images = row.get("images")
            if isinstance(images, int):
                row["megapixels"] = 512 * 384 * wider**2 * images / 1e6
            rows.append(row)
        bench.show("Wider images, 25 %", rows)
    if "ready" in options.parts:
        bench.show("Visibility and levels of detail, 20 %", ready(small, 0.20, frames))
    if "grid" in options.parts:
        bench.show("The dissertation's grid, 50 %", grids(cyc.scenes.pipes(20_000), 0.5, frames))
    if "optimisers" in options.parts:
        searches = sweeps.optimisers(small, [0.2], views=10 if options.quick else 40, progress=False)
        bench.show("Searches for an image", searches)
    if "methods" in options.parts:
        bench.show("Ways to find images, 50 %", methods(cyc.scenes.pipes(20_000), 0.5))
    if "proof" in options.parts:
        frames = 1000 if options.quick else 100_000
        rows = [proof(pipes, 0.20, frames, "yaw"), proof(small, 0.40, frames, "sphere")]
        bench.show("Proof and frames, 20 %; of any gaze, 40 %", rows)


if __name__ == "__main__":
    main()
