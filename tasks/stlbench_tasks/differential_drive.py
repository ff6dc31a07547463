"""A differential-drive robot: the system of most of the paper's tasks (Saxena et al., sec. IV-B)."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, System

__all__ = ["DifferentialDrive"]


class DifferentialDrive(System):
    """x' = x + dt v cos(heading), y' = y + dt v sin(heading), heading' = heading + dt omega.

    State: x, y in metres and heading in radians, not wrapped. Action: v in m/s, omega in rad/s. Signals: x, y.
    """

    state = ("x", "y", "heading")

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
