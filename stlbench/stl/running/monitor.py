"""An online monitor: one sample at a time, bounds of the robustness at t = 0 over everything that may still follow."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.syntax import Formula
from stlbench.stl.language.traversal import require_formula
from stlbench.stl.predicates.compiler import Sample
from stlbench.stl.predicates.inputs import as_array, as_names, check_names
from stlbench.stl.predicates.signed_margin import SIDE
from stlbench.stl.recorded.evaluator import cause
from stlbench.stl.running.operator_tree import Tree, last_step
from stlbench.stl.running.scalar_operators import ONE, Operator


class Interval(NamedTuple):
    """What is known after a sample.

    Attributes:
        lower, upper: bounds of the robustness at t = 0 over all continuations (-inf, +inf while nothing is known).
        verdict: True or False once no continuation can change it (Boolean semantics), else None.
    """

    lower: float
    upper: float
    verdict: bool | None


#: `Interval(*values)` without the detour over Python
_INTERVAL = partial(tuple.__new__, Interval)


class Monitor:
    """Watches one trace for `formula`; for many traces at once see `BatchMonitor`.

    G, F, G F, F G and until over formulas without temporal operators, with intervals or without, cost constant
    amortised time per step and at most one window of memory, also inside !, &, | and ->. Any other nesting keeps up to
    horizon + 1 samples and evaluates them again at each step. `copy.deepcopy` forks a monitor.

    Attributes:
        steps: how many samples were taken.
        horizon: the last step that the formula reads; `END` where an operator has no interval.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
    """

    def __init__(self, formula: Formula, names: Sequence[str]) -> None:
        """Start before the first sample; `names` are the signals of a sample, in order."""
        require_formula(formula)
        self.formula, self.names = formula, as_names(names)
        check_names(formula, self.names)
        self.horizon = last_step(formula)
        self.steps = 0
        self._tree = Tree(formula, self.names, ONE)
        self._width = len(self.names)
        self._turn = 0  # the next step at which a leaf starts or stops reading
        self._reading: list[Operator] = []
        self._readers: list[Callable[[Sample], Any]] = []
        self._takers: list[Callable[[int, Any], bool]] = []
        self._answer = Interval(-math.inf, math.inf, None)

    def update(self, sample: ArrayLike) -> Interval:
        """Take the next sample (k,) and return what is known now. A tuple or list of floats is fastest.

        After horizon + 1 samples lower == upper == `robustness` of the trace (to rounding of sin, cos, exp), and later
        samples change nothing.

        Raises:
            UndefinedError: a predicate that is read has no value at the sample: a signal is NaN, or its arithmetic has
                none. The monitor stays as it was before the sample.
            TypeError: a masked array.
            ValueError: the sample is not of shape (k,).
        """
        now = self.steps
        if now > self.horizon:
            return self._answer
        row: Any = sample.tolist() if isinstance(sample, np.ndarray) else sample
        try:
            total = sum(row)  # no float, or NaN, for what has to be looked at closer
            if type(total) is not float or total != total or len(row) != self._width:
                row = self._checked(sample)
        except TypeError:
            row = self._checked(sample)
        if now == self._turn:
            self._reschedule(now)
        readers, takers = self._readers, self._takers
        changed = now == 0
        try:
            if len(readers) == 1:  # without a list, for speed
                changed |= takers[0](now, readers[0](row))
            else:
                values = [read(row) for read in readers]  # all of them, before one is taken
                for take, value in zip(takers, values, strict=True):
                    changed |= take(now, value)
        except UndefinedError as error:
            raise self._located(error, row) from None
        self.steps = now + 1
        if changed:
            self._answer = self._ask()
        return self._answer

    def _checked(self, sample: ArrayLike) -> list[float]:
        """Anything that NumPy reads as (k,) floats."""
        values = np.asarray(as_array(sample), dtype=float)
        if values.shape != (self._width,):
            raise ValueError(f"a sample has shape ({self._width},) for {', '.join(self.names)}, got {values.shape}")
        row: list[float] = values.tolist()
        return row

    def _reschedule(self, now: int) -> None:
        leaves = self._tree.leaves
        self._reading = [leaf for leaf in leaves if leaf.start <= now <= leaf.stop]
        self._readers = [leaf.reader(now) for leaf in self._reading]
        self._takers = [leaf.take for leaf in self._reading]
        self._turn = min((turn for leaf in leaves for turn in leaf.turns if turn > now), default=-1)

    def _located(self, error: UndefinedError, row: Sequence[float]) -> UndefinedError:
        """The error with the signal or predicate at fault, and the step."""
        for leaf in self._reading:
            for psi, value in leaf.asks(self.steps):
                try:
                    value(row)
                except UndefinedError:
                    return UndefinedError(cause(psi, self.names, np.array(row)), self.steps)
        return error

    def _ask(self) -> Interval:
        lower, upper = self._tree.root.bounds()
        verdict = True if lower > 0.0 else False if upper < 0.0 else None
        if -SIDE <= lower <= SIDE:
            lower = 0.0
        if -SIDE <= upper <= SIDE:
            upper = 0.0
        return _INTERVAL((lower, upper, verdict))
