"""Gymnasium's HalfCheetah-v5 whose speed returns to a band again and again, G[0,150] with F[0,50], with a gait by hand;
needs the extra mujoco.
"""

from collections.abc import Mapping, Sequence
from math import pi, sin
from typing import Any

from stlbench.contract import GymTask

_PERIOD, _STIFF = 8.346, 0.763
"""Steps of a stride, and torque a rad off."""
_SWINGS = (
    (-0.355, 0.26, 4.834),
    (0.16, 0.677, 0.709),
    (0.281, 0.344, 4.668),
    (0.195, 0.65, 4.147),
    (0.15, 0.329, 3.123),
    (0.484, 0.196, 5.54),
)
"""For each joint from the back thigh to the front foot: its middle, its swing to each side and its phase, in rad."""
_JOINTS = 2
"""The place of the first joint's angle in the observation."""


class CheetahBand(GymTask):
    """Half-cheetah whose speed returns to a band again and again, G[0,150] with F[0,50]; needs the extra mujoco."""

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        """Torques (6,) in [-1, 1] of a gait that a search over its numbers found in 100 CPU seconds."""
        torques = []
        for joint, (middle, swing, phase) in enumerate(_SWINGS):
            aim = middle + swing * sin(2 * pi * t / _PERIOD + phase)
            torques.append(max(-1.0, min(1.0, _STIFF * float(aim - observation[_JOINTS + joint]))))
        return torques
