"""The point among zones that move: its motion and that of the zones by hand."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from stlbench import stl
from stlbench.task import load_task

TASK = load_task("zones")


def test_the_point_by_hand() -> None:
    """v' = v + .1 (u - .5 v): from (1, -2) under (1.5, 0) it is (1.1, -1.9); the place moves by a tenth of that."""
    (after,) = TASK.system.step(np.array([[0.0, 1.0, 1.0, -2.0, 0.3]]), np.array([[1.5, 0.0]]))
    assert after == pytest.approx([0.11, 0.81, 1.1, -1.9, 0.32])


def test_the_zones_by_hand() -> None:
    """At phase 0 they are at their turns 0, 1 and 2 rad; a quarter turn of the phase is 4, -5 and 6 quarter turns."""
    places = TASK.system.signals(np.array([[0, 0, 0, 0, 0], [0, 0, 0, 0, pi / 2]]))[:, 2:]
    start = [1, 0, 0.8 * cos(1), 2 + 0.8 * sin(1), 2 + 0.6 * cos(2), 0.6 * sin(2)]
    quarter = [1, 0, 0.8 * sin(1), 2 - 0.8 * cos(1), 2 - 0.6 * cos(2), -0.6 * sin(2)]
    assert places == pytest.approx(np.array([start, quarter]))


def test_zones_stay_in_their_ranges_and_nobody_moves_them() -> None:
    """Their places follow from the phase alone; the ranges of the signals are the boxes round their circles."""
    states = np.random.default_rng(0).uniform(-3, 3, (2000, 5))
    zones, low, high = TASK.system.signals(states)[:, 2:], TASK.specification.low[2:], TASK.specification.high[2:]
    assert zones.min(axis=0) == pytest.approx(low, abs=1e-3)
    assert zones.max(axis=0) == pytest.approx(high, abs=1e-3)
    states[:, :4] = 0
    assert np.array_equal(TASK.system.signals(states)[:, 2:], zones)


def test_time_alone_does_not_tell_where_the_zones_are() -> None:
    phases = TASK.starts.report_and_selection()[0][:, 4]
    assert np.ptp(phases) > 6


def test_a_point_in_a_zone_violates_by_how_deep_it_is() -> None:
    """At its goals in time, and in a's middle at step 70: .4 too deep. Else it is 1 m from all zones at least."""
    trace = np.zeros((301, 8))
    trace[:, :2] = np.where(np.arange(301)[:, None] < 150, [2.0, 2.0], [-2.0, 2.0])
    trace[:, 2:] = [0, 0, 0, 1.2, 2, 0]
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.4)
    trace[70, :2] = 0, 0
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(-0.4)
