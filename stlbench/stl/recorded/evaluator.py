"""Formulas compiled to functions that evaluate many traces at once, and the values that a formula can have.

An evaluator returns the values at steps lo..hi and evaluates its operands at exactly the steps that it needs, so t = 0
alone reads only the windows that the formula names. Values are robustness, or signed margins (see `dialect`), whose
sign is the verdict; only predicates are compiled differently.
"""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache, reduce
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.arithmetic.folds import Values, slide, until
from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.structure import is_temporal, lookahead, lookbehind, signals, walk
from stlbench.stl.language.syntax import END, Between, Connective, Formula, Predicate, Prefix, Release
from stlbench.stl.predicates import compile_arrays, evaluated, margin, without_value
from stlbench.stl.predicates.writer import Reading


def value_range(formula: Formula, of: Callable[[Predicate], tuple[float, float]]) -> tuple[float, float]:
    """Sound bounds of the robustness over all traces on which the margin of each predicate is within its bounds `of`.

    A past operator whose interval can lie before step 0 has infinity as one of them.
    """
    match formula:
        case Predicate():
            return of(formula)
        case Connective():
            ranges = (_signed_range(value_range(arg, of), negated) for arg, negated in formula.signed)
            lows, highs = zip(*ranges, strict=True)
            pick = min if formula.least else max
            return pick(lows), pick(highs)
        case Prefix(a, _, arg):
            low, high = value_range(arg, of)
            if formula.past and a > 0:
                return (low, math.inf) if formula.least else (-math.inf, high)
            return low, high
        case Between(a, _, left, right):
            goal = value_range(right, of)
            if a == 0:  # at the step itself the goal counts without a guard
                return goal
            pick = max if isinstance(formula, Release) else min
            low, high = map(pick, value_range(left, of), goal)
            return (-math.inf if formula.past else low), high
        case _:
            return math.inf, math.inf


def _signed_range(ends: tuple[float, float], negated: bool) -> tuple[float, float]:
    return (-ends[1], -ends[0]) if negated else ends


