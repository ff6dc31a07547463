"""The paper's task on the ball-in-cup of the DeepMind control suite: catch, let go, catch. The system, and features
that a person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.mujoco_model import MujocoSystem, columns

_BALL_HEIGHT = 0.2
"""Metres above the ground at which the model's coordinate of the ball is zero."""
_HELD, _WEIGHT = 5, 0.14
"""Steps that a row below is held, and the force, in units of 5 N, that carries the cup."""
_CATCH = np.array(
    [
        *((0.6, -0.1), (-0.4, 0.4), (0.1, -0.3), (-1.0, -0.9), (-0.9, -0.2), (-0.6, 0.6)),
        *((0.2, 0.4), (1.0, -0.9), (0.9, -0.5), (0.6, 0.3), (0.0, 0.6), (-0.3, 0.4)),
    ]
)
_LET_GO = np.array([(-1.0, 0.1), (-0.1, -0.1), (-0.2, 0.4), (-0.2, 0.8), (-0.1, -1.0), (0.8, -0.4), (0.3, -0.9)])
_SWINGS = ((145, _CATCH), (300, _LET_GO), (660, _CATCH))
"""The step at which each swing begins, and its forces; found by search, from a ball that hangs or lies still."""


class BallInCup(MujocoSystem):
    """Cup that catches a ball on a string, lets it go and catches it again, three terms G; needs the extra mujoco.

    State: of cup and ball in m, each from its own zero, then the ball's place less the cup's. Action: the forces on
    the cup, in units of 5 N. Signal: distance of the ball from the cup, the middle of its rim, in m.
    """

    model_file = ("dm_control", "suite/ball_in_cup.xml")
    state = columns(("cup_x", "cup_z", "ball_x", "ball_z"), "x", "z")
    coordinates = ("ball_x", "ball_z")

    def __init__(self, dt: float) -> None:
        super().__init__(dt)
        self._cup, self._ball = self.model.body("cup").id, self.model.body("ball").id

    def initial_states(self, coordinates: Array) -> Array:
        """The cup at rest, the ball at (x, height above the ground) and at rest: (N, 2) -> (N, 14)."""
        positions = np.zeros((len(coordinates), 4))
        positions[:, 2:] = coordinates - [0.0, _BALL_HEIGHT]
        return self.placed(positions, np.zeros((len(coordinates), 4)))

    def derived(self) -> Array:
        """The ball's place less the cup's, x and z: (2,)."""
        difference: Array = self.data.xpos[self._ball, ::2] - self.data.xpos[self._cup, ::2]
        return difference

    def signals(self, state: Array) -> Array:
        """distance: (..., 14) -> (..., 1)."""
        return np.hypot(state[..., -2:-1], state[..., -1:])

    def scaled_state(self, state: Array) -> Array:
        """Places of cup and ball, each from its own zero, over 0.33 m, and their speeds over 2 m/s: (N, 8).

        The rest of the state, where MuJoCo's solver starts its search, is not shown.
        """
        return np.concatenate([state[:, :4] * 3, state[:, 4:8] / 2], axis=1)

    def controller(self, state: Array, t: Integers) -> Array:
        """Let the cup follow the ball until it hangs or lies still, and swing at three fixed times: (N, 2).

        A ball that already lies in the cup is not swung at.
        """
        x, z = state[:, -2:].T
        v_x, v_z = (state[:, 6:8] - state[:, 4:6]).T
        follow = np.clip(3 * x - 0.5 * v_x - 0.6 * state[:, 4], -1, 1)
        action = np.stack([follow, np.full(len(state), _WEIGHT)], axis=1)
        caught = (np.hypot(x, z) < 0.08) & (np.hypot(v_x, v_z) < 0.1)
        for begin, swing in _SWINGS:
            row = (t - begin) // _HELD
            now = (row >= 0) & (row < len(swing))
            if swing is _CATCH:
                now &= ~caught
            action[now] = swing[row[now]]
        return action


_SWITCHES = np.array([300, 600])
"""The last steps of the first two intervals: to let the ball go, and to catch it again, begin after them."""


class BallInCupByHand(BallInCup):
    beyond_state = ("whether the ball is to be caught", "where the ball is from the cup")

    def features(self, state: Array, t: Integers) -> Array:
        """The cup's place, the ball's from there, their speeds, and what is asked for at t: (N, 9).

        Places of the cup over 0.33 m and of the ball over 0.25 m, speeds over 2 m/s; 1 where the ball is to be caught
        and -1 where it is to be let go.
        """
        caught = 1.0 - 2.0 * (np.searchsorted(_SWITCHES, t, side="right") == 1)
        return np.concatenate([state[:, :2] * 3, state[:, -2:] * 4, state[:, 4:8] / 2, caught[:, None]], axis=1)
