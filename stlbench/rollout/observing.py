"""What a policy observes: the numbers of the task, the time, the inputs of the method, in this order.

Simulations (`Simulator`) and wrapped environments (`stlbench.wrap`) take the time and the inputs from here. The record
of an observation (`Observation`) says what its numbers mean.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stlbench.contract import Array, GymTask, Integers, RewardMethod, System, World
from stlbench.records.observation import Observation
from stlbench.rollout.worlds import make_world
from stlbench.task.task import Task


def scaled_times(steps: int) -> Array:
    """The times 0..steps, from -1 to 1: (steps + 1, 1)."""
    return np.arange(steps + 1, dtype=np.int64)[:, None] * np.float64(2.0 / steps) - 1.0


def time_and_inputs(method: RewardMethod, times: Array, t: Integers, memory: Array) -> list[Array]:
    """What follows the numbers of the task: the scaled times (N, 1), and the inputs (N, i) of a method with memory."""
    return [times[t], method.inputs(memory)] if method.memory_size else [times[t]]


def features(task: Task, world: World, t: Integers) -> Array:
    """The numbers of the task at steps t (N,): the state's, and with `features: formula` those of the view: (N, d)."""
    state = world.features(t)
    return state if task.view is None else np.concatenate([state, task.view(state, world.signals, t)], axis=1)


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
    size: int = features(task, world, np.zeros(1, dtype=np.int64)).shape[1]
    return size + 1
