"""What the gate needs of many cells: a few numbers of each, and how they came about. Two snapshots are compared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from stlbench.records.identity import OUTSIDE, CellId
from stlbench.records.result import TASK_FOLDER, Result, reported
from stlbench.records.status import Status
from stlbench.study.provenance import CODE

_PER_CELL = ("time", CODE, TASK_FOLDER)
"""What of a cell's provenance differs from cell to cell."""


@dataclass(frozen=True)
class Sample:
    """One cell. The numbers are None where it was not measured. The fields' names are those of the table's columns."""

    id: CellId
    status: Status
    reason: str = ""
    robustness_mean: float | None = None
    """Of the selected policy, over the starts of the report."""
    satisfaction: float | None = None
    """Share of the starts, in [0, 1]."""
    training_cpu_seconds: float | None = None
    reward_nanoseconds: float | None = None
    """CPU nanoseconds of the method's reward per step."""


@dataclass(frozen=True)
class Snapshot:
    """Cells by identity, and what is known of how they came about: values of the provenance, each said once."""

    samples: Mapping[CellId, Sample] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)


Pair = tuple[Sample, Sample | None]
"""A cell of the base, and the same cell of the new snapshot where there is one."""


def pair(base: Snapshot, new: Snapshot) -> list[Pair]:
    """Every cell of the base with its twin, ordered by identity. Cells of `new` alone are in no pair."""
    return [(base.samples[cell], new.samples.get(cell)) for cell in sorted(base.samples)]


def sample(result: Result) -> Sample:
    """A few numbers of a result."""
    measured = result.measurement
    return Sample(
        result.id,
        result.status,
        reason=" ".join(result.reason.split()),
        robustness_mean=reported(measured.selected).mean if measured else None,
        satisfaction=reported(measured.selected).satisfaction if measured else None,
        training_cpu_seconds=measured.training_cpu_seconds if measured else None,
        reward_nanoseconds=measured.reward_nanoseconds if measured else None,
    )


def gather(results: Iterable[Result]) -> Snapshot:
    """A snapshot of results, one per cell, as `Ledger.results` gives them, without those that nobody measures again."""
    samples: dict[CellId, Sample] = {}
    provenance: dict[str, set[str]] = {}
    for result in results:
        if result.id.track == OUTSIDE:
            continue
        samples[result.id] = sample(result)
        for name in result.provenance.keys() - _PER_CELL:
            provenance.setdefault(name, set()).add(result.provenance[name])
    return Snapshot(samples, {name: ", ".join(sorted(values)) for name, values in sorted(provenance.items())})
