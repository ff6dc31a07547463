"""The paper's overlapping intervals: two goals in turn, obstacles all the time. The system, and features that a
person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.differential_drive import DifferentialDrive, Steering, polar

SWITCH = 50.0
"""Seconds at which the first goal's interval ends and the second one's begins."""
_PASSAGE = 1.25
"""y midway between two of the obstacles, 0.25 m from both."""
_steer = Steering(speed=0.3, speed_step=0.03, turn=1.0, turn_step=1 / 6, held=0.5)


class Overlap(DifferentialDrive):
    """Mobile robot with overlapping intervals: off the obstacles for 100 s, at (3,1) by 50 s, at (1,3) by 90 s."""

    room = (0.0, 4.0)

    def controller(self, state: Array, t: Integers) -> Array:
        """Through the passage y = 1.25 to the first goal, and back, round the left, to the second one: (N, 2)."""
        x, y = state[:, :1], state[:, 1:2]
        aligned = abs(y - _PASSAGE) < 0.02
        west, east, up = (1.15, _PASSAGE), (2.75, _PASSAGE), (0.8, 2.75)
        there = np.select([x >= 2.7, aligned | (x > 1.4)], [(3.0, 1.0), east], west)
        back = np.select([y >= 2.7, x < 0.9, aligned | (x < 2.6)], [(1.0, 3.0), up, (0.8, _PASSAGE)], east)
        goal = np.where(t[:, None] * self.dt >= SWITCH, back, there)
        return _steer(state, goal[:, 0], goal[:, 1])


_ROOM, _ROOM_HALF = (2.0, 2.0), 2.0
_OBSTACLES, _OBSTACLE_HALF = ((2.0, 2.0), (2.0, 0.5), (3.0, 3.0)), 0.5
_FEELER = 0.3
"""Metres from the robot at which it feels for obstacles."""


class OverlapByHand(Overlap):
    beyond_state = (
        "which goal counts",
        "distance and bearing of that goal",
        "clearance here and at four points around",
        "close-ups of goal and clearance",
    )

    def features(self, state: Array, t: Integers) -> Array:
        """Pose, goal and obstacles: (N, 15).

        x and y over 2 m from the room's middle, the heading's cosine and sine; 1 for the second goal, else -1; the
        goal's distance over 2 m and as tanh over 0.3 m, its bearing's cosine and sine, which fade out there. Then the
        clearance over 0.5 m and as tanh over 0.2 m. Last the clearance 0.3 m ahead, to the left, behind and to the
        right, as tanh over 0.25 m.
        """
        x, y, heading = state.T
        second = t * self.dt >= SWITCH
        distance, bearing = polar(state, np.where(second, 1.0, 3.0), np.where(second, 3.0, 1.0))
        near, here = np.tanh(distance / 0.3), _clearance(x, y)
        turns = heading + np.array([[0.0], [0.5], [1.0], [1.5]]) * np.pi
        around = _clearance(x + _FEELER * np.cos(turns), y + _FEELER * np.sin(turns))
        columns = [x / 2 - 1, y / 2 - 1, np.cos(heading), np.sin(heading), second * 2.0 - 1]
        columns += [distance / 2 - 1, near, np.cos(bearing) * near, np.sin(bearing) * near]
        return np.stack([*columns, here * 2, np.tanh(here * 5), *np.tanh(around * 4)], axis=1)


def _clearance(x: Array, y: Array) -> Array:
    """The margin of the formula's G term: infinity norm to the nearest wall or obstacle, negative inside one."""
    margin = _ROOM_HALF - np.maximum(abs(x - _ROOM[0]), abs(y - _ROOM[1]))
    for cx, cy in _OBSTACLES:
        margin = np.minimum(margin, np.maximum(abs(x - cx), abs(y - cy)) - _OBSTACLE_HALF)
    return margin
