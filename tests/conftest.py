"""Fixtures every test may ask for, and the one rule about skips.

A test that needs a package, a driver or a mesh which is not here skips with a reason. With `CYCLORAMA_STRICT=1` (as
`.ci/run` sets it) each such skip is a failure, so that a machine meant to run everything cannot quietly run less.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, settings

import cyclorama as cyc

pytest.register_assert_rewrite("failures")

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")

# A shell that starts this in the background has it ignore Ctrl-C, and its children too: back to the default.
signal.signal(signal.SIGINT, signal.default_int_handler)

STRICT = os.environ.get("CYCLORAMA_STRICT", "") not in ("", "0")

settings.register_profile(
    "cyclorama", deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
settings.register_profile("strict", settings.get_profile("cyclorama"), derandomize=True, print_blob=True)
settings.load_profile("strict" if STRICT else "cyclorama")

DATA = Path(__file__).parents[1].parent / "shared" / "data"

Triangles = tuple[npt.NDArray[np.floating], npt.NDArray[np.uint32]]


@cache
def _triangles(name: str) -> Triangles:
    paths = [path for path in sorted(DATA.glob(f"{name}.*")) if path.suffix in (".obj", ".ply", ".stl")]
    if not paths:
        pytest.skip(f"needs {DATA.name}/{name}.*, a mesh that is not beside this clone")
    trimesh = pytest.importorskip("trimesh", reason="needs trimesh to read meshes")
    loaded = trimesh.load(paths[0], process=False, force="mesh")
    vertices, faces = np.array(loaded.vertices), np.array(loaded.faces, dtype=np.uint32)
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces


@cache
def _scene(name: str) -> cyc.Scene:
    return cyc.Scene(*_triangles(name))


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real meshes, `../shared/data` seen from the clone."""
    if not DATA.is_dir():
        pytest.skip("needs ../shared/data, which is not beside this clone")
    return DATA


@pytest.fixture(scope="session")
def triangles(data: Path) -> Callable[[str], Triangles]:
    """`triangles("bunny")`: vertices and faces of a real mesh, read once and read-only."""
    return _triangles


@pytest.fixture(scope="session")
def real_scene(data: Path) -> Callable[[str], cyc.Scene]:
    """`real_scene("bunny")`: a `Scene` of a real mesh, made once."""
    return _scene


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20020607)


def _refuse_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    if STRICT and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{reason}\nCYCLORAMA_STRICT is set: nothing may be left out here."


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report = yield
    _refuse_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    report = yield
    _refuse_skip(report)
    return report
