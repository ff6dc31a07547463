"""Every kind of task is stepped by one simulator: a system, an environment, and a simulation of one's own."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.line_task import line
from helpers.walk_task import FILE, walk, walk_text

from stlbench.contract import Array, Integers, World, WorldTask
from stlbench.registry.choices import Choice
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.referee import Referee
from stlbench.simulation.worlds import make_world, scaled_times
from stlbench.task import build_method
from stlbench.task.reading import read_task_file
from stlbench.task.task import Task


class Drift(World):
    """x grows by its action, and by a tenth of its seed in each step; it ends at 3."""

    def __init__(self, count: int) -> None:
        self.signals, self.ended = np.zeros((count, 1)), np.zeros(count, dtype=np.bool_)
        self.lived, self._seed = np.zeros(count, dtype=np.int64), np.zeros(count)

    def restart(self, rows: Integers, starts: Array) -> None:
        self.signals[rows], self.ended[rows], self.lived[rows] = 0.0, False, 0
        self._seed[rows] = starts[:, 0]

    def advance(self, action: Array, steps: int) -> Array:
        samples = [self.signals.copy()]
        for _ in range(steps):
            self.signals = np.where(
                self.ended[:, None], self.signals, self.signals + action + 0.1 * self._seed[:, None]
            )
            self.lived += ~self.ended
            self.ended = self.signals[:, 0] >= 3
            samples.append(self.signals.copy())
        return np.stack(samples)

    def features(self, t: Integers) -> Array:
        return self.signals / 3


class DriftTask(WorldTask):
    """That world."""

    def world(self, count: int) -> World:
        return Drift(count)


def drift() -> Task:
    actions = {"by": {"low": -1, "high": 1, "count": 3}}
    return Task(Choice("drift"), read_task_file(walk_text(environment=None, actions=actions), "drift"), DriftTask())


@pytest.mark.parametrize("task", [line(), walk(), drift()], ids=lambda task: task.name)
def test_one_simulator_for_all(task: Task) -> None:
    method = build_method(task, "raw")
    environment = BatchEnvironment(task, method, 3, seed=0)
    environment.reset()
    last = task.actions.size - 1  # type: ignore[union-attr]
    transitions = [environment.step(np.full(3, last)) for _ in range(task.file.steps)]
    assert transitions[-1].reward.shape == (3,)
    assert any(transition.ended.any() for transition in transitions)
    assert len(Referee(task, method)._selection) == FILE["starts"]


def test_a_world_by_hand() -> None:
    world = make_world(drift(), 2)
    world.restart(np.arange(2), np.array([[0.0], [5.0]]))
    assert world.advance(np.array([[1.0], [1.0]]), 2)[..., 0].tolist() == [[0, 0], [1, 1.5], [2, 3]]
    assert (world.ended.tolist(), world.state.shape) == ([False, True], (2, 0))
    assert world.by_hand(np.zeros(2, dtype=np.int64)) is None


def test_scaled_times_never_leave_their_range() -> None:
    """The space of a wrapped environment ends at 1; 49 * (2 / 49) - 1 is a rounding below it."""
    ends = [float(scaled_times(steps)[-1, 0]) for steps in range(1, 3000)]
    assert max(ends) == 1.0
    assert min(ends) == 1.0 - 2**-52
