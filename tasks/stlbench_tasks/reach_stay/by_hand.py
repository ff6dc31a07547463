"""Features that a person made for policies on reach-stay."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.reach_stay.system import GOAL, ReachStay
from stlbench_tasks.steering import polar


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
