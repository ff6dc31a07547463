"""Features that a person made for policies on ball-in-cup."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.ball_in_cup.system import BallInCup

_SWITCHES = np.array([300, 600])
"""The last steps of the first two intervals: to let the ball go, and to catch it again, begin after them."""


class BallInCupByHand(BallInCup):
    beyond_state = ("whether the ball is to be caught", "where the ball is from the cup")

    def features(self, state: Array, t: Integers) -> Array:
        """The cup's place, the ball's from there, their speeds, and what is asked for at t: (N, 9).

        Places of the cup over 0.33 m and of the ball over 0.25 m, speeds over 2 m/s; 1 where the ball is to be caught
        and -1 where it is to be let go.
        """
        caught = 1.0 - 2.0 * (np.searchsorted(_SWITCHES, t, side="right") == 1)
        return np.concatenate([state[:, :2] * 3, state[:, -2:] * 4, state[:, 4:8] / 2, caught[:, None]], axis=1)
