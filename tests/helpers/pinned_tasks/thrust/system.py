"""A point on a line with a speed, pushed by a force."""

import numpy as np

from stlbench.contract import Array, Integers, System


class Thrust(System):
    """x' = x + dt v, v' = v + dt u."""

    state = ("x", "v")

    def step(self, state: Array, action: Array) -> Array:
        """(N, 2), (N, 1) -> (N, 2)."""
        x, v = state.T
        return np.column_stack([x + self.dt * v, v + self.dt * action[:, 0]])

    def signals(self, state: Array) -> Array:
        """The place: (..., 2) -> (..., 1)."""
        return state[..., :1]

    def features(self, state: Array, t: Integers) -> Array:
        """(N, 2) -> (N, 2)."""
        return state / 2
