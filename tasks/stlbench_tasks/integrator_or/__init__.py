"""The paper's disjunction inside a temporal operator, for a discrete-time integrator (sec. IV-C). The system, and
features that a person made for its policies.
"""

import numpy as np

from stlbench.contract import Array, Integers, System
from stlbench_tasks.differential_drive import nearest


class IntegratorOr(System):
    """Discrete-time integrator that stays near 5 or near 45, G[0,2000] of a disjunction. x' = x + dt v."""

    state = ("x",)

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 1), (N, 1) -> (N, 1)."""
        return state + self.dt * action

    def signals(self, state: Array) -> Array:
        """x: (..., 1) -> (..., 1)."""
        return state

    def scaled_state(self, state: Array) -> Array:
        """Position from the middle between the goals over 25, so from -1 to 1 over [0, 50]: (N, 1) -> (N, 1)."""
        return (state - 25) / 25

    def controller(self, state: Array, t: Integers) -> Array:
        """Velocities to the nearer one of the two points, within a held action's 0.1 s if possible: (N, 1)."""
        return nearest((np.where(state < 25, 5.0, 45.0) - state) / 0.1, 3.0, 0.5)


class IntegratorOrByHand(IntegratorOr):
    beyond_state = ("a close-up of each of the two points",)

    def features(self, state: Array, t: Integers) -> Array:
        """Position from the middle between the goals over 20, and from each goal as tanh over 3: (N, 3)."""
        x = state[:, 0]
        return np.stack([(x - 25) / 20, np.tanh((x - 5) / 3), np.tanh((x - 45) / 3)], axis=1)
