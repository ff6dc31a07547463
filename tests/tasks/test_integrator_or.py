"""The integrator with a disjunction, sec. IV-C of the paper."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.controlled_traces import all_starts, trace

from stlbench import stl
from stlbench.task import load_task, starts

TASK = load_task("integrator-or")


def test_the_paper() -> None:
    """G[0,2000] (|x - 5| <= 5 or |x - 45| <= 5), v in -3, -2.5, ... 3; tau is .01 in the other case studies."""
    assert TASK.formula == stl.parse("G[0,2000] (abs(x - 5) <= 5 | abs(x - 45) <= 5)")
    assert (TASK.file.sampling_time, TASK.file.steps) == (0.01, 2000)
    assert TASK.actions.names == ("v",)
    assert TASK.actions.axes == ((-3, -2.5, -2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2, 2.5, 3),)


def test_dynamics_by_hand() -> None:
    state = np.array([[0.0], [25.0]])
    assert TASK.system.step(state, np.array([[3.0], [-0.5]])) == pytest.approx(np.array([[0.03], [24.995]]))
    assert TASK.system.signals(state).tolist() == [[0], [25]]


def test_features() -> None:
    features = TASK.system.features(np.array([[5.0], [45.0], [25.0]]), np.zeros(3, dtype=np.int64))
    assert features[:, 0].tolist() == [-1, 1, 0]
    assert features[:2, 1:].tolist() == [[0, pytest.approx(-1)], [pytest.approx(1), 0]]


def test_the_controller_reaches_the_bound_of_every_start() -> None:
    """5 less the distance of the start from the nearer point: it never goes away from it."""
    states = all_starts(TASK)
    traces = trace(TASK, states)
    best = 5 - np.minimum(abs(states[:, 0] - 5), abs(states[:, 0] - 45))
    assert stl.robustness(TASK.formula, traces, TASK.signals) == pytest.approx(best)
    assert abs(traces[:, -1, 0] - np.where(states[:, 0] < 25, 5, 45)).max() <= 0.025 + 1e-9


def test_the_controller_goes_to_the_nearer_point_as_fast_as_it_may() -> None:
    """.2 off: 2 m/s for a tenth of a second."""
    state = np.array([[24.0], [26.0], [5.2]])
    action = TASK.system.controller(state, np.zeros(3, dtype=np.int64))
    assert action is not None
    assert action == pytest.approx(np.array([[-3.0], [3.0], [-2.0]]))


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
