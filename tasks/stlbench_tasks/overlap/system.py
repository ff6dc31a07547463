"""The robot between obstacles."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive
from stlbench_tasks.steering import Steering

SWITCH = 50.0
"""Seconds at which the first goal's interval ends and the second one's begins."""
_PASSAGE = 1.25
"""y midway between two of the obstacles, 0.25 m from both."""
_steer = Steering(speed=0.3, speed_step=0.03, turn=1.0, turn_step=1 / 6, held=0.5)


class Overlap(DifferentialDrive):
    """Mobile robot with overlapping intervals: off the obstacles for 100 s, at (3,1) by 50 s, at (1,3) by 90 s."""

    room = (0.0, 4.0)

    def controller(self, state: Array, t: Integers) -> Array:
        """Through the passage y = 1.25 to the first goal, and back, round the left, to the second one: (N, 2)."""
        x, y = state[:, :1], state[:, 1:2]
        aligned = abs(y - _PASSAGE) < 0.02
        west, east, up = (1.15, _PASSAGE), (2.75, _PASSAGE), (0.8, 2.75)
        there = np.select([x >= 2.7, aligned | (x > 1.4)], [(3.0, 1.0), east], west)
        back = np.select([y >= 2.7, x < 0.9, aligned | (x < 2.6)], [(1.0, 3.0), up, (0.8, _PASSAGE)], east)
        goal = np.where(t[:, None] * self.dt >= SWITCH, back, there)
        return _steer(state, goal[:, 0], goal[:, 1])
