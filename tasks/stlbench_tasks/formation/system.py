"""Three point robots whose velocities are controlled."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers, System
from stlbench_tasks.steering import nearest

_DEADLINES = np.array([50, 90])
"""The last steps of the first and the second goal's interval."""
_STOPS = np.array(
    [[4.0, 3.5, 2.0, 2.25, 1.75, 3.25], [4.0, 3.5, 4.0, 2.25, 1.75, 3.0], [4.0, 3.5, 4.0, 2.25, 4.0, 1.0]],
)
"""The points to which the controller sends all robots while the first, the second, the third goal counts."""
_LEAVE = np.array([0, 5, 20, 20, 0, 0])
"""The step at which each coordinate begins to move: the first robot passes the second one, which waits for it."""
_HELD = 0.5
"""Seconds for which an action is held."""


class Formation(System):
    """Three robots in the plane go to goals of their own in turn and keep their distances. p' = p + dt v."""

    state = ("ax", "ay", "bx", "by", "cx", "cy")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 6), (N, 6) -> (N, 6)."""
        return state + self.dt * action

    def signals(self, state: Array) -> Array:
        """The robots' places: (..., 6) -> (..., 6)."""
        return state

    def scaled_state(self, state: Array) -> Array:
        """The robots' places from -1 to 1 over [-1, 6] m: (N, 6) -> (N, 6)."""
        return (state - 2.5) / 3.5

    def controller(self, state: Array, t: Integers) -> Array:
        """Every robot straight to its present stop, the others in reach of the one whose goal counts: (N, 6)."""
        return np.where(t[:, None] < _LEAVE, 0.0, nearest((_STOPS[phase_at(t)] - state) / _HELD, 1.0, 0.5))


def phase_at(t: Integers) -> Integers:
    """0, 1 or 2: whose goal counts."""
    return np.searchsorted(_DEADLINES, t, side="right")
