"""Where the files of one cell are in a folder of results: its traces, its policies and its log."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from stlbench.errors import printable
from stlbench.records.identity import CellId

TRACES, POLICIES, LOGS = "traces", "policies", "logs"
"""Names of the folders in a folder of results."""


class CellFiles(NamedTuple):
    traces: Path
    """See `saved_traces`."""
    policies: Path
    """See `saved_policies`."""
    log: Path
    """What the cell wrote to standard output and error."""


def cell_files(folder: Path, cell: CellId, key: str) -> CellFiles:
    """The paths in a folder of results. Names consist of the cell and the beginning of its key."""
    name = cell.name.replace("/", "_") + end_of_name(key)
    return CellFiles(folder / TRACES / name, folder / POLICIES / name, (folder / LOGS / name).with_suffix(".log"))


def end_of_name(key: str) -> str:
    """How the names of the arrays of a result end. The key of a stranger's result may look like a path."""
    return f"_{key[:12]}.npz".replace("/", "_")


def end_of_log(log: Path, lines: int = 20) -> list[str]:
    """The last lines of a log, safe to show; none where there is no log."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - 100 * lines))
            text = file.read().decode(errors="backslashreplace")
    except OSError:
        return []
    return printable(text).splitlines()[-lines:]
