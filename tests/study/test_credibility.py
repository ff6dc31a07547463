"""The traces of a cell are scored again, in another process than the cell's."""

from __future__ import annotations

import signal
import subprocess
import time
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Pipe
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from helpers.synthetic_results import result

from stlbench.records.array_files import Assessment, save_traces
from stlbench.records.result import MAIN, Measurement, Result
from stlbench.records.result_files import cell_files
from stlbench.registry.choices import parse_choices
from stlbench.study import credibility, trial
from stlbench.study.cell import Cell
from stlbench.study.credibility import ConsistencyCheck, contradiction
from stlbench.study.plan import plan_cells
from stlbench.task import load_task


@pytest.fixture(scope="module")
def cell() -> Cell:
    (cell,) = plan_cells(parse_choices("hold-disc"), parse_choices("raw"), None, [0], "smoke")
    return cell


@pytest.fixture(scope="module")
def honest(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """A smoke cell, and its folder."""
    folder = tmp_path_factory.mktemp("results")
    return trial.run_cell(cell, folder), folder


def measured(found: Result) -> Measurement:
    assert found.measurement is not None
    return found.measurement


def test_an_honest_cell_is_believed_and_one_without_a_measurement_says_nothing(
    cell: Cell, honest: tuple[Result, Path]
) -> None:
    found, folder = honest
    assert contradiction(cell, found, folder) is None
    assert contradiction(cell, result(status="unsuitable"), folder) is None
    with ConsistencyCheck([cell], folder) as examined:
        assert examined(cell, found) is found


def told(found: Result, **changes: Any) -> Result:
    return replace(found, measurement=replace(measured(found), **changes))


def test_a_score_that_is_not_that_of_the_traces(cell: Cell, honest: tuple[Result, Path]) -> None:
    found, folder = honest
    main = measured(found).selected[MAIN]
    better = replace(main, robustness=tuple(value + 1 for value in main.robustness), satisfied=(True,) * 64)
    lies = told(found, selected={**measured(found).selected, MAIN: better})
    assert str(contradiction(cell, lies, folder)).startswith("it says robustness ")


def test_traces_from_elsewhere(cell: Cell, honest: tuple[Result, Path], tmp_path: Path) -> None:
    """Where there are none, and where they begin in the middle of the disc or are too few: the files are removed."""
    found, task = honest[0], load_task("hold-disc")
    assert "has no traces at" in str(contradiction(cell, found, tmp_path))
    path = cell_files(tmp_path, cell.id, cell.key).traces
    still = np.zeros((64, task.file.steps + 1, len(task.signals)))
    fewer = (still[:3], "traces from 3 starts, and its row says 64")
    for samples, said in ((still, "do not begin at the report's starts"), fewer):
        save_traces(path, Assessment({}, samples, None), task.signals)
        with ConsistencyCheck([cell], tmp_path) as examined:
            failed = examined(cell, found)
        assert (failed.status, failed.key, failed.measurement) == ("raised", cell.key, None)
        assert said in failed.reason
        assert not path.exists()


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    links = list[Any]()

    def started(check: ConsistencyCheck) -> Any:
        ours, theirs = Pipe()
        links.append(theirs)
        if len(links) > 1:
            theirs.send("about the second")
        return ours

    monkeypatch.setattr(credibility, "_DEADLINE", 0.0)
    monkeypatch.setattr(ConsistencyCheck, "_started", started)
    with ConsistencyCheck([], Path()) as examined:
        assert str(examined._ask(cast(Any, "first"))).startswith("who looks at it gave no answer within")
        with suppress(BrokenPipeError):
            links[0].send("about the first")
        assert examined._ask(cast(Any, "second")) == "about the second"


class Hanging:
    """A cell whose task takes a while to load."""

    measurement = True

    def load_task(self) -> None:
        time.sleep(20)


def test_a_process_that_hangs_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, popen = list[subprocess.Popen[bytes]](), subprocess.Popen

    def started(*words: Any, **options: Any) -> Any:
        begun.append(popen(*words, **options))
        return begun[-1]

    monkeypatch.setattr(credibility, "_DEADLINE", 0.0)
    monkeypatch.setattr(subprocess, "Popen", started)
    with ConsistencyCheck([], Path()) as examined:
        examined._ask(cast(Any, (Hanging(), Hanging(), Path())))
    assert [process.returncode for process in begun] == [-signal.SIGKILL]
