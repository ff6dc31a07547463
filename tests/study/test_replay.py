"""A stored policy acts from any start."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers import kept_policies

from stlbench.records.array_files import read_saved
from stlbench.records.result import MAIN, Result
from stlbench.records.result_files import cell_files
from stlbench.study.policies import Start, parse_start, replay


@pytest.fixture
def result(site: Callable[..., Path], tmp_path: Path) -> Result:
    """Its selected policy goes down, its final one goes up, half a metre a step for 8 steps; G[0,4] (x <= 1)."""
    return kept_policies.trained(site, tmp_path)


def test_all_starts_of_the_report_give_what_was_recorded(result: Result, tmp_path: Path) -> None:
    assert result.measurement is not None
    shown = replay(tmp_path, result)
    recorded = read_saved(cell_files(tmp_path, result.id, result.key).traces)
    assert shown.robustness == result.measurement.selected[MAIN].robustness
    assert np.array_equal(shown.recording.traces, recorded.samples)
    assert shown.recording.film is not None
    assert recorded.film is not None
    assert np.array_equal(shown.recording.film.states, recorded.film.states)


def test_one_of_them(result: Result, tmp_path: Path) -> None:
    every, one = replay(tmp_path, result, "final"), replay(tmp_path, result, "final", Start(index=2))
    assert one.robustness == every.robustness[2:3]
    assert np.array_equal(one.recording.traces, every.recording.traces[2:3])


def test_any_other(result: Result, tmp_path: Path) -> None:
    shown = replay(tmp_path, result, "final", Start(point=(-3.0,)))
    assert shown.recording.traces[0, :, 0] == pytest.approx(np.arange(-3, 1.5, 0.5))
    assert shown.robustness == pytest.approx((2.0,))  # 1 - x_4
    assert shown.recording.film is not None
    assert shown.recording.film.states.shape == (1, 9, 1)


def test_numbers_of_a_start() -> None:
    assert parse_start("-0.3, 1.2e1") == (-0.3, 12.0)
