"""How the hand controllers of the robots drive: turn towards a point, then go there, with actions of a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stlbench.contract import Array

_AIMED = 0.3
"""Radians of bearing below which the robot drives; above, it turns on the spot."""


def nearest(action: Array, limit: float, step: float) -> Array:
    """The values of the grid -limit, ..., -step, 0, step, ..., limit that are nearest to `action`."""
    rounded: Array = np.round(np.round(np.clip(action, -limit, limit) / step) * step, 12)
    return rounded


def polar(state: Array, x: Array | float, y: Array | float) -> tuple[Array, Array]:
    """Distance (N,) in metres and bearing (N,) in [-pi, pi) of the points (x, y), seen from states (N, 3)."""
    dx, dy = x - state[:, 0], y - state[:, 1]
    bearing = (np.arctan2(dy, dx) - state[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return np.hypot(dx, dy), bearing


@dataclass(frozen=True)
class Steering:
    """Drives a differential-drive robot to a point, forwards or backwards, and never away from it.

    Called with states (N, 3) and the points' x, y, numbers or (N,), it gives back actions (N, 2): v in m/s, omega in
    rad/s.
    """

    speed: float
    """Greatest v, in m/s."""
    speed_step: float
    """The step from one v of the grid to the next."""
    turn: float
    """Greatest omega, in rad/s."""
    turn_step: float
    """The step from one omega of the grid to the next."""
    held: float
    """Seconds for which an action is held: where it can, the robot arrives within them."""

    def __call__(self, state: Array, x: Array | float, y: Array | float) -> Array:
        """The present actions: (N, 3), (N,), (N,) -> (N, 2)."""
        distance, bearing = polar(state, x, y)
        aside = (bearing + np.pi / 2) % np.pi - np.pi / 2  # of the nearer end, front or back
        ahead = np.where(abs(aside) < _AIMED, distance * np.cos(bearing), 0.0)
        v = nearest(ahead / self.held, self.speed, self.speed_step)
        omega = nearest(aside / self.held, self.turn, self.turn_step)
        return np.stack([v, omega], axis=1)
