"""Assertions for those who write a renderer: is what it draws what there is to be seen?

Each compares one answer of the caller's renderer with ours. Two right renderers differ where an edge passes so near a
pixel's centre that their arithmetic puts the centre on different sides: such pixels are *explained* by pictures shifted
by `reach` pixels (`cyclorama.validation`), and everything else is *unexplained*. If there is more of that than is
allowed, an AssertionError says how many pixels, the first of them, and what was probably done: the same is drawn with
each common mistake, then with two at a time, and what leaves the least unexplained is named. A picture of the
difference is written beside.

>>> import cyclorama as cyc
>>> scene = cyc.scenes.sphere(500)
>>> camera = cyc.Camera.look_at((2, 3, 4), (0, 0, 0), width=64, height=48)
>>> mine = scene.render(camera).ids[::-1]
>>> try:
...     assert_ids_match(scene, camera, mine, picture=False)
... except AssertionError as error:
...     print(str(error).splitlines()[-1])
probably: rows are flipped: the first row is the bottom one (leaves 0 of ... unexplained pixels)
"""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import warp
from .arguments import as_numpy
from .bitfield import Bitfields
from .camera import Camera
from .depth_image import DepthImage
from .render import BACKGROUND, View
from .scene import Scene
from .validation import SAME_DEPTH, UNEXPLAINED, classify, shifted
from .warp import Splat, Warped

__all__ = ["assert_depth_matches", "assert_ids_match", "assert_visible_matches", "assert_warp_matches"]

Mask = npt.NDArray[np.bool_]
Ids = npt.NDArray[np.uint32]
Floats = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]
Picture = str | os.PathLike[str] | bool | None

#: How far from a pixel's centre an edge may explain a difference, in pixels: OpenGL snaps corners to 1/256; ray casters
#: in float32 need a quarter of that.
REACH = 1 / 256

#: Where the first sample of a multisampled pixel may lie, from its centre: of 2, 4 and 8 samples, and mirrored, where
#: rows go the other way. A depth buffer that is resolved has the depth of that one.
SAMPLES = ((1 / 4, 1 / 4), (1 / 8, 3 / 8), (3 / 8, 1 / 8), (1 / 16, 3 / 16), (3 / 16, 1 / 16))

#: Roundings of float32 on the way from a pixel to a coordinate of its warped place: six each in the numerator and the
#: denominator (three products, their sum, the disparity's product and sum), the quotient, and two for the viewport.
_ROUNDINGS = 15

#: A mistake is named if it explains all but this share of what was unexplained.
_TELLING = 0.2

#: Pixels and faces that a report names.
_NAMED = 5

#: Pixels that a face may own and yet be overlooked by a picture of a third of the size.
_FEW = 9

#: Where pictures of differences go by default.
_FOLDER = "cyclorama-differences"


def assert_ids_match(
    scene: Scene,
    camera: Camera,
    ids: npt.ArrayLike,
    *,
    reach: float = REACH,
    allowed: float = UNEXPLAINED,
    picture: Picture = None,
) -> None:
    """Asserts that an id-buffer has the nearest face at each pixel's centre.

    Parameters
    ----------
    scene : Scene
        Of F faces.
    camera : Camera
        Of W x H pixels.
    ids : (H, W) array_like of int
        The caller's: faces from 0 to F - 1; anything negative, or `BACKGROUND`, where nothing is seen. Another face at
        the same depth (1e-4, relatively) agrees: of touching faces either may be drawn.
    reach : float
        How far from a pixel's centre an edge may explain a difference, in pixels. 1/256 is OpenGL's.
    allowed : float
        Share of covered pixels that may differ unexplained: where three surfaces meet within the reach.
    picture : path or bool, optional
        Where to write the picture of the difference (a PNG: ours, the caller's, and green where they agree, yellow
        where explained, red where not); by default a file named after the test in ``cyclorama-differences``. False for
        none.

    Raises
    ------
    AssertionError
        If more differs.
    ValueError
        If the ids are no integers, or of another shape than the camera.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(500)
    >>> camera = cyc.Camera.look_at((2, 3, 4), (0, 0, 0), width=64, height=48)
    >>> assert_ids_match(scene, camera, scene.render(camera, engine="raycast").ids)
    """
    theirs = _ids(ids, camera, "ids")
    ours = scene.render(camera)
    depth = _depth_of(scene, camera, theirs)
    found = classify(ours, theirs, depth, shifted(scene, camera, reach))
    count, covered = int(found.unexplained.sum()), int(found.covered.sum())
    if count <= allowed * covered:
        return
    lines = [
        f"{count:,} of {covered:,} covered pixels show another face than the nearest one, "
        f"{int(found.explained.sum()):,} more are explained by edges within {reach:.4g} of a pixel"
    ]
    for row, column in np.argwhere(found.unexplained)[:_NAMED].tolist():
        a, b = ours.ids[row, column], theirs[row, column]
        lines.append(
            f"  pixel [{row}, {column}]: {_face(a)} at {ours.depth[row, column]:.6g}, got {_face(b)}"
            + (f" at {depth[row, column]:.6g}" if np.isfinite(depth[row, column]) else "")
        )
    lines += _faces_of(ours.ids[found.unexplained])

    def unlike(view: View) -> int:
        return int(((view.ids != theirs) & ~found.explained).sum())

    causes = []
    for name, got in _rearranged(theirs):
        if got.shape == theirs.shape:
            # What agrees as it is may differ as it should have been: all covered pixels count.
            causes.append((name, int(((ours.ids != got) & ((ours.ids != BACKGROUND) | (got != BACKGROUND))).sum())))
    causes += _numbered_otherwise(scene, ours.ids, theirs, found.unexplained)
    causes += _pictures_gone_wrong(scene, camera, unlike)
    if not _cause(causes, count):
        put_right = list(_rearranged(theirs))
        causes += _mixtures(
            scene, camera, theirs, lambda view: put_right, lambda got, view: int((view.ids != got).sum())
        )
    lines.append(_cause(causes, count) or _place(ours, depth, theirs != BACKGROUND, found.agree, found.unexplained))
    panels = [_colored(ours.ids), _colored(theirs), _verdict(found.agree, found.explained, found.unexplained)]
    raise AssertionError(_with_picture("id-buffer", lines, panels, picture))


