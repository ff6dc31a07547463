"""A cell that the gate runs is the study's cell, and says how fast the machine was around it."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers import scripted_cells, synthetic_results

from stlbench.gate import trial
from stlbench.gate.calibration import Speed
from stlbench.result import Result
from stlbench.study.cell import Cell


def test_passes_before_the_cell_and_after_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (cell,), happened = scripted_cells.cells("a"), list[str]()
    coming = [Speed((0.01,), (0.002,)), Speed((0.03, 0.02), (0.001,))]

    def speed() -> Speed:
        happened.append("speed")
        return coming.pop(0)

    def run(given: Cell, folder: Path | None) -> Result:
        happened.append(f"{given.id.name} in {folder}")
        return synthetic_results.result()

    monkeypatch.setattr(trial, "measure", speed)
    monkeypatch.setattr(trial.os, "getloadavg", lambda: (3.14, 0.0, 0.0))
    monkeypatch.setattr(trial.trial, "run_cell", run)
    found = trial.run_cell(cell, tmp_path).provenance
    assert happened == ["speed", f"{cell.id.name} in {tmp_path}", "speed"]
    calibrations = {"training_calibration_seconds": "0.02", "reward_calibration_seconds": "0.001"}
    assert found == {"jobs": "2", "load": "3.1", **calibrations}
