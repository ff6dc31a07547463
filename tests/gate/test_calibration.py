"""The workload is the same for ever, and each result of a calibrated ledger says how fast the machine was."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from helpers import synthetic_results

from stlbench.gate import calibration
from stlbench.gate.calibration import CALIBRATION, CalibratedLedger, measure, workload
from stlbench.study.ledger import Ledger


def test_the_workload_is_what_it_was_when_references_were_made() -> None:
    assert calibration.UPDATES == 96
    assert workload(1) == pytest.approx(1.04027, rel=1e-4)  # about the mean square of standard normal numbers, 1
    assert workload(2) < workload(1)
    assert workload() == pytest.approx(0.00371, rel=0.1)


def test_the_workload_learns_by_the_gradient() -> None:
    losses = [workload(updates) for updates in (1, 10, 40, 96)]
    assert losses == sorted(losses, reverse=True)


def test_more_work_measures_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    once = min(measure() for _ in range(3))
    monkeypatch.setattr(calibration.workload, "__defaults__", (4 * calibration.UPDATES,))
    assert 2 * once < min(measure() for _ in range(3)) < 10 * once


class TestLedger:
    @pytest.fixture
    def seconds(self, monkeypatch: pytest.MonkeyPatch) -> list[float]:
        """What the next measurements give."""
        coming = [0.01, 0.04, 0.01]
        monkeypatch.setattr(calibration, "measure", lambda: coming.pop(0))
        return coming

    def test_a_result_has_the_mean_of_before_and_after(self, tmp_path: Path, seconds: list[float]) -> None:
        with CalibratedLedger(tmp_path / "ledger.sqlite", {"harness": "abc"}) as ledger:
            for seed in range(3):
                ledger.record(synthetic_results.result(seed=seed))
            found = [result.provenance for result in ledger.results()]
        # The first has none before it; sqrt(0.01 * 0.04) = 0.02.
        assert [float(entry[CALIBRATION]) for entry in found] == pytest.approx([0.01, 0.02, 0.02])
        assert {(entry["harness"], entry["jobs"]) for entry in found} == {("abc", "2")}
        assert seconds == []

    def test_what_other_code_computed_is_not_finished(self, tmp_path: Path) -> None:
        path, stamp = tmp_path / "ledger.sqlite", {"harness": "abc", "numpy": "2"}
        keys = [synthetic_results.result(seed=seed).key for seed in range(3)]
        with Ledger(path) as plain:
            plain.record(synthetic_results.result(seed=0))
        with CalibratedLedger(path, stamp) as ledger:
            assert ledger.finished(keys) == set()  # never calibrated
            ledger.record(synthetic_results.result(seed=0))
            ledger.record(synthetic_results.result(seed=1, status="raised"))
            assert ledger.finished(keys) == set(keys[:2])
            assert ledger.finished(keys, retry=True) == set(keys[:1])
        with CalibratedLedger(path, stamp | {"numpy": "3"}) as other:
            assert other.finished(keys) == set()
        with CalibratedLedger(path, {"numpy": "2"}) as fewer:
            assert fewer.finished(keys) == set(keys[:2])

    def test_a_measurement_is_a_plausible_time(self, tmp_path: Path) -> None:
        with CalibratedLedger(tmp_path / "ledger.sqlite", {}) as ledger:
            ledger.record(synthetic_results.result())
            (result,) = ledger.results()
        assert 0 < float(result.provenance[CALIBRATION]) < math.inf
