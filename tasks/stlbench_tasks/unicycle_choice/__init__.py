"""A unicycle that stays at one of two places, visits a third and then stays at a fourth, round an obstacle,
F (G | G) & F F G & G, with a way by hand.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import Steering
from stlbench_tasks.suite.systems import Unicycle

_EITHER = np.array([[5.0, 1.0], [1.0, 5.0]])
_THIRD, _CORNER, _FOURTH = np.array([5.0, 5.0]), np.array([4.9, 2.0]), np.array([3.0, 1.0])
_UNTIL = (100, 180)
"""The steps from which the third and the fourth place are the aims."""
_PASSED = 2.3
"""The y below which the robot has passed the obstacle, on its way from the third place."""
_drive = Steering(speed=1.0, speed_step=0.05, turn=1.5, turn_step=0.05, held=0.2)


class UnicycleChoice(Unicycle):
    """Unicycle that stays at one of two places, then visits two in order, F[0,90] (G | G) & F[0,180] F[0,100] G & G."""

    def controller(self, state: Array, t: Integers) -> Array:
        """Drives to the nearer one of the first two places, then on: (N, 3), (N,) -> (N, 2)."""
        place = state[:, :2]
        far = np.linalg.norm(place[:, None] - _EITHER, axis=2)
        last = np.where(place[:, 1:] > _PASSED, _CORNER, _FOURTH)
        aims = np.stack([_EITHER[far.argmin(axis=1)], np.broadcast_to(_THIRD, place.shape), last])
        x, y = aims[np.searchsorted(_UNTIL, t, side="right"), np.arange(len(state))].T
        return _drive(state, x, y)
