"""Cells to rows: accidents become rows, what is finished is not run again, an interrupt loses nothing that ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from helpers import scripted_cells

from stlbench.contract import Executor, Outcome
from stlbench.study import scheduler
from stlbench.study.ledger import Ledger
from stlbench_executors.local import LocalExecutor


class Here(Executor):
    """Runs items in this process, and remembers which, and whether it was closed."""

    def __init__(self, *, jobs: int = 1) -> None:
        super().__init__(jobs=jobs)
        self.ran, self.closed = [], False

    def run(self, function, items, deadlines):
        try:
            for index, item in reversed(list(enumerate(items))):
                self.ran.append((item.seed, deadlines[index]))
                try:
                    yield Outcome(index, "done", function(item))
                except ValueError as error:
                    yield Outcome(index, "raised", reason=str(error), details="trace")
        finally:
            self.closed = True


@pytest.fixture
def ledger(tmp_path):
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        yield ledger


@pytest.mark.parametrize("jobs", [1, 2])
def test_accidents_become_rows_with_their_reasons_and_the_others_go_on(ledger, jobs):
    cells = scripted_cells.cells("a", "raise", "b", "kill", "c", "hang", "d", "lie", "e")
    found = list(
        scheduler.run(cells, ledger, LocalExecutor(jobs=jobs), scripted_cells.run_cell, [3.0] * len(cells), {})
    )
    assert sorted(result.seed for result in found) == list(range(9))
    rows = {result.method: (result.status, result.reason) for result in ledger.results()}
    assert rows.pop("lie")[0] == "raised"
    assert rows == {
        "raise": ("raised", "ValueError: no such luck"),
        "kill": ("killed", "killed by signal 9 (SIGKILL)"),
        "hang": ("timeout", "no result after 3 s"),
        **{method: ("unsuitable", "for the test") for method in "abcde"},
    }
    details = {result.method: result.details for result in found}
    assert 'raise ValueError("no such luck")' in details["raise"]


def test_a_row_has_the_cells_words(ledger):
    (cell,) = scripted_cells.cells("raise")
    (result,) = scheduler.run([cell], ledger, Here(), scripted_cells.run_cell, [1.0], {})
    assert (result.key, result.name, result.budget, result.details) == (cell.key, cell.name, "smoke", "trace")
    assert list(ledger.results()) == [result]


def test_what_is_finished_is_not_run_again_and_each_keeps_its_deadline(ledger):
    cells = scripted_cells.cells("a", "b", "c", "d")
    ledger.record(scripted_cells.run_cell(cells[1]))
    executor = Here()
    found = list(scheduler.run(cells, ledger, executor, scripted_cells.run_cell, [1.0, 2.0, 3.0, 4.0], {}))
    assert executor.ran == [(3, 4.0), (2, 3.0), (0, 1.0)]
    assert [result.seed for result in found] == [3, 2, 0]
    executor = Here()
    assert list(scheduler.run(cells, ledger, executor, scripted_cells.run_cell, [1.0] * 4, {})) == []
    assert executor.ran == []


def test_retry_runs_accidents_again_and_nothing_else(ledger):
    cells = scripted_cells.cells("a", "raise")
    list(scheduler.run(cells, ledger, Here(), scripted_cells.run_cell, [1.0, 1.0], {}))
    for retry, ran in ((False, []), (True, [(1, 1.0)])):
        executor = Here()
        list(scheduler.run(cells, ledger, executor, scripted_cells.run_cell, [1.0, 1.0], {}, retry))
        assert executor.ran == ran


def test_a_cell_given_twice_runs_once(ledger):
    (cell,) = scripted_cells.cells("a")
    executor = Here()
    assert len(list(scheduler.run([cell, cell], ledger, executor, scripted_cells.run_cell, [1.0, 1.0], {}))) == 1
    assert len(executor.ran) == 1


def test_a_result_is_recorded_when_it_is_yielded_and_closing_stops_the_executor(ledger):
    cells, executor = scripted_cells.cells("a", "b", "c"), Here()
    running = scheduler.run(cells, ledger, executor, scripted_cells.run_cell, [1.0] * 3, {})
    first = next(running)
    assert list(ledger.results()) == [first]
    running.close()
    assert executor.closed
    assert len(executor.ran) == 1


def test_every_cell_needs_a_deadline(ledger):
    with pytest.raises(ValueError, match="zip"):
        list(scheduler.run(scripted_cells.cells("a", "b"), ledger, Here(), scripted_cells.run_cell, [1.0], {}))


PROGRAM = """
import sys
from pathlib import Path
from helpers import scripted_cells
from stlbench.study import scheduler
from stlbench.study.ledger import Ledger
from stlbench_executors.local import LocalExecutor
if __name__ == "__main__":
    cells = scripted_cells.cells("a", "b", "hang", "hang", "c", "hang")
    with Ledger(Path(sys.argv[1])) as ledger:
        runs = scheduler.run(cells, ledger, LocalExecutor(jobs=2), scripted_cells.run_cell, [600.0] * len(cells), {})
        for result in runs:
            print(result.method, flush=True)
"""


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_or_killed_run_has_recorded_what_ended(tmp_path, sent):
    program, path = tmp_path / "program.py", tmp_path / "ledger.sqlite"
    program.write_text(PROGRAM)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    parent = subprocess.Popen(
        [sys.executable, program, path], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert {parent.stdout.readline().strip(), parent.stdout.readline().strip()} == {"a", "b"}
    time.sleep(0.5)  # both workers hang
    parent.send_signal(sent)
    parent.communicate(timeout=60)
    assert parent.returncode == -sent
    with Ledger(path) as ledger:
        assert {result.method for result in ledger.results()} == {"a", "b"}
