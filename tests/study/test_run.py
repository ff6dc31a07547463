"""A study: what is missing runs once, what is finished does not, and the caller is informed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers import scripted_cells
from helpers.scripted_cells import Here, Told

from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.lines import write_lines
from stlbench.records.result import ACCIDENTS
from stlbench.records.result_files import LINES
from stlbench.registry.choices import choice_of
from stlbench.study import run, trial
from stlbench.study.code_changes import run_checked
from stlbench.study.plan import Checked, preload
from stlbench.study.run import run_cells
from stlbench.study.scheduler import build_executor
from stlbench.study.study import Study

pytestmark = pytest.mark.usefixtures("scripted")


def study(folder, cells, **words):
    executor, told = Here(), Told()
    scripted_cells.run_cells(cells, folder, executor, progress=told, **words)
    return executor.ran, told.lines


def test_what_is_missing_runs_with_its_deadline_and_the_caller_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "check_cells", lambda cells: Checked(("by the way",)))
    cells = scripted_cells.cells("a", "b", "raise", deadline=7)
    ran, lines = study(tmp_path, cells)
    assert ran == [("a", 7), ("b", 7), ("raise", 7)]
    ends = [("a", "unsuitable"), ("b", "unsuitable"), ("raise", "raised")]
    assert lines == [(["a", "b", "raise"], 0), "by the way", *ends]
    with Ledger(tmp_path / LEDGER, create=False) as ledger:
        assert [result.id for result in ledger.results()] == [cell.id for cell in cells]


def test_what_is_not_compiled_is_so_before_the_first_cell_and_the_caller_is_told(tmp_path, monkeypatch):
    cells, done = scripted_cells.cells("a", "b"), list[str]()

    class Compiles:
        def uncompiled(self):
            return None if done else lambda: done.append("compiled")

    agents = [(cells[0].id.agent, Compiles()), (cells[0].id.agent, Compiles()), (choice_of("other"), None)]
    monkeypatch.setattr(run, "check_cells", lambda cells: Checked(agents=tuple(agents)))
    _, lines = study(tmp_path, cells)
    assert lines[1:3] == ["compiling agent, once per machine", ("a", "unsuitable")]
    assert done == ["compiled"]
    done.clear()
    _, lines = study(tmp_path, cells)
    assert done == []
    assert not any("compiling" in line for line in lines)


def test_what_is_finished_is_not_run_again_and_a_cell_given_twice_runs_once(tmp_path):
    cells = scripted_cells.cells("a", "b", "c")
    assert study(tmp_path, [*cells[:2], cells[0]])[0] == [("a", 60), ("b", 60)]
    assert study(tmp_path, cells) == ([("c", 60)], [(["c"], 2), ("c", "unsuitable")])
    assert study(tmp_path, cells) == ([], [([], 3)])


def test_a_study_that_is_kept_as_text_goes_on(tmp_path):
    cells = scripted_cells.cells("a", "b", "raise", "d")
    study(tmp_path, cells[:3])
    with Ledger(tmp_path / LEDGER, create=False) as ledger:
        ledger.plan_also({cells[3].key: cells[3].id})
        before = list(ledger.results())
        write_lines(before, tmp_path / LINES, results_folder.missing(tmp_path))
    (tmp_path / LEDGER).unlink()
    assert study(tmp_path, cells[:1]) == ([], [([], 1)])
    assert list(results_folder.read(tmp_path)) == before
    assert [*results_folder.missing(tmp_path)] == [cells[3].key]
    (tmp_path / LINES).write_text("damaged")  # a ledger goes before the text
    assert study(tmp_path, cells)[0] == [("d", 60)]


def test_nothing_runs_beside_a_text_that_is_damaged(tmp_path):
    (tmp_path / LINES).write_text("damaged")
    for _ in range(2):
        with pytest.raises(UsageError, match=r"cells\.jsonl, line 1: not a result as `stlbench export"):
            study(tmp_path, scripted_cells.cells("a"))


def test_a_study_ends_with_the_first_result_that_is_asked_for_and_is_not_begun_again(tmp_path):
    def is_b(result):
        return result.id.method.name == "b"

    cells = scripted_cells.cells("a", "b", "c")
    assert study(tmp_path, cells, until=is_b)[1] == [(["a", "b", "c"], 0), ("a", "unsuitable"), ("b", "unsuitable")]
    assert study(tmp_path, cells, until=is_b) == ([], [([], 2)])
    assert study(tmp_path, cells)[0] == [("c", 60)]


@pytest.mark.parametrize("as_text", [False, True, "beside an empty ledger"])
@pytest.mark.parametrize("keep_old", [False, True])
def test_a_dry_run_names_what_would_run(tmp_path, keep_old, as_text):
    """Also where a result is of other code, an accident of it, or to be measured again."""
    cells = scripted_cells.cells("a", "b", "c", "d", "e")
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(cells[0].ended("unsuitable"))
        ledger.record(replace(cells[1].ended("unsuitable"), key="of other code"))
        ledger.record(replace(cells[2].ended("raised"), key="of other code too"))
        ledger.record(cells[3].ended("unsuitable"))
        if as_text:
            write_lines(ledger.results(), tmp_path / LINES, {})
        else:
            ledger.mark(cells[3].key, cells[3].key)
    if as_text:
        (tmp_path / LEDGER).unlink()
    if as_text == "beside an empty ledger":
        (tmp_path / LEDGER).touch()
    before = sorted(path.name for path in tmp_path.iterdir())
    described = Study.of({"tasks": "a", "methods": "b", "results": tmp_path, "keep_old": keep_old})
    named = [cell.id.method.name for cell in run.missing_cells(described, cells)[0]]
    assert named == [*(() if keep_old else "b"), "c", *(() if as_text else "d"), "e"]
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert named == [name for name, _ in study(tmp_path, cells, keep_old=keep_old)[0]]


def test_nothing_runs_where_one_cell_is_wrong_and_only_missing_cells_are_checked(tmp_path, monkeypatch):
    def refuse(cells):
        if any(cell.id.method.name == "wrong" for cell in cells):
            raise UsageError("wrong: no parameter")
        return Checked()

    monkeypatch.setattr(run, "check_cells", refuse)
    cells = scripted_cells.cells("a", "wrong")
    with pytest.raises(UsageError, match="no parameter"):
        study(tmp_path / "new", cells)
    assert not list(tmp_path.iterdir())  # neither a ledger nor a folder
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(cells[1].ended("unsuitable"))
    assert study(tmp_path, cells)[0] == [("a", 60)]


def test_the_plan_is_written_before_anything_runs(tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Here, "run", interrupted)
    cells = scripted_cells.cells("a", "b")
    with pytest.raises(KeyboardInterrupt):
        study(tmp_path, cells)
    with Ledger(tmp_path / LEDGER, create=False) as ledger:
        assert ledger.missing() == [cell.id for cell in cells]


def test_an_executor_by_name():
    assert build_executor(jobs=3).jobs == 3
    assert build_executor("local").jobs in (1, 2)
    with pytest.raises(UsageError, match="no executor 'locale'; did you mean 'local'"):
        build_executor("locale")


def test_the_executor_is_told_what_to_run_what_to_load_and_where_logs_go(tmp_path):
    seen = []

    class Remembers(Here):
        def run(self, function, items, deadlines):
            seen.append(function)
            return super().run(function, items, deadlines)

    cells = scripted_cells.cells("a", "a")
    run_cells(cells, tmp_path, Remembers())
    (work,) = seen
    assert work.function.func is run_checked
    assert work.function.keywords == {"run_cell": trial.run_cell, "folder": tmp_path}
    assert (work.prepare.func, work.prepare.args) == (preload, (cells[:1],))
    assert work.log(cells[1]) == tmp_path / "logs" / "task_a_agent_1_key-1.log"


def test_memory_is_a_parameter_of_the_executor_and_what_is_in_brackets_goes_first():
    assert build_executor(memory="4G").memory == 4 * 2**30
    assert build_executor("local[memory=512M]", memory="4G").memory == 512 * 2**20
    assert build_executor(jobs=4).memory == build_executor(jobs=1).memory // 4
    with pytest.raises(UsageError, match=r"^local: memory should be"):
        build_executor(memory="lots")
    with pytest.raises(UsageError, match=r"memory .*at least 1048576"):
        build_executor(memory="4K")


def test_retry_runs_accidents_again_and_is_by_how_a_cell_failed(tmp_path):
    cells = scripted_cells.cells("a", "raise")
    study(tmp_path, cells)
    for retry in ((), ["timeout", "killed"]):
        assert study(tmp_path, cells, retry=retry)[0] == []
    for retry in (["raised"], ACCIDENTS):
        assert study(tmp_path, cells, retry=retry)[0] == [("raise", 60)]


def test_a_cell_that_failed_so_often_is_given_up_and_the_caller_is_told(tmp_path):
    cells = scripted_cells.cells("a", "raise")
    for _ in range(3):
        assert study(tmp_path, cells, retry=ACCIDENTS, attempts=3)[0][-1] == ("raise", 60)
    ran, lines = study(tmp_path, cells, retry=ACCIDENTS, attempts=3)
    assert ran == []
    said = "1 cell failed 3 times or more in a row, given up: task/raise/agent/1; "
    said += "--attempts with a greater number tries again"
    assert lines == [([], 2), said]
    assert study(tmp_path, cells, attempts=3)[1] == [([], 2)]  # nothing is to be tried again
    assert study(tmp_path, cells, retry=ACCIDENTS, attempts=4)[0] == [("raise", 60)]
    assert study(tmp_path, cells, retry=ACCIDENTS)[0] == [("raise", 60)]


def test_a_success_forgets_the_failures_of_before(tmp_path):
    (cell,) = scripted_cells.cells("a")
    with Ledger(tmp_path / LEDGER) as ledger:
        for status in ("killed", "timeout", "unsuitable", "killed"):
            ledger.record(cell.ended(status))
        assert ledger.given_up([cell.key], 2) == []
        ledger.record(cell.ended("raised"))
        assert ledger.given_up([cell.key], 2) == [cell.id]
