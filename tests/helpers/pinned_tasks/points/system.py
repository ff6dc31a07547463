"""Two points on two lines, each with a speed of its own."""

import numpy as np

from stlbench.contract import Array, Integers, System


class Points(System):
    """a' = a + dt v, b' = b + dt w; `scaled_state` differs from `features`."""

    state = ("a", "b")

    def step(self, state: Array, action: Array) -> Array:
        """(N, 2), (N, 2) -> (N, 2)."""
        return state + self.dt * action

    def signals(self, state: Array) -> Array:
        """Both places: (..., 2) -> (..., 2)."""
        return state

    def features(self, state: Array, t: Integers) -> Array:
        """Places and their distance: (N, 2) -> (N, 3)."""
        return np.column_stack([state / 4, (state[:, 0] - state[:, 1]) / 8])

    def scaled_state(self, state: Array) -> Array:
        """(N, 2) -> (N, 2)."""
        return state / 4
