"""Features that a person made for policies on formation."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.formation.system import Formation, phase_at

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

        Each robot's goal x and y from there, over 5 m and, to resolve the last metre, as tanh over 0.5 m; of each
        pair of robots the second's x and y from the first as tanh over 2 m, and how far their distance is above the
        least and below the greatest, as tanh over 0.5 m; 1 for the goal that counts at t, -1 for the others.
        """
        goal, places = _GOALS - state, state.reshape(-1, 3, 2)
        apart = np.stack([places[:, j] - places[:, i] for i, j in _PAIRS], axis=1)
        distance = np.hypot(apart[..., 0], apart[..., 1])
        pairs = [np.tanh(apart / 2).reshape(-1, 6), np.tanh((distance - _NEAR) * 2), np.tanh((_FAR - distance) * 2)]
        counts = np.where(phase_at(t)[:, None] == np.arange(3), 1.0, -1.0)
        return np.concatenate([goal / 5, np.tanh(goal * 2), *pairs, counts], axis=1)
