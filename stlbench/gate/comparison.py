"""Two recordings of the same cells, read from ledgers or tables and put side by side.

A *recording* is what the gate needs of many cells: a few numbers of each. It comes from a ledger, from a folder of
results, or from a *reference*: a folder with `cells.csv`, one line a cell, which is small enough for git and shows in
a diff what changed, and `provenance.json`, which says how it was measured.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from stlbench.errors import UsageError
from stlbench.gate.calibration import CALIBRATION
from stlbench.result import MAIN, Result, Status
from stlbench.study.ledger import Ledger, is_sqlite

__all__ = ["Identity", "Pair", "Recording", "Sample", "load", "pair", "sample", "save"]

LEDGER, TABLE, PROVENANCE = "ledger.sqlite", "cells.csv", "provenance.json"

Identity = tuple[str, str, str, str, int]
"""Task, method, agent, budget, seed."""

PER_CELL = ("time", CALIBRATION)
"""What of a cell's provenance differs from cell to cell."""


@dataclass(frozen=True)
class Sample:
    """One cell. The numbers are None where it was not measured. The fields' names are those of the table's columns."""

    task: str
    method: str
    agent: str
    seed: int
    budget: str
    status: Status
    reason: str = ""
    robustness_mean: float | None = None
    """Of the selected policy, over the starts of the report."""
    satisfaction: float | None = None
    """Share of the starts, in [0, 1]."""
    training_cpu_seconds: float | None = None
    reward_nanoseconds: float | None = None
    calibration_seconds: float | None = None
    """CPU seconds of the fixed workload, beside the cell (see `calibration`); only the gate measures it."""

    @property
    def identity(self) -> Identity:
        """What pairs it with the same cell of another recording."""
        return (self.task, self.method, self.agent, self.budget, self.seed)

    @property
    def name(self) -> str:
        """The cell's human name: hold-disc/funnel/dqn/0."""
        return f"{self.task}/{self.method}/{self.agent}/{self.seed}"


IDENTITY = ("task", "method", "agent", "seed", "budget", "status")
NUMBERS = ("robustness_mean", "satisfaction", "training_cpu_seconds", "reward_nanoseconds")
COLUMNS = tuple(entry.name for entry in fields(Sample))


@dataclass(frozen=True)
class Recording:
    """Cells by identity, and what is known of how they came about: values of the provenance, each said once."""

    samples: Mapping[Identity, Sample] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)


Pair = tuple[Sample, Sample | None]
"""A cell of the base, and the same cell of the new recording where there is one."""


def pair(base: Recording, new: Recording) -> list[Pair]:
    """Every cell of the base with its twin, ordered by identity. Cells of `new` alone are in no pair."""
    return [(base.samples[identity], new.samples.get(identity)) for identity in sorted(base.samples)]


# ------------------------------------------------------------------------------------------------------------- read


def load(path: Path) -> Recording:
    """Read a reference, a folder of results, a ledger, or a table of cells.

    In a folder of results the ledger goes before the table, which has the cells of the last command alone.

    Raises:
        UsageError: there is nothing of these, or it is not as it should be; the message says where.
    """
    if (path / PROVENANCE).is_file():
        return _reference(path)
    for file, read in ((path / LEDGER, _ledger), (path / TABLE, _table)):
        if file.is_file():
            return read(file)
    if path.is_dir():
        raise UsageError(f"{path} has neither {LEDGER} nor {TABLE}; `stlbench run` and `stlbench gate` write them")
    return _table(path) if path.suffix == ".csv" else _ledger(path)


def sample(result: Result) -> Sample:
    """A few numbers of a result."""
    measured, seconds = result.measurement, result.provenance.get(CALIBRATION)
    return Sample(
        *(result.task, result.method, result.agent, result.seed, result.budget, result.status),
        reason=" ".join(result.reason.split()),
        robustness_mean=measured.selected[MAIN].mean if measured else None,
        satisfaction=measured.selected[MAIN].satisfaction if measured else None,
        training_cpu_seconds=measured.training_cpu_seconds if measured else None,
        reward_nanoseconds=measured.reward_nanoseconds if measured else None,
        calibration_seconds=float(seconds) if seconds else None,
    )


def gather(results: Iterable[Result]) -> Recording:
    """A recording of results, one a cell, as `Ledger.results` gives them."""
    samples: dict[Identity, Sample] = {}
    provenance: dict[str, set[str]] = {}
    for result in results:
        entry = sample(result)
        samples[entry.identity] = entry
        for name in result.provenance.keys() - PER_CELL:
            provenance.setdefault(name, set()).add(result.provenance[name])
    return Recording(samples, {name: ", ".join(sorted(values)) for name, values in sorted(provenance.items())})


def _ledger(path: Path) -> Recording:
    if path.is_file() and not is_sqlite(path):
        raise UsageError(f"{path} is neither a ledger nor a table of cells (.csv)")
    with Ledger(path, create=False) as ledger:
        return gather(ledger.results())


def _reference(folder: Path) -> Recording:
    file = folder / PROVENANCE
    try:
        found = _provenance().validate_json(file.read_bytes())
    except (OSError, ValidationError) as error:
        raise UsageError(f"cannot read {file}: an object of texts is expected") from error
    return Recording(_table(folder / TABLE).samples, found)


@lru_cache
def _provenance() -> TypeAdapter[dict[str, str]]:
    return TypeAdapter(dict[str, str])


def _table(path: Path) -> Recording:
    samples: dict[Identity, Sample] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for line, row in enumerate(csv.DictReader(file, strict=True), start=2):
                entry = _row(row, f"{path}, line {line}")
                if samples.setdefault(entry.identity, entry) is not entry:
                    raise UsageError(f"{path}, line {line}: a second row of {entry.name}, budget {entry.budget}")
    except (OSError, UnicodeError, csv.Error) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    return Recording(samples)


def _row(row: Mapping[str, str | None], where: str) -> Sample:
    missing = [name for name in (*IDENTITY, *NUMBERS) if row.get(name) is None]
    if missing:
        raise UsageError(f"{where}: no column {', '.join(missing)}; expected are {', '.join(COLUMNS)}")
    text = {name: row.get(name) or "" for name in COLUMNS}
    try:
        entry = _adapter().validate_python({name: value for name, value in text.items() if value or name == "reason"})
    except ValidationError as error:
        first = error.errors()[0]
        raise UsageError(f"{where}: {first['loc'][0]} is {text[str(first['loc'][0])]!r}: {first['msg']}") from error
    if entry.status == "done" and any(getattr(entry, name) is None for name in NUMBERS):
        raise UsageError(f"{where}: status is done and one of {', '.join(NUMBERS)} is empty")
    return entry


@lru_cache
def _adapter() -> TypeAdapter[Sample]:
    return TypeAdapter(Sample)


# ------------------------------------------------------------------------------------------------------------ write


def save(folder: Path, recording: Recording) -> None:
    """Write a reference. Robustness and satisfaction have all digits, so that equal results are seen to be equal."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / TABLE).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for identity in sorted(recording.samples):
                writer.writerow([_text(getattr(recording.samples[identity], name), name) for name in COLUMNS])
        provenance = json.dumps(dict(recording.provenance), indent=2, ensure_ascii=False) + "\n"
        (folder / PROVENANCE).write_text(provenance, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"cannot write the reference {folder}: {error}") from error


def _text(value: object, column: str) -> str:
    if value is None:
        return ""
    if isinstance(value, float) and math.isfinite(value) and column.endswith("seconds"):
        return f"{value:.4g}"
    return str(value)
