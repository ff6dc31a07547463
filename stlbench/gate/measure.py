"""Measure the cells of a reference again: which they are, as they are planned now, and what they give."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stlbench.contract import Executor
from stlbench.errors import UsageError, did_you_mean
from stlbench.gate import files
from stlbench.gate.snapshot import Sample, Snapshot, gather
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.status import ACCIDENTS
from stlbench.registry.choices import Choice
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.study.run import Progress, run_cells


@dataclass(frozen=True)
class Selection:
    """Which cells of a snapshot: those of one budget, of these tasks, methods, agents and seeds. None is all."""

    budget: str
    tasks: Collection[Choice] | None = None
    methods: Collection[Choice] | None = None
    agents: Collection[Choice] | None = None
    seeds: Collection[int] | None = None

    @property
    def is_everything(self) -> bool:
        """Nothing but the budget is said."""
        return all(part is None for part in (self.tasks, self.methods, self.agents, self.seeds))


def select(reference: Path, selection: Selection) -> Snapshot:
    """The chosen cells of a reference. Raises `UsageError` where it has none of a name, or there is no reference."""
    if not reference.exists():
        raise UsageError(f"there is no reference at {reference}; --update with --tasks and --methods makes one")
    snapshot = files.load(reference)
    samples = _with(list(snapshot.samples.values()), "budget", [selection.budget])
    samples = _with(samples, "task", selection.tasks)
    samples = _with(samples, "method", selection.methods)
    samples = _with(samples, "agent", selection.agents)
    samples = _with(samples, "seed", selection.seeds)
    return replace(snapshot, samples={sample.id: sample for sample in samples})


def _with(samples: list[Sample], part: str, values: Collection[object] | None) -> list[Sample]:
    """Those of the samples whose identity has one of the values as its `part`."""
    if values is None:
        return samples
    known = {getattr(sample.id, part) for sample in samples}
    for value in values:
        if value not in known:
            raise UsageError(
                f"the reference has no cells of {part} '{value}'{did_you_mean(str(value), map(str, known))}"
            )
    return [sample for sample in samples if getattr(sample.id, part) in values]


def cells_of(snapshot: Snapshot) -> tuple[Cell, ...]:
    """The cells of a snapshot as they are planned now, task by task, since an agent may have no recipe in others."""
    cells: list[Cell] = []
    for task in sorted({cell.task for cell in snapshot.samples}):
        own = [cell for cell in snapshot.samples if cell.task == task]
        methods, agents = (sorted({getattr(cell, part) for cell in own}) for part in ("method", "agent"))
        for budget, track in sorted({(cell.budget, cell.track) for cell in own}):
            cells += plan_cells([task], methods, agents, sorted({cell.seed for cell in own}), budget, track)
    return tuple(cell for cell in cells if cell.id in snapshot.samples)


def measure(cells: Sequence[Cell], folder: Path, executor: Executor, progress: Progress | None = None) -> Snapshot:
    """Run what is missing in the folder, or was computed by other code."""
    run_cells(cells, folder, executor, retry=ACCIDENTS, progress=progress)
    with Ledger(folder / FILE, create=False) as ledger:
        return gather(ledger.results_of(cell.id for cell in cells))
