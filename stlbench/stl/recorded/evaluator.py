"""Formulas compiled to plans that evaluate many traces at once.

A plan answers "the values at steps lo..hi" and asks its operands for exactly the steps it needs, so that t = 0 alone
reads only the windows the formula names. The same plans compute robustness (on floats) and satisfaction (on bools, from
the Boolean semantics); only the `Algebra` differs.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial, reduce
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.language.syntax import Always, And, Eventually, Formula, Implies, Not, Or, TrueFormula, Until
from stlbench.stl.language.traversal import is_temporal
from stlbench.stl.predicates.compiler import Operand, compile_holds, compile_margin, compile_sided
from stlbench.stl.recorded.windows import Values, slide, until

Policy: TypeAlias = Literal["strict", "clip", "interval"]


@dataclass(frozen=True)
class Algebra:
    """The values a formula takes: reals with min, max and -, or truth values with and, or and not."""

    dtype: type
    bottom: float | bool
    top: float | bool
    negate: Callable[[Any], Any]
    compile: Callable[[Formula, tuple[str, ...]], Operand]


ROBUST = Algebra(float, -math.inf, math.inf, operator.neg, compile_margin)
#: robustness and verdict in one number, see `sided`
SIDED = Algebra(float, -math.inf, math.inf, operator.neg, compile_sided)
BOOLEAN = Algebra(bool, False, True, np.logical_not, partial(compile_holds, checked=True))


class Recording(NamedTuple):
    """Samples (n, T+1, k) of n traces, and how the steps after T are read.

    `last` is the last step with a value of its own: T, or T + 1 under `interval`, where that one sample stands for the
    whole unknown future.
    """

    samples: NDArray[np.float64]
    policy: Policy
    last: int


#: (recording, lo, hi, worst) -> values (n, hi - lo + 1) at steps lo..hi <= last; `worst` says which end of the values
#: that unknown samples may still take is asked for, the least or the greatest
Plan: TypeAlias = Callable[[Recording, int, int, bool], Values]


@lru_cache(maxsize=128)
def plan(formula: Formula, names: tuple[str, ...], algebra: Algebra) -> Plan:
    """The plan of `formula` on recordings of the signals `names`."""
    if not is_temporal(formula):
        return _pointwise_plan(formula, names, algebra)
    match formula:
        case Not(arg):
            return _negated(plan(arg, names, algebra), algebra)
        case And(args):
            return _joined([plan(arg, names, algebra) for arg in args], np.minimum)
        case Or(args):
            return _joined([plan(arg, names, algebra) for arg in args], np.maximum)
        case Implies(left, right):
            premise = _negated(plan(left, names, algebra), algebra)
            return _joined([premise, plan(right, names, algebra)], np.maximum)
        case Always(a, b, arg):
            return _window_plan(plan(arg, names, algebra), a, b, np.minimum, algebra.top)
        case Eventually(a, b, arg):
            return _window_plan(plan(arg, names, algebra), a, b, np.maximum, algebra.bottom)
        case Until(a, b, left, right):
            return _until_plan(plan(left, names, algebra), plan(right, names, algebra), a, b, algebra)
        case _:  # pragma: no cover - predicates and True are pointwise
            raise AssertionError(formula)


def _pointwise_plan(psi: Formula, names: tuple[str, ...], algebra: Algebra) -> Plan:
    compiled = algebra.compile(psi, names)

    def run(recording: Recording, lo: int, hi: int, worst: bool) -> Values:
        known = recording.samples[:, lo : hi + 1]
        if not callable(compiled):
            return np.full((known.shape[0], hi - lo + 1), compiled, dtype=algebra.dtype)
        values: Values = compiled(known)
        if hi < recording.samples.shape[1]:
            return values
        return _pad(values, 1, unknown(psi, algebra, names, worst))

    return run


def unknown(psi: Formula, algebra: Algebra, names: tuple[str, ...], worst: bool) -> Any:
    """The least (`worst`) or greatest value of `psi` at a sample that is not known yet: infinite unless constant."""
    match psi:
        case Not(arg):
            return algebra.negate(unknown(arg, algebra, names, not worst))
        case And(args):
            return min(unknown(arg, algebra, names, worst) for arg in args)
        case Or(args):
            return max(unknown(arg, algebra, names, worst) for arg in args)
        case Implies(left, right):
            return max(algebra.negate(unknown(left, algebra, names, not worst)), unknown(right, algebra, names, worst))
        case TrueFormula():
            return algebra.top
        case _:
            constant = algebra.compile(psi, names)
            return constant if not callable(constant) else algebra.bottom if worst else algebra.top


def _negated(arg: Plan, algebra: Algebra) -> Plan:
    return lambda recording, lo, hi, worst: algebra.negate(arg(recording, lo, hi, not worst))


def _joined(args: list[Plan], pick: np.ufunc) -> Plan:
    return lambda recording, lo, hi, worst: reduce(pick, [arg(recording, lo, hi, worst) for arg in args])


def _window_plan(arg: Plan, a: int, b: int, pick: np.ufunc, empty: float | bool) -> Plan:
    def run(recording: Recording, lo: int, hi: int, worst: bool) -> Values:
        if hi + b <= recording.last:
            return slide(arg(recording, lo + a, hi + b, worst), b - a + 1, pick)
        start, stop = _capped(recording, a, b, lo)
        ahead = _ahead(arg, recording, lo + start, hi + stop, worst, empty)
        return slide(ahead, stop - start + 1, pick)

    return run


def _until_plan(left: Plan, right: Plan, a: int, b: int, algebra: Algebra) -> Plan:
    def run(recording: Recording, lo: int, hi: int, worst: bool) -> Values:
        start, stop = _capped(recording, a, b, lo)
        goal = _ahead(right, recording, lo + start, hi + stop, worst, algebra.bottom)
        if stop == 0:
            return goal
        guard = _ahead(left, recording, lo, hi + stop - 1, worst, algebra.top)
        return until(guard, goal, start, hi - lo + 1)

    return run


def _capped(recording: Recording, a: int, b: int, lo: int) -> tuple[int, int]:
    """Interval ends, cut where every window is past the end already, so that huge intervals cost no memory."""
    beyond = recording.last - lo + 1
    return min(a, beyond), min(b, beyond)


def _ahead(plan: Plan, recording: Recording, lo: int, hi: int, worst: bool, empty: float | bool) -> Values:
    """Values at lo..hi where hi may lie past the end: `empty` there, or under `interval` the unknown value."""
    last = recording.last
    if hi <= last:
        return plan(recording, lo, hi, worst)
    if recording.policy == "interval":
        known = plan(recording, min(lo, last), last, worst)
        return _pad(known, hi - max(lo, last), known[:, -1:])[:, -(hi - lo + 1) :]
    if lo > last:
        dtype = bool if isinstance(empty, bool) else float
        return np.full((recording.samples.shape[0], hi - lo + 1), empty, dtype=dtype)
    return _pad(plan(recording, lo, last, worst), hi - last, empty)


def _pad(values: Values, count: int, fill: Any) -> Values:
    out = np.empty((values.shape[0], values.shape[1] + count), dtype=values.dtype)
    out[:, : values.shape[1]] = values
    out[:, values.shape[1] :] = fill
    return out
