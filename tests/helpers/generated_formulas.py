"""Formulas and traces for the property tests, and the definition of the semantics, word for word and slow."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench import stl

NAMES = ("x", "y", "z")
SIGNALS = st.sampled_from([stl.Signal(name) for name in NAMES])
NUMBERS = st.sampled_from([0.0, 0.25, 0.5, 1.0, 2.0, 3.0]).map(stl.Number)
COMPARISONS = st.sampled_from(["<=", ">=", "<", ">"])


def _grow_expression(inner: st.SearchStrategy[stl.Expression]) -> st.SearchStrategy[stl.Expression]:
    several = st.lists(inner, min_size=1, max_size=3).map(tuple)
    return st.one_of(
        st.builds(stl.Negative, inner),
        st.builds(stl.Binary, st.sampled_from("+-*"), inner, inner),
        st.builds(stl.Binary, st.just("**"), inner, st.sampled_from([0, 1, 2, 3]).map(stl.Number)),
        st.builds(stl.Call, st.sampled_from(["min", "max", "norm", "norminf"]), several),
        st.builds(stl.Call, st.sampled_from(["abs", "sin", "cos"]), inner.map(lambda arg: (arg,))),
    )


EXPRESSIONS = st.recursive(st.one_of(SIGNALS, NUMBERS), _grow_expression, max_leaves=4)
PREDICATES = st.builds(stl.Predicate, COMPARISONS, EXPRESSIONS, EXPRESSIONS)
#: |h| is 1-Lipschitz in the sup norm of the samples
LIPSCHITZ = st.builds(stl.Predicate, COMPARISONS, SIGNALS, NUMBERS)


def intervals(longest: int) -> st.SearchStrategy[tuple[int, int]]:
    """(a, b) with 0 <= a <= b <= longest."""
    return st.tuples(st.integers(0, longest), st.integers(0, longest)).map(lambda ends: (min(ends), max(ends)))


def _boolean(inner: st.SearchStrategy[stl.Formula]) -> st.SearchStrategy[stl.Formula]:
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    return st.one_of(
        st.builds(stl.Not, inner),
        st.builds(stl.And, several),
        st.builds(stl.Or, several),
        st.builds(stl.Implies, inner, inner),
    )


def _temporal(
    inner: st.SearchStrategy[stl.Formula], longest: int, endless: bool, past: bool
) -> st.SearchStrategy[stl.Formula]:
    ends = intervals(longest)
    if endless:
        ends = st.one_of(ends, st.just((0, stl.END)))
    windows = st.sampled_from([stl.Always, stl.Eventually, *([stl.Historically, stl.Once] if past else [])])
    between = st.sampled_from([stl.Until, stl.Release, *([stl.Since] if past else [])])
    return st.one_of(
        st.builds(lambda kind, ab, arg: kind(*ab, arg), windows, ends, inner),
        st.builds(lambda kind, ab, left, right: kind(*ab, left, right), between, ends, inner, inner),
    )


def formulas(
    predicates: st.SearchStrategy[Any] = PREDICATES,
    longest: int = 5,
    leaves: int = 6,
    endless: bool = False,
    constants: bool = True,
    past: bool = True,
) -> st.SearchStrategy[stl.Formula]:
    """Formulas of any nesting with intervals up to `longest`; `endless`: or without; `constants`: `True` occurs;
    `past`: operators that look back occur."""
    base = st.one_of(predicates, predicates, predicates, st.just(stl.TrueFormula())) if constants else predicates

    def grow(inner: st.SearchStrategy[stl.Formula]) -> st.SearchStrategy[stl.Formula]:
        return st.one_of(_boolean(inner), _temporal(inner, longest, endless, past))

    return st.recursive(base, grow, max_leaves=leaves)


def pointwise(predicates: st.SearchStrategy[Any] = PREDICATES) -> st.SearchStrategy[stl.Formula]:
    """Formulas without temporal operators."""
    return st.recursive(st.one_of(predicates, st.just(stl.TrueFormula())), _boolean, max_leaves=4)


def _answers() -> st.SearchStrategy[stl.Formula]:
    """An operator about something now and something earlier or later, as `G[0,9] (p -> F[0,3] q)`."""
    psi = pointwise(LIPSCHITZ)
    once = _temporal(psi, 5, endless=True, past=True)
    twice = _temporal(st.one_of(psi, st.builds(lambda one, other: stl.And((one, other)), psi, once)), 4, True, True)
    now = st.builds(lambda kind, *parts: kind(parts), st.sampled_from([stl.And, stl.Or]), psi, st.one_of(once, twice))
    return _temporal(now, 8, endless=True, past=False)


#: the nestings for which monitors have operators of their own, and any others
WATCHED = st.one_of(
    _answers(),
    formulas(leaves=4),
    formulas(leaves=4, endless=True),
    st.builds(
        lambda ac, de, psi: stl.Eventually(*ac, stl.Always(*de, psi)), intervals(6), intervals(6), pointwise(LIPSCHITZ)
    ),
    st.builds(
        lambda ac, de, psi: stl.Not(stl.Always(*ac, stl.Eventually(*de, psi))), intervals(6), intervals(6), pointwise()
    ),
    st.builds(lambda ab, left, right: stl.Until(*ab, left, right), intervals(8), pointwise(LIPSCHITZ), pointwise()),
)


def traces(steps: int, seed: int, batch: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Random traces (*batch, steps, 3) on a grid of quarters, so that ties and margins of exactly 0 are common."""
    return np.random.default_rng(seed).integers(-12, 13, size=(*batch, steps, len(NAMES))) / 4.0


