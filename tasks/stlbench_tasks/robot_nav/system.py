"""The robot of the navigation task."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive
from stlbench_tasks.steering import Steering

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
