"""A point robot that reaches two places in time among zones that move, F & F & G, with a way by hand."""

import numpy as np

from stlbench.contract import Array, Integers, System

_GOALS = np.array([[2.0, 2.0], [-2.0, 2.0]])
_SECOND = 150
"""The step from which the second place is the aim."""
_CENTRES = np.array([[0.0, 0.0], [0.0, 2.0], [2.0, 0.0]])
_RADII = np.array([1.0, 0.8, 0.6])
_ROUNDS = np.array([4.0, -5.0, 6.0])
"""Middle of a zone's circle in m, its radius in m, and how often it goes round in a whole turn of the phase."""
_TURNS = np.array([0.0, 1.0, 2.0])
"""The angle of a zone on its circle at phase 0, in rad."""
_PACE = 0.2
"""Radians a second by which the phase goes on."""
_DRAG = 0.5
"""1/s."""
_PULL, _BRAKE, _PUSH, _REACH, _AHEAD = 2.0, 1.0, 6.0, 1.2, 0.6
"""The controller's acceleration a metre off the place, against a m/s, and away from a zone. It keeps off zones within
1.2 m, as robot and zones will be 0.6 s ahead."""


class Zones(System):
    """A point with drag, whose acceleration is controlled, and three zones that circle.

    v' = v + dt (u - 0.5 v); then the place moves by dt v'. The phase goes on by 0.2 rad/s. A zone is on its circle at
    the angle turn + rounds * phase. Signals: the places of point and zones.
    """

    state = ("x", "y", "v_x", "v_y", "phase")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 5), (N, 2) -> (N, 5)."""
        velocity = state[:, 2:4] + self.dt * (action - _DRAG * state[:, 2:4])
        return np.concatenate([state[:, :2] + self.dt * velocity, velocity, state[:, 4:] + _PACE * self.dt], axis=1)

    def signals(self, state: Array) -> Array:
        """x, y; x, y of each zone: (..., 5) -> (..., 8)."""
        zones = places(state[..., 4])
        return np.concatenate([state[..., :2], zones.reshape(*zones.shape[:-2], -1)], axis=-1)

    def scaled_state(self, state: Array) -> Array:
        """The place over 3 m, the velocity over 1.5 m/s, and of each zone the way round: (N, 5) -> (N, 10)."""
        angles = _TURNS + state[:, 4:] * _ROUNDS
        return np.concatenate([state[:, :2] / 3, state[:, 2:4] / 1.5, np.cos(angles), np.sin(angles)], axis=1)

    def controller(self, state: Array, t: Integers) -> Array:
        """Accelerations towards the place, and away from the zones of soon: (N, 5), (N,) -> (N, 2)."""
        place, velocity = state[:, :2], state[:, 2:4]
        aim = _GOALS[(t >= _SECOND).astype(np.int64)]
        off = (place + _AHEAD * velocity)[:, None] - places(state[:, 4] + _PACE * _AHEAD)
        far = np.hypot(off[..., 0], off[..., 1])[..., None]
        # At the middle of a zone no direction leads away: the bound keeps the division finite.
        away = off / np.maximum(far, 0.05) * np.maximum(0.0, _REACH - far) / _REACH
        wanted = np.clip(_PULL * (aim - place), -1, 1) - _BRAKE * velocity
        acceleration: Array = np.clip(wanted + _PUSH * away.sum(axis=1), -1.5, 1.5)
        return acceleration


def places(phase: Array) -> Array:
    """The places of the zones at a phase: (...,) -> (..., 3, 2)."""
    angles = _TURNS + phase[..., None] * _ROUNDS
    found: Array = _CENTRES + _RADII[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return found