SEEDS = st.integers(0, 2**32 - 1)


def told(formula: stl.Formula, last: int) -> int:
    """The last step at which `formula` can be told on a trace with samples 0..last, perhaps negative."""
    match formula:
        case stl.TrueFormula() | stl.Predicate():
            return last
        case stl.Not(arg):
            return told(arg, last)
        case stl.And(args) | stl.Or(args):
            return min(told(arg, last) for arg in args)
        case stl.Implies(left, right):
            return min(told(left, last), told(right, last))
        case stl.Always(_, b, arg) | stl.Eventually(_, b, arg):
            return told(arg, last) - (0 if b == stl.END else b)
        case stl.Historically(a, _, arg) | stl.Once(a, _, arg):
            return min(last, told(arg, last) + a)
        case stl.Since(a, b, left, right):
            return min(last, told(right, last) + a, told(left, last) if b else last)
        case stl.Until(_, b, left, right) | stl.Release(_, b, left, right):
            if b in (0, stl.END):
                return told(right, last) if b == 0 else min(told(left, last), told(right, last))
            return min(told(right, last) - b, told(left, last) - b + 1)


def naive(formula: stl.Formula, trace: NDArray[np.float64], t: int, strict: bool = False) -> float:
    """rho at t from the definition, windows clipped to the trace: an empty maximum is -inf, an empty minimum +inf.

    Strict, an operator without an interval ends with the last step at which its operands can be told.
    """
    return defined(formula, t, len(trace) - 1, strict, lambda psi, s: float(stl.margin(psi, NAMES)(trace[s])))


def naive_satisfied(formula: stl.Formula, trace: NDArray[np.float64], t: int, strict: bool = False) -> bool:
    """s_t |= formula from the definition (eq. 1), likewise: a truth is 1, its opposite -1."""
    truth = defined(formula, t, len(trace) - 1, strict, lambda psi, s: 1.0 if stl.holds(psi, NAMES)(trace[s]) else -1.0)
    return truth > 0


def defined(
    formula: stl.Formula, t: int, last: int, strict: bool, value: Callable[[stl.Predicate, int], float]
) -> float:
    def at(part: stl.Formula, s: int) -> float:
        return defined(part, s, last, strict, value)

    def ahead(a: int, b: int, *parts: stl.Formula) -> range:
        end = min(told(part, last) for part in parts) if strict and b == stl.END else min(t + b, last)
        return range(t + a, end + 1)

    def until(steps: range, left: stl.Formula, right: stl.Formula, way: int) -> float:
        """The best of right at these steps, as far as left holds at each step on the way there."""
        reached = (min([at(right, s), *(at(left, r) for r in range(t, s, way))]) for s in steps)
        return max(reached, default=-math.inf)

    match formula:
        case stl.TrueFormula():
            return math.inf
        case stl.Predicate():
            return value(formula, t)
        case stl.Not(arg):
            return -at(arg, t)
        case stl.And(args):
            return min(at(arg, t) for arg in args)
        case stl.Or(args):
            return max(at(arg, t) for arg in args)
        case stl.Implies(left, right):
            return max(-at(left, t), at(right, t))
        case stl.Always(a, b, arg):
            return min((at(arg, s) for s in ahead(a, b, arg)), default=math.inf)
        case stl.Eventually(a, b, arg):
            return max((at(arg, s) for s in ahead(a, b, arg)), default=-math.inf)
        case stl.Until(a, b, left, right):
            return until(ahead(a, b, left, right), left, right, 1)
        case stl.Release(a, b, left, right):
            return -until(ahead(a, b, left, right), stl.Not(left), stl.Not(right), 1)
        case stl.Historically(a, b, arg):
            return min((at(arg, s) for s in range(max(t - b, 0), t - a + 1)), default=math.inf)
        case stl.Once(a, b, arg):
            return max((at(arg, s) for s in range(max(t - b, 0), t - a + 1)), default=-math.inf)
        case stl.Since(a, b, left, right):
            return until(range(max(t - b, 0), t - a + 1), left, right, -1)
