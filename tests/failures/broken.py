"""For each entry a change of the library that it has to notice: a remedy that is not taken, another default.

`test_failures.py` makes each change and expects the entry to fail.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np

import cyclorama as cyc
import cyclorama.bakes.evaluation
from cyclorama import BACKGROUND, DepthImage, LayeredDepthImage, bitfield, geometry_warp, octree, placement, warp

from . import buildings, layered, rails

#: Where, the name there, and what takes its place.
Change = tuple[Any, str, Any]


def changes() -> Iterator[tuple[str, Change]]:
    """The name of each entry, and what to change."""
    for name, owner, attribute, make in _CHANGES:
        old = getattr(owner, attribute)
        new = make(old)
        yield name, (owner, attribute, staticmethod(new) if isinstance(owner.__dict__[attribute], _BOUND) else new)


_BOUND = (staticmethod, classmethod)


def _with(**options: Any) -> Callable[[Any], Any]:
    """The same with some options, whatever was asked."""
    return lambda old: lambda *arguments, **asked: old(*arguments, **asked | options)


def _splat(asked: Any, drawn: Any) -> Callable[[Any], Any]:
    """One splat drawn where another one was asked for."""

    def make(old: Any) -> Any:
        def forward(*arguments: Any, splat: Any = 3, **options: Any) -> Any:
            return old(*arguments, splat=drawn if splat == asked else splat, **options)

        return forward

    return make


def _without(missing: Callable[[DepthImage], Any]) -> Callable[[Any], Any]:
    """Warps that lose some samples."""

    def make(old: Any) -> Any:
        def forward(image: DepthImage, *arguments: Any, **options: Any) -> Any:
            gone = missing(image)
            left = DepthImage(image.color, np.where(gone, 1.0, image.depth), image.camera, missing=gone)
            return old(left, *arguments, **options)

        return forward

    return make


def _filled(old: Any) -> Any:
    def forward(*arguments: Any, **options: Any) -> Any:
        out = old(*arguments, **options)
        out.hole[:] = False
        return out

    return forward


def _beneath(_: Any) -> Any:
    """Only the sphere's face beneath the eye."""

    def visible_faces(vis: cyc.Visibility, eye: Any, out: Any = None) -> Any:
        assert vis.cells is not None
        return bitfield.ids(vis.cells.union(vis.sphere.locate(np.asarray(eye) - vis.sphere.center)))

    return visible_faces


def _higher_id(old: Any) -> Any:
    """Ties go to the higher id."""

    def render(scene: cyc.Scene, camera: cyc.Camera) -> Any:
        ids = old(cyc.Scene(scene.vertices, scene.faces[::-1]), camera).ids
        return SimpleNamespace(ids=np.where(ids == BACKGROUND, ids, len(scene) - 1 - ids))

    return render


def _all_faces(old: Any) -> Any:
    def visible_from(scene: cyc.Scene, *arguments: Any, **options: Any) -> Any:
        found = old(scene, *arguments, **options)
        return SimpleNamespace(faces=np.arange(len(scene)), unseen=found.unseen)

    return visible_from


def _without_a_door(old: Any) -> Any:
    return lambda house, cells, portals: old(house, cells, portals[1:])


def _narrow_doors(old: Any) -> Any:
    return SimpleNamespace(find=lambda scene, **options: old.find(scene, **options | {"door": 0.6}))


def _printed(old: Any) -> Any:
    """The printed form for the corrected one."""
    return lambda *arguments, **options: SimpleNamespace(
        case=lambda kind, form="printed": old(*arguments, **options).case(kind, "printed")
    )


def _scattered(vertices: Any, faces: Any, count: int, progress: Any) -> Any:
    """Patches whose faces lie anywhere."""
    return np.random.default_rng(0).permutation(np.arange(len(faces)) % count)


