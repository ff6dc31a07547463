"""The world of a task, which the simulator drives: that of a system, of an environment, or the task's own."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stlbench.contract import Array, GymTask, Integers, System, World
from stlbench.contract.presentation import Drawn, Pixels
from stlbench.task.task import Task


def make_world(task: Task, count: int, *, drawn: bool = False) -> World:
    """So many copies, none of them begun; `drawn` if pictures are wanted, which Gymnasium must know in advance."""
    dynamics = task.dynamics
    if isinstance(dynamics, System):
        return SystemWorld(dynamics, count, engineered=task.file.features == "engineered")
    if isinstance(dynamics, GymTask):
        from stlbench.rollout.gymnasium.world import GymWorld  # imports Gymnasium, which most tasks do without

        return GymWorld(dynamics, task.source, count, drawn=drawn)
    return dynamics.world(count)


class SystemWorld(World):
    """N copies of a system, stepped at once. Their starts are states (r, n); none of them ever ends by itself."""

    can_end: ClassVar[bool] = False

    def __init__(self, system: System, count: int, engineered: bool = True) -> None:
        self.system, self._engineered = system, engineered
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
            states[i + 1] = state = self.system.step(state, action)
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
