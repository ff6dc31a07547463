"""The gradient by which witnesses of drawn tasks are improved."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.studies import load

from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.task import Task, load_task

FOUND = load("suite_gradient")
NAMES = ["arm/tube/0", "unicycle/until/0", "pair/deliver/0", "double-integrator/response/0", "quadrotor/reach/0"]


def drawn(name: str) -> tuple[Task, Array, Array]:
    """A task, four of its starts, and actions at random that are not of the grid."""
    task = load_task("suite-" + name.replace("/", "-"))
    low, high = task.actions.low, task.actions.high
    shape = (4, task.file.steps // task.file.hold, len(low))
    actions = np.random.default_rng(0).uniform(low, high, shape) / 4 + np.add(low, high) * 3 / 8
    return task, task.starts.report_and_selection()[0][:4], actions


@pytest.mark.parametrize("name", NAMES)
def test_the_gradient_is_the_slope(name: str) -> None:
    task, begun, actions = drawn(name)
    step = 1e-6 * np.random.default_rng(1).normal(size=actions.shape)
    after, before = (FOUND.gradient(task, begun, actions + sign * step, 10.0)[0] for sign in (1, -1))
    expected = (FOUND.gradient(task, begun, actions, 10.0)[1] * step).sum(axis=(1, 2))
    np.testing.assert_allclose((after - before) / 2, expected, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_sharp_is_exact(name: str) -> None:
    """Log-sum-exp of n values is off by log(n) / k; a formula of the suite has few levels of less than e^7 values."""
    task, begun, actions = drawn(name)
    states = [begun]
    for t in range(task.file.steps):
        states.append(task.system.step(states[-1], actions[:, t // task.file.hold]))
    exact = stl.robustness(task.formula, task.system.signals(np.stack(states, axis=1)), task.signals)
    np.testing.assert_allclose(FOUND.gradient(task, begun, actions, 1e4)[0], exact, atol=7 * 5 / 1e4)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_brought_to_the_grid_is_of_the_grid(name: str) -> None:
    task, begun, actions = drawn(name)
    assert isinstance(task.actions, ActionGrid)
    for found in (FOUND.rounded(task, actions), FOUND.followed(task, begun, actions)):
        for axis, values in enumerate(task.actions.axes):
            assert np.isin(found[..., axis], values).all()


def test_actions_of_the_grid_are_followed_exactly() -> None:
    task, begun, actions = drawn("double-integrator/response/0")
    on_grid = FOUND.rounded(task, actions)
    np.testing.assert_array_equal(FOUND.followed(task, begun, on_grid), on_grid)


def test_ascending_makes_no_start_worse() -> None:
    task, begun, actions = drawn("arm/tube/0")
    before = FOUND.rounded(task, actions)
    found = FOUND.ascend(task, begun, before, 0.5)
    value, was = (FOUND.robustness_of(task, begun, each) for each in (found, before))
    assert (value >= was).all()
    assert value.mean() > was.mean() + 0.1
