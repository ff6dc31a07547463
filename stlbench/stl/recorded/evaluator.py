"""Formulas compiled to functions that evaluate many traces at once.

An evaluator returns the values at steps lo..hi and evaluates its operands at exactly the steps that it needs, so t = 0
alone reads only the windows that the formula names. Values are robustness, or signed margins (see `dialect`), whose
sign is the verdict; only predicates are compiled differently.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache, reduce
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.structure import is_temporal, lookahead, lookbehind, signals, walk
from stlbench.stl.language.syntax import (
    END,
    Always,
    And,
    Eventually,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Predicate,
    Release,
    Since,
    TrueFormula,
    Until,
)
from stlbench.stl.predicates import compile_arrays
from stlbench.stl.predicates.writer import Reading
from stlbench.stl.recorded.windows import Values, slide, until

#: how a trace that ends before the horizon is read; "interval": its end is unknown, and values are bounds
End: TypeAlias = Literal["strict", "clip", "interval"]


class Traces(NamedTuple):
    """Samples (n, T+1, k) of n traces, and how the steps after T are read.

    `last` is the last step with a value of its own: T. Under `interval` it is the first step from which on no operator
    can reach back to a known sample: that one step stands for the whole unknown future.

    `before` is for samples that are not the first of their trace. It has the value of each past operator without an
    interval at the step before the first at which its operands have a value from these samples.
    """

    samples: NDArray[np.float64]
    end: End
    last: int
    first: int = 0  # the number of the first trace, in messages
    before: Mapping[Formula, Values] = {}


#: (traces, lo, hi, worst) -> values (n, hi - lo + 1) at steps lo..hi <= last: the least (`worst`) or the greatest that
#: unknown samples may still give
Evaluator: TypeAlias = Callable[[Traces, int, int, bool], Values]


@lru_cache(maxsize=128)
def evaluator(formula: Formula, names: tuple[str, ...], reading: Reading, checked: bool = False) -> Evaluator:
    """The evaluator of `formula` on traces of the signals `names`.

    Where a predicate has no value at a sample that is read the values are NaN; `checked` raises UndefinedError there.
    """
    if not is_temporal(formula):
        return _pointwise(formula, names, reading, checked)

    def of(operand: Formula) -> Evaluator:
        return evaluator(operand, names, reading, checked)

    match formula:
        case Not(arg):
            return _negated(of(arg))
        case And(args) | Or(args):
            return _joined([of(arg) for arg in args], _EXTREMES[type(formula)][0])
        case Implies(left, right):
            return _joined([_negated(of(left)), of(right)], np.maximum)
        case Always(a, b, arg) | Eventually(a, b, arg):
            return _window(of(arg), a, b, lookahead(arg), *_EXTREMES[type(formula)])
        case Until(a, b, left, right):
            return _until(of(left), of(right), a, b, lookahead(formula))
        case Release(a, b, left, right):
            return _negated(_until(_negated(of(left)), _negated(of(right)), a, b, lookahead(formula)))
        case Historically(a, b, arg) | Once(a, b, arg):
            return _past_window(formula, of(arg), a, b, *_EXTREMES[type(formula)])
        case Since(a, b, left, right):
            return _since(formula, of(left), of(right), a, b)
        case _:  # pragma: no cover - predicates and True are pointwise
            raise AssertionError(formula)


#: the extreme that an operator takes, and its value of an empty window
_EXTREMES: dict[type, tuple[np.ufunc, float]] = {
    **dict.fromkeys((And, Always, Historically), (np.minimum, math.inf)),
    **dict.fromkeys((Or, Eventually, Once), (np.maximum, -math.inf)),
}


def _pointwise(psi: Formula, names: tuple[str, ...], reading: Reading, checked: bool) -> Evaluator:
    compiled = compile_arrays(psi, names, reading)

    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        known = traces.samples[:, lo : hi + 1]
        if not callable(compiled):
            return np.full((known.shape[0], hi - lo + 1), float(compiled))
        values: Values = compiled(known)
        if checked and np.isnan(values).any():
            trace, step = np.argwhere(np.isnan(values))[0]
            raise UndefinedError(cause(psi, names, known[trace, step]), int(lo + step), int(traces.first + trace))
        if hi < traces.samples.shape[1]:
            return values
        return _pad(values, hi - lo + 1 - known.shape[1], unknown(psi, names, reading, worst))

    return run


def cause(psi: Formula, names: tuple[str, ...], sample: NDArray[np.float64]) -> str:
    """Why `psi`, without temporal operators, has no value at `sample` (k,), by the first predicate that has none."""
    with np.errstate(all="ignore"):
        for node in walk(psi):
            margin = compile_arrays(node, names, "signed") if isinstance(node, Predicate) else None
            if isinstance(node, Predicate) and callable(margin) and np.isnan(margin(sample[np.newaxis])).any():
                psi = node
                break
    values = {name: float(sample[names.index(name)]) for name in signals(psi)}
    for name, value in values.items():
        if math.isnan(value):
            return f"signal {shorten(name)!r} is NaN"
    shown = shorten(", ".join(f"{name} = {value:g}" for name, value in values.items()))
    return f"{shorten(str(psi))} has no value (square root below 0, division by 0 or inf - inf) where {shown}"


@lru_cache(maxsize=512)
def unknown(psi: Formula, names: tuple[str, ...], reading: Reading, worst: bool) -> float:
    """The least (`worst`) or greatest value of `psi` at a sample that is not known yet: infinite unless constant."""
    match psi:
        case Not(arg):
            return -unknown(arg, names, reading, not worst)
        case And(args):
            return min(unknown(arg, names, reading, worst) for arg in args)
        case Or(args):
            return max(unknown(arg, names, reading, worst) for arg in args)
        case Implies(left, right):
            return max(-unknown(left, names, reading, not worst), unknown(right, names, reading, worst))
        case TrueFormula():
            return math.inf
        case _:
            if signals(psi):
                return -math.inf if worst else math.inf
            constant = compile_arrays(psi, names, reading)
            assert not callable(constant)
            return float(constant)


def _negated(arg: Evaluator) -> Evaluator:
    return lambda traces, lo, hi, worst: -arg(traces, lo, hi, not worst)


def _joined(args: list[Evaluator], pick: np.ufunc) -> Evaluator:
    return lambda traces, lo, hi, worst: reduce(pick, [arg(traces, lo, hi, worst) for arg in args])


def _window(arg: Evaluator, a: int, b: int, beyond: int, pick: np.ufunc, empty: float) -> Evaluator:
    """G or F; `beyond` steps must follow one at which `arg` has a value."""

    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        if b == END and traces.end == "strict":
            return _to_the_end(arg(traces, lo, traces.last - beyond, worst), hi - lo + 1, pick)
        start, stop = _capped(traces, a, b, lo)
        ahead = _ahead(arg, traces, lo + start, hi + stop, worst, empty)
        return slide(ahead, stop - start + 1, pick)

    return run


def _until(left: Evaluator, right: Evaluator, a: int, b: int, beyond: int) -> Evaluator:
    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        if b == END and traces.end == "strict":
            last = traces.last - beyond
            goal = right(traces, lo, last, worst)
            if last == lo:
                return goal
            guard, padding = left(traces, lo, last - 1, worst), np.full((len(goal), hi - lo), -math.inf)
            return until(np.hstack([guard, padding]), np.hstack([goal, padding]), 0, hi - lo + 1)
        start, stop = _capped(traces, a, b, lo)
        goal = _ahead(right, traces, lo + start, hi + stop, worst, -math.inf)
        if stop == 0:
            return goal
        guard = _ahead(left, traces, lo, hi + stop - 1, worst, math.inf)
        return until(guard, goal, start, hi - lo + 1)

    return run


def _past_window(
    formula: Historically | Once, arg: Evaluator, a: int, b: int, pick: np.ufunc, empty: float
) -> Evaluator:
    """H or O, its window cut at step 0."""
    first = lookbehind(formula.arg)

    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        if b == END:
            start = first if formula in traces.before else 0
            values = arg(traces, start, hi, worst)
            if formula in traces.before:
                values = np.column_stack([pick(values[:, 0], traces.before[formula]), values[:, 1:]])
            so_far: Values = pick.accumulate(values, axis=1)[:, lo - start :]
            return so_far
        stop, start = min(a, hi + 1), min(b, hi + 1)  # huge intervals cost no memory
        return slide(_behind(arg, traces, lo - start, hi - stop, worst, empty), start - stop + 1, pick)

    return run


def _since(formula: Since, left: Evaluator, right: Evaluator, a: int, b: int) -> Evaluator:
    """An until of the steps in reverse."""
    first = max(lookbehind(formula.left), lookbehind(formula.right))

    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        known = traces.before.get(formula)
        if known is not None:  # as if the goal had that value at the step before `first`
            goal = np.column_stack([known, right(traces, first, hi, worst)])
            guard = left(traces, first, hi, worst)
            earlier = np.full((len(goal), hi - lo), -math.inf)
            goal, guard = np.hstack([earlier, goal]), np.hstack([earlier, guard])
            return until(guard[:, ::-1], goal[:, ::-1], 0, hi - lo + 1)[:, ::-1]
        stop, start = min(a, hi + 1), min(b, hi + 1)  # huge intervals cost no memory
        goal = _behind(right, traces, lo - start, hi - stop, worst, -math.inf)
        if start == 0:
            return goal
        guard = _behind(left, traces, lo - start + 1, hi, worst, math.inf)
        return until(guard[:, ::-1], goal[:, ::-1], stop, hi - lo + 1)[:, ::-1]

    return run


def _behind(arg: Evaluator, traces: Traces, lo: int, hi: int, worst: bool, empty: float) -> Values:
    """Values at lo..hi where lo may lie before step 0: `empty` there."""
    if lo >= 0:
        return arg(traces, lo, hi, worst)
    out = np.full((traces.samples.shape[0], hi - lo + 1), empty)
    if hi >= 0:
        out[:, -lo:] = arg(traces, 0, hi, worst)
    return out


def _to_the_end(values: Values, count: int, pick: np.ufunc) -> Values:
    """`pick` over each of the first `count` steps and all that follow it."""
    if count == 1:
        return pick.reduce(values, axis=1, keepdims=True)  # type: ignore[no-any-return]
    later: Values = pick.accumulate(values[:, ::-1], axis=1)[:, ::-1]
    return later[:, :count]


def _capped(traces: Traces, a: int, b: int, lo: int) -> tuple[int, int]:
    """Interval ends, cut where every window is past the end already, so that huge intervals cost no memory."""
    beyond = traces.last - lo + 1
    return min(a, beyond), min(b, beyond)


def _ahead(arg: Evaluator, traces: Traces, lo: int, hi: int, worst: bool, empty: float) -> Values:
    """Values at lo..hi where hi may lie past the end: `empty` there, or under `interval` the unknown value."""
    last = traces.last
    if hi <= last:
        return arg(traces, lo, hi, worst)
    if traces.end == "interval":
        known = arg(traces, min(lo, last), last, worst)
        return _pad(known, hi - max(lo, last), known[:, -1:])[:, -(hi - lo + 1) :]
    if lo > last:
        return np.full((traces.samples.shape[0], hi - lo + 1), empty)
    return _pad(arg(traces, lo, last, worst), hi - last, empty)


def _pad(values: Values, count: int, fill: Any) -> Values:
    out = np.empty((values.shape[0], values.shape[1] + count), dtype=values.dtype)
    out[:, : values.shape[1]] = values
    out[:, values.shape[1] :] = fill
    return out
