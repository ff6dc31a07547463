"""Features that a person made for policies on either-or."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.either_or.system import PLACES, EitherOr

_OBSTACLE = (4.0, 5.0)
"""Its centre; its sides are 2 m long."""


class EitherOrByHand(EitherOr):
    beyond_state = ("where both targets and the goal are", "where the obstacle is, and a close-up of it")

    def features(self, state: Array, t: Integers) -> Array:
        """The state, and where the regions are: (N, 15).

        The scaled state; the way to each target and to the goal as tanh over 1 m; the way to the obstacle's centre over
        5 m and as tanh over 1 m; the margin to its edge as tanh over 0.5 m.
        """
        place = state[:, :2]
        ways = np.tanh(PLACES.ravel() - np.tile(place, 3))
        off = np.array(_OBSTACLE) - place
        margin = np.tanh((np.abs(off).max(axis=1, keepdims=True) - 1) / 0.5)
        return np.concatenate([self.scaled_state(state), ways, off / 5, np.tanh(off), margin], axis=1)
