"""A task's controller by hand in the place of a trained policy: the reference that policies are compared with.

The referee runs and scores it as it does a policy: from the same starts, its actions held as long.
"""

from __future__ import annotations

import warnings

import numpy as np

from stlbench.contract import ActionGrid, Array, Integers, RewardMethod
from stlbench.registry.plugins import PluginWarning
from stlbench.result import Score
from stlbench.rollout import referee
from stlbench.rollout.environment import Simulator
from stlbench.task import Task

__all__ = ["record", "score", "warn"]


def record(task: Task, states: Array) -> Array | None:
    """The traces (N, T + 1, k) when the controller acts from `states` (N, n); None where the task has none.

    It does only what an agent could do: its actions are clipped, and on a grid the nearest of each axis is taken.
    """
    control, actions = task.system.controller, task.actions
    if control(states, np.zeros(len(states), dtype=np.int64)) is None:
        return None

    def act(simulator: Simulator) -> Integers | Array:
        vectors = np.asarray(control(simulator.state, simulator.t), dtype=np.float64)
        return _nearest(actions, vectors) if isinstance(actions, ActionGrid) else vectors

    return referee.follow(task, _Unpaid(task.specification), act, states)


def score(task: Task) -> Score | None:
    """The controller's score by the task's formula, from the report's starts.

    None where the task has none, or where it fails, and then with a `PluginWarning`.
    """
    try:
        traces = record(task, referee.start_states(task)[0])
    except Exception as error:
        warn(task.name, error)
        return None
    return None if traces is None else referee.score(task.formula, traces, task.signals)


def warn(task: str, error: Exception) -> None:
    """Say, as a `PluginWarning`, why the controller of a task cannot be scored."""
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    warnings.warn(f"task {task}: its controller cannot be scored: {reason}", PluginWarning, stacklevel=3)


class _Unpaid(RewardMethod):
    """No reward and no memory: a controller needs neither."""

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """Nothing is paid: zeros (N,)."""
        return np.zeros(len(t)), memory


def _nearest(grid: ActionGrid, vectors: Array) -> Integers:
    """The index (N,) of the action that is nearest to each of the vectors (N, axes), axis by axis."""
    axes = zip(vectors.T, grid.axes, strict=True)
    places = [np.abs(np.subtract.outer(column, axis)).argmin(axis=1) for column, axis in axes]
    index: Integers = np.ravel_multi_index(places, grid.shape)
    return index
