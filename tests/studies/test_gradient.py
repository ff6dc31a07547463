"""The gradient by which witnesses of drawn tasks are improved."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.studies import load
from scipy.linalg import solve_discrete_are

from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.simulation import baselines
from stlbench.task import Task, load_task

FOUND, SMOOTH = load("gradient"), load("smooth")
NAMES = ["arm/tube/0", "unicycle/until/0", "pair/deliver/0", "double-integrator/response/0", "quadrotor/reach/0"]


def drawn(name: str) -> tuple[Task, Array, Array]:
    """A task, four of its starts, and actions at random that are not of the grid."""
    task = load_task("suite-" + name.replace("/", "-"))
    low, high = task.actions.low, task.actions.high
    shape = (4, task.file.decisions, len(low))
    actions = np.random.default_rng(0).uniform(low, high, shape) / 4 + np.add(low, high) * 3 / 8
    return task, task.starts.report_and_selection()[0][:4], actions


def along(task: Task, begun: Array, actions: Array) -> Any:
    return FOUND.Course(actions, FOUND._states(task, begun, actions))


@pytest.mark.parametrize("name", NAMES)
def test_the_model_is_the_slope(name: str) -> None:
    task, begun, actions = drawn(name)
    course = along(task, begun, actions)
    model = FOUND.linearised(task, course, SMOOTH.slope(task, course.states, 10.0))
    steps, n = FOUND._decisions(task, model), len(task.system.state)
    by_state, by_action = np.zeros((len(begun), n)), np.zeros_like(actions)
    for d in reversed(range(actions.shape[1])):
        by_action[:, d] = steps.by_action[:, d] + FOUND._times(by_state, steps.b[:, d])
        by_state = steps.by_state[:, d] + FOUND._times(by_state, steps.a[:, d])
    step = 1e-6 * np.random.default_rng(1).normal(size=actions.shape)
    after, before = (SMOOTH.value_of(task, along(task, begun, actions + sign * step).states, 10.0) for sign in (1, -1))
    expected = -(by_action * step).sum(axis=(1, 2))
    np.testing.assert_allclose((after - before) / 2, expected, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_sharp_is_exact(name: str) -> None:
    """Log-sum-exp of n values is off by log(n) / k; a formula of the suite has few levels of less than e^7 values."""
    task, begun, actions = drawn(name)
    states = along(task, begun, actions).states
    exact = stl.robustness(task.formula, task.system.signals(states), task.signals)
    np.testing.assert_allclose(SMOOTH.value_of(task, states, 1e4), exact, atol=7 * 5 / 1e4)


def test_a_regulator_is_that_of_the_riccati_equation() -> None:
    """Far from the end, costs are those of scipy's solution for ever."""
    a, b = np.array([[1.0, 0.1], [0.2, 1.1]]), np.array([[0.0], [0.1]])
    linear = np.zeros((1, 400, 2)), np.zeros((1, 400, 1))
    steps = FOUND._Decisions(np.tile(a, (1, 400, 1, 1)), np.tile(b, (1, 400, 1, 1)), *linear)
    change, gain, cost = FOUND._regulator(steps, np.tile(np.eye(2), (1, 401, 1, 1)), np.eye(1)[None])
    expected = solve_discrete_are(a, b, np.eye(2), np.eye(1))
    np.testing.assert_allclose(cost[0, 0], expected, rtol=1e-9)
    np.testing.assert_allclose(gain[0, 0], -np.linalg.solve(1 + b.T @ expected @ b, b.T @ expected @ a), rtol=1e-9)
    assert not change.any()


def test_actions_of_the_grid_are_followed_exactly() -> None:
    task, begun, actions = drawn("double-integrator/response/0")
    assert isinstance(task.actions, ActionGrid)
    chosen = np.random.default_rng(0).integers(len(task.actions.vectors), size=actions.shape[:2])
    course = along(task, begun, task.actions.vectors[chosen])
    cost, still = FOUND._cost(task, course), np.zeros(len(begun))
    found = FOUND._followed(task, begun, course.states, cost, still, np.random.default_rng(0))
    np.testing.assert_array_equal(found, course.actions)


@pytest.mark.parametrize("name", ["arm/tube/0", "cart-pendulum/tube/1"])
def test_no_start_gets_worse(name: str) -> None:
    task, begun, _ = drawn(name)
    assert isinstance(task.actions, ActionGrid)
    before = np.tile(baselines.zero(task), (len(begun), task.file.decisions, 1))
    found = FOUND.improved(task, begun, before, 1.0)
    assert np.isin(found, task.actions.vectors).all()
    value, was = (FOUND.robustness_of(task, begun, each) for each in (found, before))
    assert (value >= was).all()
    assert value.mean() > was.mean() + 0.01  # a slow machine does less in a second


def test_what_has_no_gradient_is_said() -> None:
    with pytest.raises(ValueError, match=r"no gradient for O\[0,1\] x <= 1"):
        SMOOTH._smooth(stl.parse("O[0,1] x <= 1"), {}, 1.0, False)
