"""Gymnasium's CartPole-v1, written from its equations, to be kept slow, in the middle and upright. The system, and
features that a person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers, System

_GRAVITY, _CART, _POLE, _HALF = 9.8, 1.0, 0.1, 0.5
"""m/s^2, kg, kg, and half of the pole's length in m."""
_LOST = 12 * 2 * np.pi / 360
"""The angle at which Gymnasium's episode terminates, in rad."""
_GAIN = np.array([1.0, 2.2, 22.0, 4.2])
"""Weights of x, its speed, theta and its speed: the sign of the sum is that of the force."""


class CartpoleSteady(System):
    """Cart-pole with two forces that is kept slow, in the middle and upright, G[0,490] with F[0,10] of a slow cart.

    The equations of Barto, Sutton, Anderson (1983) with Gymnasium's constants, in explicit Euler steps, the same bit
    for bit. State and signals as there: x of the cart in m, theta of the pole in rad, 0 upright and not wrapped, and
    their speeds. Action: the force on the cart in N. Episodes that Gymnasium ends go on here.
    """

    state = ("x", "x_dot", "theta", "theta_dot")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 4), (N, 1) -> (N, 4)."""
        _, x_dot, theta, theta_dot = state.T
        cosine, sine = np.cos(theta), np.sin(theta)
        total = _CART + _POLE
        push = (action[:, 0] + _POLE * _HALF * np.square(theta_dot) * sine) / total
        turning = (_GRAVITY * sine - cosine * push) / (_HALF * (4.0 / 3.0 - _POLE * np.square(cosine) / total))
        pushed = push - _POLE * _HALF * turning * cosine / total
        change = np.stack([x_dot, pushed, theta_dot, turning], axis=1)
        return state + self.dt * change

    def signals(self, state: Array) -> Array:
        """x, x_dot, theta: (..., 4) -> (..., 3)."""
        return state[..., :3]

    def scaled_state(self, state: Array) -> Array:
        """x in m, theta over the 12 degrees that end Gymnasium's episodes, speeds over 2 m/s and 2 rad/s: (N, 4).

        theta is small or the pole is lost, so there is no cosine and sine.
        """
        return state / [1.0, 2.0, _LOST, 2.0]

    def controller(self, state: Array, t: Integers) -> Array:
        """Full force to the side to which a weighted sum of the state points: (N, 1)."""
        return np.where(state @ _GAIN > 0, 10.0, -10.0)[:, None]


class CartpoleSteadyByHand(CartpoleSteady):
    beyond_state = ("close-ups of place, speed and angle",)

    def features(self, state: Array, t: Integers) -> Array:
        """The scaled state, and the tanh of place, speed and angle over 0.5 m, 0.2 m/s and 0.2 rad: (N, 7)."""
        fine = np.tanh(state[:, :3] / [0.5, 0.2, 0.2])
        return np.concatenate([self.scaled_state(state), fine], axis=1)
