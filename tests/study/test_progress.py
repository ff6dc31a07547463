"""How long the rest may take, by a clock that the test sets."""

from __future__ import annotations

import pytest
from helpers.synthetic_results import result

from stlbench.study import progress
from stlbench.study.progress import Progress


@pytest.fixture
def clock(monkeypatch):
    """Seconds since the start; set the only entry. Cells of these tests take 16."""
    seconds = [0.0]
    monkeypatch.setattr(progress.time, "time", lambda: seconds[0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: seconds[0])
    return seconds


def left(told):
    return told.bar.tasks[0].description


def test_cells_that_ran_tell_how_long_the_others_take(clock):
    ended = [result("raw", seed, jobs=1) for seed in range(4)]
    with Progress() as told:
        told.begin([entry.id for entry in ended], 10)
        clock[0] = 30
        told.ended(ended[0])
        assert left(told) == "about 48 s left"  # the first 14 seconds are of no cell
        clock[0] = 50
        told.ended(ended[1])
        assert left(told) == "about 40 s left"  # 4 seconds from one to the next
        clock[0] = 70
        told.ended(ended[2])
        clock[0] = 90
        told.ended(ended[3])
        assert left(told) == ""


def test_methods_that_do_not_fit_count_neither_as_run_nor_as_left(clock):
    unfit = [result("tau-mdp", seed, "intractable") for seed in range(3)]
    others = [result("raw", seed) for seed in range(3)]
    with Progress() as told:
        told.begin([entry.id for entry in [*unfit, *others]], 0)
        clock[0] = 1
        told.ended(unfit[0])
        assert left(told) == ""  # nothing has run yet
        clock[0] = 61
        told.ended(others[0])
        assert left(told) == "about 32 s left"  # two of raw; the other two of tau-mdp take no time
        told.ended(unfit[1])
        assert left(told) == "about 32 s left"


def test_a_method_that_does_not_fit_one_task_may_fit_another(clock):
    cells = [result("tau-mdp", 0, "unsuitable"), result("raw"), result("tau-mdp", task="other")]
    with Progress() as told:
        told.begin([entry.id for entry in cells], 0)
        told.ended(cells[0])
        clock[0] = 10
        told.ended(cells[1])
        assert left(told) == "about 16 s left"


def test_lines_say_how_many_there_are_and_how_each_ended(capsys):
    with Progress() as told:
        told.begin([result().id], 2)
        told.ended(result(robustness=(0.25, 0.75)))
    lines = ["3 cells, 2 of them done before", "[3/3] hold-disc/funnel/dqn/0 done: robustness 0.500, satisfied 100.0 %"]
    assert [line.partition(" %,")[0] for line in capsys.readouterr().err.splitlines()] == [
        lines[0],
        lines[1].removesuffix(" %"),
    ]
