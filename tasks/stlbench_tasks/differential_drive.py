"""A differential-drive robot: the system of most of the paper's tasks (Saxena et al., sec. IV-B), and the steering of
its hand controllers.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from stlbench.contract import Array, System

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
    """Seconds for which an action is held: the robot arrives within them if it can."""

    def __call__(self, state: Array, x: Array | float, y: Array | float) -> Array:
        """The present actions: (N, 3), (N,), (N,) -> (N, 2)."""
        distance, bearing = polar(state, x, y)
        aside = (bearing + np.pi / 2) % np.pi - np.pi / 2  # bearing from the nearer end, front or back
        ahead = np.where(abs(aside) < _AIMED, distance * np.cos(bearing), 0.0)
        v = nearest(ahead / self.held, self.speed, self.speed_step)
        omega = nearest(aside / self.held, self.turn, self.turn_step)
        return np.stack([v, omega], axis=1)


class DifferentialDrive(System):
    """x' = x + dt v cos(heading), y' = y + dt v sin(heading), heading' = heading + dt omega.

    State: x, y in metres and heading in radians, not wrapped. Action: v in m/s, omega in rad/s. Signals: x, y.
    """

    state = ("x", "y", "heading")
    room: ClassVar[tuple[float, float]]
    """The range of x and of y, as the task file has it, in metres; `scaled_state` has it from -1 to 1."""

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 3), (N, 2) -> (N, 3)."""
        heading = state[:, 2]
        change = np.empty_like(state)  # a stack of columns takes half as long again for 16 copies
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
