"""Buildings: cells that open into each other through portals (chapter 6 of the 1998 dissertation)."""

from .building import Building
from .cells import Cell, Portal
from .drawing import PortalDrawn, PortalFrame, PortalWalk
from .images import PortalImages

__all__ = ["Building", "Cell", "Portal", "PortalDrawn", "PortalFrame", "PortalImages", "PortalWalk"]
