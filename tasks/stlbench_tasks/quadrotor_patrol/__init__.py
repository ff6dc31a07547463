"""A quadrotor in space that visits two places again and again, G with F of each, with a flight by hand."""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.quadrotor_in_space import QuadrotorInSpace

_PLACES = np.array([[1.0, 0.0, 1.5], [-1.0, 1.0, 2.0]])
_LEG = 120
"""The steps for which each place is the aim."""


class QuadrotorPatrol(QuadrotorInSpace):
    """Quadrotor that is at each of two places again and again, G[0,300] with F[0,250], without leaning far."""

    def aims(self, t: Integers) -> Array:
        """The places in turn: (N,) -> (N, 3)."""
        aims: Array = _PLACES[t // _LEG % 2]
        return aims
