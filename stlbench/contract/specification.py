"""The knowledge of a reward method about a task, and how a plugin refuses one. Import them from `stlbench.contract`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

from stlbench import stl
from stlbench.contract.arrays import Array, Truth


class Intractable(Exception):
    """A method would make training too dear; the message says what it would take. Ends a cell as `intractable`."""


class Unsuitable(ValueError):
    """A plugin cannot be applied to this task, or on this machine; the message names the rule that is broken."""


@dataclass(frozen=True)
class Specification:
    """The formula of a task and its signals. Intervals are in steps. A method sees no system, agent or budget."""

    formula: stl.Formula
    """The task. The referee measures its robustness at t = 0."""
    signals: tuple[str, ...]
    """Names of the k signals, in the order of the columns of samples."""
    low: tuple[float, ...]
    """Lower end of each signal's range; with `high` the box S of the paper's rho_max = max over S."""
    high: tuple[float, ...]
    steps: int
    """T: transitions in an episode. T >= horizon of the formula."""
    dt: float
    """Sampling time in seconds."""
    nested: stl.Formula | None = None
    """The same task as one outer operator over a window, `G[0,190] G[0,10] psi`, where the task file gives one."""
    can_end: bool = True
    """Whether an episode may be ended before step T by its environment; False for a `System`."""

    @cached_property
    def terms(self) -> tuple[stl.Term, ...]:
        """The conjunction of eq. 2 as terms F[a,b] psi, G[a,b] psi, F[a,c1] G[c2,b] psi.

        Raises `Unsuitable` where the formula is outside that fragment, with the place and the reason.
        """
        try:
            return stl.fragment(self.formula)
        except stl.FragmentError as error:
            raise Unsuitable(str(error)) from error

    def margin(self, psi: stl.Formula) -> Callable[[Array], Array]:
        """The robustness of `psi`, free of temporal operators, as a function of signals (..., k) -> (...)."""
        return stl.margin(psi, self.signals)

    def holds(self, psi: stl.Formula) -> Callable[[Array], Truth]:
        """The truth of `psi`, free of temporal operators, as a function of signals (..., k) -> (...)."""
        return stl.holds(psi, self.signals)

    def range(self, psi: stl.Formula) -> tuple[float, float]:
        """Sound bounds (rho_min, rho_max) of the robustness of `psi` over the box of the signals."""
        return _proven(psi, tuple(zip(self.signals, self.low, self.high, strict=True)))


@lru_cache(maxsize=4096)
def _proven(psi: stl.Formula, box: tuple[tuple[str, float, float], ...]) -> tuple[float, float]:
    """Kept, as every method asks for the ranges of all terms."""
    proven = stl.bounds(psi, {name: (low, high) for name, low, high in box})
    return proven.low, proven.high
