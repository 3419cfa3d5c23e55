"""Cyclorama decides ahead of time what of a 3D scene can be seen from where."""

from . import (
    bitfield,
    camera_files,
    lab,
    ldi,
    octree,
    panorama,
    parts,
    patches,
    placement,
    portals,
    quality,
    scenes,
    sphere,
    sweeps,
    warp,
)
from .bakes.assembly import Assembly
from .bakes.baking import bake
from .bakes.evaluation import Evaluation, evaluate
from .bakes.merging import merge
from .bakes.paths import PathVisibility, bake_path
from .bakes.visibility import Visibility
from .bitfield import Bitfields
from .camera import Camera
from .depth_image import DepthImage, disparity_from_zbuffer
from .hidden import never_seen, strip_hidden
from .ldi import LayeredDepthImage
from .loading import describe, load
from .placement import place_images
from .region import Region, visible_from
from .render import BACKGROUND, View
from .scene import Scene
from .sightings import Sightings, next_best, sightings
from .tradeoff import Tradeoff, tradeoff

__version__ = "0.1.0"

__all__ = [
    "BACKGROUND",
    "Assembly",
    "Bitfields",
    "Camera",
    "DepthImage",
    "Evaluation",
    "LayeredDepthImage",
    "PathVisibility",
    "Region",
    "Scene",
    "Sightings",
    "Tradeoff",
    "View",
    "Visibility",
    "__version__",
    "bake",
    "bake_path",
    "bitfield",
    "camera_files",
    "describe",
    "disparity_from_zbuffer",
    "evaluate",
    "lab",
    "ldi",
    "load",
    "merge",
    "never_seen",
    "next_best",
    "octree",
    "panorama",
    "parts",
    "patches",
    "place_images",
    "placement",
    "portals",
    "quality",
    "scenes",
    "sightings",
    "sphere",
    "strip_hidden",
    "sweeps",
    "tradeoff",
    "visible_from",
    "warp",
]
