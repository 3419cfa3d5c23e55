"""The user's own mesh, drawn by us and by renderers nobody here wrote, pixel by pixel.

Two renderers may rightly differ at a pixel in one case: an edge passes so near its centre that their arithmetic puts
the centre on different sides. How near depends on the renderer: ray casters and OpenCV compute in float32, OpenGL snaps
projected corners to 1/256 of a pixel. So a pixel *agrees* if both see the same face, or both see a surface at the same
depth (within 1e-4, relatively: touching and crossing faces); it is *explained* if our own picture changes within that
reach of its centre; and what remains is *unexplained*: there, one of the two is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from importlib import metadata
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import peers
from .camera import Camera
from .lab import Row
from .progress import Progress, reporter
from .render import BACKGROUND, View
from .scene import Scene

__all__ = ["Classes", "classify", "compare", "shifted", "validate"]

Mask = npt.NDArray[np.bool_]

#: Relative difference of depths that counts as none: a hundred times what float32 loses over a scene's depth.
SAME_DEPTH = 1e-4

#: Unexplained pixels that a view may have, of its covered ones: where three or more surfaces meet within the reach, the
#: shifted pictures that explain a pixel can miss the one which its peer saw.
UNEXPLAINED = 1e-5

#: Name, distribution, adapter, and how far from a pixel's centre an edge may explain a difference, in pixels.
PEERS: tuple[tuple[str, str, Callable[[Any, Any], peers.Peer], float], ...] = (
    ("Open3D", "open3d", peers.Embree, 1 / 1024),
    ("trimesh with embreex", "embreex", peers.TrimeshEmbree, 1 / 1024),
    ("pyrender", "pyrender", peers.PyrenderIds, 1 / 256),
    ("OpenCV", "opencv-python-headless", peers.OpenCV, 1 / 1024),
)

#: The eight ways to shift a picture by the reach.
SHIFTS = tuple((dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if (dx, dy) != (0, 0))


def validate(
    scene: Scene,
    *,
    views: int = 3,
    size: tuple[int, int] = (510, 480),
    seed: int = 0,
    names: Iterable[str] | None = None,
    progress: Progress = None,
) -> list[Row]:
    """Draws random views of a scene with our two engines and with every peer that is installed.

    Parameters
    ----------
    scene : Scene
    views : int
        Random directions, each from the distance at which the scene fills the image.
    size : (int, int)
        Width and height of the images in pixels.
    seed : int
        Of the directions.
    names : iterable of str, optional
        Only these peers, of ``"Open3D"``, ``"trimesh with embreex"``, ``"pyrender"`` and ``"OpenCV"``.
    progress : bool, callable or None
        One unit is one view of one peer.

    Returns
    -------
    list of dict
        A row for each peer: `peer`, `version`, `covered` pixels (by either, over all views), `same` and `agree`
        (shares of them), `explained` and `unexplained` (counts of those that do not agree) and `ok`; or, for a peer
        that can't be asked here, `skipped`, the reason. The first row compares our two engines, whose ids and depths
        must be the same bits.

    Raises
    ------
    ValueError
        If `views` is less than 1, or a name is unknown.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> [row["ok"] for row in validate(scene, views=1, size=(32, 24), names=[], progress=False)]
    [True]
    """
    if views < 1:
        raise ValueError(f"views must be at least 1, got {views}")
    known = [name for name, *_ in PEERS]
    chosen = known if names is None else list(names)
    for name in chosen:
        if name not in known:
            raise ValueError(f"{name!r} is no peer: choose from {', '.join(known)}")
    cameras = _cameras(scene, views, size, seed)
    rows = []
    with reporter(progress, views * (1 + len(chosen)), "comparing") as report:
        rows.append(_engines(scene, cameras))
        done = views
        report(done)
        for name, distribution, kind, reach in PEERS:
            if name not in chosen:
                continue
            row: Row = {"peer": name}
            try:
                peer = kind(scene.vertices, scene.faces)
                row["version"] = _version(distribution)
                row |= _compare_all(scene, cameras, peer, reach, _later(report, done))
            except peers.Missing as error:
                row["skipped"] = str(error)
            rows.append(row)
            done += views
            report(done)
    return rows


def _later(report: Callable[[int], object], done: int) -> Callable[[int], object]:
    return lambda more: report(done + more)


def _compare_all(
    scene: Scene, cameras: list[Camera], peer: peers.Peer, reach: float, report: Callable[[int], object]
) -> Row:
    totals = np.zeros(5, dtype=np.int64)
    ok = True
    for view, camera in enumerate(cameras):
        counts = compare(scene, camera, *peer.render(camera), reach=reach)
        ok &= counts["unexplained"] <= UNEXPLAINED * counts["covered"]
        totals += list(counts.values())
        report(view + 1)
    covered, same, agree, explained, unexplained = totals.tolist()
    return {
        "covered": covered,
        "same": same / max(covered, 1),
        "agree": agree / max(covered, 1),
        "explained": explained,
        "unexplained": unexplained,
        "ok": bool(ok),
    }


def compare(
    scene: Scene, camera: Camera, ids: npt.NDArray[np.uint32], depth: npt.NDArray[np.floating], *, reach: float
) -> dict[str, int]:
    """Counts the pixels of one view where another renderer's answer agrees with ours.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    ids : (H, W) ndarray of uint32
        The other's nearest faces, `BACKGROUND` where it sees none.
    depth : (H, W) ndarray of float
        The other's depths along the optical axis, in the user's units; infinite where it sees nothing.
    reach : float
        How far from a pixel's centre an edge may explain a difference, in pixels.

    Returns
    -------
    dict
        `covered`, `same`, `agree`, `explained`, `unexplained`: numbers of pixels.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> camera = cyc.Camera.look_at([0.3, 0.3, 2], [0.3, 0.3, 0], width=3, height=3)
    >>> view = scene.render(camera)
    >>> counts = compare(scene, camera, view.ids, view.depth, reach=1 / 1024)
    >>> counts["covered"] == counts["same"], counts["unexplained"]
    (True, 0)
    """
    found = classify(scene.render(camera), ids, depth, shifted(scene, camera, reach))
    return {name: int(mask.sum()) for name, mask in found._asdict().items()}


class Classes(NamedTuple):
    """Which pixels of two pictures agree, and where an edge explains that they don't; (H, W) ndarrays of bool."""

    covered: Mask
    same: Mask
    agree: Mask
    explained: Mask
    unexplained: Mask


