"""A cell beside which the machine's speed is measured. Runs in a worker process, and so where the cell does."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from stlbench.gate.calibration import measure
from stlbench.result import Result
from stlbench.study import trial
from stlbench.study.cell import Cell

__all__ = ["run_cell"]


def run_cell(cell: Cell, folder: Path | None = None) -> Result:
    """As `stlbench.study.trial.run_cell`; the provenance has calibrations, of passes before the cell and after it, and
    the machine's load at its end: processes that ran or waited in the last minute, the cell's own among them."""
    before = measure()
    result = trial.run_cell(cell, folder)
    load = f"{os.getloadavg()[0]:.1f}"
    return replace(result, provenance={**result.provenance, **(before + measure()).provenance, "load": load})
