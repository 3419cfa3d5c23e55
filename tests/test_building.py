"""What pip builds has its pages, where Node.js is there to bundle them."""

import importlib.util
import os
import sys
from pathlib import Path

import pytest

from peers import need

WEB = Path(__file__).parents[1] / "web"


@pytest.fixture
def building(tmp_path, monkeypatch):
    """The build's module, with folders of its own and an npm that notes what it is asked for and makes two files."""
    need("maturin")
    spec = importlib.util.spec_from_file_location("building", WEB / "building.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for folder in ("web/src", "pages", "bin"):
        (tmp_path / folder).mkdir(parents=True)
    for name in ("src/page.js", "build.mjs", "package-lock.json"):
        (tmp_path / "web" / name).write_text("")
    npm = tmp_path / "bin" / "npm"
    npm.write_text(f"#!{sys.executable}\nimport sys\nopen('asked', 'a').write(sys.argv[1])\n" + MAKES)
    npm.chmod(0o755)
    monkeypatch.setenv("PATH", str(npm.parent))
    monkeypatch.setattr(module, "WEB", tmp_path / "web")
    monkeypatch.setattr(module, "PAGES", tmp_path / "pages")
    return module


MAKES = "if sys.argv[1] == 'run':\n    [open(f'../pages/{name}.js', 'w').close() for name in 'ab']\n"


def test_pages_are_bundled_if_they_are_older_than_their_sources(building):
    asked = building.WEB / "asked"
    building.bundle()
    assert asked.read_text() == "cirun"
    building.bundle()
    assert asked.read_text() == "cirun", "nothing has changed"
    made = min(page.stat().st_mtime for page in building.PAGES.iterdir())
    os.utime(building.WEB / "src" / "page.js", (made + 1, made + 1))
    building.bundle()
    assert asked.read_text() == "ciruncirun"


def test_without_node_or_where_it_fails_the_package_is_built_all_the_same(building, monkeypatch, capfd):
    npm = Path(os.environ["PATH"]) / "npm"
    npm.write_text(f"#!{sys.executable}\nraise SystemExit(1)\n")
    building.bundle()
    assert "npm ci failed: the package has no pages" in capfd.readouterr().err
    npm.unlink()
    building.bundle()
    assert "no Node.js: the package has no pages" in capfd.readouterr().err
    assert not list(building.PAGES.iterdir())


def test_all_that_pip_asks_for_is_there(building):
    import maturin

    hooks = [name for name in dir(maturin) if name.startswith(("build_", "get_requires_for_", "prepare_metadata_"))]
    assert len(hooks) >= 6
    assert [name for name in hooks if not callable(getattr(building, name, None))] == []