def assert_depth_matches(
    scene: Scene,
    camera: Camera,
    depth: npt.ArrayLike,
    *,
    reach: float = REACH,
    relative: float = SAME_DEPTH,
    allowed: float = UNEXPLAINED,
    picture: Picture = None,
) -> None:
    """Asserts that a depth buffer has the distance along the viewing axis at each pixel's centre.

    A pixel agrees if its depth is that of our picture or of one shifted by `reach`, within `relative` and what the
    surface's depth changes within the reach: so grazing faces may be off by as much as they are steep.

    Parameters
    ----------
    scene, camera, allowed, picture
        As for `assert_ids_match`.
    depth : (H, W) array_like of float
        The caller's, in the scene's unit; infinity, NaN, 0 or less where nothing is seen.
    reach : float
        How far from a pixel's centre a surface may be looked at, in pixels.
    relative : float
        Relative error: by default a hundred times what float32 loses over a scene's depth. A z-buffer of 24 bits has
        about ``depth / (near * 2**24)``.

    Raises
    ------
    AssertionError
        If more differs.
    ValueError
        If the depths are of another shape than the camera.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(500)
    >>> camera = cyc.Camera.look_at((2, 3, 4), (0, 0, 0), width=64, height=48)
    >>> assert_depth_matches(scene, camera, scene.render(camera, engine="raycast").depth)
    """
    given = _image(depth, camera, "depth")
    theirs = np.where(np.isfinite(given) & (given > 0), given, np.inf)
    ours = scene.render(camera)
    truth = ours.depth.astype(np.float64)
    covered = np.isfinite(truth) | np.isfinite(theirs)
    agree = covered & _near(theirs, truth, relative)
    explained = np.zeros_like(agree)
    if (covered & ~agree).any():
        views = list(shifted(scene, camera, reach))
        change = np.zeros(truth.shape)
        for view in views:
            same = (view.ids == ours.ids) & np.isfinite(truth)
            change[same] = np.maximum(change[same], np.abs(view.depth[same] - truth[same]))
        for view in (ours, *views):
            explained |= _near(theirs, view.depth.astype(np.float64), relative, change)
        explained &= covered & ~agree
    unexplained = covered & ~agree & ~explained
    count = int(unexplained.sum())
    if count <= allowed * covered.sum():
        return
    lines = [
        f"{count:,} of {int(covered.sum()):,} covered pixels have another depth than the nearest surface, "
        f"{int(explained.sum()):,} more are explained by what is within {reach:.4g} of a pixel"
    ]
    for row, column in np.argwhere(unexplained)[:_NAMED].tolist():
        lines.append(
            f"  pixel [{row}, {column}]: {truth[row, column]:.6g} on {_face(ours.ids[row, column])}, "
            f"got {given[row, column]:.6g}"
        )
    lines += _faces_of(ours.ids[unexplained])

    def unlike(view: View) -> int:
        return int((~_near(theirs, view.depth.astype(np.float64), 10 * relative) & ~explained).sum())

    def differ(depth: Floats, view: View) -> int:
        return int((~_near(depth, view.depth.astype(np.float64), 10 * relative)).sum())

    def mended(view: View) -> Iterator[tuple[str, Floats]]:
        yield from _rearranged(theirs)
        yield from _measured_otherwise(camera, given, view.depth.astype(np.float64))

    causes = []
    for name, got in mended(ours):
        if got.shape == truth.shape:
            causes.append((name, int((~_near(got, truth, 10 * relative) & (covered | np.isfinite(got))).sum())))
    causes += _pictures_gone_wrong(scene, camera, unlike)
    if not _cause(causes, count):
        causes += _mixtures(scene, camera, theirs, mended, differ)
    lines.append(_cause(causes, count) or _place(ours, theirs, np.isfinite(theirs), agree, unexplained))
    panels = [_grey(truth, truth), _grey(theirs, truth), _verdict(agree, explained, unexplained)]
    raise AssertionError(_with_picture("depth buffer", lines, panels, picture))


