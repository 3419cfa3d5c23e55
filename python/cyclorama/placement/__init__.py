"""Budgets: from any eye and any gaze inside a scene no more than a number of primitives are drawn.

A small, far part of the scene is a picture then: images taken from viewpoints behind the eyes stand for what lies
behind their quadrilaterals (1998 dissertation, chapter 3). `place_images` finds the images; a `Plan` says frame by
frame what to draw; `predict` says what the paper expects that to cost.
"""

from .cells import Cells, cells
from .directions import ViewDirections, view_directions
from .grid import GridPlan, place_on_grid
from .optimising import Subset, optimise
from .plan import Frame, Image, Images, Plan, Proof
from .prediction import Prediction, predict
from .search import place_images
from .star import StarRadius, lattice, star_radius

__all__ = [
    "Cells",
    "Frame",
    "GridPlan",
    "Image",
    "Images",
    "Plan",
    "Prediction",
    "Proof",
    "StarRadius",
    "Subset",
    "ViewDirections",
    "cells",
    "lattice",
    "optimise",
    "place_images",
    "place_on_grid",
    "predict",
    "star_radius",
    "view_directions",
]
