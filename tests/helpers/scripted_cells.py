"""Cells that do what their method says, for tests of the scheduler: importable, so that workers find them."""

from __future__ import annotations

import os
import signal
import time

from stlbench.result import Result
from stlbench.study.matrix import Cell


def cells(*methods: str) -> tuple[Cell, ...]:
    """One cell a method."""
    return tuple(Cell("task", method, "agent", seed, "smoke", f"key-{seed}") for seed, method in enumerate(methods))


def run_cell(cell: Cell) -> Result:
    """End as the cell's method says."""
    if cell.method == "raise":
        raise ValueError("no such luck")
    if cell.method == "hang":
        time.sleep(600)
    if cell.method == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    key = "of another cell" if cell.method == "lie" else cell.key
    return Result(key, cell.task, cell.method, cell.agent, cell.seed, cell.budget, "unsuitable", "for the test")
