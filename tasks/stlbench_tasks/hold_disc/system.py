"""The robot of the comparative study."""

from __future__ import annotations

from typing import ClassVar

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive
from stlbench_tasks.steering import Steering


class HoldDisc(DifferentialDrive):
    """Comparative study: a differential-drive robot stays in a disc, G[0,200], sampled at 0.01 s."""

    room = (0.0, 4.0)

    turn_step: ClassVar[float] = 0.5
    """The step from one turning rate of the grid of actions to the next, in rad/s."""

    def controller(self, state: Array, t: Integers) -> Array:
        """Straight to the disc's centre, never away from it: (N, 2)."""
        return Steering(speed=5.0, speed_step=0.5, turn=3.0, turn_step=self.turn_step, held=self.dt)(state, 2.0, 2.0)
