"""Notebooks run from the first cell to the last, are committed without outputs, and open in Colab."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import nbclient
import nbformat
import pytest

pytestmark = pytest.mark.slow

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs/notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", ":".join(entry for entry in sys.path if entry))
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    shown = [output.data for cell in code for output in cell.outputs if "data" in output]
    assert sum("image/png" in data for data in shown) == 1
    texts = [data["text/plain"] for data in shown if "image/png" not in data]
    if path.stem == "first-study":
        assert texts[0] == "<Results of 4 cells in first-study: 4 done>"
        assert texts[-1].startswith("(('x', 'y'), (64, ")
    else:
        assert texts[0] == "(64, 801, 2)"
        streams = [output.text for cell in code for output in cell.outputs if output.output_type == "stream"]
        assert re.findall(r"satisfied from (\d+) %", "".join(streams))[0] == "100"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_is_committed_without_outputs(path):
    code = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    assert code
    assert not any(cell.outputs or cell.execution_count for cell in code)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_opens_in_colab_and_installs_what_it_needs_there(path):
    link = f"https://colab.research.google.com/github/OWNER/stlbench/blob/main/docs/notebooks/{path.name}"
    assert link in (path.parents[1] / "howto/python.md").read_text(encoding="utf-8")
    assert "%pip install --quiet stlbench-rl" in nbformat.read(path, as_version=4).cells[1].source
