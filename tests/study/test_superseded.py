"""Cells with a result of other code: the user is told in a line why they run again, and may keep what there is."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers import scripted_cells

from stlbench.records.ledger import FILE, Ledger
from stlbench.study import run
from stlbench.study.cell import Cell

PARTS = {"harness": "a" * 32, "task": "b" * 32, "method": "c" * 32, "agent": "d" * 32, "packages": "e" * 32}


class Told:
    def __init__(self):
        self.begun, self.notes = [], []

    def begin(self, missing, done):
        self.begun.append((len(missing), done))

    def note(self, text):
        self.notes.append(text)

    def ended(self, result): ...


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "check_cells", lambda cells: ())
    monkeypatch.setattr(run, "uncompiled", lambda cells: ())

    def ran(cells, numpy="2.4", **words):
        monkeypatch.setattr(run, "collect", lambda jobs: {"jobs": str(jobs), "numpy": numpy, "time": numpy})
        told = Told()
        run.run_cells(cells, tmp_path, run.build_executor(), run_cell=scripted_cells.run_in, progress=told, **words)
        return told.begun[0], *told.notes

    return ran


def cells(*methods: str, **changed: str) -> list[Cell]:
    parts = tuple((PARTS | changed).items())
    return [
        replace(cell, key=f"{cell.key}-{'-'.join(changed.values())}", parts=parts)
        for cell in scripted_cells.cells(*methods)
    ]


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
    with Ledger(tmp_path / FILE, create=False) as ledger:
        found = {result.id.method.name: result.key for result in ledger.results()}
        assert found == {"a": "key-0-", "raise": "key-1-1", "b": "key-2-1"}
        assert ledger.missing() == []
