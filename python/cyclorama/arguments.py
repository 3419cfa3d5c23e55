"""Arguments of the wrong kind, refused by name before anything is done with them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

__all__ = [
    "as_numpy",
    "check_threads",
    "checked_choice",
    "checked_floats",
    "checked_number",
    "checked_pair",
    "checked_sequence",
    "checked_whole",
]

T = TypeVar("T")


def as_numpy(value: Any) -> Any:
    """An array of another library as NumPy's, by DLPack and without a copy; anything else as it is."""
    if hasattr(value, "__dlpack__") and not isinstance(value, (np.ndarray, np.generic)):
        return np.from_dlpack(value)
    return value


def check_threads(threads: object) -> None:
    """A whole number, or none; the kernels say how many there may be."""
    if threads is not None and not isinstance(threads, (int, np.integer)):
        raise ValueError(f"threads must be a whole number of at least 1, or None for all cores, got {threads!r}")


def checked_choice(name: str, value: object, choices: tuple[object, ...]) -> None:
    """One of some names; an array, which compares item by item, is none."""
    if not (isinstance(value, (str, bool, np.bool_)) and value in choices):
        named = ", ".join(map(repr, choices[:-1]))
        raise ValueError(f"{name} must be {named} or {choices[-1]!r}, got {value!r}")


def checked_number(name: str, value: object, most: float | None = None) -> float:
    """A finite number of at least 0, and at most `most`."""
    fits = isinstance(value, (int, float, np.integer, np.floating)) and np.isfinite(value) and value >= 0
    if fits and (most is None or float(value) <= most):  # type: ignore[arg-type]
        return float(value)  # type: ignore[arg-type]
    limits = "finite and at least 0" if most is None else f"from 0 to {most:g}"
    raise ValueError(f"{name} must be {limits}, got {value!r}")


def checked_floats(name: str, values: object) -> npt.NDArray[np.float64]:
    """A copy of an array of numbers."""
    try:
        return np.array(as_numpy(values), dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numbers, got {values!r}") from None


def checked_whole(name: str, value: object, least: int, most: int | None = None) -> int:
    """A whole number of at least `least`, and at most `most`."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        if least <= value and (most is None or value <= most):
            return int(value)
    limits = f"of at least {least}" if most is None else f"from {least} to {most}"
    raise ValueError(f"{name} must be an integer {limits}, got {value!r}")


def checked_pair(name: str, values: object) -> tuple[int, int]:
    """Two whole numbers of at least 1."""
    pair = list(values) if isinstance(values, (tuple, list, np.ndarray)) else []
    if len(pair) == 2 and all(isinstance(v, (int, np.integer)) and 1 <= v < 2**31 for v in pair):
        return int(pair[0]), int(pair[1])
    raise ValueError(f"{name} must be two integers of at least 1, got {values!r}")


def checked_sequence(name: str, values: Iterable[T] | T, kind: type[T]) -> list[T]:
    """Things of a kind, in a list; a single one is a list of it."""
    if isinstance(values, kind):
        return [values]
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable):
        raise ValueError(f"{name} must be a sequence of {kind.__name__}, got {type(values).__name__}")
    found = list(values)
    for index, value in enumerate(found):
        if not isinstance(value, kind):
            raise ValueError(f"{name}[{index}] must be a {kind.__name__}, got {type(value).__name__}")
    return found
