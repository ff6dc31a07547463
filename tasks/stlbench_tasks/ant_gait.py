"""A walk by hand for Gymnasium's Ant: a trot towards a place, without turning. Needs the extra mujoco.

The four legs are alike, so the ant walks in each direction as well as in any other. Legs that are opposite on the
diagonal move together. While the feet of one pair are down, their hips sweep against the way to go.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from math import atan2, cos, hypot, pi, sin
from typing import Any

from stlbench.contract import GymTask

_LEGS = (pi / 4, 3 * pi / 4, -3 * pi / 4, -pi / 4)
"""The directions of the legs 1 to 4, from the torso's x axis."""
_BENT = (1, -1, -1, 1)
"""The sign by which a leg's ankle bends down."""
_ACTED = (3, 0, 1, 2)
"""The legs in the order of the actions, each with its hip and its ankle."""
_PERIOD, _SWEEP, _DOWN, _UP = 11, 0.56, 1.02, 0.88
"""Steps of a stride; how far a hip sweeps to each side, and an ankle's bend on the ground and in the air, in rad."""
_STIFF, _DAMPED = 0.68, 0.036
"""Torque a rad off, and a rad/s."""
_NEAR = 0.3
"""Metres to the place from which strides become shorter."""
_JOINTS, _SPEEDS = 7, 21
"""The places of the joints' angles and of their speeds in an observation that begins with x and y."""


class AntWalk(GymTask):
    """An ant that trots to its `place`; a search over the gait's six numbers found it in 20 CPU seconds."""

    @abstractmethod
    def place(self, x: float, y: float, t: int) -> tuple[float, float]:
        """The place to go to at step t from x, y."""

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        """Torques (8,) in [-1, 1]."""
        x, y, _, w, i, j, k = map(float, observation[:_JOINTS])
        to_x, to_y = self.place(x, y, t)
        turned = atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k))
        way, stride = atan2(to_y - y, to_x - x) - turned, min(1.0, hypot(to_x - x, to_y - y) / _NEAR)
        torques = []
        for leg in _ACTED:
            phase = 2 * pi * t / _PERIOD + pi * (leg % 2)
            hip = _SWEEP * stride * sin(way - _LEGS[leg]) * cos(phase)
            ankle = _DOWN if sin(phase) > 0 else _DOWN + stride * (_UP - _DOWN)
            for joint, aim in ((2 * leg, hip), (2 * leg + 1, _BENT[leg] * ankle)):
                torque = _STIFF * (aim - observation[_JOINTS + joint]) - _DAMPED * observation[_SPEEDS + joint]
                torques.append(max(-1.0, min(1.0, float(torque))))
        return torques
