"""Code that changes while a cell runs, which then gets no result under the old key; and results of older code."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from stlbench.errors import DiskFull, one_line
from stlbench.records.ledger import Ledger
from stlbench.records.result import Result
from stlbench.records.result_files import discard_arrays
from stlbench.registry import named_tasks
from stlbench.study.cell import Cell, digest
from stlbench.study.provenance import code_of

_EXAMINED = 100  # old results that are compared with today's code, at most: to read all of a long study takes seconds


@dataclass(frozen=True)
class NoSpace:
    """In place of a result: the disk is full, so no cell can store anything."""

    reason: str


def run_checked(cell: Cell, run_cell: Callable[..., Result], folder: Path) -> Result | NoSpace:
    """The result of `run_cell`; a failure if the cell's code has changed since the study was planned.

    Such a failure has a key that no plan has. So the next command runs the cell again, even if the edit is undone.
    """
    if cell.folder is not None:
        named_tasks.know(cell.folder)  # this process may be another than the one in which it was named
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
    discard_arrays(folder, cell.id, cell.key)
    text = f"{one_line(place)} has changed since the study was planned; the same command again measures the cell"
    return Result(cell.id, key_without_code(cell), "raised", text)


def changed(cell: Cell) -> str | None:
    """The first file or distribution of the cell's code that has changed; None if none has."""
    return next((place for code in cell.code if (place := code.changed) is not None), None)


def key_without_code(cell: Cell) -> str:
    """The key of a failure whose code is not known."""
    return digest([cell.key, "changed"])


def outdated(missing: Iterable[Cell], ledger: Ledger) -> dict[str, Cell]:
    """The cells that have a result of other code, unless it was an accident, by that result's key."""
    counted = ledger.counted(accidents=False)
    return {key: cell for cell in missing if (key := counted.get(cell.id)) is not None and key != cell.key}


def outdated_note(cells: Mapping[str, Cell], ledger: Ledger, today: Mapping[str, str], keep: bool | None) -> str:
    """One line: how many results are of other code, what has changed, and whether they are kept.

    `today` is the provenance of cells that start now; `keep` is None if the user has no such choice.
    """
    examined = {key: cells[key] for key in islice(cells, _EXAMINED)}
    results = ledger.results(examined)
    causes = dict.fromkeys(cause for old in results for cause in _causes(old, examined[old.key], today))
    have = "1 cell has a result" if len(cells) == 1 else f"{len(cells)} cells have results"
    fate = f"{'is' if len(cells) == 1 else 'are'} {'not ' if keep else ''}measured anew"
    hint = "; --keep-old counts the old results as done" if keep is False else ""
    text = ", ".join(islice(causes, 4)) or "not known"
    return f"{have} of other code and {fate}{hint}; what has changed: {text}{', ...' if len(causes) > 4 else ''}"


def _causes(old: Result, cell: Cell, today: Mapping[str, str]) -> list[str]:
    then = code_of(old.provenance)
    if not then:
        return ["not known, as the old results do not say of which code they are"]
    changed = [name for name, text in cell.parts if not text.startswith(then.get(name, "?"))]
    names = {
        "harness": ["stlbench's own code"],
        "task": [f"task {cell.id.task}"],
        "method": [f"method {cell.id.method}"],
        "agent": [f"agent {cell.id.agent} or its recipe"],
        "packages": _packages(old.provenance, today),
    }
    return [cause for name in changed for cause in names[name]]


def _packages(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    other = ("time", "jobs", "machine")
    moved = [name for name in now if name not in other and then.get(name, now[name]) != now[name]]
    return [f"{name} {then[name]} to {now[name]}" for name in moved] or ["packages that the plugins import"]
