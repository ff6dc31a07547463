"""How much times of equal code scatter, from a reference that was measured, and simulated runs that scatter so."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stlbench.gate.files import load
from stlbench.gate.metrics import METRICS, Metric
from stlbench.gate.snapshot import Sample, Snapshot
from stlbench.identity import CellId, Setting

Floats = NDArray[np.float64]

GATE = Path(__file__).parents[2] / "results"
REFERENCE, LOADED = GATE / "gate-reference", GATE / "gate-loaded"
"""The committed reference, and equal code beside two busy processes more."""

TIMES = [metric for metric in METRICS if metric.timing]


def logarithms(snapshot: Snapshot, metric: Metric) -> dict[Setting, Floats]:
    """Of the calibrated times of each setting, one per seed."""
    found: dict[Setting, list[float]] = {}
    for cell, sample in sorted(snapshot.samples.items()):
        value = metric.value(sample)
        if value is not None:
            found.setdefault(cell.setting, []).append(math.log(value))
    return {setting: np.array(values) for setting, values in found.items()}


def residuals(snapshot: Snapshot, metric: Metric) -> Floats:
    """How far each cell's logarithm is from its setting's mean; larger by as much as a mean of few makes it smaller."""
    groups = [values for values in logarithms(snapshot, metric).values() if len(values) > 1]
    return np.concatenate([(each - each.mean()) * math.sqrt(len(each) / (len(each) - 1)) for each in groups])


def scatter(snapshot: Snapshot, metric: Metric) -> float:
    """Standard deviation of the logarithm from seed to seed, over all settings."""
    return float(np.sqrt(np.mean(residuals(snapshot, metric) ** 2)))


def shifts(base: Snapshot, new: Snapshot, metric: Metric) -> Floats:
    """By how much the mean logarithm of each setting differs."""
    one, two = logarithms(base, metric), logarithms(new, metric)
    return np.array([two[setting].mean() - one[setting].mean() for setting in one])


@dataclass(frozen=True)
class Times:
    """One CPU time of all settings, and how it scatters."""

    metric: Metric
    truth: Mapping[Setting, float]
    quiet: Floats
    """What the base differs by from the truth, cell by cell: drawn from these."""
    loaded: Floats
    """The same of the new measurements."""
    shifts: Floats
    """What load does to a whole setting; the same in each take."""


@cache
def measured_times() -> tuple[Times, ...]:
    """Both times, with the noise of the committed measurements."""
    base, new = load(REFERENCE), load(LOADED)
    return tuple(
        Times(
            metric,
            {setting: float(values.mean()) for setting, values in logarithms(base, metric).items()},
            residuals(base, metric),
            residuals(new, metric),
            shifts(base, new, metric),
        )
        for metric in TIMES
    )


class Run:
    """A simulated base, and equal code that is measured under load, as often as is asked for."""

    def __init__(self, times: Sequence[Times], cells: Sequence[Sample], generator: np.random.Generator) -> None:
        self._times, self._cells, self._generator = times, list(cells), generator
        settings = sorted({cell.id.setting for cell in cells})
        self._shifts = [
            dict(zip(settings, generator.choice(time.shifts, len(settings)), strict=True)) for time in times
        ]
        self.base = self._taken(self._cells, loaded=False)

    def take(self, cells: Collection[CellId] | None = None, number: int = 1) -> Snapshot:
        """Measure these cells under load, or all."""
        return self._taken([cell for cell in self._cells if cells is None or cell.id in cells], loaded=True)

    def _taken(self, cells: Sequence[Sample], loaded: bool) -> Snapshot:
        samples = {cell.id: cell for cell in cells}
        for time, shift in zip(self._times, self._shifts, strict=True):
            noise = self._generator.choice(time.loaded if loaded else time.quiet, len(cells))
            for cell, away in zip(cells, noise, strict=True):
                setting = cell.id.setting
                value = math.exp(time.truth[setting] + away + (shift[setting] if loaded else 0.0))
                columns = dict(zip(time.metric.columns, (value, 1.0), strict=True))
                samples[cell.id] = replace(samples[cell.id], **columns)
        return Snapshot(samples)
