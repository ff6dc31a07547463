"""A quadrotor in space that flies through three gates in time, F & F & F & G, with a flight by hand."""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.quadrotor_in_space import QuadrotorInSpace

_GATES = np.array([[2.0, 1.0, 1.5], [4.0, -1.0, 2.5], [6.0, 0.0, 1.5]])
_BEFORE = (130, 260)
"""The steps from which the second and the third gate are the aims."""


class QuadrotorGates(QuadrotorInSpace):
    """Quadrotor that flies through three gates in time without leaning far, F[0,130] & F[130,260] & F[260,400] & G."""

    def aims(self, t: Integers) -> Array:
        """The gate whose time it is: (N,) -> (N, 3)."""
        aims: Array = _GATES[np.searchsorted(_BEFORE, t, side="right")]
        return aims
