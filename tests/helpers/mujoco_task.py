"""What the tests of the three tasks on MuJoCo models have in common."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array
from stlbench.task import starts
from stlbench.task.task import Task


def rollout(task: Task, state: Array, actions: Array) -> Array:
    """The states (steps, n) to which the actions (steps, axes) lead from one state (n,), a copy at a time."""
    states = list[Array]()
    for action in actions:
        state = task.system.step(state[None], action[None])[0]
        states.append(state)
    return np.array(states)


def check_no_memory(task: Task, steps: int = 60) -> None:
    """Trajectories from different starts do not disturb each other, to the last bit, in turns and in a batch."""
    generator = np.random.default_rng(1)
    first = task.system.initial_states(starts.sample(task.file.initial, generator, 3))
    actions = generator.uniform(task.actions.low, task.actions.high, (steps, 3, len(task.actions.names)))
    alone = np.stack([rollout(task, state, actions[:, i]) for i, state in enumerate(first)], axis=1)
    turns, batch = [row[None] for row in first], first
    for i in range(steps):
        turns = [task.system.step(row, actions[i, j : j + 1]) for j, row in enumerate(turns)]
        batch = task.system.step(batch, actions[i])
        assert np.array_equal(np.concatenate(turns), alone[i])
        assert np.array_equal(batch, alone[i])
