"""What policies are compared with, run in the place of one: a task's controller by hand, and actions at random.

The referee runs and scores them as it does a policy: from the same starts, their actions held as long.
"""

from __future__ import annotations

import numpy as np

from stlbench.contract import ActionGrid, Array, Integers, RewardMethod
from stlbench.result import Score
from stlbench.rollout import referee
from stlbench.rollout.environment import Simulator
from stlbench.task import Task

__all__ = ["Unpaid", "nearest", "record", "score", "score_at_random"]


def record(task: Task, begun: Array) -> Array | None:
    """The traces (N, T + 1, k) when the controller acts from the starts (N, s); None where the task has none.

    It does only what an agent could do: its actions are clipped, and on a grid the nearest of each axis is taken.
    """
    actions, unpaid = task.actions, Unpaid(task.specification)
    first = Simulator(task, unpaid)
    first.reset(begun[:1])
    if first.world.by_hand(first.t) is None:
        return None

    def act(simulator: Simulator) -> Integers | Array:
        vectors = np.asarray(simulator.world.by_hand(simulator.t), dtype=np.float64)
        return nearest(actions, vectors) if isinstance(actions, ActionGrid) else vectors

    return referee.follow(task, unpaid, act, begun)


def score(task: Task) -> Score | None:
    """The controller's score by the task's formula, from the report's starts; None where the task has none.

    Raises whatever the controller and the system raise.
    """
    traces = record(task, task.starts.report_and_selection()[0])
    return None if traces is None else referee.score(task, traces)


def score_at_random(task: Task) -> Score:
    """The score of a policy that knows nothing: every action is drawn evenly from all, anew at each decision.

    From the report's starts, the same at every call. Raises whatever the system raises.
    """
    generator, actions = np.random.default_rng(0), task.actions

    def act(simulator: Simulator) -> Integers | Array:
        count = len(simulator.t)
        if isinstance(actions, ActionGrid):
            return generator.integers(actions.size, size=count)
        return generator.uniform(actions.low, actions.high, (count, len(actions.low)))

    traces = referee.follow(task, Unpaid(task.specification), act, task.starts.report_and_selection()[0])
    return referee.score(task, traces)


class Unpaid(RewardMethod):
    """No reward and no memory: a controller needs neither."""

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """Nothing is paid: zeros (N,)."""
        return np.zeros(len(t)), memory


def nearest(grid: ActionGrid, vectors: Array) -> Integers:
    """The index (N,) of the action that is nearest to each of the vectors (N, axes), axis by axis."""
    axes = zip(vectors.T, grid.axes, strict=True)
    places = [np.abs(np.subtract.outer(column, axis)).argmin(axis=1) for column, axis in axes]
    index: Integers = np.ravel_multi_index(places, grid.shape)
    return index
