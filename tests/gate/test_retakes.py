"""Cells that seem slower are measured again, the others are not; the take in the middle counts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from stlbench.gate.retakes import middle, settle
from stlbench.gate.snapshot import Sample, Snapshot
from stlbench.identity import CellId

FINE = {"robustness_mean": 0.3, "satisfaction": 0.8, "training_cpu_seconds": 2.0, "reward_nanoseconds": 20.0}
FINE |= {"training_calibration_seconds": 0.01, "reward_calibration_seconds": 0.002}


def take(method: str = "funnel", seed: int = 0, **numbers: Any) -> Sample:
    return Sample(CellId.parse(f"disc/{method}/dqn/{seed}", "smoke"), "done", **(FINE | numbers))


def snapshot(**slow: float) -> Snapshot:
    """Three seeds of two methods; of those named, training takes so many times as long."""
    samples = [take(method, seed) for method in ("funnel", "raw") for seed in range(3)]
    timed = [replace(one, training_cpu_seconds=2.0 * slow.get(one.id.method.name, 1.0)) for one in samples]
    return Snapshot({one.id: one for one in timed}, {"machine": "m"})


class Retaken:
    """Measures again, by the script; remembers what."""

    def __init__(self, *takes: Snapshot) -> None:
        self.takes, self.asked = list(takes), list[tuple[int, list[str]]]()

    def __call__(self, cells: Collection[CellId], number: int) -> Snapshot:
        self.asked.append((number, sorted(cell.name for cell in cells)))
        taken = self.takes.pop(0)
        return Snapshot({cell: taken.samples[cell] for cell in cells if cell in taken.samples})


def test_what_is_fine_is_measured_once() -> None:
    again = Retaken()
    assert settle(snapshot(), snapshot(), again) == snapshot()
    assert settle(snapshot(), snapshot(funnel=1.2), again) == snapshot(funnel=1.2)  # tolerated
    assert settle(snapshot(), snapshot(funnel=0.3), again) == snapshot(funnel=0.3)  # faster
    assert again.asked == []


def test_a_slow_setting_is_measured_twice_more_and_load_that_went_away_is_forgotten() -> None:
    again = Retaken(snapshot(), snapshot(funnel=1.1, raw=9))
    found = settle(snapshot(), snapshot(funnel=1.5), again)
    cells = [f"disc/funnel/dqn/{seed}" for seed in range(3)]
    assert again.asked == [(2, cells), (3, cells)]
    assert found == snapshot(funnel=1.1)  # the middle of 1.5, 1 and 1.1; raw is as in the first take


def test_what_is_slow_stays_slow() -> None:
    again = Retaken(snapshot(funnel=1.6), snapshot(funnel=1.4))
    assert settle(snapshot(), snapshot(funnel=1.5), again) == snapshot(funnel=1.5)


def test_robustness_is_not_measured_again() -> None:
    worse = Snapshot({cell: replace(one, robustness_mean=-1.0) for cell, one in snapshot().samples.items()})
    assert settle(snapshot(), worse, Retaken()) == worse


def test_each_time_has_its_own_middle_with_its_own_calibration() -> None:
    takes = [
        take(training_cpu_seconds=3.0, training_calibration_seconds=0.02, reward_nanoseconds=30.0),  # 150 and 15000
        take(training_cpu_seconds=2.0, training_calibration_seconds=0.01, reward_nanoseconds=10.0),  # 200 and 5000
        take(training_cpu_seconds=5.0, training_calibration_seconds=0.01, reward_nanoseconds=20.0),  # 500 and 10000
    ]
    found = middle(takes)
    assert (found.training_cpu_seconds, found.training_calibration_seconds) == (2.0, 0.01)
    assert (found.reward_nanoseconds, found.reward_calibration_seconds) == (20.0, 0.002)


def test_of_two_takes_the_lower_and_of_none_the_first() -> None:
    slow, fast = take(training_cpu_seconds=9.0), take(training_cpu_seconds=3.0)
    assert middle([slow, fast]) == fast
    assert middle([slow, take(training_cpu_seconds=None)]) == slow
    bare = Sample(slow.id, "raised", "no luck")
    assert middle([bare, bare]) == bare


def test_cells_that_a_retake_could_not_measure_keep_what_they_had() -> None:
    found = settle(snapshot(), snapshot(funnel=1.5), Retaken(Snapshot(), snapshot(funnel=1.3)))
    assert found == snapshot(funnel=1.3)
