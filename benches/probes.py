"""Accuracy bought by each probe: where probes look from, and what they look with.

For some faces of a view sphere, the share of pixels that held-out views inside them miss, after so many probes for
each, and the share of the scene that is culled there:

    python benches/probes.py bunny.ply --views 258 --faces 24 --plot probes.png
"""

from __future__ import annotations

import argparse
from functools import partial
from itertools import pairwise

import numpy as np

import bench
import cyclorama as cyc
from cyclorama import bitfield, lab, sphere
from cyclorama.bakes.learning import Cells, Looker
from cyclorama.bakes.probing import STRATEGIES, Prober
from cyclorama.framing import Framing

STEPS = (0, 4, 8, 16, 32)


def held_out(points: np.ndarray, faces: np.ndarray, chosen: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random directions inside each chosen sphere face, and the face of each."""
    probes = Prober(points, faces, seed=12345, strategy="random").place(chosen, 0, count)
    return probes.directions, probes.home


def curve(scene: cyc.Scene, args: argparse.Namespace, strategy: str, fill: str | None) -> list[dict[str, float]]:
    """Missed and culled shares after each of STEPS probes."""
    points, faces = sphere.octahedron((args.views - 2).bit_length() // 2 - 1)
    chosen = np.sort(np.random.default_rng(args.seed).choice(len(faces), min(args.faces, len(faces)), replace=False))
    framing = Framing.of(scene)
    corners = np.unique(faces[chosen])
    samples = np.zeros((len(points), bitfield.width(len(scene))), dtype=np.uint64)
    samples[corners] = Looker(scene, framing, fill="rays").see(points[corners])
    cells = Cells.of_corners(samples, faces)
    # Neighbours take their turns too: what they find near the common edge is shared.
    prober = Prober(points, faces, args.seed, strategy)
    around = np.unique(np.concatenate([chosen, prober.across[chosen].ravel()]))
    looker = Looker(scene, framing)
    where, home = held_out(points, faces, chosen, args.held_out)
    rows, seconds = [], 0.0

    def learn(begin: int, end: int) -> None:
        for spent in range(begin, end, 4):
            probes = prober.place(around, spent, 4)
            seen, missed = looker.probe(probes.directions, cells.rows, probes.home, fill=fill)
            cells.learn(probes.learners, seen)
            prober.tell(probes, missed)

    for before, step in pairwise((0, *STEPS)):
        seconds += lab.elapsed(partial(learn, before, step))[1]
        missed = looker.probe(where, cells.rows, home)[1]
        culled = 1 - bitfield.count(cells.rows[chosen]).mean() / len(scene)
        rows.append({"probes": step, "missed": missed.mean(), "culled": culled, "ms": 1e3 * seconds / len(around)})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", nargs="?", default=bench.MESHES / "bunny.ply")
    parser.add_argument("--quick", action="store_true", help="few views and one strategy, to see that it runs")
    parser.add_argument("--views", type=int, default=258)
    parser.add_argument("--faces", type=int, default=24, help="sphere faces to look into")
    parser.add_argument("--held-out", type=int, default=25, help="views held out in each")
    parser.add_argument("--strategies", nargs="*", default=list(STRATEGIES))
    parser.add_argument("--fills", nargs="*", default=["bare", "rays"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot", help="write the chart there")
    args = parser.parse_args()
    if args.quick:
        args.views, args.faces, args.held_out, args.strategies, args.fills = 18, 4, 5, args.strategies[:1], ["bare"]
    scene = cyc.load(args.mesh)
    curves = {}
    for strategy in args.strategies:
        for fill in args.fills:
            rows = curve(scene, args, strategy, None if fill == "bare" else fill)
            curves[f"{strategy}, {fill}"] = rows
            cells = "  ".join(f"{r['missed']:.1e}/{r['culled']:.3f}" for r in rows)
            print(f"{strategy:8s} {fill:10s} {cells}   {rows[-1]['ms']:.0f} ms a sphere face", flush=True)
    if args.plot:
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(figsize=(7, 5))
        for name, rows in curves.items():
            axes.plot([r["probes"] for r in rows], [max(r["missed"], 1e-8) for r in rows], marker="o", label=name)
        axes.set(xlabel="probes for each sphere face", ylabel="share of pixels missed", yscale="log", title=args.mesh)
        axes.legend()
        figure.savefig(args.plot, dpi=150)


if __name__ == "__main__":
    main()
