"""A unicycle in two regions' neighbourhood whose velocities are disturbed (Ikemoto, Ushio 2022)."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, System
from stlbench_tasks.random_numbers import normal
from stlbench_tasks.steering import Steering

REGIONS = ((4.0, 4.0), (4.0, 2.0))
"""Centres of the regions A and B, squares with sides of 1 m."""
drive = Steering(speed=1.0, speed_step=0.05, turn=1.55, turn_step=0.05, held=0.5)
"""Drives to a point within a held action's 0.5 s."""


class NoisyUnicycle(System):
    """x' = x + dt (v cos(heading) + w1), y' = y + dt (v sin(heading) + w2), heading' = heading + dt (omega + w3).

    Each w is normal with mean 0 and standard deviation `noise`, in m/s and rad/s, independent of all others. A system
    draws no random numbers: w is a function of two more columns of the state. `seed`, any number, is drawn with the
    initial state; `count` is the number of steps so far. Features and scaled state do not show them. Whoever sees the
    whole state could know the noise beforehand; the hand controllers do not look.

    State: x, y in metres, heading in radians, not wrapped. Action: v in m/s, omega in rad/s. Signals: x, y.
    """

    state = ("x", "y", "heading", "seed", "count")
    coordinates = ("x", "y", "heading", "seed")

    def __init__(self, dt: float, *, noise: float = 0.1) -> None:
        super().__init__(dt)
        self.noise = noise

    def initial_states(self, coordinates: Array) -> Array:
        """Pose and seed (N, 4), of which nothing has been used up: (N, 5)."""
        return np.concatenate([coordinates, np.zeros((len(coordinates), 1))], axis=1)

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 5), (N, 2) -> (N, 5)."""
        heading, seed, count = state[:, 2:].T
        velocity = self.noise * normal(seed, count, 3)
        velocity[:, 0] += action[:, 0] * np.cos(heading)
        velocity[:, 1] += action[:, 0] * np.sin(heading)
        velocity[:, 2] += action[:, 1]
        after = state.copy()
        after[:, :3] += self.dt * velocity
        after[:, 4] += 1
        return after

    def signals(self, state: Array) -> Array:
        """x, y: (..., 5) -> (..., 2)."""
        return state[..., :2]

    def scaled_state(self, state: Array) -> Array:
        """x and y from -1 to 1 over [0, 5] m, the heading's cosine and sine, and nothing of the noise: (N, 4)."""
        x, y, heading = state[:, :3].T
        return np.stack([x / 2.5 - 1, y / 2.5 - 1, np.cos(heading), np.sin(heading)], axis=1)