def assert_visible_matches(
    scene: Scene,
    camera: Camera,
    faces: npt.ArrayLike | Bitfields,
    *,
    reach: float = REACH,
    exact: bool = False,
    allowed: float = 0.0,
    picture: Picture = None,
) -> None:
    """Asserts that a set of visible faces lacks none that owns a pixel, and, if asked, has no other.

    A face must be in the set if it owns the same pixel in our picture and in all those shifted by `reach`. With `exact`
    it may only be if it owns a pixel of one of these or of a picture four times as fine, or if a point of it was proved
    to be seen (`Scene.visible`). Transparent faces may be in any set.

    Parameters
    ----------
    scene, camera, reach, picture
        As for `assert_ids_match`. The picture shows in red what is missing.
    faces : (K,) array_like of int, (F,) array_like of bool, or Bitfields of one row
        The caller's.
    exact : bool
        Whether faces that cannot be seen are refused, too; otherwise a set may be conservative.
    allowed : float
        Share of the faces that must be there which may be missing, and of the set which may be too many.

    Raises
    ------
    AssertionError
        If more is missing, or too many.
    ValueError
        If an entry is no face of the scene.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> scene = cyc.scenes.sphere(500)
    >>> camera = cyc.Camera.look_at((2, 3, 4), (0, 0, 0), width=64, height=48)
    >>> assert_visible_matches(scene, camera, scene.visible(camera), exact=True)
    """
    mine = _face_set(faces, len(scene))
    ours = scene.render(camera)
    views = list(shifted(scene, camera, reach))
    stable = ours.ids != BACKGROUND
    for view in views:
        stable &= view.ids == ours.ids
    must = np.zeros(len(scene), np.bool_)
    must[ours.ids[stable]] = True
    missing = must & ~mine
    spare = np.zeros_like(missing)
    if exact:
        may = scene.visible(camera, points=64, progress=False).unpack()[0]
        for view in (ours, *views, scene.render(camera.scaled(4))):
            may[view.ids[view.ids != BACKGROUND]] = True
        spare = mine & ~may
    if missing.sum() <= allowed * must.sum() and spare.sum() <= allowed * mine.sum():
        return
    lines = []
    toward = _facing(scene, camera)
    if missing.any():
        pixels = np.bincount(ours.ids[ours.ids != BACKGROUND], minlength=len(scene))
        lines.append(f"{int(missing.sum()):,} of {int(must.sum()):,} faces that own a pixel are missing")
        for face in np.flatnonzero(missing)[np.argsort(-pixels[missing], kind="stable")][:_NAMED].tolist():
            row, column = np.argwhere(ours.ids == face)[0].tolist()
            lines.append(f"  face {face}: owns {pixels[face]} pixels, the first is [{row}, {column}]")
        if not toward[missing].any() and toward[must].any():
            lines.append("probably: back faces are culled: all that is missing turns its back to the eye")
        elif toward[missing].all() and not toward[must].all():
            lines.append("probably: front faces are culled: all that is missing turns its front to the eye")
        elif np.median(pixels[missing]) <= _FEW:
            lines.append(
                f"probably: it was read from a coarser picture: most of what is missing owns {_FEW} pixels at most"
            )
    if spare.any():
        lines.append(f"{int(spare.sum()):,} of {int(mine.sum()):,} faces of the set were not seen")
        outside = _outside(scene, camera)
        for face in np.flatnonzero(spare)[:_NAMED].tolist():
            why = "outside the image" if outside[face] else "in the image and hidden"
            lines.append(f"  face {face}: {why}" + ("" if toward[face] else ", turns its back to the eye"))
        if outside[spare].mean() > 1 - _TELLING:
            lines.append("probably: the set is of another camera or a wider one: most of these lie outside the image")
        elif not toward[spare].any():
            lines.append("probably: of some faces the back is taken for visible: all of these turn it to the eye")
    lost = np.append(missing, False)[np.minimum(ours.ids, len(scene))]
    shown = np.append(mine, False)[np.minimum(ours.ids, len(scene))]
    panels = [
        _colored(ours.ids),
        _colored(np.where(shown, ours.ids, BACKGROUND)),
        _verdict(shown, (ours.ids != BACKGROUND) & ~shown & ~lost, lost),
    ]
    raise AssertionError(_with_picture("visible set", lines, panels, picture))


