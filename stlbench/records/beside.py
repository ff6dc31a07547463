"""What is stored of a cell beside its row in the ledger."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from stlbench.records.identity import CellId
from stlbench.records.logs import log_file
from stlbench.records.saved_policies import policy_file
from stlbench.records.saved_traces import FOLDER, trace_file


class Beside(NamedTuple):
    """The files of one cell, whether they are there or not."""

    traces: Path
    policies: Path
    log: Path
    """What it wrote to standard output and error."""


def files_beside(folder: Path, cell: CellId, key: str) -> Beside:
    """Where they are in a folder of results."""
    return Beside(trace_file(folder / FOLDER, cell, key), policy_file(folder, cell, key), log_file(folder, cell, key))
