"""Renderers nobody here wrote, behind one face, and the one place that says which are missing.

Each peer answers `render(camera)` with ids (H, W) uint32 and depth (H, W) float64, `BACKGROUND` and inf where it sees
nothing, for the same pixel centres and the same axes as ours.
"""

from __future__ import annotations

import importlib
import os
from types import ModuleType

import pytest

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")


def need(name: str) -> ModuleType:
    """The module of this name; the test skips, with the reason, where it can't be imported."""
    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:
        pytest.skip(f"needs {name}: {error}")