def assert_warp_matches(
    image: DepthImage,
    camera: Camera,
    color: npt.ArrayLike,
    hole: npt.ArrayLike | None = None,
    *,
    splat: Splat = 3,
    levels: float = 2.0,
    allowed: float | None = None,
    picture: Picture = None,
) -> None:
    """Asserts that a forward warp shows what ours does, within a pixel.

    Where a sample falls on the border of two pixels, arithmetic decides which of them it covers. So a pixel agrees if
    its colour lies between the lowest and the highest of our colours in the 3 x 3 pixels around it, or is a hole and
    one of those nine is.

    Parameters
    ----------
    image : DepthImage
        What is warped.
    camera : Camera
        Where to, W x H pixels.
    color : (H, W, 3) array_like of uint8
        The caller's.
    hole : (H, W) array_like of bool, optional
        Its pixels of which nothing is known. By default those that are black.
    splat : int or {"projected", "disparity", "mesh"}
        Of our warp; see `cyclorama.warp.forward`.
    levels : float
        By how many of 255 a colour may be off. Two: half a level each where the caller's colour and ours are rounded to
        bytes, and one where a texture unit's weights have 8 bits. A renderer that copies samples passes with 0.
    allowed : float, optional
        Share of pixels that may differ by more: by default that of the samples which float32 may round into another
        pixel, see Notes.
    picture : path or bool, optional
        As for `assert_ids_match`.

    Raises
    ------
    AssertionError
        If more differs.
    ValueError
        If a shape or type is none of these.

    Notes
    -----
    Both sides may work in float32. A coordinate of up to N pixels, the picture's longer side, is then off by at most
    ``e = 15 * N / 2**24`` pixels after the 15 roundings between a pixel and its warped place. A sample falls into
    another pixel only if it is so near to one of the four sides of its own, which a share of ``4 * e`` of them are: 0.2
    % of a picture of 640 pixels. Splats of such a sample lie one pixel aside and show its own colour, which the nine
    pixels explain, but where it hides, or stops hiding, something else. So ``4 * e`` is what is allowed; each sample
    beyond it is no matter of rounding.

    Examples
    --------
    >>> import cyclorama as cyc
    >>> here, aside = (cyc.Camera.look_at((x, 0, 4), (x, 0, 0), width=64, height=48) for x in (0.0, 0.2))
    >>> image = cyc.scenes.sphere(500).depth_image(here)
    >>> warped = cyc.warp.forward(image, aside, order="zbuffer")
    >>> assert_warp_matches(image, aside, warped.color, warped.hole)
    """
    theirs = np.asarray(as_numpy(color))
    if theirs.shape != (camera.height, camera.width, 3) or theirs.dtype != np.uint8:
        raise ValueError(
            f"color must be ({camera.height}, {camera.width}, 3) uint8 as the camera, got {theirs.shape} {theirs.dtype}"
        )
    holes = (theirs == 0).all(axis=2) if hole is None else _image(hole, camera, "hole").astype(bool)
    ours = warp.forward(image, camera, splat=splat)
    wrong = _unlike_warp(ours, theirs, holes, levels)
    count, pixels = int(wrong.sum()), wrong.size
    share = 4 * _ROUNDINGS * max(camera.width, camera.height) / 2**24 if allowed is None else allowed
    if count <= share * pixels:
        return
    filled, lost = wrong & ours.hole & ~holes, wrong & ~ours.hole & holes
    lines = [
        f"{count:,} of {pixels:,} pixels differ by more than {levels:g} levels from all within a pixel: "
        f"{int(filled.sum()):,} are holes of ours, {int(lost.sum()):,} are holes of the caller's"
    ]
    for row, column in np.argwhere(wrong)[:_NAMED].tolist():
        a = "hole" if ours.hole[row, column] else ours.color[row, column].tolist()
        b = "hole" if holes[row, column] else theirs[row, column].tolist()
        lines.append(f"  pixel [{row}, {column}]: {a}, got {b}")
    causes = []
    for (name, got), (_, gone) in zip(_rearranged(theirs), _rearranged(holes), strict=True):
        if gone.shape == holes.shape:
            causes.append((name, int(_unlike_warp(ours, got, gone, levels).sum())))
    causes.append(("red and blue are exchanged", int(_unlike_warp(ours, theirs[..., ::-1], holes, levels).sum())))
    here = image.camera
    moved = here.world_to_camera @ np.linalg.inv(camera.world_to_camera) @ here.world_to_camera
    for name, other in (
        ("the motion is inverted: from the new camera to the old one", camera.replace(world_to_camera=moved)),
        *_shifted_cameras(camera),
    ):
        if (other.width, other.height) == (camera.width, camera.height):
            found = warp.forward(image, other, splat=splat)
            causes.append((name, int(_unlike_warp(found, theirs, holes, levels).sum())))
    for name, other in (("nothing is warped: it is the source picture", here), ("samples cover a pixel each", camera)):
        if (other.width, other.height) == (camera.width, camera.height):
            found = warp.forward(image, other, splat=1)
            causes.append((name, int(_unlike_warp(found, theirs, holes, levels).sum())))
    causes.append(("holes are filled: what is not known is drawn", count - int(filled.sum())))
    lines.append(_cause(causes, count) or _beside(ours.depth, wrong))
    shown, drawn = np.where(ours.hole[..., None], 255, ours.color), np.where(holes[..., None], 255, theirs)
    panels = [shown.astype(np.uint8), drawn.astype(np.uint8), _verdict(~wrong, np.zeros_like(wrong), wrong)]
    raise AssertionError(_with_picture("warp", lines, panels, picture))


