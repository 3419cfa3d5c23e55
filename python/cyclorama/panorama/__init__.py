"""Walkthroughs on a rail: panoramas drawn ahead along a track, in slabs of range, from which any view is put together.

After "A Panoramic Walkthrough System with Occlusion Culling" (Yang and Crawfis, 2003). `bake` renders a scene at
*reference viewpoints* of a `Track`, splits each panorama into slabs, drops tiles that the track never sees, and writes
a folder; `view` draws what an eye on the track sees, from the two references beside it.
"""

from .baking import bake
from .culling import kept_tiles
from .outside import PanoramaFolder, PovRay, Pyrender
from .projection import Projection
from .renderers import BuiltIn, Layer, Renderer
from .server import application, serve
from .slabs import find_slabs
from .spacing import places_by_error
from .store import Store
from .survey import Survey
from .track import Track
from .viewing import Seen, view

__all__ = [
    "BuiltIn",
    "Layer",
    "PanoramaFolder",
    "PovRay",
    "Projection",
    "Pyrender",
    "Renderer",
    "Seen",
    "Store",
    "Survey",
    "Track",
    "application",
    "bake",
    "find_slabs",
    "kept_tiles",
    "places_by_error",
    "serve",
    "view",
]
