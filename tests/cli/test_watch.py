"""`stlbench watch`, beside a run that a test plays."""

from __future__ import annotations

from helpers.planned_ledger import planned

from stlbench.records.lock import writer, writing
from stlbench.study.live_cells import announce


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


def test_who_writes(tmp_path):
    assert writer(tmp_path) is None
    with writing(tmp_path):
        assert (writer(tmp_path) or "").startswith("process ")
    assert writer(tmp_path) is None