def _near(depth: Floats, truth: Floats, relative: float, more: Floats | float = 0.0) -> Mask:
    """Where two depths are the same, or both see nothing."""
    both = np.isfinite(depth) & np.isfinite(truth)
    found = ~np.isfinite(depth) & ~np.isfinite(truth)
    with np.errstate(invalid="ignore"):
        found |= both & (np.abs(depth - truth) <= relative * np.abs(truth) + more)
    return found


def _unlike_warp(ours: Warped, color: Bytes, hole: Mask, levels: float) -> Mask:
    """Pixels that are neither like one within a pixel nor between all within a pixel."""
    height, width = hole.shape
    low, high = np.full((height, width, 3), np.inf), np.full((height, width, 3), -np.inf)
    gap = np.zeros((height, width), np.bool_)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            to = np.s_[max(dy, 0) : height + min(dy, 0), max(dx, 0) : width + min(dx, 0)]
            at = np.s_[max(-dy, 0) : height + min(-dy, 0), max(-dx, 0) : width + min(-dx, 0)]
            known = ~ours.hole[at][..., None]
            shade = ours.color[at].astype(np.float64)
            low[to] = np.minimum(low[to], np.where(known, shade, np.inf))
            high[to] = np.maximum(high[to], np.where(known, shade, -np.inf))
            gap[to] |= ours.hole[at]
    like = ((color >= low - levels) & (color <= high + levels)).all(axis=2)
    return np.asarray(np.where(hole, ~gap, ~like))


def _depth_of(scene: Scene, camera: Camera, ids: Ids) -> Floats:
    """How deep each pixel's face is under its centre; NaN where it is not under it, or there is none."""
    depth = np.full(ids.shape, np.nan)
    named = np.nonzero(ids < len(scene))
    origins, directions = (array[named] for array in camera.rays())
    a, b, c = (scene.vertices[scene.faces[ids[named], k]].astype(np.float64) for k in range(3))
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((a - origins) * normal).sum(axis=1) / (directions * normal).sum(axis=1)
        point = origins + t[:, None] * directions
        # The three areas that the point cuts off, of the whole one; a touching face's border is on it to rounding.
        area = (normal * normal).sum(axis=1)
        parts = [(np.cross(v - u, point - u) * normal).sum(axis=1) / area for u, v in ((a, b), (b, c), (c, a))]
        inside = (np.minimum(np.minimum(*parts[:2]), parts[2]) >= -1e-6) & np.isfinite(t) & (t > 0)
    depth[named] = np.where(inside, t, np.nan)
    return depth


def _facing(scene: Scene, camera: Camera) -> Mask:
    """(F,) whether the eye is on the side of each face from which its corners run anticlockwise."""
    a, b, c = (scene.vertices[scene.faces[:, k]].astype(np.float64) for k in range(3))
    toward = -camera.forward if camera.orthographic else camera.eye - a
    return np.asarray((np.cross(b - a, c - a) * toward).sum(axis=1) > 0)


def _outside(scene: Scene, camera: Camera) -> Mask:
    """(F,) whether all corners of each face are beyond one side of the image, or behind the eye."""
    pixels, depth = camera.project(scene.vertices)
    x, y = np.nan_to_num(pixels).T
    sides = [depth <= camera.near, (depth > 0) & (x < 0), (depth > 0) & (x > camera.width)]
    sides += [(depth > 0) & (y < 0), (depth > 0) & (y > camera.height)]
    return np.asarray(np.any([side[scene.faces].all(axis=1) for side in sides], axis=0))


def _shifted_cameras(camera: Camera) -> Iterator[tuple[str, Camera]]:
    """Cameras with their pixel centres half a pixel or a pixel off."""
    for step in (0.5, 1.0):
        for dx, dy in ((1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1)):
            K = camera.K.copy()
            K[:2, 2] += step * dx, step * dy
            beside = f"({step * dx:+g}, {step * dy:+g})"
            yield f"the picture is shifted by {beside} pixels: where are pixel centres?", camera.replace(K=K)
    for across, down in SAMPLES:
        for right, below in itertools.product((across, -across), (down, -down)):
            K = camera.K.copy()
            K[:2, 2] -= right, below
            beside = f"({right:+g}, {below:+g})"
            yield f"a sample {beside} beside the pixels' centres is shown: multisampling?", camera.replace(K=K)


def _pictures_gone_wrong(scene: Scene, camera: Camera, unlike: Callable[[View], int]) -> Iterator[tuple[str, int]]:
    """What a renderer draws that makes a common mistake, and how many pixels that leaves unexplained."""
    for name, view in _mistakes(scene, camera):
        # That a camera sees nothing explains no picture.
        if (view.ids != BACKGROUND).any():
            yield name, unlike(view)


