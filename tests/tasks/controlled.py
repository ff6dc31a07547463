"""What the tests of tasks have in common: the starts of the referee, and the traces of a task's hand controller."""

from __future__ import annotations

import numpy as np

from stlbench import referee
from stlbench.contract import Array
from stlbench.controlled import record
from stlbench.problem import Problem


def trace(task: Problem, states: Array) -> Array:
    """The traces (N, T + 1, k) under the controller, which the task has."""
    traces = record(task, states)
    assert traces is not None
    return traces


def all_starts(task: Problem) -> Array:
    """The starts of the report and those of the selection: (2 * starts, n)."""
    return np.concatenate([referee.start_states(task, part) for part in (0, 1)])
