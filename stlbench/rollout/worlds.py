"""The world of a task, which the simulator drives: that of a system, of an environment, or the task's own."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from stlbench.contract import Array, GymTask, Integers, System, World
from stlbench.contract.presentation import Drawn, Pixels
from stlbench.rollout import faults
from stlbench.task.task import Task


def make_world(task: Task, count: int, *, drawn: bool = False) -> World:
    """So many copies, none of them begun; `drawn` if pictures are wanted, which Gymnasium must know in advance."""
    dynamics = task.dynamics
    if isinstance(dynamics, System):
        return SystemWorld(task, dynamics, count)
    if isinstance(dynamics, GymTask):
        from stlbench.rollout.gymnasium.world import GymWorld  # imports Gymnasium, which most tasks do without

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
        return self.system.controller(self._state, t)