def _mixtures(
    scene: Scene,
    camera: Camera,
    theirs: npt.NDArray[Any],
    mended: Callable[[View], Iterable[tuple[str, npt.NDArray[Any]]]],
    differ: Callable[[Any, View], int],
) -> Iterator[tuple[str, int]]:
    """As `_pictures_gone_wrong`, with two mistakes: in what is drawn and in how it was put away or measured, which
    `mended` takes back, or culled and from another camera."""

    def counted() -> Iterator[tuple[str, npt.NDArray[Any], View]]:
        for first, view in _mistakes(scene, camera):
            for second, got in mended(view):
                if got.shape == view.ids.shape:
                    yield f"{first}; and {second}", got, view
        for first, faces in _culled(scene, camera):
            for second, other in (*_shifted_cameras(camera), *_cameras_gone_wrong(camera)):
                yield f"{first}; and {second}", theirs, scene.render(other, faces)

    for name, got, view in counted():
        if (view.ids != BACKGROUND).any():
            yield name, differ(got, view)


def _culled(scene: Scene, camera: Camera) -> Iterator[tuple[str, Ids]]:
    """The faces that are left by culling one side."""
    toward = _facing(scene, camera)
    opaque = np.ones(len(scene), np.bool_) if scene.transparent is None else ~scene.transparent
    for name, faces in (
        ("back faces are culled", toward & opaque),
        ("front faces are culled, or all faces are turned over and back faces culled", ~toward & opaque),
    ):
        yield name, np.flatnonzero(faces).astype(np.uint32)


def _mistakes(scene: Scene, camera: Camera) -> Iterator[tuple[str, View]]:
    for name, faces in _culled(scene, camera):
        yield name, scene.render(camera, faces)
    if scene.transparent is not None and scene.transparent.any():
        yield "transparent faces are drawn", scene.render(camera, np.arange(len(scene)))
    for name, other in (*_shifted_cameras(camera), *_cameras_gone_wrong(camera)):
        yield name, scene.render(other)
    for axis, letter in enumerate("xyz"):
        mirrored = scene.vertices * np.where(np.arange(3) == axis, -1, 1)
        found = Scene(mirrored, scene.faces, transparent=scene.transparent).render(camera)
        yield f"the scene is mirrored in {letter}: a left-handed system?", found


def _cameras_gone_wrong(camera: Camera) -> Iterator[tuple[str, Camera]]:
    pose = camera.world_to_camera
    turned = np.diag([1.0, -1.0, -1.0, 1.0])
    yield (
        "the camera's axes are OpenGL's (y up, z back) taken for OpenCV's, or the other way",
        camera.replace(world_to_camera=turned @ pose),
    )
    yield "camera_to_world is used as world_to_camera", camera.replace(world_to_camera=np.linalg.inv(pose))
    transposed = pose.copy()
    transposed[:3, :3] = pose[:3, :3].T
    yield "the rotation is transposed", camera.replace(world_to_camera=transposed)
    if camera.width != camera.height:
        for name, factor in (
            ("the vertical field of view is used as the horizontal one", camera.width / camera.height),
            ("the horizontal field of view is used as the vertical one", camera.height / camera.width),
        ):
            K = camera.K.copy()
            K[0, 0], K[1, 1] = K[0, 0] * factor, K[1, 1] * factor
            yield name, camera.replace(K=K)
    K = camera.K.copy()
    K[:2, 2] = camera.width / 2, camera.height / 2
    if not np.array_equal(K, camera.K):
        yield "the principal point is ignored", camera.replace(K=K)


def _rearranged(array: npt.NDArray[Any]) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """The caller's image as it should have been, if it was put away in another order."""
    yield "rows are flipped: the first row is the bottom one", array[::-1]
    yield "columns are flipped: the picture is mirrored", array[:, ::-1]
    yield "the picture is turned by 180 degrees", array[::-1, ::-1]
    yield "rows and columns are exchanged", array.swapaxes(0, 1)


def _numbered_otherwise(scene: Scene, ours: Ids, theirs: Ids, unexplained: Mask) -> Iterator[tuple[str, int]]:
    for step, name in ((1, "faces are numbered from 1"), (-1, "ids are one too low")):
        got = np.where(theirs < len(scene) + 1, theirs.astype(np.int64) - step, -1)
        yield name, int((got != np.where(ours == BACKGROUND, -1, ours.astype(np.int64))).sum())
    if (theirs[unexplained] >= len(scene)).any():
        other = int(theirs[unexplained][theirs[unexplained] >= len(scene)][0])
        got = np.where(theirs >= len(scene), BACKGROUND, theirs)
        yield f"{other} is written where nothing is seen: BACKGROUND, or -1, is asked", int((got != ours).sum())
    zeros = np.where((theirs == 0) & (ours == BACKGROUND), BACKGROUND, theirs)
    yield "0 is written where nothing is seen: BACKGROUND, or -1, is asked", int((zeros != ours).sum())
    both = (ours != BACKGROUND) & (theirs < len(scene))
    pairs, pixels = np.unique(np.stack([ours[both], theirs[both]]), axis=1, return_counts=True)
    # The number that most of a face's pixels have is its own, unless another face has it, too.
    most: dict[int, int] = {}
    for index in np.argsort(-pixels, kind="stable").tolist():
        most.setdefault(int(pairs[0, index]), int(pairs[1, index]))
    if len(most) > 1 and len(set(most.values())) == len(most):
        told = sum(int(n) for (a, b), n in zip(pairs.T.tolist(), pixels, strict=True) if most[a] == b)
        outline = int(((ours == BACKGROUND) != (theirs == BACKGROUND)).sum())
        yield "faces are numbered in another order", int(both.sum()) - told + outline


