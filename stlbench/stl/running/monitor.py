"""An online monitor: one sample at a time, bounds of the robustness at t = 0 over everything that may still follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import MethodType

from numpy.typing import ArrayLike

from stlbench.stl.language.syntax import Formula
from stlbench.stl.language.traversal import require_formula
from stlbench.stl.predicates.inputs import as_names
from stlbench.stl.running.monitor_source import Interval, State, program


class Monitor:
    """Watches one trace for `formula`; for many traces at once see `BatchMonitor`.

    G, F, G F, F G and until over formulas without temporal operators, with intervals or without, cost constant
    amortised time per step and at most one window of memory, also inside !, &, | and ->. Any other nesting keeps up to
    horizon + 1 samples and evaluates them again at each step. `copy.deepcopy` forks a monitor.

    Attributes:
        horizon: the last step that the formula reads; `END` where an operator has no interval.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
    """

    update: Callable[[ArrayLike], Interval]
    """Take the next sample (k,) and return what is known now. A tuple of floats is fastest.

    After horizon + 1 samples lower == upper == `robustness` of the trace (to rounding of sin, cos, exp), and later
    samples change nothing.

    Raises:
        UndefinedError: a predicate that is read has no value at the sample: a signal is NaN, or its arithmetic has
            none. The monitor stays as it was before the sample.
        TypeError: a masked array.
        ValueError: the sample is not of shape (k,).
    """

    def __init__(self, formula: Formula, names: Sequence[str]) -> None:
        """Start before the first sample; `names` are the signals of a sample, in order."""
        require_formula(formula)
        self.formula, self.names = formula, as_names(names)
        made = program(formula, self.names)
        self.horizon = made.horizon
        self._state = State()
        made.begin(self._state)
        self.update = MethodType(made.step, self._state)

    @property
    def steps(self) -> int:
        """How many samples were taken."""
        return self._state.steps
