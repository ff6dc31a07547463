"""What the tests of tasks have in common: a task's hand controller, scored as the referee scores policies."""

from __future__ import annotations

import numpy as np

from stlbench import starts
from stlbench.contract import ActionGrid, Array
from stlbench.problem import Problem


def trace(task: Problem, states: Array) -> Array:
    """The traces (N, T + 1, k) under the controller, its actions held as long as an agent's and all on the grid."""
    assert isinstance(task.actions, ActionGrid)
    samples = [task.system.signals(states)]
    for t in range(task.file.steps):
        if t % task.file.hold == 0:
            action = task.system.controller(states, np.full(len(states), t))
            assert action is not None
            for column, axis in zip(action.T, task.actions.axes, strict=True):
                assert np.isin(np.round(column, 9), np.round(axis, 9)).all()
        states = task.system.step(states, action)
        samples.append(task.system.signals(states))
    return np.stack(samples, axis=1)


def all_starts(task: Problem) -> Array:
    """The starts of the report and those of the selection: (2 * starts, n)."""
    file = task.file
    return np.concatenate([task.system.begin(starts.grid(file.initial, file.starts, part=part)) for part in (0, 1)])
