"""The paper's mobile robot navigation: two regions in turn. The system, and features that a person made for its
policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive, Steering

SWITCH = 1300
"""The last step of the first region's interval: the robot heads for the second one after it."""
_steer = Steering(speed=5.0, speed_step=0.5, turn=3.0, turn_step=0.5, held=0.1)


class RobotNav(DifferentialDrive):
    """Mobile robot navigation: in one region for G[900,1300], in another for G[1600,2000]."""

    room = (-5.0, 40.0)

    def controller(self, state: Array, t: Integers) -> Array:
        """Straight to the centre of the present region: (N, 2)."""
        goal = np.where(t >= SWITCH, 30.0, 25.0)
        return _steer(state, goal, goal)


class RobotNavByHand(RobotNav):
    beyond_state = ("which goal counts", "distance and bearing of that goal", "a close-up of the last metres")

    def features(self, state: Array, t: Integers) -> Array:
        """Distance and bearing of the goal that counts at t, and which one it is: (N, 6).

        Distance over 20 m and, to resolve the last metres, its tanh over 2 m; the bearing's cosine and sine, which
        fade out at the goal, where the bearing has no meaning, and the cosine a second time without fading.
        """
        second = t >= SWITCH
        goal = np.where(second, 30.0, 25.0)
        dx, dy = goal - state[:, 0], goal - state[:, 1]
        distance = np.hypot(dx, dy)
        bearing = np.arctan2(dy, dx) - state[:, 2]
        near = np.tanh(distance)
        cosine, sine = np.cos(bearing), np.sin(bearing)
        columns = [distance / 20 - 1, np.tanh(distance / 2), cosine * near, sine * near, cosine, second * 2.0 - 1]
        return np.stack(columns, axis=1)
