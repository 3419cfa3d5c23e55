"""Budgets: which part of a scene a picture replaces, so that what is drawn never exceeds a number of primitives.

Chapter 3 of the 1998 dissertation (Aliaga, automatic image placement).
"""

from .cells import Cells, cells
from .directions import ViewDirections, view_directions
from .grid import GridPlan, place_on_grid
from .optimising import Subset, optimise
from .prediction import Prediction, predict
from .star import StarRadius, lattice, star_radius

__all__ = [
    "Cells",
    "GridPlan",
    "Prediction",
    "StarRadius",
    "Subset",
    "ViewDirections",
    "cells",
    "lattice",
    "optimise",
    "place_on_grid",
    "predict",
    "star_radius",
    "view_directions",
]
