"""A task with a reward method as a process in time: the one place where transitions are made.

`Simulator` runs N copies from given states to the end. `BatchEnvironment` puts fresh initial states where an episode
ended; agents train on it. `stlbench.gym` shows the same through Gymnasium's interface.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stlbench.contract import ActionGrid, Array, Integers, RewardMethod, Transition, Truth, World
from stlbench.rollout import faults
from stlbench.rollout.clock import scaled_times
from stlbench.rollout.counterfactuals import Taken, counterfactual
from stlbench.rollout.early_ends import remainder
from stlbench.rollout.endings import ends_of, first_end
from stlbench.rollout.worlds import make_world
from stlbench.task.task import Task


class Steps(NamedTuple):
    """What happened while one action was held."""

    reward: Array
    """(N,), the mean of the method's rewards over the steps."""
    samples: Array
    """(N, hold, k): the signals after each step."""


class Simulator:
    """N copies of a task with a method's memory, all at their own time, without restarts."""

    def __init__(self, task: Task, method: RewardMethod, rewarded: bool = True, *, drawn: bool = False) -> None:
        """What it simulates.

        Args:
            task: whose copies.
            method: what pays, and has memory and inputs.
            rewarded: whether rewards are wanted; without, those of a method without memory are NaN.
            drawn: whether pictures are wanted, see `make_world`.
        """
        self.task, self.method, self._drawn = task, method, drawn
        self._rewarded = rewarded or method.memory_size > 0
        self.horizon, self.hold = task.file.steps, task.file.hold
        actions = task.actions
        self._vectors = actions.vectors if isinstance(actions, ActionGrid) else np.empty((0, len(actions.names)))
        self._low, self._high = np.array(actions.low), np.array(actions.high)
        self._times = scaled_times(self.horizon)

    @property
    def state(self) -> Array:
        """The states (N, n) of the copies; (N, 0) where they cannot be read."""
        return self.world.state

    @property
    def signals(self) -> Array:
        """The newest sample of each copy, (N, k)."""
        return self.world.signals

    def reset(self, begun: Array) -> Array:
        """Begin an episode at each of the starts (N, s), states or seeds. Returns the first observation (N, D)."""
        self.world: World = make_world(self.task, len(begun), drawn=self._drawn)
        self.world.restart(np.arange(len(begun)), begun)
        self.t: Integers = np.zeros(len(begun), dtype=np.int64)
        self.memory = self.method.initial_memory(self.signals, self.t)
        return self.observe()

    def reset_rows(self, rows: Integers, begun: Array, t: Integers) -> None:
        """Begin new episodes in the given rows (r,), increasing, at the starts (r, s) and at steps t (r,)."""
        self.world.restart(rows, begun)
        self.t[rows] = t
        if self.method.memory_size:
            self.memory = self.memory.copy()
            self.memory[rows] = self.method.initial_memory(self.signals[rows], t)

    def observe(self, t: Integers | None = None) -> Array:
        """What a policy sees: the task's features, the time scaled to [-1, 1], the method's inputs: (N, D).

        `t` (N,) stands in place of the copies' own time where it is given.
        """
        t = self.t if t is None else t
        parts = [self.world.features(t), self._times[t]]
        if self.method.memory_size:
            parts.append(self.method.inputs(self.memory))
        observation = np.concatenate(parts, axis=1)
        faults.check_observation(self.task, self.method, parts, observation, t)
        return observation

    def advance(self, action: Integers | Array) -> Steps:
        """Hold actions for `hold` steps: indices (N,) of the grid, or vectors (N, axes), clipped to their ends."""
        faults.check_action(self.task.actions, action, self.t)
        vectors: Array = self._vectors[action] if action.dtype.kind == "i" else action.clip(self._low, self._high)
        samples, self.last_action = self.world.advance(vectors, self.hold), vectors
        faults.check_samples(self.task, samples, self.hold, self.t)
        self.last_samples = samples
        if self._rewarded:
            reward, self.memory = self.paid(samples, vectors, self.t, self.memory)
        else:
            reward = np.full(len(vectors), np.nan)
        self.t = self.t + self.hold
        return Steps(reward, samples[1:].transpose(1, 0, 2))

    def paid(self, samples: Array, vectors: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """What the method pays for samples (hold + 1, N, k) from a memory on, the mean (N,), and the memory after."""
        rewards, memory = self.method.along(samples, vectors, t, memory)
        faults.check_rewards(self.method, rewards, self.hold, t)
        if self.method.memory_size:
            faults.check_memory(self.method, memory, t + self.hold)
        mean: Array = rewards[0] if self.hold == 1 else rewards.mean(axis=0)
        return mean, memory

    def over(self, memory: Array) -> Truth:
        """Which memories (N, m) the method says are over; it is one that can end."""
        over = self.method.over(memory)
        faults.check_over(self.method, over, len(memory))
        return over


class BatchEnvironment:
    """N copies that restart by themselves (`contract.Environment`). All randomness is that of the initial states.

    How training episodes differ from those that the referee scores is the task's, `TaskFile.training`.
    """

    def __init__(self, task: Task, method: RewardMethod, count: int, seed: int) -> None:
        self.task, self.count = task, count
        self.actions, self.hold = task.actions, task.file.hold
        self.simulator = Simulator(task, method)
        self._training, horizon = task.file.training, task.file.steps
        self._cut = np.zeros(horizon + 1, dtype=np.bool_)
        self._cut[[*self._training.cuts, horizon]] = True
        self._ends = ends_of(task, method)
        self.counterfactuals = method.counterfactuals
        self._generator = np.random.default_rng(seed)
        self._going_on = np.ones(count)
        self._none: Truth = np.zeros(count, dtype=np.bool_)
        self._going_on.flags.writeable = self._none.flags.writeable = False  # agents are given the one
        self.taken = 0
        self.observation_size = self.reset().shape[1]
        self._generator = np.random.default_rng(seed)

    def reset(self) -> Array:
        """Start N episodes: the first observation, (N, D)."""
        self._broken_off: Integers = np.full(self.count, self.simulator.horizon)
        self.simulator.reset(self._draw(self.count))
        if self._training.exploring is not None:
            self._reset_rows(np.arange(self.count))
        self._seen = self.simulator.observe()
        return self._seen

    def step(self, action: Integers | Array) -> Transition:
        """Hold the actions for `hold` steps (see `contract.Environment`); rows whose episode is over are reset."""
        simulator = self.simulator
        if not self.counterfactuals:
            return self._step(action)[0]
        seen, t, memory = self._seen, simulator.t, simulator.memory
        transition, fixed = self._step(action)
        self._seen = transition.observation
        self._taken = Taken(seen, t, memory, simulator.last_samples, simulator.last_action, transition, fixed)
        return transition

    def counterfactual(self, generator: np.random.Generator) -> tuple[Array, Transition]:
        """The last step with other memories (see `contract.Environment`)."""
        return counterfactual(self.simulator, self._taken, generator)

    def _step(self, action: Integers | Array) -> tuple[Transition, Truth]:
        """The transition, and which copies the task or the world has ended (N,), whatever the method says."""
        simulator = self.simulator
        held = simulator.advance(action)
        self.taken += self.count * self.hold
        reward = held.reward / simulator.method.scale
        t, fixed = simulator.t, self._none
        ended, discount = t >= self._broken_off, self._going_on
        if self._ends:
            fixed, paid = first_end(self._ends, held.samples, t)
            reward[fixed] = paid[fixed]
            ended, discount = ended | fixed, np.where(fixed, 0.0, 1.0)
        if simulator.world.can_end and (stopped := simulator.world.ended & (t < simulator.horizon) & ~ended).any():
            discount = self._stop(stopped, reward, discount, simulator.last_action)
            ended, fixed = ended | stopped, fixed | stopped
        once = None
        if simulator.method.can_end:
            over = simulator.over(simulator.memory)
            ended, discount = ended | over, np.where(over, 0.0, discount)
            once = discount == 0
        cut = self._cut[t] | ended
        observation = simulator.observe()
        if not np.count_nonzero(cut):
            return Transition(observation, reward, observation, discount, cut, ended, once), fixed
        # beyond a boundary the reward asks for something else: the value is that of going on as before it
        boundary = cut & (t < simulator.horizon) & self._cut[t]
        arrived = simulator.observe(np.where(boundary, t - self.hold, t)) if boundary.any() else observation
        if ended.any():
            self._reset_rows(np.flatnonzero(ended))
            observation = simulator.observe()
        return Transition(observation, reward, arrived, discount, cut, ended, once), fixed

    def _stop(self, stopped: Truth, reward: Array, discount: Array, action: Array) -> Array:
        """Pay those copies that the world has ended, in place; returns the discounts."""
        simulator = self.simulator
        method = simulator.method
        if self.task.file.terminated == "interval":
            return discount  # nobody knows what would follow: it is worth what going on would be
        for row in np.flatnonzero(stopped):
            t, last, memory = int(simulator.t[row]), simulator.signals[row], simulator.memory[[row]]
            left = remainder(method, self.task.file.terminated, last, action[[row]], t, memory) / method.scale
            reward[row] = reward[row] + left / self.hold if method.can_end else left / (simulator.horizon - t)
        return np.where(stopped, 0.0, discount)

    def _reset_rows(self, rows: Integers) -> None:
        """New episodes in the given rows, some of them at a random time."""
        simulator, exploring = self.simulator, self._training.exploring
        begun, t = self._draw(len(rows)), np.zeros(len(rows), dtype=np.int64)
        self._broken_off[rows] = simulator.horizon
        if exploring is not None:
            chosen = np.flatnonzero(self._generator.random(len(rows)) < exploring.share)
            decisions = simulator.horizon // self.hold
            t[chosen] = self._generator.integers(decisions, size=len(chosen)) * self.hold
            kept = self._generator.random(len(chosen)) < exploring.kept
            begun[chosen[kept]] = simulator.state[rows[chosen[kept]]]
            if exploring.states is not None:
                drawn = chosen[~kept]
                begun[drawn] = self.task.starts.of_exploring(self._generator, len(drawn))
            if exploring.length is not None:
                length = self._generator.integers(1, 2 * exploring.length, size=len(chosen)) * self.hold
                self._broken_off[rows[chosen]] = np.minimum(t[chosen] + length, simulator.horizon)
        simulator.reset_rows(rows, begun, t)

    def _draw(self, count: int) -> Array:
        return self.task.starts.of_training(self._generator, count)
