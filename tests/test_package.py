"""The package as a user installs it."""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import cyclorama as cyc
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
    assert {path.name for path in tmp_path.iterdir()} == {"bunny.npz", "tradeoff.png", "proof.npz", "backdrops"}
    said = capsys.readouterr().out
    assert "culled on average" in said
    assert "% hole" in said and "violations=0" in said
