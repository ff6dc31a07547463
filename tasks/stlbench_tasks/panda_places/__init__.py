"""The seven joints of a Franka Panda that bring its flange to one place and then hold it at another, over a column,
F F G & G, with a way by hand.
"""

import numpy as np

from stlbench.contract import Array, Integers, System

_LENGTHS = np.array([0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088])
_TURNS = np.array([0.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0]) * np.pi / 2
_OFFSETS = np.array([0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0])
_FLANGE = 0.107
"""Craig's Denavit-Hartenberg numbers that the maker has published: for each joint a in m, alpha in rad and d in m, and
d of the flange.
"""
_LEAST = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
_MOST = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
"""The ends of the joints, in rad, which the maker has published."""
_REST = np.array([0.0, -1.0, 0.0, -3.0, 0.0, 2.0, 1.0]) * np.pi / 4
"""A usual pose, about which the scaled state is."""
_FIRST, _OVER, _SECOND = np.array([0.45, 0.4, 0.35]), np.array([0.45, -0.1, 0.75]), np.array([0.45, -0.4, 0.35])
"""The first place, a point over the column on the way to the second, and the second place."""
_FASTEST = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
"""The joints' greatest speeds, in rad/s, as the task file has them."""
_LEAVE, _CROSSED = 60, -0.02
"""The step from which the flange goes on, and the y below which it has crossed the column."""
_GAIN, _TOP, _DAMPING = 3.0, 0.5, 0.05
"""The controller's speed a metre off, its greatest speed in m/s, and the damping of its least squares in m."""


class PandaPlaces(System):
    """A Panda whose joints' speeds are controlled: q' = q + dt u, within the joints' ends.

    State: seven angles in rad. Action: seven speeds in rad/s. Signals: x, y, z of the flange in m.
    """

    state = ("q1", "q2", "q3", "q4", "q5", "q6", "q7")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 7), (N, 7) -> (N, 7)."""
        moved: Array = np.clip(state + self.dt * action, _LEAST, _MOST)
        return moved

    def signals(self, state: Array) -> Array:
        """x, y, z of the flange: (..., 7) -> (..., 3)."""
        return chain(state)[0]

    def scaled_state(self, state: Array) -> Array:
        """The angles from a usual pose, in rad, and the flange's place in half metres from 0, 0, 0.5: (N, 10)."""
        return np.concatenate([state - _REST, (chain(state)[0] - [0.0, 0.0, 0.5]) * 2], axis=1)

    def controller(self, state: Array, t: Integers) -> Array:
        """Speeds that move the flange towards its aim, by damped least squares: (N, 7), (N,) -> (N, 7)."""
        place, axes, arms = chain(state)
        after = np.where(place[:, 1:2] > _CROSSED, _OVER, _SECOND)
        way = _GAIN * (np.where((t < _LEAVE)[:, None], _FIRST, after) - place)
        way *= np.minimum(1, _TOP / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9))
        moves = np.cross(axes, arms)  # each joint's motion of the flange, a rad
        square = moves.swapaxes(1, 2) @ moves + _DAMPING**2 * np.eye(3)
        speeds: Array = np.clip((moves @ np.linalg.solve(square, way[..., None]))[..., 0], -_FASTEST, _FASTEST)
        return speeds


def chain(angles: Array) -> tuple[Array, Array, Array]:
    """The flange's place (..., 3), and of each joint the axis and the way from it to the flange, (..., 7, 3) each."""
    turned, at = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3)), np.zeros((*angles.shape[:-1], 3))
    axes, places = [], []
    for i in range(7):
        c, s, cosine, sine = np.cos(_TURNS[i]), np.sin(_TURNS[i]), np.cos(angles[..., i]), np.sin(angles[..., i])
        at = at + turned @ [_LENGTHS[i], -s * _OFFSETS[i], c * _OFFSETS[i]]
        zero = np.zeros_like(cosine)
        rows = [[cosine, -sine, zero], [c * sine, c * cosine, zero - s], [s * sine, s * cosine, zero + c]]
        turned = turned @ np.moveaxis(np.array(rows), (0, 1), (-2, -1))
        axes.append(turned[..., 2])
        places.append(at)
    flange = at + _FLANGE * turned[..., 2]
    return flange, np.stack(axes, axis=-2), flange[..., None, :] - np.stack(places, axis=-2)
