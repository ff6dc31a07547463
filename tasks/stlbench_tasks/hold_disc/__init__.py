"""The paper's comparative study: stay in a disc. The system, and features that a person made for its policies."""

from typing import ClassVar

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive, Steering


class HoldDisc(DifferentialDrive):
    """Comparative study: a differential-drive robot stays in a disc, G[0,200], sampled at 0.01 s."""

    room = (0.0, 4.0)

    turn_step: ClassVar[float] = 0.5
    """The step from one turning rate of the grid of actions to the next, in rad/s."""

    def controller(self, state: Array, t: Integers) -> Array:
        """Straight to the disc's centre, never away from it: (N, 2)."""
        return Steering(speed=5.0, speed_step=0.5, turn=3.0, turn_step=self.turn_step, held=self.dt)(state, 2.0, 2.0)


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
