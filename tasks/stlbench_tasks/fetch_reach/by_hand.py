"""Features that a person made for policies on fetch-reach."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.fetch_reach.system import POINTS, SWITCH, FetchReach

_MIDDLE = np.array([1.35, 0.75, 0.5])


class FetchReachByHand(FetchReach):
    beyond_state = ("which point counts", "a close-up of the way to it")

    def features(self, state: Array, t: Integers) -> Array:
        """The gripper's place and velocity, and the place of the point that counts at t: (N, 10).

        Place from the middle of the table over 0.33 m, velocity over 1.25 m/s; the tanh of the way to the point over
        0.1 m; -1 for the first point, 1 for the second.
        """
        place, velocity = state[:, 45:48], state[:, 48:]
        second = (t >= SWITCH).astype(np.int64)
        way = np.tanh((POINTS[second] - place) / 0.1)
        return np.concatenate([(place - _MIDDLE) * 3, velocity * 0.8, way, second[:, None] * 2.0 - 1], axis=1)
