"""A quadrotor in space, moved by its thrust and three torques, and a flight to a place by hand."""

from abc import abstractmethod

import numpy as np

from stlbench.contract import Array, Integers, System

GRAVITY, MASS = 9.81, 0.468
"""m/s^2 and kg."""
INERTIA = np.array([4.856e-3, 4.856e-3, 8.801e-3])
"""kg m^2 about the body's axes x, y, z. The mass and these are those of Luukkonen 2011."""
_ACTIONS = np.array([[0.0, -0.05, -0.05, -0.02], [9.18, 0.05, 0.05, 0.02]])
"""The least and the greatest thrust and torques, as the task files have them."""
_LEAST_COSINE = 0.05
"""The least cosine of the pitch by which turns are divided: the angles are singular where the robot stands on edge."""
_PULL, _BRAKE, _LEAN = 2.5, 2.6, 2.0
"""The controller's acceleration a metre off and against a m/s, and the most of it along each axis, in m/s^2."""
_TURN, _CALM = 120.0, 18.0
"""The controller's turning a rad off and against a rad/s, in rad/s^2."""


class QuadrotorInSpace(System):
    """A rigid body whose rotors push along its own z axis.

    State: place in m, velocity in m/s; roll, pitch and yaw in rad, of the rotation Rz(yaw) Ry(pitch) Rx(roll) from body
    to room; rates p, q, r in rad/s about the body's axes. Actions: thrust in N, torques in N m about the body's axes.
    The accelerations of the place and of the rates are those at the start of a step. The angles change by the mean of
    the old and the new rates. Signals: x, y, z and the tilt, the angle in rad between the body's z axis and the
    vertical.
    """

    state = ("x", "y", "z", "v_x", "v_y", "v_z", "roll", "pitch", "yaw", "p", "q", "r")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 12), (N, 4) -> (N, 12)."""
        dt, place, velocity, angles, rates = self.dt, state[:, :3], state[:, 3:6], state[:, 6:9], state[:, 9:]
        push = _upwards(angles) * (action[:, :1] / MASS) - [0.0, 0.0, GRAVITY]
        turned = rates + dt * (action[:, 1:] - np.cross(rates, INERTIA * rates)) / INERTIA
        moved = place + dt * velocity + dt**2 / 2 * push
        leaning = angles + dt * _turning(angles, (rates + turned) / 2)
        return np.concatenate([moved, velocity + dt * push, leaning, turned], axis=1)

    def signals(self, state: Array) -> Array:
        """x, y, z, tilt: (..., 12) -> (..., 4)."""
        upright = np.cos(state[..., 6:7]) * np.cos(state[..., 7:8])
        return np.concatenate([state[..., :3], np.arccos(np.clip(upright, -1, 1))], axis=-1)

    def scaled_state(self, state: Array) -> Array:
        """The place over 4 m, velocities over 2 m/s, the angles' cosines and sines, the rates over 2 rad/s: (N, 15)."""
        angles = state[:, 6:9]
        parts = (state[:, :3] / 4, state[:, 3:6] / 2, np.cos(angles), np.sin(angles), state[:, 9:] / 2)
        return np.concatenate(parts, axis=1)

    @abstractmethod
    def aims(self, t: Integers) -> Array:
        """The places (N, 3) to which it flies by hand at steps t (N,)."""

    def controller(self, state: Array, t: Integers) -> Array:
        """Thrust and torques that bring it to its aim, with the yaw brought to zero: (N, 12), (N,) -> (N, 4)."""
        wanted = _PULL * (self.aims(t) - state[:, :3]) - _BRAKE * state[:, 3:6]
        wanted = np.clip(wanted, -_LEAN, _LEAN)
        angles, (roll, pitch, yaw) = state[:, 6:9], state[:, 6:9].T
        thrust = MASS * (GRAVITY + wanted[:, 2]) / np.maximum(np.cos(roll) * np.cos(pitch), 0.5)
        ahead = np.cos(yaw) * wanted[:, 0] + np.sin(yaw) * wanted[:, 1]
        aside = np.sin(yaw) * wanted[:, 0] - np.cos(yaw) * wanted[:, 1]
        leaning = np.stack([aside / GRAVITY, ahead / GRAVITY, np.zeros(len(state))], axis=1)
        torques = INERTIA * (_TURN * np.array([1.0, 1.0, 0.1]) * (leaning - angles) - _CALM * state[:, 9:])
        actions: Array = np.clip(np.concatenate([thrust[:, None], torques], axis=1), *_ACTIONS)
        return actions


def _upwards(angles: Array) -> Array:
    """The body's z axis in the room: (N, 3) -> (N, 3)."""
    (c_roll, c_pitch, c_yaw), (s_roll, s_pitch, s_yaw) = np.cos(angles).T, np.sin(angles).T
    x = c_roll * s_pitch * c_yaw + s_roll * s_yaw
    y = c_roll * s_pitch * s_yaw - s_roll * c_yaw
    return np.stack([x, y, c_roll * c_pitch], axis=1)


def _turning(angles: Array, rates: Array) -> Array:
    """The speeds of roll, pitch and yaw at rates about the body's axes: (N, 3), (N, 3) -> (N, 3)."""
    (roll, pitch, _), (p, q, r) = angles.T, rates.T
    cosine = np.cos(pitch)
    cosine = np.where(cosine < 0, -1.0, 1.0) * np.maximum(np.abs(cosine), _LEAST_COSINE)
    across = (np.sin(roll) * q + np.cos(roll) * r) / cosine
    return np.stack([p + np.sin(pitch) * across, np.cos(roll) * q - np.sin(roll) * r, across], axis=1)
