"""What each further per cent of the visible faces costs: time of a view against the share found, chart and table.

The truth is Embree's (Open3D): 3 x 3 rays a pixel and 16 uniformly random points on every face that none of them hit,
with a seed of its own. Coincident faces count as one, faces without area not at all. A reported face is false if
neither that truth nor 500 further random points on it can confirm it; for the default also: nor 20,000. Shares are of
all views of a setting together. *ms for 1 %* is what a per cent of the visible faces more costs than with the cheapest
sampler that finds fewer.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import bench
from cyclorama import lab

#: The samplers of the chart: the bare id-buffer, the paper's guess, and rays with their options from cheap to dear.
SAMPLERS: dict[str, dict[str, Any]] = {
    "bare": {"fill": None},
    "neighbours": {"fill": "neighbours"},
    "rays 1, 8": {"fill": "rays", "supersampling": 1, "points": 8},
    "rays 2, 16": {"fill": "rays", "supersampling": 2, "points": 16},
    "rays (default)": {"fill": "rays"},
    "rays 3, 128": {"fill": "rays", "supersampling": 3, "points": 128},
    "rays 5, 128": {"fill": "rays", "supersampling": 5, "points": 128},
}
CHARTED = ["bunny", "kitchen inside", "engine_2cylinder", "tree"]


def measured(setting: bench.Setting, samplers: dict[str, dict[str, Any]], rounds: int, seed: int) -> list[lab.Row]:
    """A row for each sampler."""
    from reference.truth import Truth

    scene, cameras = setting.scene, setting.cameras
    truth = Truth(scene.vertices, scene.faces)
    seen = [truth.view(camera, seed=seed + place) for place, camera in enumerate(cameras)]
    jobs = {name: functools.partial(scene.visible, cameras, progress=False, **how) for name, how in samplers.items()}
    timed = lab.sweep(
        {"sampler": jobs}, timed=lambda sampler: jobs[sampler], rounds=rounds, errors="raise", progress=False
    )
    table: list[lab.Row] = []
    for row in timed:
        bits = jobs[row["sampler"]]()
        verdicts = [view.judge(bits.ids(place)) for place, view in enumerate(seen)]
        reported = max(1, sum(v.reported for v in verdicts))
        visible = max(1, sum(v.visible for v in verdicts))
        patient = None
        if row["sampler"] == "rays (default)":
            far = (view.judge(bits.ids(place), points=20_000) for place, view in enumerate(seen))
            patient = 100 * sum(len(v.false_faces) for v in far) / reported
        figures = {
            "scene": setting.name,
            "kind": setting.kind,
            "sampler": row["sampler"],
            "visible": visible,
            "missed, %": 100 * sum(len(v.missed_faces) for v in verdicts) / visible,
            "false, %": 100 * sum(len(v.false_faces) for v in verdicts) / reported,
            "by 20,000 points, %": patient,
            "ms a view": row["time"] / len(cameras) * 1e3,
        }
        cheaper = [r for r in table if r["ms a view"] < figures["ms a view"] and r["missed, %"] > figures["missed, %"]]
        if cheaper:
            before = min(cheaper, key=lambda r: r["missed, %"])
            dearer, fewer = (figures[name] - before[name] for name in ("ms a view", "missed, %"))
            figures["ms for 1 %"] = -dearer / fewer
        table.append(figures)
    return table


def draw(table: list[lab.Row], path: object) -> None:
    """Time against share found, a panel a scene; a dashed line joins what nothing beats."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row["scene"] for row in table))
    figure = Figure(figsize=(9, 3.4 * -(-len(names) // 2)), layout="constrained")
    panels = figure.subplots(-(-len(names) // 2), min(2, len(names)), squeeze=False)
    for panel, name in zip(panels.flat, names, strict=False):
        rows = [row for row in table if row["scene"] == name]
        points = {row["sampler"]: (row["missed, %"], row["ms a view"]) for row in rows}
        for place, (sampler, point) in enumerate(points.items()):
            panel.plot(*point, "o", color=f"C{place}", label=sampler)
        known = sorted(points.values())
        front = [p for p in known if not any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in known)]
        panel.plot(*zip(*front, strict=True), "--", color="0.5", linewidth=1, zorder=0)
        panel.set(title=name, xlabel="visible faces missed, %", ylabel="ms a view", yscale="log")
        panel.set_xscale("symlog", linthresh=0.1)
        panel.set_xlim(left=0)
        panel.grid(alpha=0.3)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(labels)), frameon=False)
    figure.savefig(path, dpi=110)


def main() -> None:
    asked = bench.options(__doc__, views=3, rounds=5, names=CHARTED, seed=1, picture="")
    names = asked.names[:1] if asked.quick else asked.names
    views = 1 if asked.quick else asked.views
    table: list[lab.Row] = []
    for name in names:
        table += measured(bench.setting(asked.meshes, name, views), SAMPLERS, asked.rounds, asked.seed)
    bench.show(f"{views} views at 510 x 480 of each scene, medians of {asked.rounds} interleaved rounds", table)
    path = Path(asked.picture) if asked.picture else bench.picture_folder() / "recall.png"
    draw(table, path)
    print(f"\nchart: {path}")


if __name__ == "__main__":
    main()
