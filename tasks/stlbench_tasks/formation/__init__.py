"""Three point robots that change their order and keep their distances: one formula over all of them. The system, and
features that a person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers, System
from stlbench_tasks.differential_drive import nearest

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
        """Velocities of every robot straight to its present stop, which is within reach of the others': (N, 6)."""
        return np.where(t[:, None] < _LEAVE, 0.0, nearest((_STOPS[phase_at(t)] - state) / _HELD, 1.0, 0.5))


def phase_at(t: Integers) -> Integers:
    """The robot whose goal counts: 0, 1 or 2."""
    return np.searchsorted(_DEADLINES, t, side="right")


_GOALS = np.array([4.0, 3.5, 4.0, 2.25, 4.0, 1.0])
"""x and y of the three robots' goals."""
_PAIRS = ((0, 1), (1, 2), (0, 2))
_NEAR, _FAR = 0.4, 3.0
"""Metres between which all distances are kept."""


class FormationByHand(Formation):
    beyond_state = (
        "whose goal counts",
        "where each robot's goal is from it",
        "where the robots are from each other",
        "what their distances leave",
        "close-ups of the goals",
    )

    def features(self, state: Array, t: Integers) -> Array:
        """Goals, distances and whose goal counts: (N, 27).

        Each robot's goal x and y from there, over 5 m and, to resolve the last metre, as tanh over 0.5 m. For each pair
        of robots the second's x and y from the first as tanh over 2 m. Then the pair's distance above the least and
        below the greatest, as tanh over 0.5 m; 1 for the goal that counts at t, -1 for the others.
        """
        goal, places = _GOALS - state, state.reshape(-1, 3, 2)
        apart = np.stack([places[:, j] - places[:, i] for i, j in _PAIRS], axis=1)
        distance = np.hypot(apart[..., 0], apart[..., 1])
        pairs = [np.tanh(apart / 2).reshape(-1, 6), np.tanh((distance - _NEAR) * 2), np.tanh((_FAR - distance) * 2)]
        counts = np.where(phase_at(t)[:, None] == np.arange(3), 1.0, -1.0)
        return np.concatenate([goal / 5, np.tanh(goal * 2), *pairs, counts], axis=1)
