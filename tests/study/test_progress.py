"""What a run says of its cells, and how long the rest may take, by a clock that the test sets."""

from __future__ import annotations

import pytest
from helpers.synthetic_results import result

from stlbench.records.identity import CellId
from stlbench.study import progress
from stlbench.study.live_cells import Running, announce, duration, sparkline
from stlbench.study.progress import Progress, Tally


def running(seed, began, steps=0, told=0.0, method="raw"):
    return Running(f"hold-disc/{method}/dqn/{seed}", "quick", 4000, began, steps, told or began)


def test_a_cell_takes_the_mean_of_its_setting_and_else_the_mean_of_all():
    """By hand: raw took 10 and 30 seconds, funnel 40; three of raw and one of flag wait, and two cells run."""
    waiting = [result("raw", seed).id for seed in (2, 3, 4)] + [result("flag").id]
    now = [running(2, 90.0), running(3, 95.0)]
    tally = Tally(waiting)
    assert tally.left(now, 100.0) == ""  # nothing is known
    for method, seed, seconds in (("raw", 0, 10.0), ("raw", 1, 30.0), ("funnel", 0, 40.0)):
        tally.add(result(method, seed, wall_seconds=seconds))
    # rests 10 and 15, one of raw at 20, one of flag at 80 / 3, on two places
    assert tally.left(now, 100.0) == f"about {duration((10 + 15 + 20 + 80 / 3) / 2)} left"


def test_the_last_cell_that_runs_is_waited_for():
    tally = Tally([result("raw", seed).id for seed in (1, 2)])
    tally.add(result("raw", 0, wall_seconds=100.0))
    assert tally.left([running(1, 0.0), running(2, 80.0)], 90.0) == "about 1 min 30 s left"
    assert tally.left([running(1, 0.0)], 500.0) == "about 1 min 40 s left"  # it takes longer than expected
    assert tally.left([running(1, 0.0), running(2, 0.0)], 500.0) == ""


@pytest.mark.parametrize(("steps", "left"), [(1000, "about 3 min 0 s left"), (2000, "about 1 min 0 s left")])
def test_checkpoints_of_cells_that_run_count_before_any_has_ended(steps, left):
    cells = [running(seed, 1000.0, steps, 1060.0) for seed in (0, 1)]
    assert Tally([one.id for one in cells]).left(cells, 1060.0) == left


def test_methods_that_do_not_fit_take_no_time():
    tally = Tally(result(method, seed).id for method in ("tau-mdp", "raw") for seed in (1, 2))
    tally.add(result("tau-mdp", 0, "intractable"))
    assert tally.left([], 0.0) == ""
    tally.add(result("raw", 0, wall_seconds=16.0))
    assert tally.left([], 0.0) == "about 32 s left"
    assert tally.lines([], 0.0)[0] == "2 of 6 cells, 1 intractable, 1 done, 0 running, about 32 s left"


def test_lines_say_how_many_there_are_and_how_each_ended(capsys):
    with Progress() as lines:
        lines.begin([result().id], 2)
        lines.ended(result(robustness=(0.25, 0.75)))
    first, last = capsys.readouterr().err.splitlines()
    assert first == "3 cells, 2 of them done before"
    assert last.startswith("[3/3] hold-disc/funnel/dqn/0 done: robustness 0.500, satisfied 100.0 %, ")


def test_in_a_pipe_a_run_says_a_line_a_minute(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(progress, "_MINUTE", 0.05)
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(2)]
    text = ""
    with Progress(tmp_path) as lines:
        lines.begin(cells, 0)
        announce(tmp_path, cells[0], 4000)
        for _ in range(200):
            lines.over.wait(0.05)
            text += capsys.readouterr().err
            if "1 running" in text:
                break
    line = next(line for line in text.splitlines() if "1 running" in line)
    assert line.startswith("0 of 2 cells, 1 running; hold-disc/funnel/dqn/0: 0 %, 0 of 4,000 steps")


def test_bars_of_a_curve_are_drawn_on_a_terminal_alone():
    assert sparkline([0.0, 0.5, 1.0]) == "▁▅█"
    assert sparkline([2.0, 2.0]) == "▄▄"
    assert sparkline([float("nan"), -1.0, 1.0]) == " ▁█"
    assert len(sparkline([float(i) for i in range(100)])) == 20
    assert sparkline([]) == ""
    cell = result().id
    now = Running(cell.name, cell.budget, 4000, 0.0, 2000, 60.0, 0.5, 0.5, ((1000, 0.5, -1.0), (2000, 0.5, 0.5)))
    drawn, plain = (Tally([cell]).lines([now], 60.0, drawn=drawn)[1] for drawn in (True, False))
    assert drawn.endswith("robustness 0.500 ▁█")
    assert plain.isascii()
