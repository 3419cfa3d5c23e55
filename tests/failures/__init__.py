"""The failure atlas: for each method scenes that break it, by how much, and what mends it.

Each entry is a function that builds a scene, asserts that the method fails there as said and that the knob mends it,
and returns what it measured. `test_failures.py` runs them all; `tools/draw-failures` draws them and writes
``docs/failures.md``. A module here holds the entries of one group of methods.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

MODULES = ("views", "ids", "warps", "layered", "budgets", "bent", "buildings", "rails", "hidden")


@dataclass(frozen=True)
class Shown:
    """What an entry measured.

    `curves` has for each name what is wrong (`wrong` says in which unit) at values of the knob. The first curve falls
    from its first value to its last: the knob mends it. The others are what the library does about it, for instance.
    """

    knob: str
    wrong: str
    curves: Mapping[str, Mapping[object, float]]
    measured: str
    pictures: Mapping[str, npt.NDArray[np.uint8]] = field(default_factory=dict)


@dataclass(frozen=True)
class Failure:
    """An entry: `title` and `method` to find it by, `source` of the admission, and the library's `remedy`."""

    title: str
    method: str
    source: str
    remedy: str
    run: Callable[[], Shown]

    @property
    def name(self) -> str:
        return self.run.__name__.replace("_", "-")

    @property
    def says(self) -> str:
        return " ".join((self.run.__doc__ or "").split())


_entries: list[Failure] = []


def failure(
    title: str, *, method: str, source: str, remedy: str
) -> Callable[[Callable[[], Shown]], Callable[[], Shown]]:
    """Registers an entry; its docstring says what breaks, and why."""

    def register(run: Callable[[], Shown]) -> Callable[[], Shown]:
        _entries.append(Failure(title, method, source, remedy, run))
        return run

    return register


def failures() -> list[Failure]:
    """All entries, method by method."""
    for module in MODULES:
        importlib.import_module(f"{__name__}.{module}")
    return list(_entries)
