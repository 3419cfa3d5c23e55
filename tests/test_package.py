"""The package as a user installs it."""

import subprocess
import sys
import textwrap

import cyclorama as cyc


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
