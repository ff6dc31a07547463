"""The paper's inverted pendulum (sec. IV-A): three angles in turn. The system, and features that a person made for
its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers, System
from stlbench_tasks.differential_drive import nearest

_GRAVITY, _MASS, _LENGTH, _FRICTION = 9.8, 0.15, 0.5, 0.05
_INERTIA = _MASS * _LENGTH**2
TARGETS = np.array([0.0, 1.57, -1.57])
"""The angle that each of the formula's intervals asks for."""
BEGINS = np.array([0, 700, 1200])
"""The step from which the pendulum heads for each target: the end of the interval before."""


class Pendulum(System):
    """Inverted pendulum held at 0, 1.57 and -1.57 in turn, G[400,700] & G[1000,1200] & G[1700,2000].

    theta' = theta + dt omega, omega' = omega + dt (g/l sin theta - mu/(m l^2) omega + torque/(m l^2)).
    State: theta in rad, 0 upright and not wrapped, omega in rad/s.
    """

    state = ("theta", "omega")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 2), (N, 1) -> (N, 2)."""
        theta, omega = state[:, 0], state[:, 1]
        return np.stack([theta + self.dt * omega, omega + self.dt * (_drift(state) + action[:, 0] / _INERTIA)], axis=1)

    def signals(self, state: Array) -> Array:
        """theta, omega: (..., 2) -> (..., 2)."""
        return state

    def scaled_state(self, state: Array) -> Array:
        """theta over pi and omega over 6 rad/s: (N, 2) -> (N, 2).

        No cosine and sine, since the formula tells a whole turn from none. theta counts as at most 9 in size, as its
        error in `features`: so much is too far to come back.
        """
        return np.stack([np.clip(state[:, 0], -9, 9) / np.pi, state[:, 1] / 6], axis=1)

    def controller(self, state: Array, t: Integers) -> Array:
        """The torque whose next omega is nearest to -3 times the error, at most 6 rad/s: (N, 1)."""
        speed = np.clip(-3 * (state[:, 0] - TARGETS[phase_at(t)]), -6, 6)
        torque = _INERTIA * ((speed - state[:, 1]) / self.dt - _drift(state))
        return nearest(torque, 3.0, 0.1)[:, None]


def phase_at(t: Integers) -> Integers:
    """The target that counts from step t on: 0, 1, 2."""
    return np.searchsorted(BEGINS, t, side="right") - 1


def _drift(state: Array) -> Array:
    """The angular acceleration without torque, in rad/s^2: (N, 2) -> (N,)."""
    drift: Array = _GRAVITY / _LENGTH * np.sin(state[:, 0]) - _FRICTION / _INERTIA * state[:, 1]
    return drift


_WAITS = np.array([400, 300, 500])
"""Steps from there to the target's own interval."""
_WIDEST, _TOLERANCE, _NARROWEST = np.pi, 0.05, 0.03


class PendulumByHand(Pendulum):
    beyond_state = (
        "which target counts",
        "error from that target",
        "close-ups of error and speed",
        "logarithm of a width that falls to the tolerance in time, as a funnel's",
    )

    def features(self, state: Array, t: Integers) -> Array:
        """Error and speed at three scales, which target it is, and how far its deadline: (N, 8).

        The error is theta less the present target, at most 9 in size; the target is -1, 0 or 1 for the first to the
        third. The deadline is half of the logarithm of a width, plus 1. The width falls from pi at the start of a phase
        towards 0.03, as the paper's funnels do, and is 0.05 when the interval begins.
        """
        phase = phase_at(t)
        error, omega = np.clip(state[:, 0] - TARGETS[phase], -9, 9), state[:, 1]
        rate = np.log((_WIDEST - _NARROWEST) / (_TOLERANCE - _NARROWEST)) / _WAITS[phase]
        width = (_WIDEST - _NARROWEST) * np.exp(-rate * (t - BEGINS[phase])) + _NARROWEST
        scales = [column for e in (error, omega) for column in (e / 2, np.tanh(e / 0.3), np.tanh(e / 0.05))]
        return np.stack([*scales, phase - 1.0, np.log(width) / 2 + 1], axis=1)
