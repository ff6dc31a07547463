"""Cells that do what their method says, for tests of the scheduler: importable, so that workers find them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

from stlbench.contract import Executor, Outcome, cause
from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.study.cell import Cell


def cells(*methods: str, deadline: float = 60) -> tuple[Cell, ...]:
    """One cell per method."""
    ids = [CellId.parse(f"task/{method}/agent/{seed}", "smoke") for seed, method in enumerate(methods)]
    return tuple(Cell(cell, f"key-{cell.seed}", deadline) for cell in ids)


def run_cell(cell: Cell) -> Result:
    """End as the cell's method says."""
    method = cell.id.method.name
    if method == "raise":
        raise ValueError("no such luck")
    if method == "hang":
        time.sleep(600)
    if method == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    return Result(cell.id, "of another cell" if method == "lie" else cell.key, "unsuitable", "for the test")


def run_in(cell: Cell, folder: Path) -> Result:
    """The same, with the arguments of a trial."""
    return run_cell(cell)


def run_cells(cells: Sequence[Cell], folder: Path, executor: Executor, *, run_cell: Any = run_in, **words: Any) -> None:
    """A study of cells that do what their method says, or what `run_cell` does."""
    from stlbench.study import run, trial  # which workers do without

    with patch.object(trial, "run_cell", run_cell):
        run.run_cells(cells, folder, executor, **words)


class Here(Executor):
    """Runs cells in this process, and remembers which, with their deadlines, and whether it was closed."""

    def __init__(self, *, jobs: int = 1) -> None:
        super().__init__(jobs=jobs)
        self.ran, self.closed = list[tuple[str, float]](), False

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        try:
            for index, item in enumerate(items):
                self.ran.append((item.id.method.name, deadlines[index]))
                try:
                    yield Outcome(index, "done", function(item))
                except Exception as error:
                    yield Outcome(index, "raised", reason=cause(error), details="trace")
        finally:
            self.closed = True


class Told:
    """A run's progress: how it begins, as names of methods and how many are done, then notes, and how cells end."""

    def __init__(self) -> None:
        self.lines = list[Any]()

    @property
    def notes(self) -> list[str]:
        return [line for line in self.lines if isinstance(line, str)]

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        self.lines.append(([cell.method.name for cell in missing], done))

    def note(self, text: str) -> None:
        self.lines.append(text)

    def ended(self, result: Result) -> None:
        self.lines.append((result.id.method.name, result.status))
