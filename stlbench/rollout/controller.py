"""A task's controller by hand. The referee scores it as a policy: from the same starts, with the same `hold`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Array, Integers, RewardMethod, System
from stlbench.records.result import Score
from stlbench.rollout import referee
from stlbench.rollout.environment import Simulator
from stlbench.rollout.faults import PluginFault, out_of_range
from stlbench.rollout.referee import Episodes
from stlbench.task import Task


def record(task: Task, begun: Array) -> Episodes | None:
    """The episodes when the controller acts from the starts (N, s); None where the task has none.

    Actions of a system are clipped, and on a grid the nearest action is taken, as for an agent. Raises `PluginFault`
    where actions have another shape, are no finite numbers, or are out of range and the task is no system.
    """
    actions, unpaid = task.actions, Unpaid(task.specification)
    first = Simulator(task, unpaid)
    first.reset(begun[:1])
    if first.world.by_hand(first.t) is None:
        return None

    def act(simulator: Simulator) -> Integers | Array:
        vectors = _checked(task, simulator.world.by_hand(simulator.t), simulator.t)
        return nearest(actions, vectors) if isinstance(actions, ActionGrid) else vectors

    return referee.simulate(task, unpaid, act, begun)


def score(task: Task) -> Score | None:
    """The controller's score by the task's formula, from the report's starts; None where the task has none."""
    episodes = record(task, task.starts.report_and_selection()[0])
    return None if episodes is None else referee.score(task, episodes.traces, lasted=episodes.lasted)


def replay(task: Task, actions: Integers | Array, begun: Array | None = None) -> Episodes:
    """The episodes under these actions, one for each decision.

    Args:
        task: whose actions are held.
        actions: indices of the grid (starts, decisions), or vectors (starts, decisions, axes).
        begun: the starts (N, s); the report's where left out.
    """
    begun, hold = task.starts.report_and_selection()[0] if begun is None else begun, task.file.hold
    return referee.simulate(task, Unpaid(task.specification), lambda at: actions[:, int(at.t[0]) // hold], begun)


class Unpaid(RewardMethod):
    """No reward and no memory: a controller needs neither."""

    def arrival(self, signals: Array, t: Integers) -> Array:
        return np.zeros(np.shape(t))


def _checked(task: Task, answer: Any, t: Integers) -> Array:
    """A controller's actions (N, axes) at steps t (N,), checked."""
    by_hand, actions, expected = f"{task.name}, by hand", task.actions, (len(t), len(task.actions.names))
    if answer is None:
        raise PluginFault(f"{by_hand}: the controller has no action at step {t.max()}")
    array: NDArray[Any] = np.asarray(answer)
    if array.dtype.kind not in "biuf" or array.shape != expected:
        rule = f"expected are {expected} for {', '.join(actions.names)}"
        raise PluginFault(f"{by_hand}: its actions are {array.dtype} {array.shape}; {rule}")
    vectors: Array = array.astype(np.float64)
    if isinstance(task.dynamics, System):
        vectors = np.where(np.isfinite(vectors), np.clip(vectors, actions.low, actions.high), vectors)
    if wrong := out_of_range(actions, vectors):
        raise PluginFault(f"{by_hand}: {wrong}")
    return vectors


def nearest(grid: ActionGrid, vectors: Array) -> Integers:
    """The index (N,) of the action that is nearest to each of the vectors (N, axes), axis by axis."""
    axes = zip(vectors.T, grid.axes, strict=True)
    places = [np.abs(np.subtract.outer(column, axis)).argmin(axis=1) for column, axis in axes]
    index: Integers = np.ravel_multi_index(places, grid.shape)
    return index
