"""The robot that reaches a disc and stays."""

from __future__ import annotations

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive
from stlbench_tasks.steering import Steering

GOAL = 10.0
"""Both coordinates of the disc's centre."""
_steer = Steering(speed=5.0, speed_step=0.5, turn=3.0, turn_step=0.5, held=0.1)


class ReachStay(DifferentialDrive):
    """Mobile robot that reaches a disc within 6 s and stays for 2 s, F[0,600] G[0,200]."""

    room = (-5.0, 15.0)

    def controller(self, state: Array, t: Integers) -> Array:
        """Straight to the disc's centre: (N, 2)."""
        return _steer(state, GOAL, GOAL)