def _measured_otherwise(camera: Camera, given: Floats, truth: Floats) -> Iterator[tuple[str, Floats]]:
    """The caller's depths as they should have been, if something else was measured."""
    seen = np.isfinite(given) & np.isfinite(truth) & (given != 0)
    if not seen.any():
        return
    empty = np.where(np.isfinite(truth), given, np.inf)
    _, directions = camera.rays()
    if not camera.orthographic:
        long = np.linalg.norm(directions, axis=-1)
        yield "range, the distance along the ray, is written instead of depth along the axis", given / long
    with np.errstate(divide="ignore"):
        yield "disparity, 1 / depth, is written instead of depth", 1.0 / np.where(given > 0, given, 0.0)
    yield "depths are negative: OpenGL's z in eye space", np.where(given < 0, -given, np.inf)
    ratio = float(np.median(given[seen] / truth[seen]))
    if ratio > 0:
        yield f"depths are {ratio:.6g} times as large: another unit?", empty / ratio
    offset = float(np.median(given[seen] - truth[seen]))
    yield f"depths are off by {offset:.6g}: measured from the near plane?", empty - offset
    if seen.sum() > 2 and not camera.orthographic:
        # A z-buffer is a + b / depth.
        b, a = np.polyfit(1 / truth[seen], given[seen], 1)
        if b < 0 and -1e-6 <= given[seen].min() + 1 and given[seen].max() <= 1 + 1e-6:
            with np.errstate(divide="ignore", invalid="ignore"):
                linear = np.where(given < a, b / (given - a), np.inf)
                near = -b / a if given[seen].min() >= 0 else -b / (a + 1)
            yield (
                f"the z-buffer is written instead of depth (near plane about {near:.3g})",
                np.where(np.isfinite(truth), linear, np.inf),
            )


def _cause(causes: list[tuple[str, int]], count: int) -> str:
    """The mistake that leaves the least unexplained, if that is little."""
    name, left = min(causes, key=lambda cause: cause[1])
    if left > _TELLING * count:
        return ""
    return f"probably: {name} (leaves {left:,} of {count:,} unexplained pixels)"


def _place(ours: View, theirs: Floats, drawn: Mask, agree: Mask, unexplained: Mask) -> str:
    """Where the unexplained pixels are, if no mistake explains them."""
    truth = ours.depth.astype(np.float64)
    wrong, right = truth[unexplained], truth[agree]
    if len(right) and np.isfinite(wrong).all():
        if wrong.max() < right.min():
            return f"probably: a near plane beyond {wrong.max():.4g} cuts off what is nearer"
        if wrong.min() > right.max() and not drawn[unexplained].any():
            return f"probably: a far plane before {wrong.min():.4g} cuts off what is farther"
    if not drawn[unexplained].any():
        return "all of these pixels are empty: faces are missing"
    behind = np.isfinite(theirs[unexplained]) & (theirs[unexplained] > truth[unexplained])
    if behind.mean() > 1 - _TELLING:
        return "what is shown there lies behind: hidden surfaces are not removed, or the z-buffer is too coarse"
    return _beside(truth, unexplained)


def _beside(depth: npt.NDArray[np.floating], wrong: Mask) -> str:
    """Whether wrong pixels lie along silhouettes."""
    seen = np.where(np.isfinite(depth), depth, 1e30).astype(np.float64)
    edge = np.zeros(wrong.shape, np.bool_)
    for axis in (0, 1):
        before, after = (np.take(seen, range(k, seen.shape[axis] - 1 + k), axis) for k in (0, 1))
        jump = np.abs(before - after) > 0.02 * np.minimum(before, after)
        for k in (0, 1):
            where = [slice(None), slice(None)]
            where[axis] = slice(k, seen.shape[axis] - 1 + k)
            edge[tuple(where)] |= jump
    if edge[wrong].mean() > 1 - _TELLING:
        return "most of these pixels lie along silhouettes: antialiasing, or a shift of less than half a pixel?"
    return "no common mistake explains these pixels"