_CHANGES: list[tuple[str, Any, str, Callable[[Any], Any]]] = [
    ("between-samples", cyc, "bake", _with(probes=0)),
    ("far-eyes", cyc.Visibility, "visible_faces", _beneath),
    ("inside-the-sphere", cyc.Visibility, "visible_faces", _beneath),
    ("coarse-patches", cyc.patches, "tile", lambda _: _scattered),
    ("noise-in-rows", bitfield, "encode", lambda _: lambda words, size: {"words": words}),
    ("few-test-views", cyclorama.bakes.evaluation, "upper_mean", lambda _: lambda shares, level: np.mean(shares)),
    ("faces-without-a-pixel", cyc.Scene, "visible", _with(fill=None)),
    ("coincident-faces", cyc.Scene, "render", _higher_id),
    ("disocclusion-behind-a-pole", warp, "forward", _filled),
    ("grazing-surfaces", warp, "forward", _splat("mesh", "projected")),
    ("the-new-view-is-closer-than-the-reference", warp, "forward", _splat("disparity", 3)),
    ("a-move-to-behind-the-reference", warp, "forward", _without(lambda image: image.depth < 5)),
    ("two-surfaces-within-the-depth-tolerance", LayeredDepthImage, "build", _with(tolerance=32.0)),
    ("mixed-pixels-at-silhouettes", DepthImage, "from_disparity", _with(missing=None)),
    (
        "a-scene-at-infinity",
        DepthImage,
        "from_disparity",
        lambda old: lambda color, disparity, camera: old(color, np.maximum(disparity, 1e-7), camera),
    ),
    ("a-one-pixel-image", warp, "forward", _splat("projected", 3)),
    ("extreme-disparity", warp, "forward", _without(lambda image: image.depth > 1e20)),
    ("few-construction-images", LayeredDepthImage, "build", lambda old: lambda image, others: old(image, others[:1])),
    (
        "construction-outside-the-star-shape",
        layered,
        "construction_cameras",
        lambda old: lambda eye, corners, radius, size: old(eye, corners, 1e9, size),
    ),
    ("too-few-layers", LayeredDepthImage, "cast", lambda old: lambda scene, camera, layers: old(scene, camera, 1)),
    (
        "order-of-nodes",
        LayeredDepthImage,
        "warp",
        lambda old: lambda image, to, cull=False, **options: old(image, to, cull="paper" if cull else False, **options),
    ),
    ("little-is-hidden", LayeredDepthImage, "warp", _with(cull=False)),
    ("coarse-nodes", LayeredDepthImage, "warp", _with(thresholds=(64, 4))),
    ("no-parallax", geometry_warp, "bend", lambda _: lambda points, *rest: points),
    (
        "close-to-the-plane",
        geometry_warp,
        "bend",
        lambda old: lambda points, corners, at, eye: old(points, corners, at, np.maximum(eye, (0, 0, -2.9))),
    ),
    (
        "depth-between-vertices",
        geometry_warp,
        "bent_camera",
        lambda old: lambda plane, camera: (old(plane, camera)[0], 1.001 * old(plane, camera)[1]),
    ),
    ("star-shapes", placement, "star_radius", lambda old: lambda *a, **b: old(*a, **b)._replace(high=2.0)),
    ("margin-of-the-grid", placement, "predict", _printed),
    ("budget-and-cells", cyc, "place_images", lambda old: lambda scene, budget, **b: old(scene, 2 * budget, **b)),
    (
        "long-faces",
        octree.Octree,
        "__init__",
        lambda old: lambda tree, scene, kind, progress: old(tree, scene, "conventional", progress=progress),
    ),
    ("door-left-out", buildings, "Building", _without_a_door),
    ("wide-doors", buildings, "Building", _narrow_doors),
    ("pictures-in-doors", buildings, "PortalImages", _with(step=60)),
    ("far-references", cyc.panorama, "view", lambda old: lambda store, _, camera: old(store, 0.001, camera)),
    ("one-slab", cyc.panorama, "bake", lambda old: lambda scene, track, _, *a, **b: old(scene, track, 1, *a, **b)),
    ("culling-by-the-paper", rails, "kept_tiles", _with(method="paper")),
    ("keyhole", cyc, "visible_from", _all_faces),
    ("corners-of-a-box", cyc, "visible_from", _with(max_eyes=8, patience=8)),
    ("seen-by-few", cyc, "never_seen", _with(max_views=20)),
]
