"""The integrator with a disjunction, sec. IV-C of the paper."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.controlled_traces import all_starts, trace

from stlbench import stl
from stlbench.task import load_task, starts

TASK = load_task("integrator-or")


def test_the_controller_reaches_the_bound_of_every_start() -> None:
    """5 less the distance of the start from the nearer point: it never goes away from it."""
    states = all_starts(TASK)
    traces = trace(TASK, states)
    best = 5 - np.minimum(abs(states[:, 0] - 5), abs(states[:, 0] - 45))
    assert stl.robustness(TASK.formula, traces, TASK.signals) == pytest.approx(best)
    assert abs(traces[:, -1, 0] - np.where(states[:, 0] < 25, 5, 45)).max() <= 0.025 + 1e-9


def test_the_controller_reaches_a_point_from_between() -> None:
    reach = TASK.file.protocols["reach"]
    assert reach.formula is not None
    assert reach.initial is not None
    traces = trace(TASK, starts.grid(reach.initial, reach.starts))
    assert stl.robustness(reach.formula, traces, TASK.signals).min() > 4.97


def test_training_starts_between_the_goals_too_and_reach_measures_them() -> None:
    assert TASK.file.training.starts is not None
    assert TASK.file.training.starts.low.tolist() == [0]
    assert TASK.file.training.starts.high.tolist() == [50]
    reach = TASK.file.protocols["reach"]
    assert reach.formula is not None
    assert reach.initial is not None
    # From the middle, 25, at 3 m/s: at the edge of a goal, 10, after 15 / .03 = 500 steps, well before 1500.
    x = np.maximum(25 - 0.03 * np.arange(2001), 5)[None, :, None]
    assert stl.robustness(reach.formula, x, ("x",)) == pytest.approx(5)
    assert stl.robustness(TASK.formula, x, ("x",)) == pytest.approx(-15)
