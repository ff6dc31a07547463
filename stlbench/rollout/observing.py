"""What a policy observes: the numbers of the task, the time, the inputs of the method, in this order.

Simulations (`Simulator`) and wrapped environments (`stlbench.wrap`) take the time and the inputs from here. The record
of an observation (`Observation`) says what its numbers mean.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stlbench.contract import Array, GymTask, Integers, RewardMethod, System
from stlbench.records.observation import Observation
from stlbench.rollout.worlds import make_world
from stlbench.task.task import Task


def scaled_times(steps: int) -> Array:
    """The times 0..steps, from -1 to 1: (steps + 1, 1)."""
    return np.arange(steps + 1, dtype=np.int64)[:, None] * np.float64(2.0 / steps) - 1.0


def time_and_inputs(method: RewardMethod, times: Array, t: Integers, memory: Array) -> list[Array]:
    """What follows the numbers of the task: the scaled times (N, 1), and the inputs (N, i) of a method with memory."""
    return [times[t], method.inputs(memory)] if method.memory_size else [times[t]]


class Moment(NamedTuple):
    """What observations of n copies are made of, each at its own time. Moments can be joined."""

    features: Array  # (n, d), of the world
    signals: Array  # (n, k)
    t: Integers  # (n,)
    memory: Array  # (n, m), of the method

    def numbers(self, task: Task) -> Array:
        """Of the task: the world's features, and with `features: formula` those of the formula's view: (n, d)."""
        if task.view is None:
            return self.features
        return np.concatenate([self.features, task.view(self.features, self.signals, self.t)], axis=1)


def observation_of(task: Task, method: RewardMethod, name: str = "") -> Observation:
    """What policies see of a task, with the inputs of a method; `name` is what users call the method."""
    shown = Observation.beside(task.file.steps, method.input_size, name, task.name)
    names: tuple[str, ...] = ()
    if isinstance(task.dynamics, GymTask):
        described = task.source.observed.described(shown)
        if task.view is None:
            return described
        names = tuple(filter(None, described.names))
    if isinstance(task.dynamics, System):
        more = task.dynamics.beyond_state if task.file.features == "engineered" else ()
        names = (*task.dynamics.state, *more)
    if task.view is not None:
        names = (*names, *task.view.quantities)
    return replace(shown, size=size_without(task) - 1, names=names)


def size_without(task: Task) -> int:
    """The number of features, and the time. It starts no method, as some import a compiler."""
    world = make_world(task, 1)
    world.restart(np.zeros(1, dtype=np.int64), task.starts.report_and_selection()[0][:1])
    t = np.zeros(1, dtype=np.int64)
    size: int = Moment(world.features(t), world.signals, t, np.empty((1, 0))).numbers(task).shape[1]
    return size + 1
