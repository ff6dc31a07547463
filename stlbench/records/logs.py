"""The file of what a cell wrote to standard output and error, beside its traces."""

from __future__ import annotations

from pathlib import Path

from stlbench.errors import printable
from stlbench.records import npz
from stlbench.records.identity import CellId

FOLDER = "logs"
"""Name of the folder of logs in a folder of results."""


def log_file(results: Path, cell: CellId, key: str) -> Path:
    """Where a cell's log is; there is none where it wrote nothing."""
    return npz.cell_file(results / FOLDER, cell, key).with_suffix(".log")


def end_of(log: Path, lines: int = 20) -> list[str]:
    """The last lines of a log, safe to show; none where there is no log."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - 100 * lines))
            text = file.read().decode(errors="backslashreplace")
    except OSError:
        return []
    return printable(text).splitlines()[-lines:]
