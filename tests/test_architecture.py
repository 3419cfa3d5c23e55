"""The arrows of ARCHITECTURE.md point one way, and name what is there."""

import re
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[1]
SOURCES = HOUSE / "src"

#: What each kernel may use, besides `control` and `error`.
MAY_USE = {
    "error": set(),
    "control": set(),
    "bounds": set(),
    "mesh": set(),
    "camera": {"mesh"},
    "adjacency": set(),
    "patch": {"adjacency"},
    "bitfield": set(),
    "sphere": set(),
    "render": {"mesh", "camera", "adjacency"},
    "image": {"mesh", "camera", "render", "adjacency"},
    "visibility": {"mesh", "camera", "render"},
    "octree": {"bounds", "mesh"},
    "panorama": {"mesh", "camera", "render"},
    "portal": {"bounds"},
    "placement": {"bounds", "mesh", "octree"},
}


def kernels():
    return [path for path in SOURCES.rglob("*.rs") if path.parent.name != "python" and path.name != "lib.rs"]


def module_of(path):
    return path.relative_to(SOURCES).parts[0].removesuffix(".rs")


@pytest.mark.parametrize("path", kernels(), ids=lambda path: str(path.relative_to(SOURCES)))
def test_a_kernel_uses_only_what_lies_below_it(path):
    text = path.read_text(encoding="utf-8")
    used = set(re.findall(r"\bcrate::(\w+)", text)) - {module_of(path)}
    assert used <= MAY_USE[module_of(path)] | {"control", "error"}
    assert not re.search(r"\b(pyo3|numpy)::", text)


def test_benches_and_notebooks_are_timed_by_the_laboratory_alone():
    scripts = [*(HOUSE / "benches").glob("*.py"), *(HOUSE / "notebooks").glob("*.ipynb")]
    clocks = re.compile(r"\b(perf_counter|process_time|monotonic|thread_time|time)(_ns)?\(\)|\btimeit\b")
    assert [path.name for path in scripts if clocks.search(path.read_text(encoding="utf-8"))] == []


def test_the_document_names_every_module():
    text = (HOUSE / "ARCHITECTURE.md").read_text(encoding="utf-8")
    modules = {module_of(path) for path in kernels()}
    package = (HOUSE / "python" / "cyclorama").rglob("[!_]*.py")
    modules |= {path.stem for path in package if path.parent.name != "scenes"}
    assert sorted(name for name in modules if not re.search(rf"\b{name}\b", text)) == []
