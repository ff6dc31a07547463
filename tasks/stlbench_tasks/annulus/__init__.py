"""The paper's convex predicate: stay in a ring. The system, and features that a person made for its policies."""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive, Steering, polar

CENTRE, MIDDLE = 5.0, 3.5
"""Both coordinates of the ring's centre, and the radius midway between its edges."""
_steer = Steering(speed=5.0, speed_step=0.5, turn=3.0, turn_step=0.5, held=0.1)


class Annulus(DifferentialDrive):
    """Mobile robot with a convex predicate: between 2 m and 5 m from a point, G[300,2000]."""

    room = (0.0, 15.0)

    def controller(self, state: Array, t: Integers) -> Array:
        """Straight to the nearest point of the middle of the ring: (N, 2)."""
        outwards = np.arctan2(state[:, 1] - CENTRE, state[:, 0] - CENTRE)
        return _steer(state, CENTRE + MIDDLE * np.cos(outwards), CENTRE + MIDDLE * np.sin(outwards))


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
