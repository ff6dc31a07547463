"""The paper's task on the cart-pole of the DeepMind control suite: balance at one place, then at another. The
system, and features that a person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.mujoco_model import MujocoSystem, columns

_SWITCH = 500
"""The last step of the first place's interval: the cart goes to the second place after it."""
PLACE = 0.5
_GAIN = np.array([1.7, 9.0, 1.7, 2.4])
"""About the linear-quadratic regulator for actions held 0.05 s: costs 1 on x^2 and theta^2, 0.1 on other squares."""


class Cartpole(MujocoSystem):
    """Cart-pole that balances at x = 0.5, then at -0.5, G[400,500] & G[900,1000]; needs the extra mujoco.

    State: x of the cart in m, theta of the pole in rad, 0 upright and not wrapped. Action: the force on the cart, in
    units of 10 N. Signals: x, theta wrapped to [-pi, pi), omega.
    """

    model_file = ("dm_control", "suite/cartpole.xml")
    state = columns(("x", "theta"))
    coordinates = ("x", "theta", "v", "omega")

    def initial_states(self, coordinates: Array) -> Array:
        """Position, angle, speed and angular speed (N, 4) -> (N, 6)."""
        return self.placed(coordinates[:, :2], coordinates[:, 2:])

    def arrive(self) -> None:
        """Nothing: all that is read are the joints."""

    def signals(self, state: Array) -> Array:
        """x, theta, omega: (..., 6) -> (..., 3)."""
        theta = (state[..., 1] + np.pi) % (2 * np.pi) - np.pi
        return np.stack([state[..., 0], theta, state[..., 3]], axis=-1)

    def scaled_state(self, state: Array) -> Array:
        """Position over 1.8 m, the rail's end, the angle's cosine and sine, speeds over 2 m/s and 4 rad/s: (N, 5).

        The rest of the state, where MuJoCo's solver starts its search, is not shown.
        """
        x, theta, v, omega = state[:, :4].T
        return np.stack([x / 1.8, np.cos(theta), np.sin(theta), v / 2, omega / 4], axis=1)

    def controller(self, state: Array, t: Integers) -> Array:
        """A linear-quadratic regulator about the place that counts at t: (N, 1)."""
        error = state[:, :4] - place_at(t)[:, None] * [1, 0, 0, 0]
        force: Array = np.clip(error @ _GAIN, -1, 1)
        return force[:, None]


def place_at(t: Integers) -> Array:
    """The place where the cart is wanted from step t on, in m."""
    return np.where(t < _SWITCH, PLACE, -PLACE)


class CartpoleByHand(Cartpole):
    beyond_state = ("which place counts", "a close-up of the way to it", "a close-up of the angle")

    def features(self, state: Array, t: Integers) -> Array:
        """The cart's place, the pole's angle, both speeds, and the place that counts at t: (N, 8).

        Position in m, the angle's sine and cosine, speed in m/s, angular speed in 2 rad/s; to resolve what is left,
        the tanh of the way to the place over 0.2 m and of the angle over 0.1 rad; 1 for the first place, -1 for the
        second.
        """
        x, theta, v, omega = state[:, :4].T
        place = place_at(t)
        fine = [np.tanh((x - place) / 0.2), np.tanh(np.sin(theta) / 0.1)]
        return np.stack([x, np.sin(theta), np.cos(theta), v, omega / 2, *fine, place / PLACE], axis=1)
