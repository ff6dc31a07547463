"""What the tests of tasks have in common: starts of the referee, traces of a controller, and MuJoCo's own numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import pytest

from stlbench.contract import ActionGrid, Array, Integers
from stlbench.simulation import referee
from stlbench.simulation.baselines import record_controller
from stlbench.simulation.worlds import make_world
from stlbench.task.task import Task


def trace(task: Task, states: Array) -> Array:
    """The traces (N, T + 1, k) under the controller, whose actions are all on the grid or in the box as they come."""
    control = task.system.controller

    def checked(state: Array, t: Integers) -> Array | None:
        action = control(state, t)
        assert action is not None
        if isinstance(task.actions, ActionGrid):
            for column, axis in zip(action.T, task.actions.axes, strict=True):
                assert np.isin(np.round(column, 9), np.round(axis, 9)).all()
        else:
            assert np.all((task.actions.low <= action) & (action <= task.actions.high))
        return action

    with patch.object(task.system, "controller", checked):
        found = record_controller(task, states)
    assert found is not None
    return found.traces


EVERY = pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 8], ids=["all", "some"])
"""The share of the starts to try: all, or each eighth, as an environment is slow."""


def satisfying(task: Task, every: int) -> tuple[float, ...]:
    """Robustness from every so many starts of the report: the controller satisfies, and is the best known."""
    episodes = record_controller(task, task.starts.report_and_selection()[0][::every])
    assert episodes is not None
    score = referee.score(task, episodes.traces, lasted=episodes.lasted)
    assert all(score.satisfied)
    if every == 1:
        assert task.file.best_known is not None
        assert score.mean == pytest.approx(task.file.best_known.robustness, abs=1.1e-5)
    return score.robustness


def all_starts(task: Task) -> Array:
    """The starts of the report and those of the selection: (2 * starts, n)."""
    return np.concatenate(task.starts.report_and_selection())


def beside(task: Task, environment: gymnasium.Env[Any, Any]) -> Iterator[tuple[Array, Any]]:
    """The task's signals (k,), and the data of MuJoCo in Gymnasium's own environment, after each of eight actions."""
    environment.reset(seed=3)
    world = make_world(task, 1)
    world.restart(np.array([0]), np.array([[3.0]]))
    for action in np.random.default_rng(0).uniform(-1, 1, (8, len(task.actions.low))):
        environment.step(action.astype(np.float32))
        samples = world.advance(action[None], 1)
        yield samples[-1, 0], environment.unwrapped.data  # type: ignore[attr-defined]
