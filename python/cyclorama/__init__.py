"""Cyclorama decides ahead of time what of a 3D scene can be seen from where."""

from . import bitfield, patches, scenes, sphere
from .bitfield import Bitfields
from .camera import Camera
from .loading import describe, load
from .render import BACKGROUND, View
from .scene import Scene

__version__ = "0.1.0"

__all__ = [
    "BACKGROUND",
    "Bitfields",
    "Camera",
    "Scene",
    "View",
    "__version__",
    "bitfield",
    "describe",
    "load",
    "patches",
    "scenes",
    "sphere",
]
