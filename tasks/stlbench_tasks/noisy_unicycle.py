"""A unicycle near two regions, whose velocities are disturbed (Ikemoto, Ushio 2022). Also its random numbers, and
features that a person made for policies on its tasks.

The bits of the seed are mixed once, the count is added in multiples of an odd constant, and the sum is mixed again: the
generator SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), entered at any place of its sequence. Box and Muller make pairs
of normal numbers of pairs of uniform ones.
"""

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Integers, System
from stlbench_tasks.differential_drive import Steering, polar

_Bits = NDArray[np.uint64]
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIXING = ((30, np.uint64(0xBF58476D1CE4E5B9)), (27, np.uint64(0x94D049BB133111EB)))


def normal(seed: Array, count: Array, columns: int) -> Array:
    """Standard normal numbers (N, columns), the same for the same seed (N,) and count (N,), whole and not negative.

    Numbers of different counts, of different seeds and in different columns are as good as independent. Any float
    is a seed.
    """
    pairs = (columns + 1) // 2
    first: _Bits = np.multiply(count.astype(np.uint64), np.uint64(2 * pairs))
    place: _Bits = np.add.outer(first, np.arange(1, 2 * pairs + 1, dtype=np.uint64))
    key = _mixed(np.ascontiguousarray(seed + 0.0).view(np.uint64))  # 0 and -0 are one seed
    uniform = ((_mixed(key[:, None] + place * _GOLDEN) >> np.uint64(11)) + 0.5) * 2.0**-53
    radius, angle = np.sqrt(-2 * np.log(uniform[:, :pairs])), 2 * np.pi * uniform[:, pairs:]
    return np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[:, :columns]


def _mixed(bits: _Bits) -> _Bits:
    """Each number's bits mixed: every new bit depends on every old one."""
    for shift, factor in _MIXING:
        bits = (bits ^ (bits >> np.uint64(shift))) * factor
    return bits ^ (bits >> np.uint64(31))


REGIONS = ((4.0, 4.0), (4.0, 2.0))
"""Centres of the regions A and B, squares with sides of 1 m."""
drive = Steering(speed=1.0, speed_step=0.05, turn=1.55, turn_step=0.05, held=0.5)
"""Drives to a point within a held action's 0.5 s."""


class NoisyUnicycle(System):
    """x' = x + dt (v cos(heading) + w1), y' = y + dt (v sin(heading) + w2), heading' = heading + dt (omega + w3).

    Each w is normal with mean 0 and standard deviation `noise`, in m/s and rad/s, independent of all others. A system
    draws no random numbers: w is a function of two more columns of the state. `seed`, any number, is drawn with the
    initial state; `count` is the number of steps so far. Features and scaled state do not show them. Whoever sees the
    whole state could know the noise beforehand; the hand controllers do not look.

    State: x, y in metres, heading in radians, not wrapped. Action: v in m/s, omega in rad/s. Signals: x, y.
    """

    state = ("x", "y", "heading", "seed", "count")
    coordinates = ("x", "y", "heading", "seed")

    def __init__(self, dt: float, *, noise: float = 0.1) -> None:
        super().__init__(dt)
        self.noise = noise

    def initial_states(self, coordinates: Array) -> Array:
        """Pose and seed (N, 4), of which nothing has been used up: (N, 5)."""
        return np.concatenate([coordinates, np.zeros((len(coordinates), 1))], axis=1)

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 5), (N, 2) -> (N, 5)."""
        heading, seed, count = state[:, 2:].T
        velocity = self.noise * normal(seed, count, 3)
        velocity[:, 0] += action[:, 0] * np.cos(heading)
        velocity[:, 1] += action[:, 0] * np.sin(heading)
        velocity[:, 2] += action[:, 1]
        after = state.copy()
        after[:, :3] += self.dt * velocity
        after[:, 4] += 1
        return after

    def signals(self, state: Array) -> Array:
        """x, y: (..., 5) -> (..., 2)."""
        return state[..., :2]

    def scaled_state(self, state: Array) -> Array:
        """x and y from -1 to 1 over [0, 5] m, the heading's cosine and sine, and nothing of the noise: (N, 4)."""
        x, y, heading = state[:, :3].T
        return np.stack([x / 2.5 - 1, y / 2.5 - 1, np.cos(heading), np.sin(heading)], axis=1)


class NoisyUnicycleByHand(NoisyUnicycle):
    beyond_state = ("distance and bearing of each region", "close-ups of both")

    def features(self, state: Array, t: Integers) -> Array:
        """The pose, and each region from there: (N, 12).

        x and y from -1 to 1 over the room, the heading's cosine and sine. A, then B: the centre's distance over
        5 m and as tanh over 0.5 m, and its bearing's cosine and sine, which fade out at the centre.
        """
        columns = [self.scaled_state(state)]
        for x, y in REGIONS:
            distance, bearing = polar(state, x, y)
            near = np.tanh(distance / 0.5)
            columns.append(np.stack([distance / 5, near, np.cos(bearing) * near, np.sin(bearing) * near], axis=1))
        return np.concatenate(columns, axis=1)
