"""Logs beside a run: what they are told, and that nothing they do harms it."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from helpers.scripted_cells import Told
from helpers.synthetic_results import result

from stlbench.contract import LoggedCell, RunLog
from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.registry.choices import parse_choice
from stlbench.study import logs
from stlbench.study.logs import Logged, build_logs, logged
from stlbench.study.run import run_missing, run_study
from stlbench.study.study import Study


class Recorded(RunLog):
    """What it was told."""

    def __init__(self) -> None:
        self.said = list[object]()

    def begin(self, folder: Path, cells: tuple[str, ...]) -> None:
        self.said.append(cells)

    def ended(self, cell: LoggedCell) -> None:
        self.said.append((cell.cell, cell.status))

    def end(self) -> None:
        self.said.append("end")


CELL = CellId.parse("hold-disc/funnel/dqn/0", "quick")


def test_a_log_is_told_of_the_run_and_its_cells(tmp_path: Path) -> None:
    log, told = Recorded(), Told()
    with Logged({"recorded": log}, tmp_path, told) as progress:
        progress.begin([CELL], 0)
        progress.ended(result())
    assert log.said == [(CELL.name,), (CELL.name, "done"), "end"]
    assert told.lines == [(["funnel"], 0), ("funnel", "done")]


@pytest.mark.parametrize("error", [ValueError("no"), SystemExit(3), KeyboardInterrupt()])
def test_a_log_that_raises_is_turned_off_and_the_others_go_on(tmp_path: Path, error: BaseException) -> None:
    class Raises(Recorded):
        def begin(self, folder: Path, cells: tuple[str, ...]) -> None:
            raise error

    bad, good, told = Raises(), Recorded(), Told()
    with Logged({"bad": bad, "good": good}, tmp_path, told) as progress:
        progress.begin([CELL], 0)
        progress.ended(result())
    assert bad.said == []
    assert good.said == [(CELL.name,), (CELL.name, "done"), "end"]
    (note,) = told.notes
    assert note.startswith(f"log bad is turned off: {type(error).__name__}")
    assert note.endswith("the run goes on")


def test_a_log_that_hangs_is_turned_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "_END_SECONDS", 0.1)
    never = threading.Event()

    class Hangs(Recorded):
        def ended(self, cell: LoggedCell) -> None:
            never.wait()

    told = Told()
    with Logged({"slow": Hangs()}, tmp_path, told) as progress:
        progress.begin([CELL], 0)
        progress.ended(result())
    assert told.notes == ["log slow is turned off: it did not come to its end within 0.1 s; the run goes on"]
    never.set()


def test_a_call_that_takes_too_long_turns_a_log_off_while_the_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "_MOST_SECONDS", 0.0)
    here, never = threading.Event(), threading.Event()

    class Hangs(Recorded):
        def begin(self, folder: Path, cells: tuple[str, ...]) -> None:
            here.set()
            never.wait()

    told = Told()
    with Logged({"slow": Hangs()}, tmp_path, told) as progress:
        progress.begin([CELL], 0)
        here.wait()
        progress.ended(result())
        assert [note.partition(":")[0] for note in told.notes] == ["log slow is turned off"]
    assert len(told.notes) == 1
    never.set()


def test_what_a_log_is_told_of_a_cell() -> None:
    said = logged(result(robustness=(0.25, 0.75), final=(-1.0, 1.0)))
    assert (said.cell, said.budget, said.status, said.reason) == ("hold-disc/funnel/dqn/0", "quick", "done", "")
    assert said.numbers["robustness"] == 0.5
    assert said.numbers["satisfaction"] == 1.0
    assert said.numbers["final_satisfaction"] == 0.5
    assert [(each.steps, each.satisfaction) for each in said.curve] == [(1000, 0.5), (2000, 1.0)]
    lost = logged(result(status="raised", reason="ValueError: no"))
    assert (lost.status, lost.reason, lost.numbers, lost.curve) == ("raised", "ValueError: no", {}, ())


def test_a_study_names_its_logs_and_an_unknown_one_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text('tasks: hold-disc\nmethods: raw\nlog: [tensorboard, "wandb[mode=offline]"]\n')
    study = Study.of({}, tmp_path / "study.yaml")
    assert list(map(str, study.log)) == ["tensorboard", "wandb[mode=offline]"]
    assert Study.of({"log": "tensorboard[folder=/a/b]"}, study).log[0].parameters == (("folder", "/a/b"),)
    with pytest.raises(UsageError, match="no log 'tensorbord'; did you mean 'tensorboard'"):
        run_missing(Study.of({"log": "tensorbord"}, study))
    with pytest.raises(UsageError, match="mode"):
        build_logs([parse_choice("wandb[mode=never]")])


def test_progress_of_another_type_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="progress should be True, a function or a `Listener`, got 3"):
        run_study(tasks=["hold-disc"], methods=["raw"], results=tmp_path, progress=3)  # type: ignore[arg-type]
