"""Where a result is from: what might explain it without being part of its key, code that changes while a cell runs,
and results of older code.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from itertools import islice
from pathlib import Path

from stlbench.errors import DiskFull, one_line
from stlbench.records.ledger import Ledger
from stlbench.records.result import Result
from stlbench.records.result_files import cell_files, inside
from stlbench.registry import named_tasks
from stlbench.study.cell import Cell, digest

CODE = "code"
"""Beside them: of which code a cell is, as the first digits of the hash of each part of its key (`keys.PARTS`)."""
PACKAGES = ("gymnasium", "mujoco", "numba", "numpy", "scipy", "stable-baselines3", "stlbench-rl", "torch")


def collect(jobs: int) -> dict[str, str]:
    """The provenance of cells that start now on this machine, `jobs` of them at a time."""
    began = datetime.now(UTC).isoformat(timespec="seconds")
    return {**here(), "jobs": str(jobs or "as many as there were places"), "time": began}


@cache
def here() -> dict[str, str]:
    """The facts of this machine. Imports none of the packages that it names."""
    return {
        "python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs, {_processor()}",
    }


def elsewhere(provenance: Mapping[str, str], facts: Mapping[str, str]) -> dict[str, str]:
    """The provenance of a cell of the same run on another machine, whose `here` gave these facts."""
    return {**facts, **{name: text for name, text in provenance.items() if name not in here()}}


def of_cell(cell: Cell) -> dict[str, str]:
    """The code and the task folder of one cell, for its provenance."""
    from stlbench.records.result import (
        TASK_FOLDER,  # imports NumPy, which `here` is asked for before anything is loaded
    )

    code = ", ".join(f"{name} {text[:8]}" for name, text in cell.parts)
    place = {} if cell.folder is None else {TASK_FOLDER: str(cell.folder)}
    return ({CODE: code} if code else {}) | place


def code_of(provenance: Mapping[str, str]) -> dict[str, str]:
    """Part of a key -> the first digits of its hash, from the provenance of a result; empty if it has none."""
    pairs = (part.split(" ") for part in provenance.get(CODE, "").split(", "))
    return {pair[0]: pair[1] for pair in pairs if len(pair) == 2}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or "unknown processor")


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


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
    files = cell_files(folder, cell.id, cell.key)
    for file in (files.traces, files.policies):
        inside(file, folder).unlink(missing_ok=True)
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
