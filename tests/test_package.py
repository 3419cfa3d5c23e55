"""The package as a user installs it."""

import re
import shlex
import subprocess
import sys
import textwrap
from pathlib import Path

import cyclorama as cyc
from cyclorama import pages
from peers import need


def test_importing_needs_numpy_and_nothing_else():
    script = """
        import sys

        class Refuse:
            def find_spec(self, name, path=None, target=None):
                top = name.partition(".")[0]
                if top not in sys.stdlib_module_names and top not in ("numpy", "cyclorama"):
                    raise ImportError(f"{name} was imported")

        sys.meta_path.insert(0, Refuse())
        import cyclorama
        for name in cyclorama.__all__:
            getattr(cyclorama, name)
        cyclorama.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_public_name_is_there():
    assert not [name for name in cyc.__all__ if not hasattr(cyc, name)]


def test_the_lines_of_the_readme_run(tmp_path, monkeypatch, capsys):
    need("matplotlib")
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    lines = "\n".join(re.findall(r"```python\n(.*?)```", readme, re.DOTALL))
    for written, small in (
        ('cyc.load("bunny.ply")', "cyc.scenes.sphere(600)"),
        ("views=258", "views=6"),
        ("views=100", "views=5"),
        ("views=[6, 18, 66]", "views=[6], patches=[None], eval_views=5, resolution=(64, 60)"),
        ("max_missed=1e-3", "max_missed=0.5, resolution=(64, 60)"),
    ):
        assert written in lines
        lines = lines.replace(written, small)
    monkeypatch.chdir(tmp_path)
    exec(compile(lines, "README.md", "exec"), {})
    assert {path.name for path in tmp_path.iterdir()} == {"bunny.npz", "tradeoff.png", "proof.npz", "backdrops", "walk"}
    said = capsys.readouterr().out
    assert "culled on average" in said
    assert "% hole" in said and "violations=0" in said


def test_the_five_commands_of_the_readme_lead_to_a_chart_and_a_decision(tmp_path, monkeypatch, capsys):
    from cyclorama.cli import main

    need("matplotlib")
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    block = readme.split("in five:\n\n")[1].split("\n\n")[0]
    install, *lines = [line.split("#")[0].strip() for line in block.splitlines()]
    assert install == "pip install '.[mesh,viz]'" and len(lines) == 4
    need("trimesh").creation.icosphere(subdivisions=2).export(tmp_path / "bunny.ply")
    monkeypatch.chdir(tmp_path)
    small = {
        "tradeoff": ["--views", "6", "--patches", "none", "--eval-views", "4", "--resolution", "64x60"],
        "bake": ["--resolution", "64x60"],
    }
    for line in lines:
        program, *words = shlex.split(line.replace("1e-3", "0.2"))
        assert program == "cyclorama"
        if words[0] == "view" and not Path(pages.__file__).with_name("visibility.js").exists():
            continue
        assert main([*words, *small.get(words[0], [])]) == 0
    said = capsys.readouterr().out
    decision = said.split("cheapest with at most 0.2 missed:\n")[1]
    assert "| size of the file " in decision and "| faces still drawn, of all |" in decision
    assert {"bunny.ply", "tradeoff.png", "bunny.npz"} <= {path.name for path in tmp_path.iterdir()}


def test_no_module_takes_the_place_of_a_public_name():
    script = """
        import importlib
        import pkgutil

        import cyclorama

        before = {name: getattr(cyclorama, name) for name in cyclorama.__all__}
        for module in pkgutil.walk_packages(cyclorama.__path__, "cyclorama."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
        assert [name for name, value in before.items() if getattr(cyclorama, name) is not value] == []
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(script)], check=True)
