"""The third form of the paper's fragment: reach a disc in time and stay there. The system, and features that a
person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive, Steering, polar

GOAL = 10.0
"""Both coordinates of the disc's centre."""
_steer = Steering(speed=5.0, speed_step=0.5, turn=3.0, turn_step=0.5, held=0.1)


class ReachStay(DifferentialDrive):
    """Mobile robot that reaches a disc within 6 s and stays for 2 s, F[0,600] G[0,200]."""

    room = (-5.0, 15.0)

    def controller(self, state: Array, t: Integers) -> Array:
        """Straight to the disc's centre: (N, 2)."""
        return _steer(state, GOAL, GOAL)


class ReachStayByHand(ReachStay):
    beyond_state = ("distance and bearing of the goal", "a close-up of the last metre")

    def features(self, state: Array, t: Integers) -> Array:
        """Distance and bearing of the disc's centre: (N, 5).

        Distance over 10 m and, to resolve the last metre, its tanh over 1 m; the bearing's cosine and sine, which fade
        out at the goal, where the bearing has no meaning, and the cosine a second time without fading.
        """
        distance, bearing = polar(state, GOAL, GOAL)
        near, cosine, sine = np.tanh(distance), np.cos(bearing), np.sin(bearing)
        return np.stack([distance / 10 - 1, near, cosine * near, sine * near, cosine], axis=1)
