"""Snapshots: of each cell the numbers that the gate compares, and where they are from; read, or measured again.

A *reference* is a snapshot in a folder: `cells.csv`, one row per cell, is small enough for git and shows changes in a
diff; `provenance.json` says how it was measured.
"""

import csv
import io
import json
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from stlbench.contract import Executor
from stlbench.errors import UsageError, did_you_mean, in_words
from stlbench.records import lines, results_folder
from stlbench.records.identity import IDENTITY, OUTSIDE, CellId, Line, ReadCell, adapter
from stlbench.records.ledger import LEDGER
from stlbench.records.result import ACCIDENTS, NOT_RUN, SCHEMA, TASK_FOLDER, Result, Status
from stlbench.records.result_files import LINES, csv_text, followed, read, to_read, write
from stlbench.records.schema import is_sqlite
from stlbench.share.bundle import unpacked
from stlbench.study.cell import Cell
from stlbench.study.logs import Listener
from stlbench.study.plan import plan_cells
from stlbench.study.provenance import CODE
from stlbench.study.run import results_of, run_cells

Floats = NDArray[np.float64]
_PER_CELL = ("time", CODE, TASK_FOLDER)  # entries of the provenance that differ from cell to cell


@dataclass(frozen=True)
class Sample:
    """One cell."""

    id: ReadCell
    status: Status
    reason: Line = ""
    numbers: Mapping[str, float | None] = field(default_factory=dict)
    """Column -> value of the metrics; none where it was not measured."""


def relative(base: Floats, new: Floats) -> Floats:
    """Gain over the size of the base, per seed: its own, or half the mean over the seeds where that is more."""
    size = np.abs(base)
    size = np.maximum(size, size.mean() / 2)
    gain: Floats = (new - base) / np.where(size > 0, size, 1.0)
    return gain


def absolute(base: Floats, new: Floats) -> Floats:
    return new - base


def speed(base: Floats, new: Floats) -> Floats:
    """Logarithm of how many times faster."""
    gain: Floats = np.log(base) - np.log(new)
    return gain


@dataclass(frozen=True)
class Metric:
    """A number of a cell, and how two of them are compared. Losses are in the unit of `gain`."""

    name: str
    column: str  # of `SCHEMA`
    gain: Callable[[Floats, Floats], Floats]
    tolerated: float  # the largest average loss that is not worse
    shown: str  # how a change is written (see `change`)

    def value(self, sample: Sample) -> float | None:
        """None where it was not measured."""
        return sample.numbers.get(self.column)

    @property
    def is_cost(self) -> bool:
        """A CPU time: two of them say something only if they were measured by turns."""
        return self.gain is speed

    def written(self, value: float | None) -> object:
        """A cost has four digits; of the others all, so that equal results are seen to be equal."""
        return f"{value:.4g}" if self.is_cost and value is not None else value

    def change(self, gain: float) -> float:
        """A gain for people: of a cost, new over base; otherwise the gain itself."""
        return math.exp(-gain) if self.is_cost else gain

    def text(self, gain: float) -> str:
        return self.shown.format(self.change(gain))


QUALITIES = (
    Metric("robustness", "robustness_mean", relative, 0.05, "{:+.1%}"),
    Metric("satisfaction", "satisfaction", absolute, 0.05, "{:+.3f}"),
)
"""The same code gives the same bits."""
COSTS = (
    Metric("CPU", "training_cpu_seconds", speed, math.log(1.3) / 2, "x{:.2f}"),
    Metric("reward", "reward_nanoseconds", speed, math.log(1.5), "x{:.2f}"),
)
"""CPU: seconds of training; reward: nanoseconds of the method's reward per step. A limit in the middle between no loss
and the loss to be found makes both errors equally rare: 1.3 times for the CPU, and 2.25 for the much noisier reward."""
METRICS = QUALITIES + COSTS


@dataclass(frozen=True)
class Snapshot:
    """Cells by identity, and the values of their provenance, each once."""

    samples: Mapping[CellId, Sample] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)


def sample(result: Result) -> Sample:
    measured = result.measurement
    numbers = {} if measured is None else {name: SCHEMA[name].of(measured) for name in NUMBERS}
    return Sample(result.id, result.status, result.reason, numbers)


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
NUMBERS = tuple(metric.column for metric in METRICS)
COLUMNS = (*IDENTITY, "status", "reason", *NUMBERS)


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
    if (file := results_folder.locate(path)) is not None:
        return _results(file)
    if (path / TABLE).is_file():
        return _table(path / TABLE)
    if path.is_dir():
        raise UsageError(f"{path} has neither {LEDGER} nor {TABLE}; `stlbench run` and `stlbench gate` write them")
    return _results(path)


def save(folder: Path, snapshot: Snapshot) -> None:
    """Write a reference."""
    rows = list[list[object]]()
    for cell in sorted(snapshot.samples):
        sample = snapshot.samples[cell]
        numbers = [metric.written(metric.value(sample)) for metric in METRICS]
        rows.append([*cell.plain.values(), sample.status, sample.reason, *numbers])
    write(folder / TABLE, csv_text([COLUMNS, *rows]))
    write(folder / PROVENANCE, json.dumps(dict(snapshot.provenance), indent=2, ensure_ascii=False) + "\n")


def _results(path: Path) -> Snapshot:
    if path.is_file() and not lines.is_lines(path) and not is_sqlite(path):
        raise UsageError(f"{path} is neither a ledger nor a table of cells (.csv)")
    return gather(results_folder.read(path))


def _reference(folder: Path) -> Snapshot:
    file = folder / PROVENANCE
    try:
        provenance = adapter(dict[Line, Line]).validate_json(read(file, folder))
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
        short = " in this line, which is too short" if row.keys() >= {*missing} else ""
        raise UsageError(f"{where}: no column {', '.join(missing)}{short}; expected are {', '.join(COLUMNS)}")
    texts = {name: row.get(name) or "" for name in COLUMNS}
    cell = {name: texts[name] for name in IDENTITY if texts[name] or name != "track"}  # a table may have no tracks
    numbers = {name: texts[name] for name in NUMBERS if texts[name]}
    ended = {name: texts[name] for name in ("status", "reason")}
    try:
        sample: Sample = adapter(Sample).validate_python({"id": cell, **ended, "numbers": numbers})
    except ValidationError as error:
        first = error.errors()[0]
        name = next(str(part) for part in first["loc"] if part not in ("id", "numbers"))
        raise UsageError(f"{where}: {name} is {texts[name]!r}: {in_words(first['msg'])}") from error
    if sample.status == "done" and len(numbers) < len(NUMBERS):
        raise UsageError(f"{where}: status is done and one of {', '.join(NUMBERS)} is empty")
    return sample


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


def measure(cells: Sequence[Cell], folder: Path, executor: Executor, progress: Listener | None = None) -> Snapshot:
    """Run the cells without a result in the folder, or with one of other code."""
    run_cells(cells, folder, executor, retry=ACCIDENTS, progress=progress)
    return gather(results_of(cells, folder))
