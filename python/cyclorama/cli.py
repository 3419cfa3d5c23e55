"""The command line: `cyclorama demo | bake | info | export | tradeoff | place | walk | strip | view | validate`.

Exit status 0 if all went well, 1 if `validate` found a disagreement, 2 on bad input, with one line that says what was
wrong, 130 on Ctrl-C. Files appear only when they are whole.
"""

from __future__ import annotations

import argparse
import multiprocessing
import re
import sys
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, TextIO

import numpy as np

from . import __version__, exchange, lab, loading, scenes, validation
from .bakes import baking
from .bakes.visibility import Visibility
from .files import check_writable, whole_file
from .tradeoff import COSTS, tradeoff

__all__ = ["main"]

DISAGREE, BAD_INPUT, INTERRUPTED = 1, 2, 130

FILLS = {"rays": "rays", "neighbours": "neighbours", "none": None}


class _Parser(argparse.ArgumentParser):
    """One line about what was wrong, instead of the usage."""

    def error(self, message: str) -> NoReturn:
        raise _Refused(f"{message} (see {self.prog} --help)")


class _Refused(ValueError):
    """Bad input on the command line."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command; `arguments` are those of the process by default.

    Returns
    -------
    int
        The exit status; see the module's text.

    Examples
    --------
    >>> main(["info", "no-such-mesh.ply"])
    2
    """
    try:
        asked = _parser().parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
        with warnings.catch_warnings():
            warnings.showwarning = _warn
            return int(asked.run(asked))
    except KeyboardInterrupt:
        print("cyclorama: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except (ValueError, OSError, ImportError, MemoryError) as error:
        print(f"cyclorama: error: {_one_line(error)}", file=sys.stderr)
        return BAD_INPUT


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning as one line, without the place in our sources that it comes from."""
    print(f"cyclorama: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _one_line(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        text = f"{error.filename}: {error.strerror}"
    else:
        text = str(error) or type(error).__name__
    return " ".join(text.split())


def _joined(arguments: Sequence[str]) -> list[str]:
    """`--faces 0 -1 2` and `--faces -1,0,2` as one word, which argparse would take for an option or for a file."""
    words = list(arguments)
    if "--faces" in words:
        place = words.index("--faces")
        after = words[place + 1 : place + 4]
        count = 3 if len(after) == 3 and all(map(_is_number, after)) else 1
        words[place : place + 1 + count] = ["--faces=" + ",".join(after[:count])]
    return words


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# What to run ----------------------------------------------------------------------------------------------------------


def _demo(asked: argparse.Namespace) -> int:
    from . import demonstration

    _need_matplotlib()
    scene = scenes.gear() if asked.mesh is None else loading.load(asked.mesh)
    name = "gear" if asked.mesh is None else asked.mesh.stem
    _make_folder(asked.out)
    print(f"{name}: {len(scene):,} faces")
    figures = demonstration.run(scene, name, asked.out, views=asked.views, seed=asked.seed, progress=_progress(asked))
    _print_figures(figures)
    return 0


def _bake(asked: argparse.Namespace) -> int:
    out = asked.out if asked.out is not None else Path(asked.mesh.stem + ".npz")
    if out.exists() and out.samefile(asked.mesh):
        raise _Refused(f"--out {out} is the mesh itself")
    scene = loading.load(asked.mesh)
    check_writable(out)
    with _executor(asked) as executor:
        vis = baking.bake(
            scene,
            asked.views,
            asked.patches,
            asked.resolution,
            asked.fov_y,
            fill=FILLS[asked.fill],  # type: ignore[arg-type]
            join=asked.join,
            max_missed=asked.max_missed,
            distances=asked.distances,
            join_count=asked.join_count,
            probes=asked.probes,
            seed=asked.seed,
            threads=asked.threads,
            executor=executor,
            progress=_progress(asked),
        )
    vis.save(out)
    _print_figures(_about(vis) | {"file": f"{out}, {out.stat().st_size:,} bytes"})
    return 0


def _executor(asked: argparse.Namespace) -> AbstractContextManager[Any]:
    """Who works on the tasks: processes of this machine, a Dask cluster, or None for the threads of this process."""
    if asked.workers is not None:
        return ProcessPoolExecutor(asked.workers, mp_context=multiprocessing.get_context("spawn"))
    if asked.dask is None:
        return nullcontext()
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise ModuleNotFoundError("--dask needs distributed: pip install 'cyclorama[cluster]'") from error
    client: AbstractContextManager[Any] = distributed.Client(asked.dask)
    return client


def _info(asked: argparse.Namespace) -> int:
    path = asked.file
    if path.suffix.lower() == ".npz":
        vis = Visibility.load(path)
        if asked.faces is None:
            if asked.count:
                raise _Refused("--count counts the faces of an eye: give --faces X,Y,Z")
            _print_figures(_about(vis) | {"file": f"{path.stat().st_size:,} bytes"})
            return 0
        faces = vis.visible_faces(asked.faces)
        if asked.count:
            print(len(faces))
        else:
            sys.stdout.write("".join(f"{face}\n" for face in faces.tolist()))
        return 0
    if asked.faces is not None:
        raise _Refused("--faces asks a visibility file (.npz); bake the mesh first")
    scene = loading.load(path)
    about: dict[str, Any] = {name: _said(value) for name, value in loading.describe(scene).items()}
    low, high = scene.bounds
    about["bounds"] = " to ".join("(" + ", ".join(f"{x:.6g}" for x in corner) + ")" for corner in (low, high))
    about["radius"] = f"{scene.radius:.6g}"
    kinds = {len(scene.faces): "one a face", len(scene.vertices): "one a vertex"}
    about["colors"] = "none" if scene.colors is None else kinds[len(scene.colors)]
    about["transparent"] = "0" if scene.transparent is None else f"{int(scene.transparent.sum()):,}"
    _print_figures(about)
    return 0


def _export(asked: argparse.Namespace) -> int:
    mesh = asked.mesh if asked.mesh is not None else _mesh_of(asked.file)
    check_writable(asked.out)
    vis, scene = Visibility.load(asked.file), loading.load(mesh)
    vis.check(scene)
    mask = exchange.face_mask(scene, vis.visible_faces(asked.eye))
    if asked.out.suffix.lower() == ".glb":
        exchange.save_gltf(scene, asked.out, mask, labels=vis.labels)
    else:
        with whole_file(asked.out) as file:
            np.save(file, mask)
    print(f"{asked.out}: {int(mask.sum()):,} of {len(scene):,} faces may be seen from there")
    return 0


def _tradeoff(asked: argparse.Namespace) -> int:
    scene = loading.load(asked.mesh)
    for path in (asked.out, asked.csv):
        if path is not None:
            check_writable(path)
    if asked.out is not None:
        _need_matplotlib()
    chart = tradeoff(
        scene,
        asked.views,
        asked.patches,
        resolution=asked.resolution,
        fill=[FILLS[name] for name in asked.fill],
        join=asked.join,
        eval_views=asked.eval_views,
        seed=asked.seed,
        progress=_progress(asked),
    )
    print(chart.table())
    failed = [row["error"] for row in chart.rows if "error" in row]
    if len(failed) == len(chart.rows):
        raise ValueError(failed[0].split(": ", 1)[-1])
    if asked.out is not None:
        chart.plot(asked.out, costs=asked.costs)
        print(f"chart: {asked.out}")
    if asked.csv is not None:
        lab.save(chart.rows, asked.csv)
        print(f"rows: {asked.csv}")
    if asked.max_missed is not None:
        print(f"cheapest with at most {asked.max_missed:g} missed:")
        found = [{"least": COSTS[cost]} | chart.best(asked.max_missed, minimise=cost) for cost in asked.costs]
        varied = [name for name in ("resolution", "fill", "join") if len({row[name] for row in chart.rows}) > 1]
        print(
            lab.table(found, ["least", "views", "patches", *varied, "time", "bytes", "missed_high", "drawn", "query"])
        )
    return 0


def _place(asked: argparse.Namespace) -> int:
    from .placement import figures, place_images

    out = asked.out if asked.out is not None else Path(asked.mesh.stem + ".plan.npz")
    if out.exists() and out.samefile(asked.mesh):
        raise _Refused(f"--out {out} is the mesh itself")
    if asked.chart is not None:
        _need_matplotlib()
        check_writable(asked.chart)
    scene = loading.load(asked.mesh)
    check_writable(out)
    count, is_share = asked.budget
    place = partial(
        place_images,
        scene,
        budget=max(1, round(count * len(scene))) if is_share else int(count),
        optimize_to=asked.optimize_to,
        fov_x=asked.fov_x,
        aspect=asked.aspect,
        up=asked.up,
        directions=asked.directions,
        leaf_depth=asked.leaf_depth,
        threads=asked.threads,
        progress=_progress(asked),
    )
    plan, seconds = lab.elapsed(place)
    plan.save(out)
    steepest = 0.0 if asked.directions == "yaw" else figures.STEEPEST
    eyes, forwards = figures.walk(plan.domain, asked.frames, seed=asked.seed, up=plan.up, steepest=steepest)
    walked = figures.follow(plan, eyes, forwards)
    far = walked.distance[walked.image >= 0]
    edge = float((scene.bounds[1] - scene.bounds[0]).max())
    about = {
        "budget": f"{plan.budget:,} of {len(scene):,} faces",
        "images": f"{len(plan.images):,} from {len(plan.viewpoints):,} viewpoints",
        "seconds": f"{seconds:.2f}",
        "file": f"{out}, {out.stat().st_size:,} bytes",
        "frames of the path": f"{len(walked.drawn):,}, {len(far):,} with an image",
        "drawn at most": f"{walked.drawn.max():,}, by the frustum alone {walked.alone.max():,}",
        "from eye to viewpoint": f"median {np.median(far) / edge:.3g} longest edges, at most {far.max() / edge:.3g}"
        if len(far)
        else "no frame needs an image",
    }
    if asked.chart is not None:
        figures.chart_path(plan, eyes, forwards, path=asked.chart)
        about["chart"] = str(asked.chart)
    _print_figures(about)
    return 0


def _walk(asked: argparse.Namespace) -> int:
    from . import panorama

    folder = asked.mesh if asked.mesh.is_dir() else asked.out
    if not asked.mesh.is_dir():
        if asked.track is None:
            raise _Refused(
                "--track FILE says where to go: JSON with a list of points, or with points, spline and closed"
            )
        scene, track = loading.load(asked.mesh), panorama.Track.read(asked.track)
        panorama.bake(
            scene,
            track,
            asked.slabs,
            asked.size,
            asked.projection,
            alpha=asked.alpha,
            out=folder,
            spacing=asked.spacing,
            up=asked.up,
            progress=_progress(asked),
        )
    store = panorama.Store(folder)
    _print_figures(
        {
            "references": f"{len(store):,} along {store.track.length:.6g}",
            "panoramas": f"{store.projection.width} x {store.projection.height}, {store.projection.kind}",
            "slabs": f"{len(store.slabs)}",
            "folder": f"{folder}, {store.bytes:,} bytes",
        }
    )
    if not asked.bake_only:
        panorama.serve(store, host=asked.host, port=asked.port, open_page=asked.open)
    return 0


def _strip(asked: argparse.Namespace) -> int:
    from .hidden import strip_hidden

    box = None if asked.inside is None else (asked.inside[:3], asked.inside[3:])
    done = strip_hidden(
        asked.mesh,
        asked.out,
        inside=box,
        max_missed=asked.max_missed,
        resolution=asked.resolution,
        seed=asked.seed,
        threads=asked.threads,
        progress=_progress(asked),
    )
    faces, unseen = len(done.hidden.seen), [row["part"] for row in done.parts if not row["kept"]]
    about = {
        "faces": f"{done.kept:,} of {faces:,} kept, {1 - done.kept / faces:.1%} removed",
        "parts": f"{len(done.parts) - len(unseen):,} of {len(done.parts):,} have faces left",
        "views": f"{done.hidden.views:,}",
        "lost of a picture": f"at most {done.hidden.bound:.1e} of its pixels on average, with 95 % confidence",
        "file": f"{asked.out}, {asked.out.stat().st_size:,} bytes of {asked.mesh.stat().st_size:,}",
    }
    if unseen:
        shown = ", ".join(unseen[:5])
        about["never seen"] = shown + (f" and {len(unseen) - 5:,} more" if len(unseen) > 5 else "")
    _print_figures(about)
    return 0


def _view(asked: argparse.Namespace) -> int:
    from .placement import Plan
    from .viewer import write_page

    out = asked.out if asked.out is not None else Path(asked.file.stem + ".html")
    check_writable(out)
    mesh = asked.mesh if asked.mesh is not None else _mesh_of(asked.file)
    vis, scene = Visibility.load(asked.file), loading.load(mesh)
    plan = None if asked.plan is None else Plan.load(asked.plan, scene)
    write_page(vis, scene, out, plan=plan, title=asked.file.stem, up=asked.up)
    print(f"{out}, {out.stat().st_size:,} bytes: open it in a browser")
    if asked.open:
        import webbrowser

        webbrowser.open(out.resolve().as_uri())
    return 0


def _mesh_of(file: Path) -> Path:
    """The mesh beside a visibility file: of the same name, but for the ending."""
    for ending in loading.FORMATS:
        if file.with_suffix(ending).exists():
            return file.with_suffix(ending)
    raise _Refused(f"no mesh named {file.stem} lies beside {file}: give it with --mesh")


def _validate(asked: argparse.Namespace) -> int:
    scene = loading.load(asked.mesh)
    rows = validation.validate(
        scene, views=asked.views, size=asked.resolution, seed=asked.seed, progress=_progress(asked)
    )
    shown = []
    for row in rows:
        if "skipped" in row:
            shown.append({"drawn by": row["peer"], "verdict": f"not asked: {_one_line(Exception(row['skipped']))}"})
            continue
        verdict = "agrees" if row["ok"] else "DISAGREES"
        shown.append(
            {
                "drawn by": row["peer"],
                "version": row["version"],
                "pixels": row["covered"],
                "same face": _share(row["same"]),
                "same face or depth": _share(row["agree"]),
                "else: at an edge": row["explained"],
                "unexplained": row["unexplained"],
                "verdict": verdict,
            }
        )
    columns = list(dict.fromkeys(name for row in shown for name in row if name != "verdict"))
    print(lab.table(shown, [*columns, "verdict"]))
    return 0 if all(row.get("ok", True) for row in rows) else DISAGREE


# How it is said -------------------------------------------------------------------------------------------------------


def _share(value: float) -> str:
    """Percent, rounded down: 100 only if it is all."""
    return f"{np.floor(value * 1e6) / 1e4:.4f} %"


def _about(vis: Visibility) -> dict[str, Any]:
    return {name: _said(value) for name, value in vis.info().items() if value is not None and value != ""}


def _said(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, list | tuple):
        return " ".join(map(_said, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _print_figures(figures: dict[str, Any]) -> None:
    width = max(map(len, figures))
    for name, value in figures.items():
        print(f"{name.replace('_', ' '):<{width}}  {value}")


def _progress(asked: argparse.Namespace) -> bool | None:
    return False if asked.quiet else None


def _need_matplotlib() -> None:
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise ModuleNotFoundError("charts need matplotlib: pip install 'cyclorama[viz]'") from error


def _make_folder(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    check_writable(folder / "demo.png")


# What may be asked ----------------------------------------------------------------------------------------------------


def _parser() -> _Parser:
    parser = _Parser(prog="cyclorama", description="What of a 3D scene can be seen from where, decided ahead of time.")
    parser.add_argument("--version", action="version", version=f"cyclorama {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", title="commands", parser_class=_Parser)

    demo = _command(commands, "demo", _demo, "bake a mesh, rebuild it from one eye, and draw what it costs")
    demo.add_argument("mesh", nargs="?", type=_file, metavar="MESH", help="a mesh; a gear if there is none")
    demo.add_argument("--out", type=Path, default=Path("out"), help="folder of the pictures (%(default)s)")
    demo.add_argument("--views", type=_count, default=66, help="samples (%(default)s)")
    demo.add_argument("--seed", type=_seed, default=0, help="of all that is random (%(default)s)")

    bake = _command(commands, "bake", _bake, "find out what can be seen from every direction, into a file")
    bake.add_argument("mesh", type=_file, metavar="MESH")
    bake.add_argument("-o", "--out", type=Path, metavar="FILE", help="MESH with .npz, in this folder, by default")
    bake.add_argument("--views", type=_count, default=258, help="samples (%(default)s)")
    bake.add_argument("--patches", type=_count, help="a bit for each of so many patches, instead of each face")
    bake.add_argument("--max-missed", type=float, metavar="SHARE", help="as many samples as this error needs")
    bake.add_argument("--distances", type=_numbers, metavar="D,D,...", help="in sampling radii: 1,2,inf")
    bake.add_argument("--join", choices=("cells", "samples"), default="cells")
    bake.add_argument("--join-count", type=int, choices=(3, 6), default=3)
    bake.add_argument("--probes", type=int, default=32, help="most probes in each face of the sphere (%(default)s)")
    bake.add_argument("--fill", choices=FILLS, default="rays")
    bake.add_argument("--resolution", type=_size, default=(510, 480), metavar="WxH")
    bake.add_argument("--fov-y", type=float, default=45.0, metavar="DEGREES")
    bake.add_argument("--seed", type=_seed, default=0, help="of all that is random (%(default)s)")
    bake.add_argument("--threads", type=_count)
    elsewhere = bake.add_mutually_exclusive_group()
    elsewhere.add_argument("--workers", type=_count, metavar="N", help="work on so many processes, with the same bits")
    elsewhere.add_argument("--dask", metavar="ADDRESS", help="work on a Dask cluster: its scheduler, host:port")

    info = _command(commands, "info", _info, "say what a mesh or a visibility file is, or what an eye may see")
    info.add_argument("file", type=_file, metavar="FILE", help="a mesh, or what bake wrote (.npz)")
    info.add_argument("--faces", type=_eye, metavar="X,Y,Z", help="list the faces that an eye there may see")
    info.add_argument("--count", action="store_true", help="only count them")

    export = _command(commands, "export", _export, "write which faces an eye may see, for other programs")
    export.add_argument("file", type=_file, metavar="FILE", help="a visibility file (.npz)")
    export.add_argument("out", type=_exported, metavar="OUT", help=".glb: nodes seen and never seen; .npy: a mask")
    export.add_argument("--eye", type=_eye, required=True, metavar="X,Y,Z")
    export.add_argument("--mesh", type=_file, help="what it was baked from; the mesh of its name beside it by default")

    trade = _command(commands, "tradeoff", _tradeoff, "chart what accuracy costs")
    trade.add_argument("mesh", type=_file, metavar="MESH")
    trade.add_argument("--views", type=_count, nargs="+", default=[6, 18, 66, 258], metavar="N")
    trade.add_argument("--patches", type=_count_or_none, nargs="+", default=[None, 1000, 200], metavar="N|none")
    trade.add_argument("--resolution", type=_size, nargs="+", default=[(510, 480)], metavar="WxH")
    trade.add_argument("--fill", choices=FILLS, nargs="+", default=["rays"])
    trade.add_argument("--join", choices=("cells", "samples"), nargs="+", default=["cells"])
    trade.add_argument("--eval-views", type=_count, default=100, metavar="N", help="random views (%(default)s)")
    trade.add_argument(
        "--max-missed",
        type=float,
        metavar="SHARE",
        help="also print the row that is cheapest in each cost and meets this",
    )
    trade.add_argument("--out", type=_picture, metavar="PICTURE", help="write the chart: .png, .svg or .pdf")
    trade.add_argument("--costs", choices=COSTS, nargs="+", default=["bytes", "drawn"])
    trade.add_argument("--csv", type=_rows, metavar="FILE", help="write all figures of all rows: .csv or .parquet")
    trade.add_argument("--seed", type=_seed, default=0, help="of all that is random (%(default)s)")

    place = _command(commands, "place", _place, "place images so that no frame draws more than a budget")
    place.add_argument("mesh", type=_file, metavar="MESH")
    place.add_argument(
        "--budget", type=_budget, default=(0.2, True), metavar="N|N%", help="the most faces of a frame (20%%)"
    )
    place.add_argument("--optimize-to", type=_count, metavar="N", help="how many faces images should leave")
    place.add_argument("--fov-x", type=float, default=60.0, metavar="DEGREES", help="of all frames (%(default)s)")
    place.add_argument("--aspect", type=float, default=4 / 3, help="width over height of all frames (4/3)")
    place.add_argument("--up", type=_eye, default=[0.0, 1.0, 0.0], metavar="X,Y,Z", help="of all frames (0,1,0)")
    place.add_argument("--directions", choices=("yaw", "sphere"), default="yaw", help="level gazes (default), or any")
    place.add_argument("--leaf-depth", type=_count, default=5, help="of the octree that is counted in (%(default)s)")
    place.add_argument("--out", type=Path, metavar="FILE", help="what to write (MESH's name with .plan.npz)")
    place.add_argument("--chart", type=_picture, metavar="PICTURE", help="write primitives a frame along a path")
    place.add_argument("--frames", type=_count, default=200, metavar="N", help="of that path (%(default)s)")
    place.add_argument("--seed", type=_seed, default=0, help="of that path (%(default)s)")
    place.add_argument("--threads", type=_count)

    walk = _command(commands, "walk", _walk, "render a walk along a track ahead of time, and serve it to browsers")
    walk.add_argument("mesh", type=_path, metavar="MESH", help="a mesh, or the folder of a walk that is rendered")
    walk.add_argument("--track", type=_file, metavar="FILE", help="where it goes: JSON, a list of points [x, y, z]")
    walk.add_argument("--out", type=Path, default=Path("walk"), metavar="FOLDER", help="what to write (%(default)s)")
    walk.add_argument("--slabs", type=_count, default=3, help="of range, that move one before the other (%(default)s)")
    walk.add_argument("--size", type=_size, default=(4096, 1024), metavar="WxH", help="of panoramas (4096x1024)")
    walk.add_argument("--projection", choices=("cylinder", "equirect"), default="cylinder")
    walk.add_argument("--alpha", type=float, default=1.0, help="share of a tile that is hidden when it is left out (1)")
    walk.add_argument("--spacing", type=float, metavar="LENGTH", help="between references")
    walk.add_argument("--up", type=_eye, default=[0.0, 1.0, 0.0], metavar="X,Y,Z", help="(0,1,0)")
    walk.add_argument("--bake-only", action="store_true", help="write the folder and serve nothing")
    walk.add_argument("--host", default="127.0.0.1", help="who may see it: this machine alone by default")
    walk.add_argument("--port", type=_port, default=8437, help="(%(default)s); 0 takes one that is free")
    walk.add_argument("--open", action="store_true", help="open the page in a browser")

    strip = _command(commands, "strip", _strip, "write a mesh without the faces that nobody can ever see")
    strip.add_argument("mesh", type=_file, metavar="MESH")
    strip.add_argument("out", type=Path, metavar="OUT", help="what to write: GLB keeps nodes, names and materials")
    strip.add_argument(
        "--max-missed", type=float, default=1e-3, metavar="SHARE", help="of a view's pixels, on average (%(default)g)"
    )
    strip.add_argument(
        "--inside",
        type=_box,
        metavar="X,Y,Z,X,Y,Z",
        help="box in which eyes may be; by default they are around the mesh",
    )
    strip.add_argument("--resolution", type=_size, default=(510, 480), metavar="WxH")
    strip.add_argument("--seed", type=_seed, default=0, help="of all that is random (%(default)s)")
    strip.add_argument("--threads", type=_count)

    view = _command(commands, "view", _view, "write a page that shows what a baked eye sees, to be turned around")
    view.add_argument("file", type=_file, metavar="FILE", help="a visibility file (.npz)")
    view.add_argument("--mesh", type=_file, help="what it was baked from; the mesh of its name beside it by default")
    view.add_argument("--plan", type=_file, metavar="FILE", help="a plan (.plan.npz), whose backdrops are shown, too")
    view.add_argument("-o", "--out", type=Path, metavar="FILE", help="FILE with .html, in this folder, by default")
    view.add_argument("--up", type=_eye, default=[0.0, 1.0, 0.0], metavar="X,Y,Z", help="in the page (0,1,0)")
    view.add_argument("--open", action="store_true", help="open it in a browser")

    validate = _command(commands, "validate", _validate, "draw a mesh with every renderer there is, and compare")
    validate.add_argument("mesh", type=_file, metavar="MESH")
    validate.add_argument("--views", type=_count, default=3, help="random views (%(default)s)")
    validate.add_argument("--resolution", type=_size, default=(510, 480), metavar="WxH")
    validate.add_argument("--seed", type=_seed, default=0, help="of all that is random (%(default)s)")
    return parser


def _command(commands: Any, name: str, run: Any, text: str) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=text[0].upper() + text[1:] + "."
    )
    command.add_argument("-q", "--quiet", action="store_true", help="no progress bar")
    command.set_defaults(run=run)
    return command


def _file(word: str) -> Path:
    path = Path(word)
    if not path.exists():
        raise argparse.ArgumentTypeError(f"{word}: no such file")
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{word} is a folder")
    return path


def _path(word: str) -> Path:
    path = Path(word)
    return path if path.is_dir() else _file(word)


def _count(word: str) -> int:
    try:
        count = int(word)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{word!r} is not a whole number") from None
    if count < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {count}")
    return count


def _port(word: str) -> int:
    if not (re.fullmatch(r"\d+", word) and int(word) < 65536):
        raise argparse.ArgumentTypeError(f"{word!r} is no port: a whole number from 0 to 65535")
    return int(word)


def _budget(word: str) -> tuple[float, bool]:
    """A number of faces, or a share of all and True."""
    if not word.endswith("%"):
        return _count(word), False
    share = float(word[:-1]) / 100 if _is_number(word[:-1]) else 0.0
    if not 0 < share <= 1:
        raise argparse.ArgumentTypeError(f"{word!r} is not a share above 0% and at most 100%")
    return share, True


def _seed(word: str) -> int:
    if not re.fullmatch(r"\d+", word):
        raise argparse.ArgumentTypeError(f"{word!r} is not a whole number of at least 0")
    return int(word)


def _ending(word: str, endings: Sequence[str]) -> Path:
    path = Path(word)
    if path.suffix.lower() not in endings:
        raise argparse.ArgumentTypeError(f"{word!r} does not end in {' or '.join(endings)}")
    return path


def _picture(word: str) -> Path:
    return _ending(word, (".png", ".svg", ".pdf"))


def _rows(word: str) -> Path:
    return _ending(word, (".csv", ".parquet"))


def _exported(word: str) -> Path:
    return _ending(word, (".glb", ".npy"))


def _count_or_none(word: str) -> int | None:
    return None if word.lower() == "none" else _count(word)


def _numbers(word: str) -> list[float]:
    try:
        return [float(part) for part in word.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{word!r} is not numbers with commas between them") from None


def _eye(word: str) -> list[float]:
    numbers = _numbers(word)
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{word!r} is not a place: three finite numbers, X,Y,Z")
    return numbers


def _box(word: str) -> list[float]:
    numbers = _numbers(word)
    if len(numbers) != 6 or not np.isfinite(numbers).all():
        raise argparse.ArgumentTypeError(f"{word!r} is not a box: its lowest and highest corner, X,Y,Z,X,Y,Z")
    return numbers


def _size(word: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)[xX](\d+)", word)
    if match is None or min(map(int, match.groups())) < 1:
        raise argparse.ArgumentTypeError(f"{word!r} is not a size in pixels, like 510x480")
    return int(match[1]), int(match[2])
