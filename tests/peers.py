"""The peers of the package, for tests: one that is missing skips the test, with the reason."""

from __future__ import annotations

from types import ModuleType

import pytest

from cyclorama import peers


def need(name: str) -> ModuleType:
    """The module of this name; the test skips where it can't be imported."""
    try:
        return peers.need(name)
    except peers.Missing as error:
        pytest.skip(str(error))


class _Skipping:
    """A peer whose absence skips the test that asks for it."""

    def _setup(self) -> None:
        try:
            super()._setup()  # type: ignore[misc]
        except peers.Missing as error:
            pytest.skip(str(error))


class Embree(_Skipping, peers.Embree):
    pass


class TrimeshEmbree(_Skipping, peers.TrimeshEmbree):
    pass


class PyrenderIds(_Skipping, peers.PyrenderIds):
    pass


class OpenCV(_Skipping, peers.OpenCV):
    pass
