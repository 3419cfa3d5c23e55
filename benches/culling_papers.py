"""The papers' culling figures beside ours.

2001, figure 5: share of the polygons that 25 samples cull, six joined, averaged over the faces of the hull, images of
1320 x 1074; and the claims of its section 3: three samples against six, 14, 25 and 55 of them. 2002, table 1: culling
rate of 1026 samples at 510 x 480 with patches, averaged over directions. `missed` is the mean share of covered pixels
that random held-out views lose, `backfacing` and `occluded` are the parts of what these views cull. The papers' own
models differ from the meshes here where the number of faces does.

Ours are given both with a bare id-buffer, as the papers took it, and with the default sampler.
"""

from __future__ import annotations

from typing import Any

import bench
import cyclorama as cyc

#: Model here, the paper's model, its faces, its samples' culled share, pixels missed of 255 x 255.
FIGURE_5 = (
    ("bunny", "Bunny", 64_951, 0.26, 23),
    ("gear", "B-gear", 74_634, 0.53, 294),
    ("brain_icbm152", "LH-brain", 279_526, 0.70, 623),
)

#: Model here, the paper's faces, patches, culling rate.
TABLE_1 = (
    ("bunny", 69_451, 50, "15 %"),
    ("bunny", 69_451, 1000, "60 %"),
    ("horse", 96_966, 400, "38 %"),
    ("dragon_100k", 871_414, 600, "44 %"),
    ("brain_icbm152", 288_334, 1000, "66 %"),
)


def scene_of(asked: Any, name: str) -> cyc.Scene:
    return cyc.scenes.gear() if name == "gear" else bench.scene(asked.meshes, name)


def figures(vis: cyc.Visibility, scene: cyc.Scene, views: int) -> dict[str, Any]:
    report = cyc.evaluate(vis, scene, views=views, seed=11, progress=False)
    return {
        "culled": vis.culling_rate("faces"),
        "backfacing": float(report.backfacing.mean()),
        "occluded": float(report.occluded.mean()),
        "missed": report.mean_missed,
    }


def samples_2001(asked: Any) -> None:
    rows = []
    for name, theirs, faces, culled, missed in FIGURE_5[: 1 if asked.quick else None]:
        scene = scene_of(asked, name)
        for views in [14] if asked.quick else [14, 25, 55]:
            for fill in (None, "rays"):
                for joined in (3, 6):
                    vis = cyc.bake(
                        scene, views, None, (1320, 1074), fill=fill, join="samples", join_count=joined, progress=False
                    )
                    ours = figures(vis, scene, asked.eval_views)
                    row = {
                        "mesh": name,
                        "faces": len(scene),
                        "samples": views,
                        "joined": joined,
                        "fill": fill or "none",
                    }
                    said = {"paper": "", "paper: culled": "", "paper: pixels missed of 65,025": ""}
                    if views == 25 and joined == 6:
                        said = {
                            "paper": f"{theirs}, {faces:,}",
                            "paper: culled": f"{culled:.0%}",
                            "paper: pixels missed of 65,025": str(missed),
                        }
                    rows.append(row | ours | said)
    bench.show("2001: polygons, images of 1320 x 1074, culled share averaged over the faces of the hull", rows)


def patches_2002(asked: Any) -> None:
    rows = []
    for name in dict.fromkeys(name for name, *_ in TABLE_1[: 1 if asked.quick else None]):
        scene = scene_of(asked, name)
        for fill in (None, "rays"):
            baked = cyc.bake(scene, asked.views, fill=fill, join="samples", progress=False)
            asks = [(faces, patches, culled) for model, faces, patches, culled in TABLE_1 if model == name]
            for faces, patches, culled in [*asks, (asks[0][0], None, "")]:
                vis = baked
                if patches is not None:
                    labels = cyc.patches.tile(scene.vertices, scene.faces, patches, progress=False)
                    vis = baked.in_patches(labels)
                row = {"mesh": name, "faces": len(scene), "patches": patches, "fill": fill or "none"}
                ours = figures(vis, scene, asked.eval_views) | {"culled": vis.culling_rate()}
                rows.append(row | ours | {"paper: faces": faces, "paper: culled": culled})
    bench.show(
        f"2002, table 1: {asked.views:,} samples at 510 x 480, culling rate averaged over directions; "
        "no patches: a bit per face",
        rows,
    )


def main() -> None:
    asked = bench.options(__doc__, views=1026, eval_views=24)
    if asked.quick:
        asked.views, asked.eval_views = 18, 4
    samples_2001(asked)
    patches_2002(asked)


if __name__ == "__main__":
    main()
