"""Formulas and traces for the property tests, and the definition of the semantics, word for word and slow."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench.stl import (
    END,
    Always,
    And,
    Binary,
    Call,
    Eventually,
    Expression,
    Formula,
    Historically,
    Implies,
    Negative,
    Not,
    Number,
    Once,
    Or,
    Predicate,
    Release,
    Signal,
    Since,
    TrueFormula,
    Until,
    holds,
    margin,
)

NAMES = ("x", "y", "z")
SIGNALS = st.sampled_from([Signal(name) for name in NAMES])
NUMBERS = st.sampled_from([0.0, 0.25, 0.5, 1.0, 2.0, 3.0]).map(Number)
COMPARISONS = st.sampled_from(["<=", ">=", "<", ">"])


def _grow_expression(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
    several = st.lists(inner, min_size=1, max_size=3).map(tuple)
    return st.one_of(
        st.builds(Negative, inner),
        st.builds(Binary, st.sampled_from("+-*"), inner, inner),
        st.builds(Binary, st.just("**"), inner, st.sampled_from([0, 1, 2, 3]).map(Number)),
        st.builds(Call, st.sampled_from(["min", "max", "norm", "norminf"]), several),
        st.builds(Call, st.sampled_from(["abs", "sin", "cos"]), inner.map(lambda arg: (arg,))),
    )


EXPRESSIONS = st.recursive(st.one_of(SIGNALS, NUMBERS), _grow_expression, max_leaves=4)
PREDICATES = st.builds(Predicate, COMPARISONS, EXPRESSIONS, EXPRESSIONS)
#: |h| is 1-Lipschitz in the sup norm of the samples
LIPSCHITZ = st.builds(Predicate, COMPARISONS, SIGNALS, NUMBERS)


def intervals(longest: int) -> st.SearchStrategy[tuple[int, int]]:
    """(a, b) with 0 <= a <= b <= longest."""
    return st.tuples(st.integers(0, longest), st.integers(0, longest)).map(lambda ends: (min(ends), max(ends)))


def _boolean(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    return st.one_of(
        st.builds(Not, inner), st.builds(And, several), st.builds(Or, several), st.builds(Implies, inner, inner)
    )


def _temporal(inner: st.SearchStrategy[Formula], longest: int, endless: bool, past: bool) -> st.SearchStrategy[Formula]:
    ends = intervals(longest)
    if endless:
        ends = st.one_of(ends, st.just((0, END)))
    windows = st.sampled_from([Always, Eventually, *([Historically, Once] if past else [])])
    between = st.sampled_from([Until, Release, *([Since] if past else [])])
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
) -> st.SearchStrategy[Formula]:
    """Formulas of any nesting with intervals up to `longest`; `endless`: or without; `constants`: `True` occurs;
    `past`: operators that look back occur."""
    base = st.one_of(predicates, predicates, predicates, st.just(TrueFormula())) if constants else predicates

    def grow(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
        return st.one_of(_boolean(inner), _temporal(inner, longest, endless, past))

    return st.recursive(base, grow, max_leaves=leaves)


def pointwise(predicates: st.SearchStrategy[Any] = PREDICATES) -> st.SearchStrategy[Formula]:
    """Formulas without temporal operators."""
    return st.recursive(st.one_of(predicates, st.just(TrueFormula())), _boolean, max_leaves=4)


#: the nestings for which monitors have operators of their own, and any others
WATCHED = st.one_of(
    formulas(leaves=4),
    formulas(leaves=4, endless=True),
    st.builds(lambda ac, de, psi: Eventually(*ac, Always(*de, psi)), intervals(6), intervals(6), pointwise(LIPSCHITZ)),
    st.builds(lambda ac, de, psi: Not(Always(*ac, Eventually(*de, psi))), intervals(6), intervals(6), pointwise()),
    st.builds(lambda ab, left, right: Until(*ab, left, right), intervals(8), pointwise(LIPSCHITZ), pointwise()),
)


def traces(steps: int, seed: int, batch: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Random traces (*batch, steps, 3) on a grid of quarters, so that ties and margins of exactly 0 are common."""
    return np.random.default_rng(seed).integers(-12, 13, size=(*batch, steps, len(NAMES))) / 4.0


