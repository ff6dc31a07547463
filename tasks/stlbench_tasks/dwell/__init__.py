"""One of two regions to reach and to stay in, by a robot that noise disturbs. The system, and features that a person
made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.noisy_unicycle import REGIONS, NoisyUnicycle, NoisyUnicycleByHand, drive


class Dwell(NoisyUnicycle):
    """Noisy unicycle that stays in A or in B for 5 s, F[0,450] of G[0,49] A or G[0,49] B."""

    def controller(self, state: Array, t: Integers) -> Array:
        """Actions that drive to the centre of the nearer region, and back when the noise leads away: (N, 2)."""
        (x, a), (_, b) = REGIONS
        return drive(state, x, np.where(state[:, 1] > (a + b) / 2, a, b))


class DwellByHand(NoisyUnicycleByHand, Dwell):
    pass
