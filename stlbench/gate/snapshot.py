"""Snapshots: a few numbers of each cell, and where they are from; read, or measured again. The gate compares two.

A *reference* is a snapshot in a folder: `cells.csv`, one row per cell, is small enough for git and shows changes in a
diff; `provenance.json` says how it was measured.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from stlbench.contract import Executor
from stlbench.errors import UsageError, did_you_mean, in_words
from stlbench.records import lines, stored
from stlbench.records.identity import IDENTITY, OUTSIDE, CellId, Line, ReadCell
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.result import ACCIDENTS, NOT_RUN, TASK_FOLDER, Result, Status
from stlbench.records.result_files import LINES, csv_text, followed, read, to_read, write
from stlbench.records.rows import numbers
from stlbench.records.schema import is_sqlite
from stlbench.share.bundle import unpacked
from stlbench.study.cell import Cell
from stlbench.study.logs import Progress
from stlbench.study.plan import plan_cells
from stlbench.study.provenance import CODE
from stlbench.study.run import run_cells

_PER_CELL = ("time", CODE, TASK_FOLDER)  # entries of the provenance that differ from cell to cell


@dataclass(frozen=True)
class Sample:
    """One cell. The numbers are None where it was not measured. The fields' names are those of the table's columns."""

    id: ReadCell
    status: Status
    reason: Line = ""
    robustness_mean: float | None = None  # of the selected policy, over the starts of the report
    satisfaction: float | None = None  # share of the starts, in [0, 1]
    training_cpu_seconds: float | None = None
    reward_nanoseconds: float | None = None  # CPU nanoseconds of the method's reward per step


@dataclass(frozen=True)
class Snapshot:
    """Cells by identity, and the values of their provenance, each once."""

    samples: Mapping[CellId, Sample] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)


def sample(result: Result) -> Sample:
    columns = numbers(result.measurement) if result.measurement else {}
    measured = {name: columns.get(name) for name in NUMBERS}
    return Sample(result.id, result.status, " ".join(result.reason.split()), **measured)


def gather(results: Iterable[Result]) -> Snapshot:
    """A snapshot of results, one per cell. Policies from outside are left out, since nobody measures them again."""
    samples: dict[CellId, Sample] = {}
    provenance: dict[str, set[str]] = {}
    for result in results:
        if result.id.track == OUTSIDE:
            continue
        samples[result.id] = sample(result)
        for name in result.provenance.keys() - _PER_CELL:
            provenance.setdefault(name, set()).add(result.provenance[name])
    return Snapshot(samples, {name: ", ".join(sorted(values)) for name, values in sorted(provenance.items())})


TABLE, PROVENANCE = "cells.csv", "provenance.json"
COSTS = ("training_cpu_seconds", "reward_nanoseconds")
NUMBERS = ("robustness_mean", "satisfaction", *COSTS)
COLUMNS = (*IDENTITY, *(part.name for part in fields(Sample) if part.name != "id"))


def load(path: Path) -> Snapshot:
    """Read a reference, a folder of results, a ledger, a table of cells, or a bundle. Raises `UsageError`.

    In a folder of results the ledger or its lines have priority over the table.
    """
    if path.suffix == ".zip":
        with unpacked(path) as (folder, problems):
            if problems:
                raise UsageError(f"{path}: {problems[0]}")
            return _results(folder / LINES)
    if (path / PROVENANCE).is_file():
        return _reference(path)
    if path.suffix == ".csv":
        return _table(followed(path))
    if (file := stored.locate(path)) is not None:
        return _results(file)
    if (path / TABLE).is_file():
        return _table(path / TABLE)
    if path.is_dir():
        raise UsageError(f"{path} has neither {FILE} nor {TABLE}; `stlbench run` and `stlbench gate` write them")
    return _results(path)


def save(folder: Path, snapshot: Snapshot) -> None:
    """Write a reference. Robustness and satisfaction have all digits, so that equal results are seen to be equal."""
    rows = list[list[object]]()
    for cell in sorted(snapshot.samples):
        values = vars(cell) | vars(snapshot.samples[cell])
        for name in COSTS:
            values[name] = values[name] if values[name] is None else f"{values[name]:.4g}"
        rows.append([values[name] for name in COLUMNS])
    write(folder / TABLE, csv_text([COLUMNS, *rows]))
    write(folder / PROVENANCE, json.dumps(dict(snapshot.provenance), indent=2, ensure_ascii=False) + "\n")


def _results(path: Path) -> Snapshot:
    if path.is_file() and not lines.is_lines(path) and not is_sqlite(path):
        raise UsageError(f"{path} is neither a ledger nor a table of cells (.csv)")
    return gather(stored.read(path))


def _reference(folder: Path) -> Snapshot:
    file = folder / PROVENANCE
    try:
        provenance = _adapter(dict[Line, Line]).validate_json(read(file, folder))
    except (OSError, ValidationError) as error:
        raise UsageError(f"cannot read {file}: an object of texts is expected") from error
    return Snapshot(_table(folder / TABLE).samples, provenance)


def _table(path: Path) -> Snapshot:
    samples: dict[CellId, Sample] = {}
    try:
        with io.TextIOWrapper(to_read(path, path.parent), encoding="utf-8", newline="") as file:
            for line, row in enumerate(csv.DictReader(file, strict=True), start=2):
                if row.get("status") == NOT_RUN or row.get("track") == OUTSIDE:
                    continue
                sample = _row(row, f"{path}, line {line}")
                if samples.setdefault(sample.id, sample) is not sample:
                    raise UsageError(
                        f"{path}, line {line}: a second row of {sample.id.name}, budget {sample.id.budget}"
                    )
    except (OSError, UnicodeError, csv.Error) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    return Snapshot(samples)


def _row(row: Mapping[str, str | None], where: str) -> Sample:
    missing = [name for name in (*IDENTITY, "status", *NUMBERS) if name != "track" and row.get(name) is None]
    if missing:
        raise UsageError(f"{where}: no column {', '.join(missing)}; expected are {', '.join(COLUMNS)}")
    texts = {name: row.get(name) or "" for name in COLUMNS}
    cell = {name: texts[name] for name in IDENTITY if texts[name] or name != "track"}  # a table may have no tracks
    rest = {name: text for name, text in texts.items() if name not in IDENTITY and (text or name == "reason")}
    try:
        sample: Sample = _adapter(Sample).validate_python({"id": cell, **rest})
    except ValidationError as error:
        first = error.errors()[0]
        name = next(str(part) for part in first["loc"] if part != "id")
        raise UsageError(f"{where}: {name} is {texts[name]!r}: {in_words(first['msg'])}") from error
    if sample.status == "done" and any(getattr(sample, name) is None for name in NUMBERS):
        raise UsageError(f"{where}: status is done and one of {', '.join(NUMBERS)} is empty")
    return sample


@lru_cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def select(reference: Path, **chosen: Collection[object] | None) -> Snapshot:
    """The cells of a reference whose parts (task, method, ...) are among the chosen; None means all.

    Raises `UsageError` without a reference, or if it has no cell of a name.
    """
    if not reference.exists():
        raise UsageError(f"there is no reference at {reference}; --update with --tasks and --methods makes one")
    snapshot = load(reference)
    cells = set(snapshot.samples)
    for part, values in chosen.items():
        if values is None:
            continue
        known = {getattr(cell, part) for cell in cells}
        for value in values:
            if value not in known:
                hint = did_you_mean(str(value), map(str, known))
                raise UsageError(f"the reference has no cells of {part} '{value}'{hint}")
        cells = {cell for cell in cells if getattr(cell, part) in values}
    return replace(snapshot, samples={cell: sample for cell, sample in snapshot.samples.items() if cell in cells})


def cells_of(snapshot: Snapshot) -> tuple[Cell, ...]:
    """Plan the cells of a snapshot, task by task, since an agent may have recipes in some tasks only."""
    cells: list[Cell] = []
    for task in sorted({cell.task for cell in snapshot.samples}):
        own = [cell for cell in snapshot.samples if cell.task == task]
        methods, agents = (sorted({getattr(cell, part) for cell in own}) for part in ("method", "agent"))
        for budget, track in sorted({(cell.budget, cell.track) for cell in own}):
            cells += plan_cells([task], methods, agents, sorted({cell.seed for cell in own}), budget, track)
    return tuple(cell for cell in cells if cell.id in snapshot.samples)


def measure(cells: Sequence[Cell], folder: Path, executor: Executor, progress: Progress | None = None) -> Snapshot:
    """Run the cells without a result in the folder, or with one of other code."""
    run_cells(cells, folder, executor, retry=ACCIDENTS, progress=progress)
    with Ledger(folder / FILE, create=False) as ledger:
        return gather(ledger.results_of(cell.id for cell in cells))
