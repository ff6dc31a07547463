"""raw: the robustness of the active terms and nothing else (Saxena et al., eq. 18)."""

from __future__ import annotations

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
        margins = [timeless(specification.margin(term.psi)) for term in terms]
        self._reward = least_active(margins, active_table(terms, specification.steps, activity))

    def arrival(self, signals: Array, t: Integers) -> Array:
        """rho of the active terms, in the unit of the predicates: (..., k), (...) -> (...)."""
        return self._reward(signals, t)
