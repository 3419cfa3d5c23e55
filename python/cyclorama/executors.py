"""Work done elsewhere: by any executor in the style of `concurrent.futures`, on this machine or on many.

An executor has ``submit(function, *arguments)``, which gives a future with ``result()``, ``cancel()`` and
``add_done_callback()``: a thread or process pool, a Dask `Client` or what its ``get_executor()`` gives. What all tasks
need, the scene, is sent along with each and unpacked once in each process; an executor that has ``scatter``, as a Dask
client, gets it once a worker.

Tasks are pure functions of their arguments, and each result goes to the place of its task as it comes: so the answer
has the same bits whoever works it out, in whatever order, however often a task is begun again elsewhere because its
worker died. No more than `AHEAD` tasks are under way or wait to be taken: that bounds what lies in memory.
"""

from __future__ import annotations

import pickle
import threading
import uuid
from collections.abc import Callable, Iterable, Iterator
from queue import SimpleQueue
from typing import Any, Protocol, runtime_checkable

__all__ = ["AHEAD", "Executor", "Shared", "Team"]

#: Tasks that are submitted and not taken yet, at most.
AHEAD = 16


class Executor(Protocol):
    """What works on tasks."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any: ...


@runtime_checkable
class Scatters(Protocol):
    """An executor that sends values ahead of the tasks."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Any: ...
    def scatter(self, value: Any, *, broadcast: bool, hash: bool) -> Any: ...


class Shared:
    """A value that many tasks need: pickled once, and unpickled once in each process.

    Parameters
    ----------
    value : object
        It must not change.

    Examples
    --------
    >>> shared = Shared([1, 2])
    >>> pickle.loads(pickle.dumps(shared)).value is pickle.loads(pickle.dumps(shared)).value
    True
    """

    def __init__(self, value: Any) -> None:
        self.value = value
        self._key = uuid.uuid4().hex
        self._packed: bytes | None = None

    def __reduce__(self) -> tuple[Callable[[str, bytes], Shared], tuple[str, bytes]]:
        if self._packed is None:
            self._packed = pickle.dumps(self.value, protocol=pickle.HIGHEST_PROTOCOL)
        return _unpack, (self._key, self._packed)


#: The value that this process unpacked last.
_last: tuple[str, Any] = ("", None)
_unpacking = threading.Lock()


def _unpack(key: str, packed: bytes) -> Shared:
    global _last
    with _unpacking:
        if _last[0] != key:
            _last = (key, pickle.loads(packed))
        shared = Shared(_last[1])
    # It may be sent on, from worker to worker.
    shared._key, shared._packed = key, packed
    return shared


class Team:
    """An executor, and what all of its tasks need.

    Parameters
    ----------
    executor : Executor
    value : object
        It must not change.

    Raises
    ------
    ValueError
        If the executor has no ``submit``.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(2) as pool:
    ...     sorted(Team(pool, 2).run(pow, [(k,) for k in range(5)]))
    [(0, 1), (1, 2), (2, 4), (3, 8), (4, 16)]
    """

    def __init__(self, executor: Executor, value: Any) -> None:
        if not callable(getattr(executor, "submit", None)):
            raise ValueError(
                f"executor must have submit(), as those of concurrent.futures and Dask clients, got {executor!r}"
            )
        self._executor = executor
        self._shared: Any = Shared(value)
        if isinstance(executor, Scatters):
            self._shared = executor.scatter(self._shared, broadcast=True, hash=False)

    def run(self, function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """The result of ``function(value, *task)`` for each task, with its place among them, as they come.

        Parameters
        ----------
        function : callable
            Of a module, so that it has a name elsewhere; pure.
        tasks : iterable of tuple
            Taken one by one, as results are.

        Raises
        ------
        Exception
            What a task or the executor raised, a pool whose process died for example; what is under way is cancelled.
        """
        under_way: dict[int, Any] = {}
        finished: SimpleQueue[int] = SimpleQueue()
        left = enumerate(tasks)
        try:
            while True:
                while len(under_way) < AHEAD and (following := next(left, None)) is not None:
                    place, task = following
                    under_way[place] = self._executor.submit(_call, function, self._shared, *task)
                    under_way[place].add_done_callback(lambda _, place=place: finished.put(place))
                if not under_way:
                    return
                place = finished.get()
                yield place, under_way.pop(place).result()
        finally:
            for future in under_way.values():
                future.cancel()


def _call(function: Callable[..., Any], shared: Shared, *task: Any) -> Any:
    return function(shared.value, *task)
