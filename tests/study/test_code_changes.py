"""Code that is edited while a cell runs, and cells that have a result of older code."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers import scripted_cells
from helpers.scripted_cells import Here, Told

from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result_files import cell_files
from stlbench.registry.fingerprint import code_of
from stlbench.study import run
from stlbench.study.cell import Cell
from stlbench.study.code_changes import key_without_code, run_checked
from stlbench.study.plan import Checked


@pytest.fixture
def plugin(site):
    """The file of a module, and the cell whose method it is."""
    root = site("acme", "", {"zz_pack/__init__.py": "", "zz_pack/one.py": "x = 1\n", "zz_pack/data.csv": "1"})
    (cell,) = scripted_cells.cells("a")
    return root / "zz_pack" / "one.py", replace(cell, key="0" * 32, code=(code_of("zz_pack.one"),))


def test_code_that_stays_as_it_is_changes_nothing(plugin, tmp_path):
    _, cell = plugin
    assert run_checked(cell, scripted_cells.run_in, tmp_path) == scripted_cells.run_cell(cell)


@pytest.mark.parametrize("name", ["one.py", "data.csv"])
def test_an_edit_before_the_cell_is_a_failure_that_names_the_file_and_nothing_runs(plugin, tmp_path, name):
    file, cell = plugin
    file.with_name(name).write_text("y = 2\n")
    result = run_checked(cell, lambda cell, folder: pytest.fail("it ran"), tmp_path)
    said = f"{file.with_name(name)} has changed since the study was planned; the same command again measures the cell"
    assert (result.id, result.status, result.reason) == (cell.id, "raised", said)
    assert result.key == key_without_code(cell) != cell.key


def test_an_edit_while_it_runs_takes_the_result_and_its_traces_away(plugin, tmp_path):
    file, cell = plugin
    files = cell_files(tmp_path, cell.id, cell.key)
    traces, training = files.traces, files.training

    def edits(cell, folder):
        for path in (traces, training):
            path.parent.mkdir()
            path.write_text("of some code")
        file.write_text("x = 2\n")
        return scripted_cells.run_cell(cell)

    assert run_checked(cell, edits, tmp_path).status == "raised"
    assert not traces.exists()
    assert not training.exists()


def test_what_a_cell_raises_is_raised_unless_its_code_was_edited(plugin, tmp_path):
    file, cell = plugin
    raises = replace(cell, id=scripted_cells.cells("raise")[0].id)
    with pytest.raises(ValueError, match="no such luck"):
        run_checked(raises, scripted_cells.run_in, tmp_path)

    def half_saved(cell, folder):
        file.write_text("x =")
        raise SyntaxError

    assert "one.py has changed" in run_checked(cell, half_saved, tmp_path).reason


def test_the_cell_is_offered_again_even_where_the_edit_is_taken_back(plugin, tmp_path, scripted):
    file, cell = plugin

    def statuses():
        scripted_cells.run_cells([cell], tmp_path, Here())
        with Ledger(tmp_path / LEDGER, create=False) as ledger:
            return [(result.status, result.key) for result in ledger.results()]

    file.write_text("x = 2\n")
    assert statuses() == [("raised", key_without_code(cell))]
    file.write_text("x = 1\n")
    assert statuses() == [("unsuitable", cell.key)]


# results of older code: the user reads in a line why cells run again, and may keep the results

PARTS = {"harness": "a" * 32, "task": "b" * 32, "method": "c" * 32, "agent": "d" * 32, "packages": "e" * 32}


@pytest.fixture
def study(tmp_path, monkeypatch, scripted):
    def ran(cells, numpy="2.4", **words):
        monkeypatch.setattr(run, "collect", lambda jobs: {"jobs": str(jobs), "numpy": numpy, "time": numpy})
        told = Told()
        scripted_cells.run_cells(cells, tmp_path, Here(), progress=told, **words)
        (missing, done), *_ = told.lines
        return (len(missing), done), *told.notes

    return ran


def cells(*methods: str, **changed: str) -> list[Cell]:
    parts = tuple((PARTS | changed).items())
    made = scripted_cells.cells(*methods)
    return [replace(cell, key=f"{cell.key}-{'-'.join(changed.values())}", parts=parts) for cell in made]


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        ({"harness": "1"}, "stlbench's own code"),
        ({"task": "1"}, "task task"),
        ({"method": "1"}, "method a, method b"),
        ({"agent": "1"}, "agent agent or its recipe"),
        ({"packages": "1"}, "numpy 2.4 to 2.5"),
        ({"harness": "1", "task": "2"}, "stlbench's own code, task task"),
    ],
)
def test_a_line_says_what_has_changed(study, changed, cause):
    assert study(cells("a", "b")) == ((2, 0),)
    said = f"2 cells have results of other code and are measured anew; what has changed: {cause}"
    assert study(cells("a", "b", **changed), numpy="2.5" if "packages" in changed else "2.4") == ((2, 0), said)
    assert study(cells("a", "b", **changed)) == ((0, 2),)


def test_results_that_do_not_say_their_code_are_so_named_and_the_way_out_is_said(study):
    study(scripted_cells.cells("a"))
    _, said = study(cells("a"), keep_old=False)
    assert said == (
        "1 cell has a result of other code and is measured anew; --keep-old counts the old results as done; "
        "what has changed: not known, as the old results do not say of which code they are"
    )


def test_old_results_are_kept_where_the_user_says_so_and_accidents_are_not(study, tmp_path):
    study(cells("a", "raise"))
    begun, said = study(cells("a", "raise", "b", harness="1"), keep_old=True)
    assert begun == (2, 1)
    assert said == "1 cell has a result of other code and is not measured anew; what has changed: stlbench's own code"
    with Ledger(tmp_path / LEDGER, create=False) as ledger:
        found = {result.id.method.name: result.key for result in ledger.results()}
        assert found == {"a": "key-0-", "raise": "key-1-1", "b": "key-2-1"}
        assert ledger.missing() == []


def test_results_of_other_code_that_are_kept_are_not_checked(study, monkeypatch):
    study(cells("a"))
    checked = list[str]()
    monkeypatch.setattr(run, "check_cells", lambda cells: checked.extend(map(str, cells)) or Checked())
    assert study(cells("a", agent="1"), keep_old=True)[0] == (0, 1)
    assert checked == []
