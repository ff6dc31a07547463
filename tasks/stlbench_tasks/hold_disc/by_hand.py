"""Features that a person made for policies on hold-disc."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.hold_disc.system import HoldDisc


class HoldDiscByHand(HoldDisc):
    beyond_state = ("where the centre is, ahead and to the left", "a close-up of the last decimetres")

    def features(self, state: Array, t: Integers) -> Array:
        """The disc's centre (2, 2) as seen from the robot, ahead and to the left: (N, 4).

        In metres, and again as tanh over 0.2 m, which resolves the last decimetres.
        """
        dx, dy = 2 - state[:, 0], 2 - state[:, 1]
        cosine, sine = np.cos(state[:, 2]), np.sin(state[:, 2])
        ahead, left = dx * cosine + dy * sine, dy * cosine - dx * sine
        return np.stack([ahead, left, np.tanh(ahead / 0.2), np.tanh(left / 0.2)], axis=1)
