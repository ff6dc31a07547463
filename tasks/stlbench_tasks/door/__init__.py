"""The Adroit hand of Gymnasium-Robotics that opens a door with a latch and keeps it open, F G, with a way by hand; it
needs the extra mujoco.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stlbench.contract import GymTask

_BEGUN = np.array([0, 35, 60, 85, 120, 160])
"""The step from which each pose is the aim."""
_CHANGE = 10
"""Steps in which one pose becomes the next."""
_POSES = np.array(
    [
        [-0.27, -0.311, 0.364, -0.402, 0.554, -0.567, 0.247, -1.671],
        [0.026, 0.007, 0.158, -0.904, -0.228, 0.142, 0.622, 0.846],
        [-0.01, -0.074, -0.12, -0.9, -0.508, -0.58, 1.043, -0.09],
        [0.034, -0.374, 0.024, 2.209, 0.646, 0.653, 0.74, -3.863],
        [0.286, -0.336, -0.04, 3.688, 0.038, 0.294, 0.79, -0.862],
        [0.112, -0.423, -0.042, 0.833, 0.003, 0.096, 1.262, -0.556],
    ]
)
"""Each pose: x, y and z of the palm from the handle in m; roll, both joints of the wrist, the bend of the fingers and
of the thumb in rad."""
_BY_HEIGHT = np.array(
    [
        [-0.011, -0.008, 0.008, -0.021, -0.039, 0.009, 0.077, -0.122],
        [0.016, 0.013, -0.014, 0.022, -0.048, -0.03, 0.006, -0.19],
        [-0.012, -0.004, -0.012, 0.132, 0.027, 0.004, 0.052, -0.019],
        [-0.008, -0.012, -0.007, -0.113, -0.028, 0.024, 0.035, -0.028],
        [0.011, 0.007, -0.005, -0.101, 0.05, -0.033, 0.006, 0.02],
        [-0, -0, -0.008, 0.094, 0.002, -0.018, -0.154, 0.013],
    ]
)
"""By how much the numbers of a pose change for each 5 cm that the latch stands above 0.3 m."""
_WITH_DOOR, _WRIST_0, _WRIST_1, _ROLL = 0.166, -0.406, -0.132, -0.085
"""The palm's way from the handle turns by so many rad a rad of the door. The wrist and the roll change a rad of the
arm's turns."""
_LOW = np.array([-0.3, -0.75, -0.75, -1.0, -0.524, -0.79])
_HIGH = np.array([0.5, 0.75, 0.75, 2.0, 0.175, 0.61])
"""The ends of what the actions -1 and 1 ask of arm and wrist."""
_PUSH, _ARM, _FAR = 0.4, 0.5, 0.15
"""The part of an arm's aim that is asked for, since its motors stop there; the arm in m; and the most that the palm is
sent off in m.
"""
_FINGERS = [7, 8, 9, 11, 12, 13, 15, 16, 17, 20, 21, 22]
"""The actions that bend fingers by 0 to 1.6 rad."""


class Door(GymTask):
    """Adroit hand that opens a door and keeps it open, F[0,200] G[0,40]; needs the extra mujoco."""

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        """Actions (28,) that bring the palm from pose to pose about the handle."""
        turns, latch, door = observation[:3], observation[27], observation[28]
        palm, handle = observation[29:32], observation[32:35]
        # The handle's end goes down as the latch turns; with that added, it tells how high the door stands.
        height = (handle[2] + 0.15 * np.sin(latch) - 0.3) / 0.05
        k = int(np.searchsorted(_BEGUN, t, side="right")) - 1
        poses, share = _POSES + height * _BY_HEIGHT, min(1.0, (t - _BEGUN[k]) / _CHANGE)
        pose = (1 - share) * poses[max(k - 1, 0)] + share * poses[k]
        cosine, sine = np.cos(_WITH_DOOR * door), np.sin(_WITH_DOOR * door)
        way = np.array([cosine * pose[0] - sine * pose[1], sine * pose[0] + cosine * pose[1], pose[2]])
        off = np.clip(handle + way - palm, -_FAR, _FAR)
        pushed = palm[1] + 0.2 + _ARM * (1 - np.cos(turns[0]) * np.cos(turns[1]))
        arm = [pushed + off[1], turns[0] - off[2] / _ARM, turns[1] - off[0] / _ARM, pose[3] + _ROLL * turns[1]]
        wrist = [pose[4] + _WRIST_1 * turns[1], pose[5] + _WRIST_0 * turns[0]]
        actions = np.zeros(28)
        actions[:6] = (2 * np.array([*(_PUSH * np.array(arm)), *wrist]) - _LOW - _HIGH) / (_HIGH - _LOW)
        actions[_FINGERS] = pose[6] / 0.8 - 1
        actions[[18, 24, 27]] = -1, pose[7] / 0.65 - 1, 1 - max(pose[7], 0) / 0.7855
        found: list[float] = np.clip(actions, -1, 1).tolist()
        return found
