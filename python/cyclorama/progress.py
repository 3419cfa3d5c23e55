"""How far long work has come: a bar in a terminal or a notebook, a function of the caller's, or silence."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Progress", "Report", "reporter"]

#: What every `progress=` accepts.
Progress = bool | Callable[[int], object] | None

#: What the work calls with the number of units done so far.
Report = Callable[[int], object]


@contextmanager
def reporter(progress: Progress, total: int, desc: str) -> Iterator[Report]:
    """A function to call with the number of units done; its bar is closed when the block is left.

    Parameters
    ----------
    progress : bool, callable or None
        `None` and `True` show a tqdm bar where tqdm is installed and somebody watches (stderr is a terminal, or this
        runs in a notebook), `False` shows nothing, a function is called with the units done.
    total : int
        Units of the whole work.
    desc : str
        What the bar says it is doing.

    Yields
    ------
    callable
        Takes the units done so far (not those since the last call).

    Raises
    ------
    ValueError
        If `progress` is none of these.

    Examples
    --------
    >>> seen = []
    >>> with reporter(seen.append, 2, "rendering") as report:
    ...     report(1)
    ...     report(2)
    >>> seen
    [1, 2]
    """
    if callable(progress):
        yield progress
    elif progress is not None and not isinstance(progress, bool):
        raise ValueError(f"progress must be a bool, None or a function, got {progress!r}")
    elif progress is False or not _is_watched() or importlib.util.find_spec("tqdm") is None:
        yield _silent
    else:
        from tqdm.auto import tqdm

        with tqdm(total=total, desc=desc, leave=False) as bar:

            def advance(done: int) -> None:
                bar.update(done - bar.n)

            yield advance


def _silent(done: int) -> None:
    """Reports to nobody."""


def _is_watched() -> bool:
    return in_notebook() or (sys.stderr is not None and sys.stderr.isatty())


def in_notebook() -> bool:
    """Whether this runs in a Jupyter kernel, whose bars are widgets and whose stderr is no terminal."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return shell is not None and shell.__class__.__name__ == "ZMQInteractiveShell"
