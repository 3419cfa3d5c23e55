"""Each entry of the failure atlas: it fails as said, and its knob mends it; the page has them all."""

import math
from pathlib import Path

import pytest

from failures import failures
from failures.broken import changes
from peers import need

need("open3d")
need("scipy")

DOCS = Path(__file__).parents[1] / "docs"
ENTRIES = failures()


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_it_fails_as_said_and_the_knob_mends_it(entry):
    holds(entry)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_it_notices_when_the_library_does_something_else(entry, monkeypatch):
    owner, name, other = dict(changes())[entry.name]
    monkeypatch.setattr(owner, name, other)
    with pytest.raises(AssertionError):
        holds(entry)


def holds(entry):
    shown = entry.run()
    first = next(iter(shown.curves.values()))
    assert len(first) >= 2
    values = list(first.values())
    assert values[0] > values[-1]
    assert all(math.isfinite(value) for curve in shown.curves.values() for value in curve.values())
    assert all(picture.ndim == 3 for picture in shown.pictures.values())


def test_the_page_has_every_entry_and_no_other():
    page = (DOCS / "failures.md").read_text(encoding="utf-8")
    titles = [line.removeprefix("### ") for line in page.splitlines() if line.startswith("### ")]
    assert sorted(titles) == sorted(entry.title for entry in ENTRIES)
    assert len(titles) >= 25
    for entry in ENTRIES:
        assert entry.says in page and entry.remedy in page, f"make figures: {entry.title} has changed"
        assert (DOCS / "figures" / "failures" / f"{entry.name}.png").is_file()
