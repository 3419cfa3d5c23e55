"""Budgets: which part of a scene a picture replaces, so that what is drawn never exceeds a number of primitives.

Chapter 3 of the 1998 dissertation (Aliaga, automatic image placement).
"""

from .prediction import Prediction, predict

__all__ = ["Prediction", "predict"]
