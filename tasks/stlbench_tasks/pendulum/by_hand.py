"""Features that a person made for policies on pendulum."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers
from stlbench_tasks.pendulum.system import BEGINS, TARGETS, Pendulum, phase_at

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
        third. The deadline is the logarithm of a width that falls from pi at the start of a phase through 0.05 where
        the interval begins to 0.03, as the paper's funnels do, over 2 and shifted by 1.
        """
        phase = phase_at(t)
        error, omega = np.clip(state[:, 0] - TARGETS[phase], -9, 9), state[:, 1]
        rate = np.log((_WIDEST - _NARROWEST) / (_TOLERANCE - _NARROWEST)) / _WAITS[phase]
        width = (_WIDEST - _NARROWEST) * np.exp(-rate * (t - BEGINS[phase])) + _NARROWEST
        scales = [column for e in (error, omega) for column in (e / 2, np.tanh(e / 0.3), np.tanh(e / 0.05))]
        return np.stack([*scales, phase - 1.0, np.log(width) / 2 + 1], axis=1)