@lru_cache(maxsize=512)
def unknown(psi: Formula, names: tuple[str, ...], reading: Reading, worst: bool) -> float:
    """The least (`worst`) or greatest value of `psi` at a sample that is not known yet: infinite unless constant."""

    def bounds(predicate: Predicate) -> tuple[float, float]:
        constant = compile_arrays(predicate, names, reading)
        return (-math.inf, math.inf) if callable(constant) else (float(constant), float(constant))

    return value_range(psi, bounds)[0 if worst else 1]


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

    Where a predicate has no value at a sample that is read the values are NaN, or infinite where it overflows;
    `checked` raises UndefinedError there.
    """
    if not is_temporal(formula):
        return _pointwise(formula, names, reading, checked)

    def of(operand: Formula, negated: bool = False) -> Evaluator:
        inner = evaluator(operand, names, reading, checked)
        return _negated(inner) if negated else inner

    match formula:
        case Connective():
            return _joined([of(*part) for part in formula.signed], np.minimum if formula.least else np.maximum)
        case Prefix():
            return _window(formula, of(formula.arg))
        case Release():  # the opposite of an until of the opposites
            return _negated(_between(formula, of(formula.left, True), of(formula.right, True)))
        case Between():
            return _between(formula, of(formula.left), of(formula.right))
        case _:  # pragma: no cover - predicates and True are pointwise
            raise AssertionError(formula)


def _pointwise(psi: Formula, names: tuple[str, ...], reading: Reading, checked: bool) -> Evaluator:
    compiled = compile_arrays(psi, names, reading)

    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        known = traces.samples[:, lo : hi + 1]
        if not callable(compiled):
            return np.full((known.shape[0], hi - lo + 1), float(compiled))
        if not checked:
            values: Values = compiled(known)
        else:
            values, wrong = evaluated(compiled, psi, names, known)
            if wrong is not None and wrong.any():
                trace, step = np.argwhere(wrong)[0]
                raise UndefinedError(cause(psi, names, known[trace, step]), int(lo + step), int(traces.first + trace))
        if hi < traces.samples.shape[1]:
            return values
        return _pad(values, hi - lo + 1 - known.shape[1], unknown(psi, names, reading, worst))

    return run


def cause(psi: Formula, names: tuple[str, ...], sample: NDArray[np.float64]) -> str:
    """Why `psi`, without temporal operators, has no value at `sample` (k,), by the first predicate that has none."""
    for node in walk(psi):
        if isinstance(node, Predicate) and without_value(node, names, sample):
            psi = node
            break
    values = {name: float(sample[names.index(name)]) for name in signals(psi)}
    for name, value in values.items():
        if math.isnan(value):
            return f"signal {shorten(name)!r} is NaN"
    with np.errstate(all="ignore"):
        overflows = isinstance(psi, Predicate) and np.isinf(margin(psi, names)(sample))
    fault = "overflows" if overflows else "has no value (square root below 0, division by 0 or inf - inf)"
    shown = shorten(", ".join(f"{name} = {value:g}" for name, value in values.items()))
    return f"{shorten(str(psi))} {fault} where {shown}"


def _negated(arg: Evaluator) -> Evaluator:
    return lambda traces, lo, hi, worst: -arg(traces, lo, hi, not worst)


def _joined(args: list[Evaluator], pick: np.ufunc) -> Evaluator:
    return lambda traces, lo, hi, worst: reduce(pick, [arg(traces, lo, hi, worst) for arg in args])


def _window(formula: Prefix, arg: Evaluator) -> Evaluator:
    """G, F, H or O: the extreme at the steps of the interval that the trace has."""
    pick, empty = (np.minimum, math.inf) if formula.least else (np.maximum, -math.inf)
    beyond, first = lookahead(formula.arg), lookbehind(formula.arg)

    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        if formula.b == END and formula.past:
            start = first if formula in traces.before else 0
            values = arg(traces, start, hi, worst)
            if formula in traces.before:
                values = np.column_stack([pick(values[:, 0], traces.before[formula]), values[:, 1:]])
            so_far: Values = pick.accumulate(values, axis=1)[:, lo - start :]
            return so_far
        if formula.b == END and traces.end == "strict":
            return _to_the_end(arg(traces, lo, traces.last - beyond, worst), hi - lo + 1, pick)
        near, far = _reach(formula, traces, lo, hi)
        ends = (lo - far, hi - near) if formula.past else (lo + near, hi + far)
        return slide(_around(arg, traces, *ends, worst, empty), far - near + 1, pick)

    return run


def _between(formula: Between, left: Evaluator, right: Evaluator) -> Evaluator:
    """An until; for the past, of the steps in reverse."""
    beyond, first = lookahead(formula), max(lookbehind(formula.left), lookbehind(formula.right))

    def run(traces: Traces, lo: int, hi: int, worst: bool) -> Values:
        def joined(guard: Values, goal: Values, near: int) -> Values:
            if formula.past:
                return until(guard[:, ::-1], goal[:, ::-1], near, hi - lo + 1)[:, ::-1]
            return until(guard, goal, near, hi - lo + 1)

        if formula.past and formula in traces.before:  # as if the goal had that value at the step before `first`
            goal = np.column_stack([traces.before[formula], right(traces, first, hi, worst)])
            return joined(_lengthened(left(traces, first, hi, worst), lo - hi), _lengthened(goal, lo - hi), 0)
        if formula.b == END and traces.end == "strict" and not formula.past:
            last = traces.last - beyond
            goal = right(traces, lo, last, worst)
            if last == lo:
                return goal
            return joined(_lengthened(left(traces, lo, last - 1, worst), hi - lo), _lengthened(goal, hi - lo), 0)
        near, far = _reach(formula, traces, lo, hi)
        goals, guards = (lo + near, hi + far), (lo, hi + far - 1)
        if formula.past:
            goals, guards = (lo - far, hi - near), (lo - far + 1, hi)
        goal = _around(right, traces, *goals, worst, -math.inf)
        if not far:
            return goal
        read = _on_the_way(formula, traces, lo, hi, near, far)
        if read == guards:
            return joined(_around(left, traces, *guards, worst, math.inf), goal, near)
        guard = np.full((len(goal), guards[1] - guards[0] + 1), math.inf)
        if read[0] <= read[1]:
            way = slice(read[0] - guards[0], read[1] - guards[0] + 1)
            guard[:, way] = _around(left, traces, *read, worst, math.inf)
        return joined(guard, goal, near)

    return run


def _on_the_way(formula: Between, traces: Traces, lo: int, hi: int, near: int, far: int) -> tuple[int, int]:
    """The first and the last step that lie between some step of lo..hi and a goal of the trace; first > last for none.

    Elsewhere the left operand is not read: at step 0 by no operator of the past, nor at the last step of a cut trace.
    """
    if formula.past:
        first = max(lo, near)  # that has a goal at step 0 or after it
        return (max(1, first - far + 1), hi) if first <= hi else (hi + 1, hi)
    if traces.end != "clip":
        return lo, hi + far - 1
    last = min(hi, traces.last - near)  # that has a goal
    return (lo, min(last + far, traces.last) - 1) if lo <= last else (lo, lo - 1)


def _lengthened(values: Values, count: int) -> Values:
    """So many steps more at which nothing holds; for a negative count, earlier ones."""
    nothing = np.full((len(values), abs(count)), -math.inf)
    return np.hstack([values, nothing] if count > 0 else [nothing, values])


def _to_the_end(values: Values, count: int, pick: np.ufunc) -> Values:
    """`pick` over each of the first `count` steps and all that follow it."""
    if count == 1:
        return pick.reduce(values, axis=1, keepdims=True)  # type: ignore[no-any-return]
    later: Values = pick.accumulate(values[:, ::-1], axis=1)[:, ::-1]
    return later[:, :count]


def _reach(formula: Prefix | Between, traces: Traces, lo: int, hi: int) -> tuple[int, int]:
    """How far the interval's ends are, cut where every window is outside.

    So a huge interval costs no memory, unless a wide past below it makes the unknown future as long.
    """
    outside = hi + 1 if formula.past else traces.last - lo + 1
    return min(formula.a, outside), min(formula.b, outside)


def _around(arg: Evaluator, traces: Traces, lo: int, hi: int, worst: bool, empty: float) -> Values:
    """Values at lo..hi, `empty` outside of the trace; under `interval` what is still to come is unknown there."""
    last = traces.last
    if lo >= 0 and hi <= last:
        return arg(traces, lo, hi, worst)
    if lo < 0 or (lo > last and traces.end != "interval"):
        out = np.full((traces.samples.shape[0], hi - lo + 1), empty)
        if lo < 0 <= hi:
            out[:, -lo:] = arg(traces, 0, hi, worst)
        return out
    known = arg(traces, min(lo, last), last, worst)
    if traces.end == "interval":
        return _pad(known, hi - max(lo, last), known[:, -1:])[:, -(hi - lo + 1) :]
    return _pad(known, hi - last, empty)


def _pad(values: Values, count: int, fill: Any) -> Values:
    out = np.empty((values.shape[0], values.shape[1] + count), dtype=values.dtype)
    out[:, : values.shape[1]] = values
    out[:, values.shape[1] :] = fill
    return out
