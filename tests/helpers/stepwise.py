"""Reward methods for tests, written as the reward of one transition."""

from __future__ import annotations

from typing import Any

import numpy as np

from stlbench.contract import Array, Integers, RewardMethod


class Stepwise(RewardMethod):
    """A subclass writes `step`: signals s_t, action, s_{t+1}, t and memory to the reward (N,) and the next memory."""

    def step(self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array) -> Any:
        raise NotImplementedError

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        rewards = []
        for i in range(len(samples) - 1):
            reward, memory = self.step(samples[i], action, samples[i + 1], t + i, memory)
            rewards.append(reward)
        return np.ma.stack(rewards) if np.ma.isMaskedArray(rewards[0]) else np.stack(rewards), memory


def one_step(
    method: RewardMethod, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
) -> tuple[Array, Array]:
    """The reward (N,) of one transition, and the memory after it."""
    rewards, memory = method.along(np.stack([signals, next_signals]), action, t, memory)
    return rewards[0], memory
