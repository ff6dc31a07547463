"""A reward method that ends an episode, and has counterfactuals, by hand."""

from __future__ import annotations

import numpy as np

from helpers.stepwise import Stepwise
from stlbench.contract import Array, Integers, Truth


class Latch(Stepwise):
    """1 at the first sample with x >= 1, and all is over; before that, a tenth of x. The other memory is 0 or 1."""

    memory_size = 1
    can_end = True
    counterfactuals = 1
    scale = 2.0
    floor = -1.0

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return (signals[:, :1] >= 1).astype(float)

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        x, open_ = np.clip(next_signals[:, 0], -10, 10), memory[:, 0] == 0
        return open_ * np.where(x >= 1, 1.0, x / 10), np.maximum(memory, x[:, None] >= 1)

    def over(self, memory: Array) -> Truth:
        over: Truth = memory[:, 0] == 1
        return over

    def counterfactual(self, signals: Array, t: Integers, memory: Array, chance: Array) -> Array:
        return (chance >= 0.5).astype(float)
