"""The Fetch arm of Gymnasium-Robotics that brings its gripper round a ball to a point and holds it there, F G & G, with
a way by hand; needs the extra mujoco.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.fetch_reach import FetchReach

_ABOVE, _GOAL = np.array([1.4, 0.55, 0.74]), np.array([1.4, 0.4, 0.5])
"""A point above the ball, which is at 1.4, 0.58, 0.5, and the point to hold."""
_PAST = 0.56
"""The y below which the gripper has passed the ball."""
_GAIN = 8.0
"""The controller's action a metre."""


class FetchAvoid(FetchReach):
    """Fetch arm whose gripper passes a ball, comes to a point and stays, F[0,50] G[0,50] & G[0,100]; needs the extra
    mujoco.
    """

    def controller(self, state: Array, t: Integers) -> Array:
        """Proportional control, first to the point above the ball: (N, 51), (N,) -> (N, 3)."""
        place = state[:, 45:48]
        aim = np.where(place[:, 1:2] > _PAST, _ABOVE, _GOAL)
        return np.clip(_GAIN * (aim - place), -1, 1)
