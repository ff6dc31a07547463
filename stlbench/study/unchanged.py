"""A cell's code is looked at before it runs and after: what was edited meanwhile gets no result under the old key."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from stlbench.errors import DiskFull, one_line
from stlbench.records.cell_files import cell_files
from stlbench.records.outputs import inside
from stlbench.records.result import Result
from stlbench.registry import folders
from stlbench.study.cell import Cell, digest


@dataclass(frozen=True)
class NoSpace:
    """In the place of a result: there was no space to store what the cell gave, and no other cell would have any."""

    reason: str


def run_unchanged(cell: Cell, run_cell: Callable[..., Result], folder: Path) -> Result | NoSpace:
    """What a cell's function returns; a failure where the cell's code is not what it was planned with.

    Such a failure has a key that no plan has. So the cell is run again by the next command, also where the edit has
    been taken back until then.

    Args:
        cell: what to run.
        run_cell: a function with the arguments of `trial.run_cell`.
        folder: of results.
    """
    if cell.folder is not None:
        folders.know(cell.folder)  # this process may be another than the one in which it was named
    place = changed(cell)
    if place is None:
        try:
            result = run_cell(cell, folder=folder)
        except DiskFull as error:
            return NoSpace(str(error))
        except Exception:
            if (place := changed(cell)) is None:
                raise
        else:
            if (place := changed(cell)) is None:
                return result
    beside = cell_files(folder, cell.id, cell.key)
    for file in (beside.traces, beside.policies):
        inside(file, folder).unlink(missing_ok=True)
    said = f"{one_line(place)} has changed since the study was planned; the same command again measures the cell"
    return Result(cell.id, key_without_code(cell), "raised", said)


def changed(cell: Cell) -> str | None:
    """The first file or distribution of the cell's code that is no longer what it was; None where all is."""
    return next((place for code in cell.code if (place := code.changed) is not None), None)


def key_without_code(cell: Cell) -> str:
    """The key of a failure that is of no known code."""
    return digest([cell.key, "changed"])
