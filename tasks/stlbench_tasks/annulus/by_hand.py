"""Features that a person made for policies on annulus."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.annulus.system import CENTRE, MIDDLE, Annulus
from stlbench_tasks.steering import polar


class AnnulusByHand(Annulus):
    beyond_state = ("distance from the middle of the ring", "bearing of its centre", "a close-up of the last metre")

    def features(self, state: Array, t: Integers) -> Array:
        """How far out of the middle of the ring, and where its centre lies: (N, 4).

        Over 5 m and, to resolve the last metre, as tanh over 1 m; the cosine and sine of the centre's bearing, which
        fade out at the centre, where it has no meaning.
        """
        distance, bearing = polar(state, CENTRE, CENTRE)
        out, near = distance - MIDDLE, np.tanh(distance)
        return np.stack([out / 5, np.tanh(out), np.cos(bearing) * near, np.sin(bearing) * near], axis=1)
