"""A problem with a reward method as a process in time: the one place where transitions are made.

`Simulator` runs N copies from given states to the end. `BatchEnvironment` puts fresh initial states where an episode
ended; agents train on it. `stlbench.gym` shows the same through Gymnasium's interface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stlbench import starts
from stlbench.contract import Array, Integers, RewardMethod, Transition
from stlbench.problem import Problem

__all__ = ["BatchEnvironment", "Simulator", "Steps"]


class Steps(NamedTuple):
    """What happened while one action was held."""

    reward: Array
    """(N,), the mean of the method's rewards over the steps."""
    samples: Array
    """(N, hold, k): the signals after each step."""


class Simulator:
    """N copies of a task with a method's memory, all at their own time, without restarts."""

    def __init__(self, problem: Problem, method: RewardMethod) -> None:
        self.problem, self.method = problem, method
        self.system, self.horizon, self.hold = problem.system, problem.file.steps, problem.file.hold
        self._vectors = problem.actions.vectors

    def place(self, states: Array) -> Array:
        """Start an episode from each of the states (N, n). Returns the first observation (N, D)."""
        self.state = np.array(states, dtype=np.float64)
        self.signals = self.system.signals(self.state)
        self.memory = self.method.start(self.signals)
        self.t: Integers = np.zeros(len(states), dtype=np.int64)
        return self.observe()

    def replace(self, rows: Integers, states: Array) -> None:
        """Start new episodes in the given rows, from the states (len(rows), n)."""
        self.state[rows] = states
        self.signals[rows] = self.system.signals(states)
        self.t[rows] = 0
        if self.method.memory_size:
            self.memory = self.memory.copy()
            self.memory[rows] = self.method.start(self.signals[rows])

    def observe(self) -> Array:
        """What a policy sees: the task's features, the time scaled to [-1, 1], the method's inputs: (N, D)."""
        parts = [self.system.features(self.state, self.t), (self.t * (2.0 / self.horizon) - 1.0)[:, None]]
        if self.method.memory_size:
            parts.append(self.method.inputs(self.memory))
        return np.concatenate(parts, axis=1)

    def advance(self, action: Integers) -> Steps:
        """Hold the actions with these indices (N,) for `hold` steps."""
        vectors = self._vectors[action]
        states = np.empty((self.hold, *self.state.shape))
        state = self.state
        for i in range(self.hold):
            states[i] = state = self.system.step(state, vectors)
        samples = self.system.signals(states)
        reward = self._reward(vectors, np.concatenate([self.signals[None], samples]))
        self.state, self.signals, self.t = state, samples[-1].copy(), self.t + self.hold
        return Steps(reward, samples.transpose(1, 0, 2))

    def _reward(self, vectors: Array, samples: Array) -> Array:
        """The mean reward (N,) along samples (hold + 1, N, k); `memory` moves on. Without memory, in one call."""
        if self.hold > 1 and not self.method.memory_size:
            k = samples.shape[2]
            times = (self.t + np.arange(self.hold)[:, None]).ravel()
            memory = np.zeros((len(times), 0))
            before, after = samples[:-1].reshape(-1, k), samples[1:].reshape(-1, k)
            reward, _ = self.method.step(before, np.tile(vectors, (self.hold, 1)), after, times, memory)
            mean: Array = reward.reshape(self.hold, -1).mean(axis=0)
            return mean
        total = np.zeros(len(vectors))
        for i in range(self.hold):
            reward, self.memory = self.method.step(samples[i], vectors, samples[i + 1], self.t + i, self.memory)
            total += reward
        return total / self.hold


class BatchEnvironment:
    """N copies that restart by themselves (`contract.Environment`). All randomness is that of the initial states."""

    def __init__(self, problem: Problem, method: RewardMethod, count: int, seed: int) -> None:
        self.problem, self.count = problem, count
        self.actions, self.hold = problem.actions, problem.file.hold
        self.simulator = Simulator(problem, method)
        self._generator = np.random.default_rng(seed)
        self.taken = 0
        self.observation_size = self.reset().shape[1]
        self._generator = np.random.default_rng(seed)

    def reset(self) -> Array:
        """Start N episodes: the first observation, (N, D)."""
        return self.simulator.place(self._draw(self.count))

    def step(self, action: Integers) -> Transition:
        """Hold the actions (N,) for `hold` steps; rows that reach the time limit start anew."""
        held = self.simulator.advance(action)
        self.taken += self.count * self.hold
        arrived = self.simulator.observe()
        ended = self.simulator.t >= self.simulator.horizon
        observation = arrived
        if ended.any():
            rows = np.flatnonzero(ended)
            self.simulator.replace(rows, self._draw(len(rows)))
            observation = self.simulator.observe()
        return Transition(observation, held.reward / self.simulator.method.scale, arrived, ended)

    def _draw(self, count: int) -> Array:
        return starts.sample(self.problem.file.training_starts, self._generator, count)
