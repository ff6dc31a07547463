"""Cells to rows: accidents become rows, an interrupt loses nothing that ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from helpers import scripted_cells
from helpers.scripted_cells import Here

from stlbench.records.ledger import Ledger
from stlbench.study import scheduler
from stlbench.study.provenance import collect
from stlbench_executors.local import LocalExecutor


@pytest.fixture
def ledger(tmp_path):
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        yield ledger


def test_accidents_become_rows_with_their_reasons_and_the_others_go_on(ledger):
    cells = scripted_cells.cells("a", "raise", "b", "kill", "c", "hang", "d", "lie", "e")
    cells = [replace(cell, deadline=3) if cell.id.method.name == "hang" else cell for cell in cells]
    found = list(scheduler.run(cells, ledger, LocalExecutor(jobs=2), scripted_cells.run_cell, {}))
    assert sorted(result.id.seed for result in found) == list(range(9))
    rows = {result.id.method.name: (result.status, result.reason) for result in ledger.results()}
    assert rows.pop("lie")[0] == "raised"
    assert rows == {
        "raise": ("raised", "ValueError: no such luck"),
        "kill": ("killed", "killed by signal 9 (SIGKILL)"),
        "hang": ("timeout", "no result after 3 s"),
        **{method: ("unsuitable", "for the test") for method in "abcde"},
    }
    details = {result.id.method.name: result.details for result in found}
    assert 'raise ValueError("no such luck")' in details["raise"]


def test_a_row_has_the_cells_identity(ledger):
    (cell,) = scripted_cells.cells("raise")
    (result,) = scheduler.run([cell], ledger, Here(), scripted_cells.run_cell, {})
    assert (result.id, result.key, result.details) == (cell.id, cell.key, "trace")
    assert list(ledger.results()) == [result]


@pytest.mark.parametrize("facts", [None, {}, {"machine": "another"}])
def test_a_row_says_on_which_machine_its_cell_ran_however_it_ended(ledger, facts):
    class There(Here):
        def run(self, *arguments):
            yield from (replace(outcome, facts=facts) for outcome in super().run(*arguments))

    list(scheduler.run(scripted_cells.cells("a", "raise"), ledger, There(), scripted_cells.run_cell, collect(3)))
    here = collect(3)["machine"] if facts is None else None
    for result in ledger.results():
        assert result.provenance.get("machine") == (facts or {}).get("machine", here)
        assert result.provenance["jobs"] == "3"


def test_a_result_is_recorded_when_it_is_yielded_and_closing_stops_the_executor(ledger):
    cells, executor = scripted_cells.cells("a", "b", "c"), Here()
    running = scheduler.run(cells, ledger, executor, scripted_cells.run_cell, {})
    first = next(running)
    assert list(ledger.results()) == [first]
    running.close()
    assert executor.closed
    assert len(executor.ran) == 1


PROGRAM = """
import signal, sys
from pathlib import Path
from helpers import scripted_cells
from helpers.scripted_cells import Here
from stlbench.study import scheduler
from stlbench.records.ledger import Ledger
from stlbench.study.provenance import collect
from stlbench_executors.local import LocalExecutor
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background has it ignored
cells = scripted_cells.cells("a", "b", "hang", "hang", "c", "hang")
with Ledger(Path(sys.argv[1])) as ledger:
    for result in scheduler.run(cells, ledger, LocalExecutor(jobs=2), scripted_cells.run_cell, {}):
        print(result.id.method, flush=True)
"""


@pytest.mark.parametrize("sent", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGKILL])
def test_an_interrupted_or_killed_run_has_recorded_what_ended(tmp_path, sent):
    program, path = tmp_path / "program.py", tmp_path / "ledger.sqlite"
    program.write_text(PROGRAM)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command, pipe = [sys.executable, program, path], subprocess.PIPE
    parent = subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True)
    assert {parent.stdout.readline().strip(), parent.stdout.readline().strip()} == {"a", "b"}
    time.sleep(0.5)  # both workers hang
    parent.send_signal(sent)
    parent.communicate(timeout=60)
    assert parent.returncode == -sent
    with Ledger(path) as ledger:
        assert {result.id.method.name for result in ledger.results()} == {"a", "b"}
