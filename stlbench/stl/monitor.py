"""An online monitor: one sample at a time, bounds of the robustness at t = 0 over everything that may still follow."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .compiler import ARRAYS, SCALARS, check_names, compile_holds, compile_margin
from .errors import UndefinedError
from .online import Bounds, Joined, Negated, Nested, Now, Online, Pick, Psi, Replayed, Window, is_nan
from .plans import BOOLEAN, ROBUST, Algebra, unknown
from .robustness import robustness, satisfied
from .structure import horizon, is_temporal
from .syntax import Always, And, Eventually, Formula, Implies, Not, Or


class Interval(NamedTuple):
    """What is known after a sample.

    Attributes:
        lower, upper: bounds of the robustness at t = 0 over all continuations (-inf, +inf while nothing is known).
        verdict: True or False once no continuation can change it (Boolean semantics), else None.
    """

    lower: float
    upper: float
    verdict: bool | None


class Monitor:
    """Watches one trace for `formula`.

    Each of F, G, F G and G F over a formula without temporal operators costs constant amortised time a step and at most
    one window of memory, also inside !, &, | and ->. Any other nesting, and until, keeps up to horizon + 1 samples and
    re-evaluates them at each step.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
    """

    def __init__(self, formula: Formula, names: Sequence[str]) -> None:
        """Start before the first sample; `names` are the signals of a sample, in order."""
        self.formula, self.names = formula, tuple(names)
        check_names(formula, self.names)
        self.horizon = horizon(formula)
        self.steps = 0
        self._robust = _Builder(_ROBUST, self.names).build(formula)
        self._boolean = _Builder(_BOOLEAN, self.names).build(formula)
        self._answer = Interval(-math.inf, math.inf, None)

    def update(self, sample: ArrayLike) -> Interval:
        """Take the next sample (k,) and return what is known now.

        After horizon + 1 samples lower == upper == `robustness` of the trace (to rounding of sin, cos, exp), and later
        samples change nothing.

        Raises:
            UndefinedError: the sample has a NaN, or a predicate has no value at it.
            ValueError: the sample is not of shape (k,).
        """
        if self.steps > self.horizon:
            return self._answer
        values = np.asarray(sample, dtype=float)
        if values.shape != (len(self.names),):
            raise ValueError(f"a sample has shape ({len(self.names)},) for {', '.join(self.names)}, got {values.shape}")
        row: list[float] = values.tolist()
        if is_nan(row):
            raise UndefinedError(f"signal {self.names[int(np.isnan(values).argmax())]!r} is NaN at sample {self.steps}")
        lower, upper = self._robust.step(row)
        certainly, possibly = self._boolean.step(row)
        self.steps += 1
        self._answer = Interval(lower, upper, True if certainly else None if possibly else False)
        return self._answer


@dataclass(frozen=True)
class _Kind:
    """Which of the two questions is asked: how robustly, or whether."""

    algebra: Algebra
    negate: Callable[[Any], Any]
    compile: Callable[..., Any]
    evaluate: Callable[..., Any]


_ROBUST = _Kind(ROBUST, operator.neg, compile_margin, robustness)
_BOOLEAN = _Kind(BOOLEAN, operator.not_, compile_holds, satisfied)


class _Builder:
    def __init__(self, kind: _Kind, names: tuple[str, ...]) -> None:
        self.kind, self.names = kind, names

    def build(self, formula: Formula) -> Online:
        """The cheapest operator that is exact for `formula`."""
        if not is_temporal(formula):
            return Now(self.psi(formula))
        match formula:
            case Always(a, b, arg) | Eventually(a, b, arg) if not is_temporal(arg):
                pick, empty = self.window(formula)
                return Window(self.psi(arg), (a, b), pick, empty, self.unknown(arg))
            case Eventually(a, c, Always(d, e, arg) as inner) | Always(a, c, Eventually(d, e, arg) as inner) if (
                not is_temporal(arg)
            ):
                (outer_pick, outer_empty), (inner_pick, inner_empty) = self.window(formula), self.window(inner)
                picks, empties = (outer_pick, inner_pick), (outer_empty, inner_empty)
                return Nested(self.psi(arg), ((a, c), (d, e)), picks, empties, self.unknown(arg))
            case And(args):
                return Joined([self.build(arg) for arg in args], min)
            case Or(args):
                return Joined([self.build(arg) for arg in args], max)
            case Implies(left, right):
                return Joined([Negated(self.build(left), self.kind.negate), self.build(right)], max)
            case Not(arg):
                return Negated(self.build(arg), self.kind.negate)
            case _:
                return self.replayed(formula)

    def window(self, formula: Always | Eventually) -> tuple[Pick, float]:
        """min or max, and the value of an empty window."""
        algebra = self.kind.algebra
        return (min, algebra.top) if isinstance(formula, Always) else (max, algebra.bottom)

    def unknown(self, psi: Formula) -> Bounds:
        """Bounds of `psi` at a sample that has not come yet."""
        algebra = self.kind.algebra
        lower, upper = (algebra.dtype(unknown(psi, algebra, self.names, worst)) for worst in (True, False))
        return lower, upper

    def psi(self, formula: Formula) -> Psi:
        """`formula` on one sample: plain floats, or NumPy where those have no answer (division by zero gives inf)."""
        fast = self.kind.compile(formula, self.names, SCALARS)
        slow = self.kind.compile(formula, self.names, ARRAYS)
        if not callable(fast):
            return lambda sample: fast

        def run(sample: list[float]) -> float:
            try:
                value = fast(sample)
            except (ArithmeticError, ValueError):
                with np.errstate(all="ignore"):
                    value = slow(np.array(sample)).item()
            if value != value:
                raise UndefinedError(f"{formula} has no value at {dict(zip(self.names, sample, strict=True))}")
            return value  # type: ignore[no-any-return]

        return run

    def replayed(self, formula: Formula) -> Online:
        def evaluate(samples: list[list[float]]) -> Bounds:
            lower, upper = self.kind.evaluate(formula, np.array(samples), self.names, policy="interval")
            return lower.item(), upper.item()

        return Replayed(evaluate, horizon(formula))
