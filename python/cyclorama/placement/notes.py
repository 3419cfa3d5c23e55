"""What is known of the images of a store, beside them in its folder: a small JSON file each, whole or not there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..files import whole_file

__all__ = ["Notes"]


class Notes:
    """Notes in a folder, by index.

    Parameters
    ----------
    folder : Path
        It must be there.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     Notes(Path(folder)).put(3, {"center": [0.0, 1.0, 2.0]})
    ...     Notes(Path(folder)).get(3), Notes(Path(folder)).get(4), Notes(Path(folder)).centers()[0]
    ({'center': [0.0, 1.0, 2.0]}, None, array([3]))
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[int, dict[str, Any]] = {}
        self._centers: tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]] | None = None

    def _path(self, index: int) -> Path:
        return self._folder / f"{index:06d}.json"

    def get(self, index: int) -> dict[str, Any] | None:
        """What was noted, if anything was.

        Raises
        ------
        ValueError
            If the file is damaged.
        """
        if index not in self._read:
            try:
                self._read[index] = dict(json.loads(self._path(index).read_bytes()))
            except FileNotFoundError:
                return None
            except ValueError as error:
                raise ValueError(f"{self._path(index)} is no whole note: delete it, and it is made again") from error
        return self._read[index]

    def put(self, index: int, note: dict[str, Any]) -> None:
        """Writes a note."""
        with whole_file(self._path(index)) as file:
            file.write(json.dumps(note).encode())
        self._read[index] = note
        self._centers = None

    def centers(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """(N,) indices and (N, 3) the ``center`` of each note; those without one are left out."""
        if self._centers is None:
            found = {}
            for path in sorted(self._folder.glob("[0-9]*.json")):
                note = self.get(int(path.stem))
                if note is not None and "center" in note:
                    found[int(path.stem)] = note["center"]
            self._centers = np.array(list(found), np.int64), np.array(list(found.values())).reshape(-1, 3)
        return self._centers
