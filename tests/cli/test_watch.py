"""`stlbench watch`, beside a run that a test plays."""

from __future__ import annotations

from pathlib import Path

from helpers.synthetic_results import result

from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.lock import writer, writing
from stlbench.study.live_cells import announce


def planned(folder: Path, reason: str = "ValueError: no") -> list[CellId]:
    """A ledger of three cells: seed 0 is done, in 16 seconds; seed 1 raised, for this reason; seed 2 is left."""
    results = [result(seed=0), result(seed=1, status="raised", reason=reason)]
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(3)]
    with Ledger(folder / FILE) as ledger:
        ledger.plan({f"{cell.name}/quick": cell for cell in cells})
        for each in results:
            ledger.record(each)
    return cells


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
