"""Cyclorama decides ahead of time what of a 3D scene can be seen from where."""

from .camera import Camera
from .scene import Scene

__version__ = "0.1.0"

__all__ = ["Camera", "Scene", "__version__"]
