"""Procedural scenes, each made to show one thing, of the size that is asked for, the same for the same seed.

| scene | purpose |
| --- | --- |
| `sphere` | closed and convex: the visible faces are the front-facing ones |
| `gear` | deep gaps that change their sight within a few degrees |
| `pipes` | a uniform tangle of any number of primitives: hard for budgets |
"""

from .machines import gear, pipes
from .round import sphere

__all__ = ["gear", "pipes", "sphere"]
