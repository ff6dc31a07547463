"""Two regions to visit again and again, by a robot that noise disturbs. The system, and features that a person made
for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.noisy_unicycle import REGIONS, NoisyUnicycle, NoisyUnicycleByHand, drive

_FIRST, _LEG = 60, 30
"""Steps for the way to B, then for each way between the regions: from the farthest start B is 3.8 m away."""


class Patrol(NoisyUnicycle):
    """Noisy unicycle that is in A and in B again and again, G[0,900] of F[0,99] A and F[0,99] B."""

    def controller(self, state: Array, t: Integers) -> Array:
        """Actions that drive to the centre of B for 60 steps, then to A and to B for 30 steps each in turn: (N, 2)."""
        to_a = (t >= _FIRST) & ((t - _FIRST) // _LEG % 2 == 0)
        return drive(state, REGIONS[0][0], np.where(to_a, REGIONS[0][1], REGIONS[1][1]))


class PatrolByHand(NoisyUnicycleByHand, Patrol):
    pass
