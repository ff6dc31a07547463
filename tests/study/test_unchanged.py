"""What was edited while a cell ran has no result under the key of the code of before."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers import scripted_cells

from stlbench.records.cell_files import cell_files
from stlbench.records.ledger import FILE, Ledger
from stlbench.registry.fingerprint import code_of
from stlbench.study import run
from stlbench.study.unchanged import key_without_code, run_unchanged


@pytest.fixture
def plugin(site):
    """The file of a module, and the cell whose method it is."""
    root = site("acme", "", {"zz_pack/__init__.py": "", "zz_pack/one.py": "x = 1\n", "zz_pack/data.csv": "1"})
    (cell,) = scripted_cells.cells("a")
    return root / "zz_pack" / "one.py", replace(cell, key="0" * 32, code=(code_of("zz_pack.one"),))


def test_code_that_stays_as_it_is_changes_nothing(plugin, tmp_path):
    _, cell = plugin
    assert run_unchanged(cell, scripted_cells.run_in, tmp_path) == scripted_cells.run_cell(cell)


@pytest.mark.parametrize("name", ["one.py", "data.csv"])
def test_an_edit_before_the_cell_is_a_failure_that_names_the_file_and_nothing_runs(plugin, tmp_path, name):
    file, cell = plugin
    file.with_name(name).write_text("y = 2\n")
    result = run_unchanged(cell, lambda cell, folder: pytest.fail("it ran"), tmp_path)
    said = f"{file.with_name(name)} has changed since the study was planned; the same command again measures the cell"
    assert (result.id, result.status, result.reason) == (cell.id, "raised", said)
    assert result.key == key_without_code(cell) != cell.key


def test_an_edit_while_it_runs_takes_the_result_and_its_traces_away(plugin, tmp_path):
    file, cell = plugin
    traces = cell_files(tmp_path, cell.id, cell.key).traces

    def edits(cell, folder):
        traces.parent.mkdir()
        traces.write_text("of some code")
        file.write_text("x = 2\n")
        return scripted_cells.run_cell(cell)

    assert run_unchanged(cell, edits, tmp_path).status == "raised"
    assert not traces.exists()


def test_what_a_cell_raises_is_raised_unless_its_code_was_edited(plugin, tmp_path):
    file, cell = plugin
    raises = replace(cell, id=scripted_cells.cells("raise")[0].id)
    with pytest.raises(ValueError, match="no such luck"):
        run_unchanged(raises, scripted_cells.run_in, tmp_path)

    def half_saved(cell, folder):
        file.write_text("x =")
        raise SyntaxError

    assert "one.py has changed" in run_unchanged(cell, half_saved, tmp_path).reason


def test_the_cell_is_offered_again_even_where_the_edit_is_taken_back(plugin, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "check_cells", lambda cells: ())
    monkeypatch.setattr(run, "uncompiled", lambda cells: ())
    file, cell = plugin
    executor = run.build_executor(jobs=1)

    def statuses():
        run.run_cells([cell], tmp_path, executor, run_cell=scripted_cells.run_in)
        with Ledger(tmp_path / FILE, create=False) as ledger:
            return [(result.status, result.key) for result in ledger.results()]

    file.write_text("x = 2\n")
    assert statuses() == [("raised", key_without_code(cell))]
    file.write_text("x = 1\n")
    assert statuses() == [("unsuitable", cell.key)]
