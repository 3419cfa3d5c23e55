"""A bake to look at: the model as one sample sees it, turned around while the eye stays (2001, figure 1)."""

from __future__ import annotations

import html
import os
from typing import Any

import numpy as np
import numpy.typing as npt

from .arguments import checked_floats
from .bakes.visibility import Visibility
from .files import whole_file
from .pages import script
from .pages.packing import pack, pack_text
from .placement import Plan
from .scene import Scene

__all__ = ["widget", "write_page"]

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>html, body, #view {{ height: 100%; margin: 0; background: #14171c; color: #e8eaed; }}</style>
</head>
<body>
<div id="view"></div>
<script id="data" type="text/plain">{data}</script>
<script type="module">{script}</script>
</body>
</html>
"""


def write_page(
    vis: Visibility,
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    plan: Plan | None = None,
    title: str | None = None,
    up: npt.ArrayLike = (0.0, 1.0, 0.0),
) -> None:
    """Writes a bake as a page that needs no network and no server: one file, to be opened in a browser.

    It shows what an eye on the sampling sphere may see, turned around; the sphere with its samples and the face that
    the eye looks through; live, how many faces are drawn and culled and, drawn again in the browser, how many pixels
    are missed.

    Parameters
    ----------
    vis : Visibility
    scene : Scene
        What it was baked from.
    path : path
        What to write, ending in ``.html``.
    plan : Plan, optional
        Its backdrops are shown as quadrilaterals.
    title : str, optional
        What stands above the figures.
    up : (3,) array_like of float
        What is up in the page.

    Raises
    ------
    ValueError
        If `vis` was baked from another scene, it has 2**24 faces or more, which the browser's id-buffer can't tell, or
        `up` is no direction.
    FileNotFoundError
        If the package was built without its pages.
    OSError
        If the file can't be written.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> ball = cyc.scenes.sphere(faces=80)
    >>> vis = cyc.bake(ball, views=6, resolution=(64, 64), progress=False)
    >>> write_page(vis, ball, "ball.html")  # doctest: +SKIP
    """
    values, arrays = _content(vis, scene, plan, title, up)
    page = _PAGE.format(
        title=html.escape(values["title"]),
        data=pack_text(values, arrays),
        script=script("visibility").replace("</script", "<\\/script"),
    )
    with whole_file(path) as file:
        file.write(page.encode())


def widget(
    vis: Visibility,
    scene: Scene,
    *,
    plan: Plan | None = None,
    title: str | None = None,
    up: npt.ArrayLike = (0.0, 1.0, 0.0),
    height: int = 480,
) -> Any:
    """The same as a Jupyter widget, `height` pixels high.

    Parameters
    ----------
    vis, scene, plan, title, up
        See `write_page`.
    height : int
        Of the widget in pixels.

    Returns
    -------
    anywidget.AnyWidget
        Setting its `direction`, three numbers, turns the view.

    Raises
    ------
    ImportError
        If anywidget is not installed: ``pip install cyclorama[notebook]``.
    ValueError, FileNotFoundError
        As for `write_page`.
    """
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise ImportError("widgets need anywidget: pip install 'cyclorama[notebook]'") from error

    class _Widget(anywidget.AnyWidget):
        _esm = script("visibility_widget")
        data = traitlets.Bytes().tag(sync=True)
        height = traitlets.Int().tag(sync=True)
        direction = traitlets.List([0.0, 0.0, 1.0]).tag(sync=True)

    return _Widget(data=pack(*_content(vis, scene, plan, title, up)), height=height)


def _content(
    vis: Visibility, scene: Scene, plan: Plan | None, title: str | None, up: npt.ArrayLike
) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """What the page is told: lengths in model radii, from the centre of the sampling sphere."""
    vis.check(scene)
    if len(scene) >= 1 << 24:
        raise ValueError(f"the scene has {len(scene):,} faces: a page tells fewer than 2**24 apart")
    upward = checked_floats("up", up)
    if upward.shape != (3,) or not np.isfinite(upward).all() or not upward.any():
        raise ValueError(f"up must be a direction, got {up!r}")
    scale = 1.0 / vis.model_radius

    def seen_from_center(points: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        return ((points.astype(np.float64) - vis.sphere.center) * scale).astype(np.float32)

    rows = np.concatenate(list(vis.cell_rows()))
    arrays: dict[str, npt.NDArray[Any]] = {
        "positions": seen_from_center(scene.vertices),
        "indices": scene.faces,
        "points": vis.sphere.points.astype(np.float32),
        "sphereFaces": vis.sphere.faces.astype(np.uint32),
        "rows": rows.astype("<u8").view(np.uint8),
        "quads": np.empty((0, 12), dtype=np.float32),
    }
    if vis.labels is not None:
        arrays["labels"] = vis.labels
    if scene.transparent is not None:
        arrays["transparent"] = scene.transparent.astype(np.uint8)
    if scene.colors is not None:
        of_faces = len(scene.colors) == len(scene) != len(scene.vertices)
        colors = scene.colors if of_faces else scene.colors[scene.faces].mean(axis=1).astype(np.uint8)
        arrays["colors"] = colors
    if plan is not None and len(plan.images):
        arrays["quads"] = seen_from_center(plan.images.corners.reshape(-1, 3))
    if title is None:
        title = f"{len(scene):,} faces, {len(vis.sphere.points):,} samples"
    values = {
        "title": title,
        "faceCount": len(scene),
        "rowBytes": 8 * rows.shape[1],
        "radius": vis.distances[0] * vis.sphere.radius * scale if np.isfinite(vis.distances[0]) else 3.0,
        "fovY": vis.settings.fov_y,
        "up": (upward / np.linalg.norm(upward)).tolist(),
    }
    return values, arrays
