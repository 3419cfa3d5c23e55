"""Files that earlier versions wrote still load and say the same; files of a later version are refused in words."""

import importlib.util
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import cyclorama as cyc
from peers import need

FILES = Path(__file__).parent / "files"

specification = importlib.util.spec_from_file_location("make", FILES / "make.py")
make = importlib.util.module_from_spec(specification)
specification.loader.exec_module(make)


def test_files_of_each_format_say_what_they_said():
    need("OpenEXR")
    need("PIL")
    assert make.answers(FILES) == json.loads((FILES / "answers.json").read_text(encoding="utf-8"))
    assert cyc.placement.verify.verify(FILES / "certificate-1.npz", make.scene()) > 0


READERS = {
    "visibility-1.npz": cyc.Visibility.load,
    "plan-2.npz": lambda path: cyc.placement.Plan.load(path, make.scene()),
    "certificate-1.npz": lambda path: cyc.placement.verify.verify(path, make.scene()),
    "depth-image-1.npz": cyc.DepthImage.load,
    "layered-1.npz": cyc.LayeredDepthImage.load,
    "building-1.json": lambda path: cyc.portals.Building.load(path, make.scene()),
    "walk-3": cyc.panorama.Store,
}


def later(text):
    """A header with its version raised."""
    header = json.loads(text)
    kind, _, version = header["format"].rpartition(" ")
    return json.dumps(header | {"format": f"{kind} {int(version) + 1}"})


@pytest.mark.parametrize("name", READERS)
def test_a_later_version_is_refused_and_a_newer_cyclorama_asked_for(name, tmp_path):
    path = tmp_path / name
    if name.endswith(".npz"):
        with np.load(FILES / name) as file:
            members = dict(file)
        np.savez(path, **members | {"header": np.array(later(str(members["header"])))})
    elif name.endswith(".json"):
        path.write_text(later((FILES / name).read_text(encoding="utf-8")), encoding="utf-8")
    else:
        shutil.copytree(FILES / name, path)
        manifest = path / "manifest.json"
        manifest.write_text(later(manifest.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(
        ValueError, match=r"it was written by a newer Cyclorama: its format is 'cyclorama [a-z ]+ [234]'"
    ):
        READERS[name](path)


def test_something_else_is_not_called_newer(tmp_path):
    with pytest.raises(ValueError, match="its format is 'cyclorama depth image 1', not 'cyclorama visibility 1'"):
        cyc.Visibility.load(FILES / "depth-image-1.npz")
