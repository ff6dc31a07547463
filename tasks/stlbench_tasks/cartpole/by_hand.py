"""Features that a person made for policies on cartpole."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.cartpole.system import PLACE, Cartpole, place_at


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
