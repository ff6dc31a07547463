"""The world of a task, which the simulator drives, and what a policy observes of it.

Simulations (`Simulator`) and wrapped environments (`stlbench.wrap`) take the time and the inputs from here. The record
of an observation (`Observation`) says what its numbers mean.
"""

from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from stlbench.contract import Array, GymTask, Integers, RewardMethod, System, World
from stlbench.contract.presentation import Drawn, Pixels
from stlbench.records.observation import Observation
from stlbench.simulation import faults
from stlbench.task.task import Task


def make_world(task: Task, count: int, *, drawn: bool = False) -> World:
    """So many copies, none of them begun; `drawn` if pictures are wanted, which Gymnasium must know in advance."""
    dynamics = task.dynamics
    if isinstance(dynamics, System):
        return SystemWorld(task, dynamics, count)
    if isinstance(dynamics, GymTask):
        from stlbench.simulation.gym_world import GymWorld  # imports Gymnasium, which most tasks do without

        return GymWorld(dynamics, task.source, count, drawn=drawn)
    world: Any = dynamics.world(count)
    if not isinstance(world, World):
        raise faults.PluginFault(f"task {task.name}: world gives {type(world).__name__}, the contract says a World")
    return world


class SystemWorld(World):
    """N copies of a system, stepped at once. Their starts are states (r, n); none of them ever ends by itself."""

    can_end: ClassVar[bool] = False

    def __init__(self, task: Task, system: System, count: int) -> None:
        self.system, self._task, self._engineered = system, task, task.file.features == "engineered"
        self._state = np.empty((count, len(system.state)))
        self.ended = np.zeros(count, dtype=np.bool_)

    @property
    def state(self) -> Array:
        return self._state

    def restart(self, rows: Integers, starts: Array) -> None:
        if len(rows) == len(self._state):  # at the first time there is nothing to keep
            self._state = np.array(starts, dtype=np.float64)
            self.signals = self.system.signals(self._state)
            return
        self._state[rows] = starts
        self.signals[rows] = self.system.signals(starts)

    def advance(self, action: Array, steps: int) -> Array:
        states = np.empty((steps + 1, *self._state.shape))
        states[0] = state = self._state
        for i in range(steps):
            state = self.system.step(state, action)
            if type(state) is not np.ndarray or state.shape != self._state.shape or state.dtype.kind != "f":
                faults.check_states(self._task, state, self._state.shape)
            states[i + 1] = state
        samples = self.system.signals(states)
        self._state, self.signals = state, samples[-1].copy()
        return samples

    def features(self, t: Integers) -> Array:
        system = self.system
        return system.features(self._state, t) if self._engineered else system.scaled_state(self._state)

    def frames(self) -> tuple[Pixels, ...] | None:
        return tuple(map(self.system.frame, self._state)) if isinstance(self.system, Drawn) else None

    def by_hand(self, t: Integers) -> Array | None:
        return self.system.controller(self._state.copy(), t.copy())  # it may change what it is given


def scaled_times(steps: int) -> Array:
    """The times 0..steps, from -1 to 1, never beyond 1 by rounding: (steps + 1, 1)."""
    return np.arange(steps + 1, dtype=np.int64)[:, None] * np.float64(2.0 / steps) - 1.0


def time_and_inputs(method: RewardMethod, times: Array, t: Integers, memory: Array) -> list[Array]:
    """Columns after the numbers of the task: the scaled times (N, 1), and the inputs (N, i) of a method with memory."""
    return [times[t], method.inputs(memory)] if method.memory_size else [times[t]]


class Moment(NamedTuple):
    """The parts of observations of n copies, each at its own time. Moments can be joined."""

    features: Array  # (n, d), of the world
    signals: Array  # (n, k)
    t: Integers  # (n,)
    memory: Array  # (n, m), of the method

    def numbers(self, task: Task) -> Array:
        """The task's numbers (n, d): the world's features, and with `features: formula` those of the formula's view."""
        if task.view is None:
            return self.features
        return np.concatenate([self.features, task.view(self.features, self.signals, self.t)], axis=1)


def observation_of(task: Task, method: RewardMethod, name: str = "") -> Observation:
    """The view that policies have of a task, with the inputs of a method; `name` is what users call the method."""
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
