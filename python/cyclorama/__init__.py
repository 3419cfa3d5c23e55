"""Cyclorama decides ahead of time what of a 3D scene can be seen from where."""

from . import bitfield, patches, scenes, sphere
from .bitfield import Bitfields
from .camera import Camera
from .loading import describe, load
from .scene import Scene

__version__ = "0.1.0"

__all__ = [
    "Bitfields",
    "Camera",
    "Scene",
    "__version__",
    "bitfield",
    "describe",
    "load",
    "patches",
    "scenes",
    "sphere",
]
