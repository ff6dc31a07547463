"""The origin of a robustness in a trace: the one predicate, at the one step, whose margin it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.language import syntax
from stlbench.stl.language.structure import as_names, lookahead, require_formula, signals
from stlbench.stl.predicates import as_array, margin
from stlbench.stl.recorded import robustness
from stlbench.stl.recorded.evaluator import Traces, evaluator


class Link(NamedTuple):
    """A part of a formula, and the step of the trace at which it is evaluated."""

    formula: syntax.Formula
    step: int


@dataclass(frozen=True)
class Witness:
    """The origin of a trace's robustness.

    A robustness is made of minima, maxima and changes of sign alone, so it is the margin of one predicate at one
    sample, or minus that. Every part on the path to it has the same robustness at its step, up to the sign.
    """

    path: tuple[Link, ...]
    """From the formula at step 0 to the predicate (or `True`); each is an operand of the one before it."""
    margin: float
    """The predicate's at its step, in the unit of its sides; inf for `True`."""
    sign: int
    """1, or -1 where an odd number of negations is on the path."""

    @property
    def predicate(self) -> syntax.Predicate | syntax.TrueFormula:
        """The predicate whose margin it is."""
        last = self.path[-1].formula
        assert isinstance(last, syntax.Predicate | syntax.TrueFormula)
        return last

    @property
    def step(self) -> int:
        """The sample, from 0, at which the predicate has this margin."""
        return self.path[-1].step

    @property
    def robustness(self) -> float:
        """The whole formula's, at step 0."""
        return self.sign * self.margin

    @property
    def conjunct(self) -> syntax.Formula:
        """The one of the formula's conjuncts that the robustness is of; the formula itself where it has none."""
        return next(link.formula for link in self.path if not isinstance(link.formula, syntax.And))


def witness(formula: syntax.Formula, trace: ArrayLike, names: Sequence[str]) -> Witness:
    """Find the predicate and the sample that the robustness of `formula` at t = 0 comes from.

    Among equals it is the first operand and the earliest step; of an until, release or since the right operand comes
    first. At a robustness of exactly 0 it is one that also decides the verdict: the formula is satisfied if and only if
    the predicate holds there (for a negative sign: does not hold).

    Args:
        formula: any formula; intervals in steps.
        trace: (T+1, k) floats in the signals' units, one trace.
        names: the k signals, in the order of the last axis.

    Raises:
        ValueError: the trace is a batch; a past operator decides whose interval lies before step 0; or as `robustness`
            under `strict`, with its other errors.
    """
    require_formula(formula)
    named = as_names(names, formula)
    samples = as_array(trace, named, signals(formula))
    if samples.ndim != 2:
        raise ValueError(f"a witness is of one trace (T+1, k), got the shape {samples.shape}")
    robustness(formula, samples, named)  # refuses what cannot be evaluated
    search = _Search(Traces(np.asarray(samples, dtype=np.float64)[None], "strict", len(samples) - 1), named)
    path, sign = [Link(formula, 0)], 1
    while not isinstance(path[-1].formula, syntax.Predicate | syntax.TrueFormula):
        link, turn = search.below(*path[-1])
        path.append(link)
        sign *= turn
    predicate, step = path[-1]
    with np.errstate(all="ignore"):
        value = float(margin(predicate, named)(search.traces.samples[0, step]))
    return Witness(tuple(path), value, sign)


class _Search(NamedTuple):
    """One trace, searched by signed margins (see `dialect`), which know the verdict at a robustness of 0."""

    traces: Traces
    names: tuple[str, ...]

    def values(self, formula: syntax.Formula, first: int, last: int) -> NDArray[np.float64]:
        """Signed values at steps first..last, (last - first + 1,)."""
        with np.errstate(all="ignore"):
            rows = evaluator(formula, self.names, "signed")(self.traces, first, last, True)
        return np.asarray(rows[0])

    def below(self, formula: syntax.Formula, t: int) -> tuple[Link, int]:
        """The operand that the value of `formula` at step t is of, at its step, and the sign between the two."""
        match formula:
            case syntax.Connective():
                values = [(-1 if negated else 1) * self.values(arg, t, t)[0] for arg, negated in formula.signed]
                arg, negated = formula.signed[int((np.argmin if formula.least else np.argmax)(values))]
                return Link(arg, t), -1 if negated else 1
            case syntax.Prefix():
                return self._window(formula, t), 1
            case syntax.Between():
                return self._between(formula, t), 1
            case _:  # pragma: no cover - nothing is below predicates and True
                raise AssertionError(formula)

    def _window(self, formula: syntax.Prefix, t: int) -> Link:
        pick = np.argmin if formula.least else np.argmax
        near, far = formula.a, self._far(formula, t)
        first, last = (t - far, t - near) if formula.past else (t + near, t + far)
        return Link(formula.arg, first + int(pick(self.values(formula.arg, first, last))))

    def _between(self, formula: syntax.Between, t: int) -> Link:
        """At the best step for `right`: that, or the worst of `left` on the way there, whichever is less.

        A release is an until of the opposites. A since is an until whose steps are counted backwards.
        """
        near, far, way = formula.a, self._far(formula, t), -1 if formula.past else 1
        sign = -1 if isinstance(formula, syntax.Release) else 1

        def at(operand: syntax.Formula, nearest: int, farthest: int) -> NDArray[np.float64]:
            first, last = sorted((t + way * nearest, t + way * farthest))
            return sign * self.values(operand, first, last)[::way]

        goal = at(formula.right, near, far)
        guard = at(formula.left, 0, far - 1) if far else np.empty(0)
        before = np.minimum.accumulate(np.concatenate([[np.inf], guard]))[near:]
        best = int(np.argmax(np.minimum(goal, before)))
        if goal[best] <= before[best]:
            return Link(formula.right, t + way * (near + best))
        return Link(formula.left, t + way * int(np.argmin(guard[: near + best])))

    def _far(self, formula: syntax.Prefix | syntax.Between, t: int) -> int:
        """How many steps from t the operator's interval reaches, cut at step 0.

        Raises:
            ValueError: the whole interval lies before step 0.
        """
        if formula.past:
            if t < formula.a:
                raise ValueError(f"no sample decides: at step {t}, {formula.operator} looks before sample 0 alone")
            return min(t, formula.b)
        return formula.b if formula.b < syntax.END else self.traces.last - lookahead(formula) - t
