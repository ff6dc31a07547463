"""The rules of what a reward method may add: that all is over, and other memories of a transition."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, RewardMethod
from stlbench.testing.rules import Rules


def check_over(method: RewardMethod, rules: Rules, memory: Array, reward: Array, after: Array) -> None:
    """Of one step of N copies: memories (N, m) before and after it, and what it was paid (N,)."""
    over = rules.function("over", method.over, (memory,), (len(memory),))
    rules.keep(over.dtype.kind == "b", "over gives bool", over.dtype)
    rules.keep(not reward[over].any(), "nothing is paid after it is over", reward[over])
    rules.keep(bool(method.over(after)[over].all()), "what is over remains so", "a memory after it that is not")


def check_counterfactual(
    method: RewardMethod, rules: Rules, signals: Array, next_signals: Array, t: int, memory: Array
) -> None:
    """Of one step of N copies: samples (N, k) before and after it, the step, and memories (N, m) before it."""
    rows, at = len(memory), np.full(len(memory), t)
    chance = np.random.default_rng(t).random(memory.shape)
    other = rules.function("counterfactual", method.counterfactual, (signals, at, memory, chance), memory.shape)
    inputs = method.inputs(other)
    rules.keep(bool(np.all(np.abs(inputs) <= 2)), "inputs of a counterfactual memory are about in [-1, 1]", inputs)
    reward, after = method.along(np.stack([signals, next_signals]), np.zeros((rows, 1)), at, other)
    finite = bool(np.isfinite(reward).all() and np.isfinite(after).all())
    rules.keep(finite, "a step from a counterfactual memory is finite", reward)
    within = bool(np.all(reward >= method.floor - 1e-9) and np.all(np.abs(reward) <= 1.5 * method.scale))
    rules.keep(within, "a step from a counterfactual memory is paid from its floor to about its scale", reward)
