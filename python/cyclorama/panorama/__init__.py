"""Walkthroughs on a rail: panoramas drawn ahead along a track, in slabs of range, from which any view is put together.

After "A Panoramic Walkthrough System with Occlusion Culling" (Yang and Crawfis, 2003). `bake` renders a scene at
*reference viewpoints* of a `Track`, splits each panorama into slabs, drops tiles that the track never sees, and writes
a folder; `view` draws what an eye on the track sees, from the two references beside it.
"""

from .baking import bake
from .projection import Projection
from .renderers import BuiltIn, Layer, Renderer
from .server import application, serve
from .slabs import find_slabs
from .store import Store
from .track import Track
from .viewing import Seen, view

__all__ = [
    "BuiltIn",
    "Layer",
    "Projection",
    "Renderer",
    "Seen",
    "Store",
    "Track",
    "application",
    "bake",
    "find_slabs",
    "serve",
    "view",
]
