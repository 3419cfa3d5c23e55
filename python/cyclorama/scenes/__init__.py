"""Procedural scenes, each made to show one thing, of the size that is asked for, the same for the same seed.

| scene | purpose |
| --- | --- |
| `sphere` | closed and convex: the visible faces are the front-facing ones |
| `gear` | deep gaps that change their sight within a few degrees |
| `pipes` | a uniform tangle of any number of primitives: hard for budgets |
| `plant` | clusters of leaves of very different density |
| `tree` | foliage: slivers of leaves through the gaps of others |
| `house` | furnished rooms with doors and windows; knows its cells and portals |
| `castle` | walls, towers and a town of narrow lanes: far more hidden than seen; knows a way through it |
| `nested_boxes` | only the outermost shows: answered by hand |
| `window_box` | a small thing seen through a window: answered by hand |
| `notch` | an apex that no sample sees, but an eye between them does (the 2001 paper's figure 4) |
| `tubes` | deep parallel tubes: a far eye sees more than the samples that it looks through |
| `grating` | tiles behind crossed bars: each step of the eye shows others |
| `layers` | stacked sheets: any depth complexity, one visible sheet |
"""

from .answers import KnownScene, Sight, grating, layers, nested_boxes, notch, tubes, window_box
from .building import House, house
from .machines import gear, pipes
from .plants import plant, tree
from .round import sphere
from .stronghold import Castle, castle

__all__ = [
    "Castle",
    "House",
    "KnownScene",
    "Sight",
    "castle",
    "gear",
    "grating",
    "house",
    "layers",
    "nested_boxes",
    "notch",
    "pipes",
    "plant",
    "sphere",
    "tree",
    "tubes",
    "window_box",
]
