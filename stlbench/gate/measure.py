"""Measure the cells of a reference again."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from stlbench.contract import Executor
from stlbench.errors import UsageError, did_you_mean
from stlbench.gate.snapshot import Snapshot, gather, load
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.status import ACCIDENTS
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.study.run import Progress, run_cells


def select(reference: Path, **chosen: Collection[object] | None) -> Snapshot:
    """The cells of a reference whose parts (task, method, ...) are among the chosen; None means all.

    Raises `UsageError` without a reference, or if it has no cell of a name.
    """
    if not reference.exists():
        raise UsageError(f"there is no reference at {reference}; --update with --tasks and --methods makes one")
    snapshot = load(reference)
    cells = set(snapshot.samples)
    for part, values in chosen.items():
        if values is None:
            continue
        known = {getattr(cell, part) for cell in cells}
        for value in values:
            if value not in known:
                hint = did_you_mean(str(value), map(str, known))
                raise UsageError(f"the reference has no cells of {part} '{value}'{hint}")
        cells = {cell for cell in cells if getattr(cell, part) in values}
    return replace(snapshot, samples={cell: sample for cell, sample in snapshot.samples.items() if cell in cells})


def cells_of(snapshot: Snapshot) -> tuple[Cell, ...]:
    """Plan the cells of a snapshot, task by task, since an agent may have recipes in some tasks only."""
    cells: list[Cell] = []
    for task in sorted({cell.task for cell in snapshot.samples}):
        own = [cell for cell in snapshot.samples if cell.task == task]
        methods, agents = (sorted({getattr(cell, part) for cell in own}) for part in ("method", "agent"))
        for budget, track in sorted({(cell.budget, cell.track) for cell in own}):
            cells += plan_cells([task], methods, agents, sorted({cell.seed for cell in own}), budget, track)
    return tuple(cell for cell in cells if cell.id in snapshot.samples)


def measure(cells: Sequence[Cell], folder: Path, executor: Executor, progress: Progress | None = None) -> Snapshot:
    """Run the cells without a result in the folder, or with one of other code."""
    run_cells(cells, folder, executor, retry=ACCIDENTS, progress=progress)
    with Ledger(folder / FILE, create=False) as ledger:
        return gather(ledger.results_of(cell.id for cell in cells))
