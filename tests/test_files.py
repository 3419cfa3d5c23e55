"""Files are whole or not there."""

import os

import pytest

from cyclorama.files import check_writable, whole_file


def test_what_is_written_takes_its_name_only_in_the_end(tmp_path):
    path = tmp_path / "answer"
    path.write_text("old")
    with whole_file(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["answer"]


@pytest.mark.parametrize("end", [ValueError, KeyboardInterrupt])
def test_what_ends_badly_leaves_what_was_there(tmp_path, end):
    path = tmp_path / "answer"
    path.write_text("old")
    with pytest.raises(end), whole_file(path) as file:
        file.write(b"ne")
        raise end
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["answer"]


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OSError, match="no-folder"), whole_file(tmp_path / "no-folder" / "answer"):
        pass
    with pytest.raises(OSError, match="no-folder"):
        check_writable(tmp_path / "no-folder" / "answer")


def test_checking_leaves_nothing_and_refuses_a_folder(tmp_path):
    check_writable(tmp_path / "answer")
    assert os.listdir(tmp_path) == []
    with pytest.raises(OSError, match="folder"):
        check_writable(tmp_path)
