"""The robot of the convex predicate."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive
from stlbench_tasks.steering import Steering

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
