"""raw: the robustness of the active terms and nothing else (Saxena et al., eq. 18)."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers, RewardMethod, Specification
from stlbench_methods.schedule import Activity, active_table, least_active, timeless

__all__ = ["Raw"]


class Raw(RewardMethod):
    """Robustness of the active terms, without funnel: r'(s, t) = rho_psi(s), the paper's ablation (eq. 18).

    Args:
        activity: which terms are active at a time: `last-deadline` or `literal`; see `stlbench_methods.schedule`.

    Raises:
        Unsuitable: the formula is outside the fragment of eq. 2.
    """

    def __init__(self, specification: Specification, *, activity: Activity = "last-deadline") -> None:
        super().__init__(specification)
        terms = specification.terms
        self.scale = max(high - low for low, high in map(specification.range, (term.psi for term in terms)))
        self._steps = np.arange(specification.steps + 1)[:, None]
        margins = [timeless(specification.margin(term.psi)) for term in terms]
        self._reward = least_active(margins, active_table(terms, specification.steps, activity))

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """rho of the active terms at s_{t+1}: (N,) in the unit of the predicates. No memory."""
        return self._reward(next_signals, t + 1), memory

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The same for h steps at once: (h, N)."""
        return self._reward(samples[1:], t + self._steps[1 : len(samples)]), memory
