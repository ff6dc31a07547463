"""Features that a person made for policies on the tasks dwell and patrol."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.noisy_unicycle import REGIONS, NoisyUnicycle
from stlbench_tasks.steering import polar


class NoisyUnicycleByHand(NoisyUnicycle):
    beyond_state = ("distance and bearing of each region", "close-ups of both")

    def features(self, state: Array, t: Integers) -> Array:
        """The pose, and each region from there: (N, 12).

        x and y from -1 to 1 over the room, the heading's cosine and sine. A, then B: the centre's distance over
        5 m and as tanh over 0.5 m, and its bearing's cosine and sine, which fade out at the centre.
        """
        columns = [self.scaled_state(state)]
        for x, y in REGIONS:
            distance, bearing = polar(state, x, y)
            near = np.tanh(distance / 0.5)
            columns.append(np.stack([distance / 5, near, np.cos(bearing) * near, np.sin(bearing) * near], axis=1))
        return np.concatenate(columns, axis=1)
