"""The pages of the documentation: their code runs, their links lead somewhere, and the site is built from them."""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from failures import failures
from peers import need

CLONE = Path(__file__).parents[1]
DOCS = CLONE / "docs"
PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


def text_of(page):
    return (DOCS / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", [page for page in PAGES if "```python" in text_of(page)])
def test_the_code_of_a_page_runs(page, tmp_path, monkeypatch, capsys):
    if page in ("formats.md", "tour.md"):
        need("matplotlib")
    if "panorama" in text_of(page):
        need("PIL")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", text_of(page), re.DOTALL)
    exec(compile("\n".join(blocks), page, "exec"), {})
    prints = sum(block.count("print(") for block in blocks)
    said = capsys.readouterr().out
    assert len(said.splitlines()) >= prints
    assert "dtype=" not in said, "an object is printed with all its arrays"


@pytest.mark.parametrize("page", PAGES)
def test_links_and_names_of_a_page_lead_somewhere(page):
    text = text_of(page)
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        if not link.startswith(("http://", "https://")):
            assert (DOCS / page).parent.joinpath(link).exists(), link
    for name in re.findall(r"^::: ([\w.]+)", text, re.MULTILINE):
        module, _, rest = name, "", ""
        while True:
            try:
                found = importlib.import_module(module)
                break
            except ModuleNotFoundError:
                module, _, last = module.rpartition(".")
                rest = f"{last}.{rest}".rstrip(".")
        for part in filter(None, rest.split(".")):
            found = getattr(found, part)
    for name in re.findall(r"`cyc\.([\w.]+)", text):
        found = importlib.import_module("cyclorama")
        for part in name.rstrip(".").split("."):
            found = getattr(found, part)


def test_every_picture_is_drawn_by_make_figures_and_shown_somewhere():
    need("matplotlib")
    listed = subprocess.run(
        [sys.executable, str(CLONE / "tools" / "draw-figures"), "--list"], capture_output=True, text=True, check=True
    )
    drawn = set(listed.stdout.split()) | {f"docs/figures/failures/{entry.name}.png" for entry in failures()}
    shown = set()
    for page in [CLONE / "README.md", *DOCS.rglob("*.md")]:
        for link in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
            shown.add((page.parent / link).resolve().relative_to(CLONE).as_posix())
    there = {path.relative_to(CLONE).as_posix() for path in DOCS.rglob("*.*") if path.suffix not in (".md", "")}
    assert shown == drawn == there
    recipe = (CLONE / "Makefile").read_text(encoding="utf-8").split("\nfigures:")[1].split("\n\n")[0]
    assert "tools/draw-failures" in recipe and "tools/draw-figures" in recipe


def test_every_page_is_in_the_table_of_contents():
    contents = (CLONE / "mkdocs.yml").read_text(encoding="utf-8")
    assert [page for page in PAGES if page not in contents] == []


def test_the_site_is_built_without_a_complaint(tmp_path):
    need("mkdocs")
    need("mkdocstrings")
    run = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=CLONE,
        capture_output=True,
        text=True,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        check=False,
    )
    assert run.returncode == 0, run.stderr
    reference = (tmp_path / "site" / "api" / "scenes.html").read_text(encoding="utf-8")
    assert "Positions in any unit" in reference, "docstrings are in the reference"