SEEDS = st.integers(0, 2**32 - 1)


def told(formula: Formula, last: int) -> int:
    """The last step at which `formula` can be told on a trace with samples 0..last, perhaps negative."""
    match formula:
        case TrueFormula() | Predicate():
            return last
        case Not(arg):
            return told(arg, last)
        case And(args) | Or(args):
            return min(told(arg, last) for arg in args)
        case Implies(left, right):
            return min(told(left, last), told(right, last))
        case Always(_, b, arg) | Eventually(_, b, arg):
            return told(arg, last) - (0 if b == END else b)
        case Historically(a, _, arg) | Once(a, _, arg):
            return min(last, told(arg, last) + a)
        case Since(a, b, left, right):
            return min(last, told(right, last) + a, told(left, last) if b else last)
        case Until(_, b, left, right) | Release(_, b, left, right):
            if b in (0, END):
                return told(right, last) if b == 0 else min(told(left, last), told(right, last))
            return min(told(right, last) - b, told(left, last) - b + 1)


def naive(formula: Formula, trace: NDArray[np.float64], t: int, strict: bool = False) -> float:
    """rho at t from the definition, windows clipped to the trace: an empty maximum is -inf, an empty minimum +inf.

    Strict, an operator without an interval ends with the last step at which its operands can be told.
    """
    return defined(formula, t, len(trace) - 1, strict, lambda psi, s: float(margin(psi, NAMES)(trace[s])))


def naive_satisfied(formula: Formula, trace: NDArray[np.float64], t: int, strict: bool = False) -> bool:
    """s_t |= formula from the definition (eq. 1), likewise: a truth is 1, its opposite -1."""
    truth = defined(formula, t, len(trace) - 1, strict, lambda psi, s: 1.0 if holds(psi, NAMES)(trace[s]) else -1.0)
    return truth > 0


def defined(formula: Formula, t: int, last: int, strict: bool, value: Callable[[Predicate, int], float]) -> float:
    def at(part: Formula, s: int) -> float:
        return defined(part, s, last, strict, value)

    def ahead(a: int, b: int, *parts: Formula) -> range:
        end = min(told(part, last) for part in parts) if strict and b == END else min(t + b, last)
        return range(t + a, end + 1)

    def until(steps: range, left: Formula, right: Formula, way: int) -> float:
        """The best of right at these steps, as far as left holds at each step on the way there."""
        reached = (min([at(right, s), *(at(left, r) for r in range(t, s, way))]) for s in steps)
        return max(reached, default=-math.inf)

    match formula:
        case TrueFormula():
            return math.inf
        case Predicate():
            return value(formula, t)
        case Not(arg):
            return -at(arg, t)
        case And(args):
            return min(at(arg, t) for arg in args)
        case Or(args):
            return max(at(arg, t) for arg in args)
        case Implies(left, right):
            return max(-at(left, t), at(right, t))
        case Always(a, b, arg):
            return min((at(arg, s) for s in ahead(a, b, arg)), default=math.inf)
        case Eventually(a, b, arg):
            return max((at(arg, s) for s in ahead(a, b, arg)), default=-math.inf)
        case Until(a, b, left, right):
            return until(ahead(a, b, left, right), left, right, 1)
        case Release(a, b, left, right):
            return -until(ahead(a, b, left, right), Not(left), Not(right), 1)
        case Historically(a, b, arg):
            return min((at(arg, s) for s in range(max(t - b, 0), t - a + 1)), default=math.inf)
        case Once(a, b, arg):
            return max((at(arg, s) for s in range(max(t - b, 0), t - a + 1)), default=-math.inf)
        case Since(a, b, left, right):
            return until(range(max(t - b, 0), t - a + 1), left, right, -1)
