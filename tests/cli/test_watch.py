"""`stlbench watch`, beside a run that a test plays."""

from __future__ import annotations

import time

import pytest
from helpers.planned_ledger import planned
from helpers.synthetic_results import result

from stlbench.cli.looker import Looker, View
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.lock import writer, writing
from stlbench.study import progress
from stlbench.study.live_cells import announce, sparkline
from stlbench.study.progress import Progress


def test_it_says_what_runs_and_how_long_the_rest_takes(tmp_path, say):
    cells = planned(tmp_path)
    with writing(tmp_path):
        announce(tmp_path, cells[2], 4000)
        lines = say("watch", tmp_path, "--once").stdout.splitlines()
    assert lines[0].startswith("2 of 3 cells, 1 done, 1 raised, 1 running, about 1")  # 16 s, less what has passed
    assert lines[0].endswith(" s left")
    assert lines[1].startswith("  hold-disc/funnel/dqn/2: 0 %, 0 of 4,000 steps")


def test_it_ends_when_nobody_writes(tmp_path, say):
    planned(tmp_path)
    assert say("watch", tmp_path).stdout == "2 of 3 cells, 1 done, 1 raised, nobody writes here\n"


def test_a_folder_without_a_ledger_is_one_line(tmp_path, say):
    said = say("watch", tmp_path / "nowhere")
    assert (said.exit_code, said.stdout, said.stderr.count("\n")) == (2, "", 1)
    assert "there is no ledger in" in said.stderr


def test_who_writes(tmp_path):
    assert writer(tmp_path) is None
    with writing(tmp_path):
        assert (writer(tmp_path) or "").startswith("process ")
    assert writer(tmp_path) is None


def test_in_a_pipe_a_run_says_a_line_a_minute(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(progress, "_MINUTE", 0.05)
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(2)]
    said = ""
    with Progress(tmp_path) as told:
        told.begin(cells, 0)
        announce(tmp_path, cells[0], 4000)
        for _ in range(200):
            told.over.wait(0.05)
            said += capsys.readouterr().err
            if "running" in said:
                break
    line = next(line for line in said.splitlines() if "running" in line)
    assert line.startswith("0 of 2 done; running hold-disc/funnel/dqn/0: 0 %, 0 of 4,000 steps")


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_the_time_left_counts_checkpoints_of_cells_that_run(tmp_path, monkeypatch, share):
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(2)]
    seconds = [1000.0]
    monkeypatch.setattr(progress.time, "time", lambda: seconds[0])
    with Progress(tmp_path) as told:
        told.begin(cells, 0)
        notices = [announce(tmp_path, cell, 4000) for cell in cells]
        seconds[0] += 60
        for notice in notices:
            notice.at(int(4000 * share))
        assert told._left() == {0.25: "about 3 min 0 s left", 0.5: "about 1 min 0 s left"}[share]


def test_bars_of_a_curve():
    assert sparkline([0.0, 0.5, 1.0]) == "▁▅█"
    assert sparkline([2.0, 2.0]) == "▄▄"
    assert sparkline([float("nan"), -1.0, 1.0]) == " ▁█"
    assert len(sparkline([float(i) for i in range(100)])) == 20
    assert sparkline([]) == ""


def test_the_curve_is_drawn_on_a_terminal_and_not_in_a_pipe(tmp_path, say, monkeypatch):
    monkeypatch.setattr("stlbench.study.live_cells._SECONDS", 0.0)
    monkeypatch.setattr("stlbench.study.live_cells._SHARE", 1.0)
    cells = planned(tmp_path)
    with writing(tmp_path):
        notice = announce(tmp_path, cells[2], 4000)
        for steps, mean in ((1000, -1.0), (2000, 0.5)):
            notice.at(steps, lambda mean=mean: (0.5, mean))
        piped = say("watch", tmp_path, "--once").stdout
        view = Looker(tmp_path).look()
    assert "▁" not in piped
    assert piped.isascii()
    assert view.lines(drawn=True)[1].endswith("robustness 0.500 ▁█")


def test_results_are_in_the_order_in_which_they_came(tmp_path):
    cells = planned(tmp_path)
    looker = Looker(tmp_path)
    assert [each.id.seed for each in looker.look().results] == [0, 1]
    with Ledger(tmp_path / FILE) as ledger:
        ledger.plan({f"hold-disc/cfer/dqn/0/{cells[0].budget}": CellId.parse("hold-disc/cfer/dqn/0", "quick")})
        ledger.record(result("cfer"))
    looker.stamp = ()
    assert [str(each.id.method) for each in looker.look().results] == ["funnel", "funnel", "cfer"]


def test_what_this_run_recorded_counts_before_what_others_did(tmp_path):
    """By hand: earlier a cell took 16 seconds; in this run one took 20, and 10 passed from the one to the next."""
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(5)]
    done = [result(seed=0), *(result(seed=seed, jobs=1, wall_seconds=20.0) for seed in (1, 2))]
    assert View(1000.0, "process 1", [], done[:1], cells[3:], {}).left == "about 32 s left"
    recorded = {done[1].key: 950.0, done[2].key: 980.0}
    assert View(980.0, "process 1", [], done, cells[3:], recorded).left == "about 1 min 0 s left"


def test_what_a_run_recorded_is_told_from_what_was_there_before(tmp_path):
    planned(tmp_path)
    time.sleep(1.1)  # a lock says since when in whole seconds
    with writing(tmp_path):
        assert Looker(tmp_path).look().recorded == {}
        with Ledger(tmp_path / FILE) as ledger:
            ledger.record(result(seed=2))
        view = Looker(tmp_path).look()
    (key,) = view.recorded
    assert key == result(seed=2).key
    assert 0 <= view.now - view.recorded[key] < 120
