"""Measure the cells of a reference again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Self

from stlbench.contract import Executor
from stlbench.errors import UsageError, did_you_mean, one_line
from stlbench.gate.cost import Turn, unclear
from stlbench.gate.revision import Tree
from stlbench.gate.snapshot import Sample, Snapshot, gather, load
from stlbench.records.identity import CellId
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


def take_turns(cells: Collection[CellId], base: Tree, new: Tree, say: Callable[[str], None]) -> list[Turn]:
    """Train each cell with both trees, and repeat the settings whose costs are not clear yet.

    One training runs at a time. Settings take turns too, so that other load on the machine affects all of them.
    Raises `UsageError` if a tree cannot train, or the base runs code of the change.
    """
    turns: list[Turn] = []
    waiting, number = sorted(cells, key=lambda cell: (cell.seed, cell)), 0
    while waiting:
        number += 1
        count = f"{len(waiting)} {'cell' if len(waiting) == 1 else 'cells'}"
        say(f"round {number}: {count}, each by {base.name} and by {new.name}")
        with Trainer(base, new) as one, Trainer(new, base) as other:  # a process that happens to be slow does not stay
            turns += [_turn(cell, number, one, other) for cell in waiting]
        settings = unclear(turns)
        waiting = [cell for cell in waiting if cell.setting in settings]
    return turns


def _turn(cell: CellId, number: int, base: Trainer, new: Trainer) -> Turn:
    if (cell.seed + number) % 2:
        before, after = base.train(cell), new.train(cell)
    else:
        after, before = new.train(cell), base.train(cell)
    return Turn(cell, number, before, after)


class Trainer:
    """A process that trains with the code of `tree` (`stlbench.gate.trainer`), and with no code of `other`."""

    def __init__(self, tree: Tree, other: Tree) -> None:
        self.tree, self.other = tree, other
        self.errors = TemporaryFile()  # noqa: SIM115 - closed at the end of this context
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "stlbench.gate.trainer"],
            cwd=tree.root,
            env=dict(tree.environment),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)  # also the process of a cell that still trains
        self.process.communicate()
        self.errors.close()

    def train(self, cell: CellId) -> Sample | None:
        """The cell's numbers; None if this tree does not know the cell.

        Raises:
            UsageError: the process ended, or loaded a module of the other tree.
        """
        request = {name: value if isinstance(value, int) else str(value) for name, value in vars(cell).items()}
        answer = self._answer(json.dumps(request))
        status, reason = answer.pop("status"), one_line(answer.pop("reason"))
        foreign = [file for file in answer.pop("files", ()) if self.other.holds(file)]
        if foreign:
            raise UsageError(f"{self.tree.name} cannot be measured: its training loads {foreign[0]}")
        return None if status == "unknown" else Sample(cell, status, reason, **answer)

    def _answer(self, request: str) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(request + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self.process.wait()
            self.errors.seek(0)
            lines = self.errors.read().decode(errors="replace").strip().splitlines()
            raise UsageError(f"{self.tree.name} cannot train: {one_line((lines or ['no reason given'])[-1])}")
        answer: dict[str, Any] = json.loads(line)
        return answer
