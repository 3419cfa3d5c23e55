"""Every notebook runs from top to bottom, and is stored without what it prints."""

from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebook_runs(path):
    nbformat = pytest.importorskip("nbformat", reason="reads notebooks")
    client = pytest.importorskip("nbclient", reason="runs notebooks")
    pytest.importorskip("ipykernel", reason="runs notebooks")
    pytest.importorskip("matplotlib", reason="draws their charts")
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "clear the outputs before committing"
    client.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs), "no chart was drawn"
    text = [cell["source"] for cell in notebook.cells if cell["cell_type"] == "markdown"]
    assert text[0].split("\n")[0].endswith("?"), "a notebook is a question"
    assert any(
        "| ---" in str(output) or "<table>" in str(output) or output.get("name") == "stdout" for output in outputs
    )
