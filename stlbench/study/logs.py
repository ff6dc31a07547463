"""The file of what a cell wrote to standard output and error, beside its traces."""

from __future__ import annotations

from pathlib import Path

from stlbench.contract_parts.texts import printable
from stlbench.identity import CellId
from stlbench.rollout import npz
from stlbench.study.cell import Cell

__all__ = ["FOLDER", "end_of", "log_file", "log_of"]

FOLDER = "logs"
"""Name of the folder of logs in a folder of results."""


def log_file(results: Path, cell: CellId, key: str) -> Path:
    """Where a cell's log is; there is none where it wrote nothing."""
    return npz.cell_file(results / FOLDER, cell, key).with_suffix(".log")


def log_of(results: Path, cell: Cell) -> Path:
    """The same, for what runs cells."""
    return log_file(results, cell.id, cell.key)


def end_of(log: Path, lines: int = 20) -> list[str]:
    """The last lines of a log, safe to show; none where there is no log."""
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - 100 * lines))
            text = file.read().decode(errors="backslashreplace")
    except OSError:
        return []
    return printable(text).splitlines()[-lines:]
