"""Who hears how far the work is."""

import io
import sys

import pytest

from cyclorama import progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def work(chosen):
    with progress.reporter(chosen, 3, "counting") as report:
        for done in range(1, 4):
            report(done)


@pytest.mark.parametrize("chosen", [None, True])
def test_a_terminal_gets_a_bar(chosen, monkeypatch):
    pytest.importorskip("tqdm", reason="draws the bar")
    monkeypatch.setattr(sys, "stderr", Terminal())
    work(chosen)
    assert "counting" in sys.stderr.getvalue() and "0/3" in sys.stderr.getvalue()


@pytest.mark.parametrize("chosen", [None, True, False])
def test_a_file_gets_nothing(chosen, monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    work(chosen)
    assert sys.stderr.getvalue() == ""


def test_false_is_silent_in_a_terminal_too(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    work(False)
    assert sys.stderr.getvalue() == ""


def test_without_tqdm_there_is_no_bar_and_no_error(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(progress.importlib.util, "find_spec", lambda name: None)
    work(None)
    assert sys.stderr.getvalue() == ""


def test_a_function_is_called_with_what_is_done():
    seen = []
    work(seen.append)
    assert seen == [1, 2, 3]


@pytest.mark.parametrize("bad", ["yes", 1, 0.5])
def test_anything_else_is_refused(bad):
    with pytest.raises(ValueError, match="progress"):
        work(bad)
