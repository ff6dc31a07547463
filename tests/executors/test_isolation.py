"""What an item does to its process, its relatives, its memory and its output stays with it."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import pytest
from executors.test_local import alive, outcomes
from helpers import victims
from helpers.waiting import wait_for

from stlbench.contract import Work
from stlbench_executors import supervisor
from stlbench_executors.local import LocalExecutor

LEAKS = ("seterr", "chdir", "umask", "numpy", "time", "stlbench", "threads", "environment", "answer")


def test_nothing_that_an_item_changes_is_seen_by_another():
    """With one job, so that they follow each other."""
    items = ["look", *(item for leak in LEAKS for item in (leak, "look"))]
    found = outcomes(victims.leak, items)
    assert [found[index].value for index in range(1, len(items), 2)] == list(LEAKS)
    assert all(found[index].value == found[0].value for index in range(2, len(items), 2))
    assert found[0].value["numpy"] == 2.0


def test_the_number_type_of_torch_stays_with_the_cell_that_sets_it():
    pytest.importorskip("torch")
    found = outcomes(Work(victims.leak, victims.load_torch), ["dtype", "look"])
    assert (found[0].value, found[1].value["dtype"]) == ("dtype", "torch.float32")


def test_a_process_that_an_item_leaves_ends_with_it_also_in_another_session(tmp_path):
    items = [f"daemon {tmp_path / name}" for name in "abc"]
    found = outcomes(victims.family, items)
    assert [outcome.value for outcome in found.values()] == ["left one"] * 3
    assert not any(alive(int((tmp_path / name).read_text())) for name in "abc")


def test_an_exit_is_seen_at_once_even_where_a_child_goes_on():
    """Not at the deadline, which pytest would not wait for."""
    found = outcomes(victims.family, ["held", "a"], deadline=6000.0)
    assert (found[0].status, found[0].reason) == ("killed", "the process ended with exit code 0")
    assert found[1].value == "a"


def test_an_item_that_turns_against_those_around_it_ends_alone():
    found = outcomes(victims.family, ["group", "a", "keeper", "b", "close", "c", "keeper", "d"])
    assert [found[index].value for index in (1, 3, 5, 7)] == ["a", "b", "c", "d"]
    assert [(found[index].status, found[index].reason) for index in (0, 2, 4, 6)] == [
        ("killed", "killed by signal 9 (SIGKILL)"),
        ("killed", "the process that watched over it ended"),
        ("killed", "the process ended with exit code 1"),
        ("killed", "the process that watched over it ended"),
    ]


def test_a_keeper_that_an_item_stops_is_replaced_after_a_while(monkeypatch):
    monkeypatch.setattr("stlbench_executors.pool.GRACE_SECONDS", 0.5)
    found = outcomes(victims.family, ["stop", "a"], deadline=1.0)
    assert (found[0].status, found[0].reason, found[1].value) == ("timeout", "no result after 1 s", "a")


def test_an_item_that_takes_too_much_memory_is_killed_also_where_its_children_do():
    for outcome in LocalExecutor(jobs=1, memory=300 * 2**20).run(victims.eat, ["400", "150 4"], [600.0] * 2):
        assert outcome.status == "killed"
        assert outcome.reason.startswith("it took ")
        assert outcome.reason.endswith(" of memory, its limit is 300 MiB")


def written(tmp_path: Path, *items: str) -> dict[str, str]:
    work = Work(victims.say, log=partial(victims.log, tmp_path))
    outcomes(work, list(items))
    return {path.stem: path.read_text() for path in (tmp_path / "logs").glob("*")}


def test_what_an_item_writes_is_in_its_log_and_nowhere_else(tmp_path, capfd):
    found = written(tmp_path, "shell", "print one", "silent", "crash")
    assert found.keys() == {"shell", "print", "crash"}
    assert found["shell"] == "from a shell\nand its errors\n"
    assert found["print"] == "caf\\udce9 one\n"
    assert "before it" in found["crash"]
    assert 'victims.py", line' in found["crash"]
    assert capfd.readouterr() == ("", "")
    assert written(tmp_path, "print two")["print"] == "caf\\udce9 two\n"


def test_a_log_has_the_beginning_and_the_end_of_what_is_too_long(tmp_path):
    text = written(tmp_path, "much 100000")["much"]
    assert text.startswith("line         0\nline         1\n")
    assert text.endswith("line     99998\nline     99999\n")
    assert f"... {100_000 * 15 - 2 * supervisor.PART} bytes left out ..." in text
    assert len(text) < 2 * supervisor.PART + 100


def test_what_many_items_need_is_prepared_once_in_another_process():
    found = outcomes(Work(victims.prepared, victims.note_prepared), [0, 1], jobs=2)
    assert found[0].value[0] == found[1].value[0]
    assert len({found[0].value[0], str(os.getpid()), *(str(outcome.value[1]) for outcome in found.values())}) == 4


@pytest.mark.parametrize("prepare", [victims.fail, victims.crash, victims.run_threads])
def test_where_nothing_can_be_prepared_items_run_without(prepare):
    found = outcomes(Work(victims.prepared, prepare), [0])
    assert found[0].value[0] is None


def test_closing_ends_what_runs_and_leaves_no_process(tmp_path):
    import psutil

    before = psutil.Process().children(recursive=True)
    running = LocalExecutor(jobs=2).run(victims.leave_pid, [tmp_path / "a", None], [600.0] * 2)
    assert next(running).index == 1
    wait_for(lambda: (tmp_path / "a").exists() and (tmp_path / "a").read_text())
    started = [process for process in psutil.Process().children(recursive=True) if process not in before]
    started = [process for process in started if "resource_tracker" not in " ".join(process.cmdline())]
    assert len(started) == 4  # a server, two keepers, an item
    assert int((tmp_path / "a").read_text()) in {process.pid for process in started}
    running.close()
    assert not [process for process in started if process.is_running()]