def _ids(ids: npt.ArrayLike, camera: Camera, name: str) -> Ids:
    array = _image(ids, camera, name, np.asarray(as_numpy(ids)).dtype)
    if array.dtype.kind not in "iu":
        raise ValueError(f"{name} must be integers, got dtype {array.dtype}")
    wide = array.astype(np.int64) if array.dtype != np.uint64 else np.minimum(array, BACKGROUND).astype(np.int64)
    return np.where((wide < 0) | (wide > BACKGROUND), BACKGROUND, wide).astype(np.uint32)


def _image(array: npt.ArrayLike, camera: Camera, name: str, dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    found, shape = np.asarray(as_numpy(array)), (camera.height, camera.width)
    if found.shape != shape:
        hint = ": rows come first" if found.shape == shape[::-1] else ""
        raise ValueError(f"{name} has shape {found.shape}, the camera's images {shape}{hint}")
    return found.astype(dtype)


def _face_set(faces: npt.ArrayLike | Bitfields, size: int) -> Mask:
    """(F,) mask of a set of faces."""
    if isinstance(faces, Bitfields):
        if len(faces) != 1 or faces.size != size:
            raise ValueError(f"faces must be one row of {size} bits, got {len(faces)} of {faces.size}")
        return np.asarray(faces.unpack()[0])
    array = np.asarray(as_numpy(faces))
    if array.dtype == np.bool_:
        if array.shape != (size,):
            raise ValueError(f"faces must be ({size},) bool, a flag a face, got {array.shape}")
        return array.copy()
    mask = np.zeros(size, np.bool_)
    if array.size:
        if array.ndim != 1 or array.dtype.kind not in "iu":
            raise ValueError(f"faces must be (K,) integers or ({size},) bool, got {array.shape} {array.dtype}")
        for bad in np.flatnonzero((array < 0) | (array >= size))[:1]:
            raise ValueError(f"faces[{bad}] is {array[bad]}, the scene has {size} faces")
        mask[array] = True
    return mask


def _face(number: Any) -> str:
    return "nothing" if number == BACKGROUND else f"face {number}"


def _faces_of(ids: Ids) -> list[str]:
    """The faces that most of these pixels should have shown."""
    faces, pixels = np.unique(ids[ids != BACKGROUND], return_counts=True)
    if not len(faces):
        return []
    most = np.argsort(-pixels, kind="stable")[:_NAMED]
    named = ", ".join(f"{faces[k]} ({pixels[k]} pixels)" for k in most.tolist())
    return [f"  {len(faces):,} faces are concerned, most of all {named}"]


def _colored(ids: Ids) -> Bytes:
    """A colour for each face, by its number alone; white where nothing is seen."""
    mixed = ids * np.uint32(2654435761)
    colors = np.stack([mixed >> 24 & 0xFF, mixed >> 16 & 0xFF, mixed >> 8 & 0xFF], axis=-1)
    return np.where((ids == BACKGROUND)[..., None], 255, 40 + colors * 3 // 4).astype(np.uint8)


def _grey(depth: Floats, truth: Floats) -> Bytes:
    """Near is dark, far is light, by the range of our own picture; white where nothing is seen."""
    seen = truth[np.isfinite(truth)]
    low, high = (seen.min(), seen.max()) if len(seen) else (0.0, 1.0)
    share = np.clip((np.where(np.isfinite(depth), depth, 0.0) - low) / max(high - low, 1e-30), 0, 1)
    grey = np.where(np.isfinite(depth), 30 + 190 * share, 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def _verdict(agree: Mask, explained: Mask, unexplained: Mask) -> Bytes:
    """Green, yellow and red on white."""
    picture = np.full((*agree.shape, 3), 255, np.uint8)
    picture[agree], picture[explained], picture[unexplained] = (190, 225, 190), (240, 200, 60), (215, 25, 28)
    return picture


def _with_picture(what: str, lines: list[str], panels: list[Bytes], picture: Picture) -> str:
    """The report, and where the picture of it is."""
    text = f"{what}: " + "\n".join(lines)
    if picture is False:
        return text
    try:
        from PIL import Image
    except ImportError:
        return text + "\npicture: needs Pillow (pip install cyclorama[viz])"
    if picture is None or picture is True:
        test = os.environ.get("PYTEST_CURRENT_TEST", "").split("::")[-1].removesuffix(" (call)")
        name = re.sub(r"[^\w.-]+", "-", test).strip("-") or "last"
        path = Path(_FOLDER, f"{name}.{what.replace(' ', '-')}.png")
    else:
        path = Path(picture)
    path.parent.mkdir(parents=True, exist_ok=True)
    gap = np.full((panels[0].shape[0], 4, 3), 255, np.uint8)
    strip = np.concatenate([part for panel in panels for part in (panel, gap)][:-1], axis=1)
    # Small pictures are made larger, pixel by pixel.
    zoom = max(1, 960 // strip.shape[1])
    Image.fromarray(strip.repeat(zoom, axis=0).repeat(zoom, axis=1)).save(path)
    return f"{text}\npicture (expected, got, difference): {path}"
