"""Robustness and satisfaction of recorded traces, at t = 0 or as a full trace.

Satisfaction is its own evaluation in the Boolean semantics, never the sign of the robustness: at robustness 0 the two
say different things (`x >= 0` holds at x = 0, `x > 0` does not).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import ShortTraceError, UndefinedError
from stlbench.stl.language.horizon import horizon
from stlbench.stl.language.syntax import Formula
from stlbench.stl.language.traversal import signals
from stlbench.stl.predicates.compiler import check_names
from stlbench.stl.recorded.evaluator import BOOLEAN, ROBUST, Algebra, Plan, Policy, Recording, plan
from stlbench.stl.recorded.windows import Values

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
#: samples evaluated together, a signal; few enough for the cache, many enough to hide the interpreter
SAMPLES = 2**15


@dataclass(frozen=True)
class _Question:
    """A formula on named signals, with what is worked out once: how far it looks ahead and its plan."""

    algebra: Algebra
    formula: Formula
    names: tuple[str, ...]
    ahead: int
    plan: Plan


@lru_cache(maxsize=128)
def _question(algebra: Algebra, formula: Formula, names: tuple[str, ...]) -> _Question:
    check_names(formula, names)
    return _Question(algebra, formula, names, horizon(formula), plan(formula, names, algebra))


@overload
def robustness(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["strict", "clip"] = "strict"
) -> Floats: ...
@overload
def robustness(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["interval"]
) -> tuple[Floats, Floats]: ...
def robustness(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Policy = "strict"
) -> Floats | tuple[Floats, Floats]:
    """Robustness of `formula` at t = 0.

    Args:
        formula: any formula; intervals in steps.
        trace: (..., T+1, k) floats in the signals' units; samples beyond the horizon are not read.
        names: the k signals, in the order of the last axis.
        policy: for T < horizon: `strict` is an error; `clip` cuts windows at T as rtamt does (an empty window is +inf
            for G and -inf for F and U); `interval` bounds the value over all continuations of the trace.

    Returns:
        rho (...,), or for `interval` the pair (lower, upper), equal where T >= horizon.

    Raises:
        ShortTraceError: under `strict`, "needs 2001 samples, got 200".
        UnknownSignalError: the formula uses a signal not in `names`.
        UndefinedError: a sample that is read is NaN, or a predicate has no value there.
        ValueError: shapes, names or policy do not fit.
    """
    answer: Floats | tuple[Floats, Floats] = evaluate(ROBUST, formula, trace, names, policy, full=False)
    return answer


@overload
def robustness_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["strict", "clip"] = "strict"
) -> Floats: ...
@overload
def robustness_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["interval"]
) -> tuple[Floats, Floats]: ...
def robustness_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Policy = "strict"
) -> Floats | tuple[Floats, Floats]:
    """Robustness at every t: (..., T+1-horizon) under `strict`, (..., T+1) under the others; else as `robustness`."""
    answer: Floats | tuple[Floats, Floats] = evaluate(ROBUST, formula, trace, names, policy, full=True)
    return answer


@overload
def satisfied(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["strict", "clip"] = "strict"
) -> Bools: ...
@overload
def satisfied(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["interval"]
) -> tuple[Bools, Bools]: ...
def satisfied(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Policy = "strict"
) -> Bools | tuple[Bools, Bools]:
    """Whether the trace satisfies `formula` at t = 0, by the Boolean semantics (not by the sign of the robustness).

    Returns bool (...,), or for `interval` the pair (certainly, possibly) over all continuations; else as `robustness`.
    """
    answer: Bools | tuple[Bools, Bools] = evaluate(BOOLEAN, formula, trace, names, policy, full=False)
    return answer


@overload
def satisfied_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["strict", "clip"] = "strict"
) -> Bools: ...
@overload
def satisfied_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Literal["interval"]
) -> tuple[Bools, Bools]: ...
def satisfied_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Policy = "strict"
) -> Bools | tuple[Bools, Bools]:
    """Satisfaction at every t, shapes as `robustness_trace`."""
    answer: Bools | tuple[Bools, Bools] = evaluate(BOOLEAN, formula, trace, names, policy, full=True)
    return answer


def evaluate(
    algebra: Algebra, formula: Formula, trace: ArrayLike, names: Sequence[str], policy: Policy, full: bool
) -> Any:
    """The value of `formula` in `algebra` at t = 0 or (`full`) at every t; arguments and errors as `robustness`."""
    if policy not in ("strict", "clip", "interval"):
        raise ValueError(f"policy is 'strict', 'clip' or 'interval', got {policy!r}")
    question = _question(algebra, formula, tuple(names))
    samples = np.asarray(trace)
    _check(question, samples, policy)
    steps = samples.shape[-2]
    count = 1 if not full else steps - question.ahead if policy == "strict" else steps
    read = count + question.ahead if policy == "strict" else steps if full else min(steps, question.ahead + 1)
    flat = samples.reshape(math.prod(samples.shape[:-2]), *samples.shape[-2:])[:, :read]
    shape = (*samples.shape[:-2], count) if full else samples.shape[:-2]
    lower = _in_chunks(question, flat, policy, count, True).reshape(shape)
    if policy != "interval":
        return lower
    return lower, _in_chunks(question, flat, policy, count, False).reshape(shape)


def _in_chunks(question: _Question, flat: NDArray[Any], policy: Policy, count: int, worst: bool) -> Values:
    """Values at steps 0..count-1 of all traces (n, T+1, k), chunk by chunk: (n, count)."""
    dtype = question.algebra.dtype
    out: Values = np.empty((flat.shape[0], count), dtype=dtype)
    steps = flat.shape[1]
    last = steps if policy == "interval" else steps - 1
    chunk = max(1, SAMPLES // max(1, steps))
    for start in range(0, flat.shape[0], chunk):
        recording = Recording(np.asarray(flat[start : start + chunk], dtype=np.float64), policy, last)
        part = out[start : start + chunk]
        try:
            with np.errstate(all="ignore"):
                part[...] = question.plan(recording, 0, count - 1, worst)
            undefined = dtype is float and bool(np.isnan(part).any())
        except UndefinedError:
            undefined = True
        if undefined:
            raise _undefined(recording.samples, start, question)
    return out


def _check(question: _Question, samples: NDArray[Any], policy: Policy) -> None:
    names = question.names
    if samples.ndim < 2 or samples.shape[-1] != len(names):
        raise ValueError(
            f"a trace has shape (..., T+1, {len(names)}) for signals {', '.join(names)}, got {samples.shape}"
        )
    needed = 1 if policy == "clip" else 0 if policy == "interval" else question.ahead + 1
    if samples.shape[-2] < needed:
        raise ShortTraceError(needed, samples.shape[-2])


def _undefined(samples: Floats, start: int, question: _Question) -> UndefinedError:
    for name in signals(question.formula):
        bad = np.argwhere(np.isnan(samples[:, :, question.names.index(name)]))
        if len(bad):
            return UndefinedError(f"signal {name!r} is NaN at sample {bad[0][1]} of trace {start + bad[0][0]}")
    causes = "square root of a negative number, 0/0 or inf - inf"
    return UndefinedError(f"a predicate of {question.formula} has no value on this trace ({causes})")
