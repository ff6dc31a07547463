"""What a run says of its cells, and how long the rest may take, by a clock that the test sets."""

from __future__ import annotations

import pytest
from helpers.synthetic_results import result

from stlbench.records.identity import CellId
from stlbench.study import progress
from stlbench.study.progress import Progress, Tally, duration


def test_a_cell_takes_the_mean_of_its_setting_and_else_the_mean_of_all():
    """By hand: raw took 10 and 30 seconds, funnel 40; three of raw and one of flag are missing."""
    tally = Tally([result("raw", seed).id for seed in (2, 3, 4)] + [result("flag").id])
    assert tally.left(100.0) == ""  # nothing is known
    for method, seed, seconds in (("raw", 0, 10.0), ("raw", 1, 30.0), ("funnel", 0, 40.0)):
        tally.add(result(method, seed, wall_seconds=seconds))
    assert tally.expected() == pytest.approx(3 * 20 + 80 / 3)
    assert tally.left(100.0) == f"about {duration(60 + 80 / 3)} left"  # one at a time, with pauses
    assert tally.left(40.0) == f"about {duration((60 + 80 / 3) / 2)} left"  # 80 seconds of cells in 40


@pytest.mark.parametrize(
    ("seconds", "text"), [(12.4, "12 s"), (185, "3 min 5 s"), (7800, "2 h 10 min"), (59.6, "1 min 0 s")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_methods_that_do_not_fit_take_no_time():
    tally = Tally(result(method, seed).id for method in ("tau-mdp", "raw") for seed in (1, 2))
    tally.add(result("tau-mdp", 0, "intractable"))
    assert tally.left(10.0) == ""
    tally.add(result("raw", 0, wall_seconds=16.0))
    assert tally.left(16.0) == "about 32 s left"
    assert tally.line(16.0) == "2 of 6 cells, 1 intractable, 1 done, about 32 s left"


def test_lines_say_how_many_there_are_and_how_each_ended(capsys):
    with Progress() as lines:
        lines.begin([result().id], 2)
        lines.ended(result(robustness=(0.25, 0.75)))
    first, last = capsys.readouterr().err.splitlines()
    assert first == "3 cells, 2 of them done before"
    assert last.startswith("[3/3] hold-disc/funnel/dqn/0 done: robustness 0.500, satisfied 100.0 %, ")


def test_in_a_pipe_a_run_says_a_line_a_minute(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_MINUTE", 0.05)
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(2)]
    text = ""
    with Progress() as lines:
        lines.begin(cells, 0)
        for _ in range(200):
            lines.over.wait(0.05)
            text += capsys.readouterr().err
            if "0 of 2 cells" in text:
                break
    assert "0 of 2 cells" in text.splitlines()
