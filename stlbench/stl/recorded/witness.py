"""Where in a trace a robustness comes from: the one predicate, at the one step, whose margin it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.language.horizon import lookahead
from stlbench.stl.language.syntax import (
    END,
    Always,
    And,
    Eventually,
    Formula,
    Implies,
    Not,
    Or,
    Predicate,
    TrueFormula,
    Until,
)
from stlbench.stl.predicates.compiler import compile_signed
from stlbench.stl.predicates.inputs import as_array, as_names
from stlbench.stl.predicates.pointwise import margin
from stlbench.stl.recorded.evaluator import Traces, evaluator
from stlbench.stl.recorded.robustness import robustness

__all__ = ["Link", "Witness", "witness"]


class Link(NamedTuple):
    """A part of a formula, and the step of the trace at which it is asked."""

    formula: Formula
    step: int


@dataclass(frozen=True)
class Witness:
    """Why a trace has the robustness that it has.

    A robustness is made of minima, maxima and changes of sign alone, so it is the margin of one predicate at one
    sample, or minus that. Every part on the path to it has the same robustness at its step, up to the sign.
    """

    path: tuple[Link, ...]
    """From the formula at step 0 to the predicate (or `True`); each is an operand of the one before it."""
    margin: float
    """Of the predicate at its step, in the unit of its sides; inf for `True`."""
    sign: int
    """1, or -1 where an odd number of negations is on the path."""

    @property
    def predicate(self) -> Predicate | TrueFormula:
        """The predicate whose margin it is."""
        last = self.path[-1].formula
        assert isinstance(last, Predicate | TrueFormula)
        return last

    @property
    def step(self) -> int:
        """The sample, from 0, at which the predicate has this margin."""
        return self.path[-1].step

    @property
    def robustness(self) -> float:
        """Of the whole formula at step 0."""
        return self.sign * self.margin

    @property
    def conjunct(self) -> Formula:
        """The one of the formula's conjuncts that the robustness is of; the formula itself where it has none."""
        return next(link.formula for link in self.path if not isinstance(link.formula, And))


def witness(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> Witness:
    """Find the predicate and the sample that the robustness of `formula` at t = 0 comes from.

    Of equals it is the first operand and the earliest step. At a robustness of exactly 0 it is one that also decides
    the verdict: the formula is satisfied if and only if the predicate holds there (for a negative sign: does not hold).

    Args:
        formula: any formula; intervals in steps.
        trace: (T+1, k) floats in the signals' units, one trace.
        names: the k signals, in the order of the last axis.

    Raises:
        ValueError: the trace is a batch, or as `robustness` under `strict`, with its other errors.
    """
    samples, named = as_array(trace), as_names(names)
    if samples.ndim != 2:
        raise ValueError(f"a witness is of one trace (T+1, k), got the shape {samples.shape}")
    robustness(formula, samples, named)  # refuses what cannot be evaluated
    search = _Search(Traces(np.asarray(samples, dtype=np.float64)[None], "strict", len(samples) - 1), named)
    path, sign = [Link(formula, 0)], 1
    while not isinstance(path[-1].formula, Predicate | TrueFormula):
        link, turn = search.below(*path[-1])
        path.append(link)
        sign *= turn
    predicate, step = path[-1]
    with np.errstate(all="ignore"):
        value = float(margin(predicate, named)(search.traces.samples[0, step]))
    return Witness(tuple(path), value, sign)


class _Search(NamedTuple):
    """One trace, searched by signed values (see `signed_margin`), which know the verdict at a robustness of 0."""

    traces: Traces
    names: tuple[str, ...]

    def values(self, formula: Formula, first: int, last: int) -> NDArray[np.float64]:
        """Signed values at steps first..last, (last - first + 1,)."""
        with np.errstate(all="ignore"):
            rows = evaluator(formula, self.names, compile_signed)(self.traces, first, last, True)
        found: NDArray[np.float64] = rows[0]
        return found

    def below(self, formula: Formula, t: int) -> tuple[Link, int]:
        """The operand that the value of `formula` at step t is of, at its step, and the sign between the two."""
        match formula:
            case Not(arg):
                return Link(arg, t), -1
            case And(args):
                return Link(args[int(np.argmin([self.values(arg, t, t)[0] for arg in args]))], t), 1
            case Or(args):
                return Link(args[int(np.argmax([self.values(arg, t, t)[0] for arg in args]))], t), 1
            case Implies(left, right):
                vacuous = -self.values(left, t, t)[0] >= self.values(right, t, t)[0]
                return (Link(left, t), -1) if vacuous else (Link(right, t), 1)
            case Always(a, _, arg):
                return Link(arg, t + a + int(np.argmin(self.values(arg, t + a, self._last(formula, t))))), 1
            case Eventually(a, _, arg):
                return Link(arg, t + a + int(np.argmax(self.values(arg, t + a, self._last(formula, t))))), 1
            case Until():
                return self._until(formula, t), 1
            case _:  # pragma: no cover - nothing is below predicates and True
                raise AssertionError(formula)

    def _until(self, formula: Until, t: int) -> Link:
        """At the best step for `right`: that, or the worst of `left` before it, whichever is less."""
        last = self._last(formula, t)
        goal = self.values(formula.right, t + formula.a, last)
        guard = self.values(formula.left, t, last - 1) if last > t else np.empty(0)
        before = np.minimum.accumulate(np.concatenate([[np.inf], guard]))[formula.a :]
        best = int(np.argmax(np.minimum(goal, before)))
        if goal[best] <= before[best]:
            return Link(formula.right, t + formula.a + best)
        return Link(formula.left, t + int(np.argmin(guard[: formula.a + best])))

    def _last(self, formula: Always | Eventually | Until, t: int) -> int:
        """The last step that the operator's interval has from step t."""
        if formula.b < END:
            return t + formula.b
        return self.traces.last - lookahead(formula)
