"""A differential-drive robot: the system of most of the paper's tasks (Saxena et al., sec. IV-B)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from stlbench.contract import Array, System


class DifferentialDrive(System):
    """x' = x + dt v cos(heading), y' = y + dt v sin(heading), heading' = heading + dt omega.

    State: x, y in metres and heading in radians, not wrapped. Action: v in m/s, omega in rad/s. Signals: x, y.
    """

    state = ("x", "y", "heading")
    room: ClassVar[tuple[float, float]]
    """The ranges of x and y, as the task file has it, in metres: what `scaled_state` has from -1 to 1."""

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 3), (N, 2) -> (N, 3)."""
        heading = state[:, 2]
        change = np.empty_like(state)
        np.multiply(action[:, 0], np.cos(heading), out=change[:, 0])
        np.multiply(action[:, 0], np.sin(heading), out=change[:, 1])
        change[:, 2] = action[:, 1]
        change *= self.dt
        change += state
        return change

    def signals(self, state: Array) -> Array:
        """x, y: (..., 3) -> (..., 2)."""
        return state[..., :2]

    def scaled_state(self, state: Array) -> Array:
        """x and y from -1 to 1 over the `room`, the heading's cosine and sine: (N, 3) -> (N, 4)."""
        low, high = self.room
        x, y, heading = state.T
        middle, half = (low + high) / 2, (high - low) / 2
        return np.stack([(x - middle) / half, (y - middle) / half, np.cos(heading), np.sin(heading)], axis=1)
