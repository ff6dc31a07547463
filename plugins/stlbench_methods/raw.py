"""raw: the robustness of the active terms and nothing else (Saxena et al., eq. 18)."""

from types import MappingProxyType

import numpy as np

from stlbench.contract import Array, Integers, RewardMethod, Specification
from stlbench_methods.formula_parts import Activity, active_table, bounded_range, least_active, least_paid, timeless


class Raw(RewardMethod):
    """Robustness of the active terms, without funnel: r'(s, t) = rho_psi(s), the paper's ablation (eq. 18).

    Args:
        activity: which terms are active at a time: `last-deadline` or `literal`; see `stlbench_methods.formula_parts`.

    Raises:
        Unsuitable: the formula is outside the fragment of eq. 2, or a term cannot fail.
    """

    preference = MappingProxyType({"other": 2, "recurring": 3})

    def __init__(self, specification: Specification, *, activity: Activity = "last-deadline") -> None:
        super().__init__(specification)
        terms = specification.terms
        low, high = np.array([bounded_range(specification, term.psi, term.formula) for term in terms]).T
        self.scale = float((high - low).max())
        active = active_table(terms, specification.steps, activity)
        self.floor = least_paid(low[:, None], active)
        margins = [timeless(specification.margin(term.psi)) for term in terms]
        self._reward = least_active(margins, active)

    def arrival(self, signals: Array, t: Integers) -> Array:
        return self._reward(signals, t)
