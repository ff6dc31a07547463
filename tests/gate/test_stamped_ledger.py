"""What other code computed, or what was never calibrated, is measured again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from helpers import synthetic_results

from stlbench.gate.calibration import CALIBRATIONS
from stlbench.gate.stamped_ledger import StampedLedger
from stlbench.result import Result
from stlbench.status import ACCIDENTS
from stlbench.study.ledger import Ledger


def calibrated(seed: int, status: str = "done") -> Result:
    plain = synthetic_results.result(seed=seed, status=status)  # type: ignore[arg-type]
    return replace(plain, provenance={**plain.provenance, **dict.fromkeys(CALIBRATIONS, "0.01")})


def test_each_result_has_the_stamp_beside_its_own_provenance(tmp_path: Path) -> None:
    with StampedLedger(tmp_path / "ledger.sqlite", {"harness": "abc"}) as ledger:
        ledger.record(calibrated(0))
        (found,) = ledger.results()
    assert found.provenance == {"jobs": "2", "harness": "abc"} | dict.fromkeys(CALIBRATIONS, "0.01")


def test_what_other_code_computed_is_not_finished(tmp_path: Path) -> None:
    path, stamp = tmp_path / "ledger.sqlite", {"harness": "abc", "numpy": "2"}
    keys = [calibrated(seed).key for seed in range(3)]
    with Ledger(path) as plain:
        plain.record(synthetic_results.result(seed=0))
    with StampedLedger(path, stamp) as ledger:
        assert ledger.finished(keys) == set()
        ledger.record(synthetic_results.result(seed=0))
        assert ledger.finished(keys) == set()  # never calibrated
        ledger.record(calibrated(0))
        ledger.record(calibrated(1, "raised"))
        assert ledger.finished(keys) == set(keys[:2])
        assert ledger.finished(keys, retry=ACCIDENTS) == set(keys[:1])
    with StampedLedger(path, stamp | {"numpy": "3"}) as other:
        assert other.finished(keys) == set()
    with StampedLedger(path, {"numpy": "2"}) as fewer:
        assert fewer.finished(keys) == set(keys[:2])
