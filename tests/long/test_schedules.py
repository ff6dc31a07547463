"""Schedules of 100,000 random formulas: what satisfies one satisfies its formula. Six minutes."""

from __future__ import annotations

import pytest
from helpers.schedule_checks import checked

pytestmark = pytest.mark.long


def test_random_formulas() -> None:
    traces = 0
    for seed in range(1_000_000, 1_100_000):
        found = checked(seed)
        assert not found.counterexample
        traces += found.traces
    assert traces > 700_000
