"""Gymnasium's Walker2d-v5 whose speed returns to a band again and again, G[0,300] with F[0,100], with a gait by hand;
needs the extra mujoco.
"""

from collections.abc import Mapping, Sequence
from math import pi, sin
from typing import Any

from stlbench.contract import GymTask

_PERIOD, _STIFF, _CALM = 83.410, 2.883, 0.103
"""Steps of a stride, torque a rad off, and torque against a rad/s."""
_JOINTS = (
    (0.528, -0.641, -1.468, -0.4, -0.121, -0.142),
    (0.737, 1.456, 2.874, 0.401, -0.305, 0.421),
    (0.385, 0.578, 2.165, -1.199, -0.067, -0.324),
)
"""For thigh, leg and foot: middle, swing to each side and phase of the aim in rad; and by how much the aim changes a
rad of lean, a rad/s of lean, and a m/s that the speed is off."""
_SPEED = 1.0
"""The middle of the band in m/s."""
_ANGLES, _RATES = 2, 11
"""The places of the first joint's angle and of its speed in the observation."""


class WalkerBand(GymTask):
    """Walker whose speed returns to a band again and again, G[0,300] with F[0,100]; needs the extra mujoco."""

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        """Torques (6,) in [-1, 1] of a gait that a search over its numbers found; the left leg is half a stride off."""
        lean, speed, turning = float(observation[1]), float(observation[8]), float(observation[10])
        torques = []
        for i in range(6):
            middle, swing, phase, by_lean, by_turning, by_speed = _JOINTS[i % 3]
            aim = middle + swing * sin(2 * pi * t / _PERIOD + phase + pi * (i // 3))
            aim += by_lean * lean + by_turning * turning + by_speed * (speed - _SPEED)
            torque = _STIFF * (aim - float(observation[_ANGLES + i])) - _CALM * float(observation[_RATES + i])
            torques.append(max(-1.0, min(1.0, torque)))
        return torques
