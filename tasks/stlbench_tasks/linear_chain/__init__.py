"""A double integrator that visits two places and then stays at a third, round an obstacle, F F F G & G, with a way by
hand.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.suite.systems import DoubleIntegrator

_WAY = np.array([[5.0, 2.0], [4.8, 4.8], [2.0, 5.0], [5.0, 5.0]])
"""The first place, a corner on the way round the obstacle, the second place and the third."""
_UNTIL = (65, 95, 150)
"""The steps from which the next one is the aim."""
_PULL, _BRAKE = 1.2, 1.8
"""The controller's acceleration a metre off the place, and against a m/s."""


class LinearChain(DoubleIntegrator):
    """Double integrator that visits places in order and stays at the last, F[0,80] F[0,100] F[0,80] G[0,20] & G."""

    def controller(self, state: Array, t: Integers) -> Array:
        """Accelerations towards the place whose time it is: (N, 4), (N,) -> (N, 2)."""
        aim = _WAY[np.searchsorted(_UNTIL, t, side="right")]
        acceleration: Array = np.clip(_PULL * (aim - state[:, :2]) - _BRAKE * state[:, 2:], -1, 1)
        return acceleration
