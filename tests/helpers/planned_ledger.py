"""A ledger of a run that a test plays."""

from __future__ import annotations

from pathlib import Path

from helpers.synthetic_results import result
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger


def planned(folder: Path, reason: str = "ValueError: no") -> list[CellId]:
    """A ledger of three cells: seed 0 is done, in 16 seconds; seed 1 raised, for this reason; seed 2 is left."""
    results = [result(seed=0), result(seed=1, status="raised", reason=reason)]
    cells = [CellId.parse(f"hold-disc/funnel/dqn/{seed}", "quick") for seed in range(3)]
    with Ledger(folder / FILE) as ledger:
        ledger.plan({f"{cell.name}/quick": cell for cell in cells})
        for each in results:
            ledger.record(each)
    return cells
