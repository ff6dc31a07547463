"""The workloads are the same for ever, and what they measure is the speed of the machine."""

from __future__ import annotations

import pytest

from stlbench.gate import calibration
from stlbench.gate.calibration import GATHERED, REWARD_UPDATES, TRAINING_UPDATES, Speed, measure, workload


def test_the_workloads_are_what_they_were_when_references_were_made() -> None:
    assert (REWARD_UPDATES, TRAINING_UPDATES, GATHERED) == (24, 40, 512)
    assert workload(1) == pytest.approx(1.04027, rel=1e-4)  # about the mean square of standard normal numbers, 1
    assert workload(REWARD_UPDATES) == pytest.approx(0.449154, rel=1e-3)
    assert workload(TRAINING_UPDATES, GATHERED) == pytest.approx(0.99532, rel=1e-3)
    assert workload(TRAINING_UPDATES, GATHERED, seed=1) == pytest.approx(0.99780, rel=1e-3)


def test_the_workload_learns_by_the_gradient() -> None:
    losses = [workload(updates) for updates in (1, 10, 40, 96)]
    assert losses == sorted(losses, reverse=True)


def test_more_work_measures_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    def seconds() -> list[float]:
        speed = measure()
        return [min(speed.training), min(speed.reward)]

    once = seconds()
    monkeypatch.setattr(calibration, "TRAINING_UPDATES", 4 * TRAINING_UPDATES)
    monkeypatch.setattr(calibration, "REWARD_UPDATES", 4 * REWARD_UPDATES)
    for before, after in zip(once, seconds(), strict=True):
        assert 2 * before < after < 10 * before


def test_the_middle_pass_counts_for_training_and_the_least_for_rewards() -> None:
    both = Speed((0.01, 0.09), (0.004, 0.003)) + Speed((0.02,), (0.007,))
    assert both.provenance == {"training_calibration_seconds": "0.02", "reward_calibration_seconds": "0.003"}
