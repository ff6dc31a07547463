"""What is killed again and again: a run of many cells, of which some misbehave. `soak` starts it.

Each cell that is announced is a line in the file `announced`, written after its row should be on disk.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from long.faults import INNOCENT, KINDS, LIMIT

from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.study.plan import Cell, plan_cells
from stlbench.study.run import run_cells
from stlbench.study.scheduler import build_executor

__all__ = ["ANNOUNCED", "RESULTS", "kinds", "main"]

ANNOUNCED, RESULTS = "announced", "results"


def kinds(count: int, share: float, seed: int) -> list[str | None]:
    """What each cell does: a share of them, at random places, each kind of fault in turn; None is innocent."""
    rng = np.random.default_rng(seed)
    found: list[str | None] = [None] * count
    for place, number in enumerate(rng.permutation(count)[: round(share * count)].tolist()):
        found[number] = list(KINDS)[place % len(KINDS)]
    return found


def cells(done: Sequence[str | None]) -> list[Cell]:
    """Cell i has seed i, and the method that does what it is to do."""
    planned = list[Cell]()
    for kind in dict.fromkeys(done):
        seeds = [seed for seed, each in enumerate(done) if each == kind]
        method = Choice(INNOCENT if kind is None else f"soak-{kind}")
        deadline = 600.0 if kind is None else KINDS[kind].deadline
        found = plan_cells([Choice("toy-line")], [method], [Choice("toy-agent")], seeds, "quick")
        planned += [replace(cell, deadline=deadline) for cell in found]
    return sorted(planned, key=lambda cell: cell.id.seed)


class _Announces:
    """Progress, in a file that outlives this process."""

    def __init__(self, folder: Path) -> None:
        self._file = os.open(folder / ANNOUNCED, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def begin(self, missing: Sequence[CellId], done: int) -> None: ...

    def note(self, text: str) -> None: ...

    def ended(self, result: Result) -> None:
        os.write(self._file, f"{result.id.seed}\n".encode())


def main(folder: Path, count: int, share: float, seed: int, jobs: int) -> None:
    """Run what is missing."""
    executor = build_executor("local", jobs, f"{LIMIT // 2**20}M")
    run_cells(cells(kinds(count, share, seed)), folder / RESULTS, executor, progress=_Announces(folder))


if __name__ == "__main__":
    place, *numbers = sys.argv[1:]
    main(Path(place), int(numbers[0]), float(numbers[1]), int(numbers[2]), int(numbers[3]))