def classify(ours: View, ids: npt.NDArray[np.uint32], depth: npt.NDArray[np.floating], near: Iterable[View]) -> Classes:
    """Divides the pixels of one view by whether another renderer's answer agrees with ours.

    Parameters
    ----------
    ours : View
    ids, depth
        As for `compare`.
    near : iterable of View
        Our picture, shifted by as much as may explain a difference. Nothing is asked of it where all pixels agree.
    """
    covered = (ours.ids != BACKGROUND) | (ids != BACKGROUND)
    same = covered & (ours.ids == ids)
    both = (ours.ids != BACKGROUND) & (ids != BACKGROUND)
    agree = same.copy()
    agree[both] |= np.abs(ours.depth[both] - depth[both]) <= SAME_DEPTH * np.abs(depth[both])
    differ = covered & ~agree
    crossed = np.zeros_like(differ)
    if differ.any():
        for view in near:
            crossed |= view.ids != ours.ids
    return Classes(covered, same, agree, differ & crossed, differ & ~crossed)


def shifted(scene: Scene, camera: Camera, reach: float) -> Iterator[View]:
    """Our picture from pixel centres that are `reach` pixels beside the right ones, in eight directions."""
    for dx, dy in SHIFTS:
        K = camera.K.copy()
        K[:2, 2] += reach * dx, reach * dy
        yield scene.render(camera.replace(K=K))


def _engines(scene: Scene, cameras: list[Camera]) -> Row:
    covered = same = 0
    for camera in cameras:
        raster, rays = (scene.render(camera, engine=engine) for engine in ("raster", "raycast"))
        either = (raster.ids != BACKGROUND) | (rays.ids != BACKGROUND)
        covered += int(either.sum())
        same += int((either & (raster.ids == rays.ids) & (raster.depth == rays.depth)).sum())
    return {
        "peer": "our two engines",
        "version": _version("cyclorama"),
        "covered": covered,
        "same": same / max(covered, 1),
        "agree": same / max(covered, 1),
        "explained": 0,
        "unexplained": covered - same,
        "ok": covered == same,
    }


def _cameras(scene: Scene, views: int, size: tuple[int, int], seed: int) -> list[Camera]:
    width, height = size
    directions = np.random.default_rng(seed).normal(size=(views, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fov_y = 45.0
    half = math.atan(math.tan(math.radians(fov_y) / 2) * min(1.0, width / height))
    eyes = scene.center + directions * scene.radius / math.sin(half)
    return [Camera.look_at(eye, scene.center, fov_y=fov_y, width=width, height=height) for eye in eyes]


def _version(distribution: str) -> str:
    for name in (distribution, distribution.replace("python-headless", "python")):
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return "?"
