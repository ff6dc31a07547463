"""stlpy's scenario for a double integrator: one of two targets, then the goal, off the obstacle. The system, and
features that a person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers, System

PLACES = np.array([[1.5, 6.5], [7.5, 5.0], [7.5, 8.5]])
"""Centres of the two targets and of the goal."""
_SPEED, _FORCE = 1.0, 0.5
_BELOW, _BESIDE = 2.9, 5.4
"""y at which the controller passes under the obstacle, and the x from which it is beside it."""
_LEAVE, _AIM = 15, 9.5
"""The step at which the controller leaves the second target, and the y that it aims at: it is in the goal's middle at
step 20, at full speed."""


class EitherOr(System):
    """Double integrator that stays in one of two targets, reaches the goal and keeps off the obstacle, by 20 steps.

    p' = p + dt v, v' = v + dt u, where v stays in [-1, 1]. State: p = (x, y) in m, v in m/s. Action: u in m/s^2.
    Signals: x, y. stlpy has the bounds of v as constraints: what they allow and what is possible here is the same.
    """

    state = ("x", "y", "v_x", "v_y")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 4), (N, 2) -> (N, 4)."""
        place, velocity = state[:, :2], state[:, 2:]
        faster = np.clip(velocity + self.dt * action, -_SPEED, _SPEED)
        return np.concatenate([place + self.dt * velocity, faster], axis=1)

    def signals(self, state: Array) -> Array:
        """x, y: (..., 4) -> (..., 2)."""
        return state[..., :2]

    def scaled_state(self, state: Array) -> Array:
        """x and y from -1 to 1 over [0, 10] m, v_x and v_y in m/s, which stay in [-1, 1]: (N, 4) -> (N, 4)."""
        return np.concatenate([state[:, :2] / 5 - 1, state[:, 2:]], axis=1)

    def controller(self, state: Array, t: Integers) -> Array:
        """Below the obstacle to the second target, and at a fixed step on through the goal: (N, 2)."""
        x, y = state[:, 0], state[:, 1]
        under = np.where((x < _BESIDE) & (y < 4), _BELOW, PLACES[1, 1])
        wanted = np.stack([np.full(len(state), PLACES[1, 0]), np.where(t < _LEAVE, under, _AIM)], axis=1)
        return _approach(wanted - state[:, :2], state[:, 2:], self.dt)


def _approach(way: Array, velocity: Array, dt: float) -> Array:
    """The forces (N, 2) that bring the robot to rest at the end of the way (N, 2) in m, as soon as it can.

    The next steps' places are given by the velocity; what is left then is walked at the greatest speed from which one
    or two steps of full force bring it to rest there.
    """
    left = way / dt - velocity
    least = np.minimum(np.abs(left), (np.abs(left) + _FORCE * dt) / 2)
    wanted = np.sign(left) * np.minimum(least, _SPEED)
    force: Array = np.clip((wanted - velocity) / dt, -_FORCE, _FORCE)
    return force


_OBSTACLE = (4.0, 5.0)
"""Its centre; its sides are 2 m long."""


class EitherOrByHand(EitherOr):
    beyond_state = ("where both targets and the goal are", "where the obstacle is, and a close-up of it")

    def features(self, state: Array, t: Integers) -> Array:
        """The state, and where the regions are: (N, 15).

        The scaled state; the way to each target and to the goal as tanh over 1 m; the way to the obstacle's centre over
        5 m and as tanh over 1 m; the margin to its edge as tanh over 0.5 m.
        """
        place = state[:, :2]
        ways = np.tanh(PLACES.ravel() - np.tile(place, 3))
        off = np.array(_OBSTACLE) - place
        margin = np.tanh((np.abs(off).max(axis=1, keepdims=True) - 1) / 0.5)
        return np.concatenate([self.scaled_state(state), ways, off / 5, np.tanh(off), margin], axis=1)
