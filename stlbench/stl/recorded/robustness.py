"""Robustness and satisfaction of recorded traces, at t = 0 or as a full trace.

Satisfaction follows from signed values (see `signed_margin`), never by the sign of the robustness: at robustness 0 the
two say different things (`x >= 0` holds at x = 0, `x > 0` does not).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.compiler import compile_margin, compile_signed
from stlbench.stl.recorded.evaluation import Floats, evaluate

Bools: TypeAlias = NDArray[np.bool_]
#: what to do with a trace that ends before the horizon
ShortTraces: TypeAlias = Literal["strict", "clip"]


class RobustnessBounds(NamedTuple):
    """Least and greatest robustness over all continuations of a trace; equal from horizon + 1 samples on."""

    lower: Floats
    upper: Floats


class SatisfactionBounds(NamedTuple):
    """Whether every continuation of a trace satisfies the formula, and whether some may."""

    certainly: Bools
    possibly: Bools


def robustness(formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict") -> Floats:
    """Robustness of `formula` at t = 0.

    Args:
        formula: any formula; intervals in steps. An operator without one reads to the end of the trace.
        trace: (..., T+1, k) floats in the signals' units; samples that the formula does not read may be NaN.
        names: the k signals, in the order of the last axis.
        policy: for T < horizon: `strict` is an error; `clip` cuts windows at T as rtamt does (an empty window is +inf
            for G and -inf for F and U). See `robustness_bounds` for a trace that is not over.

    Returns:
        rho (...,).

    Raises:
        ShortTraceError: under `strict`, "needs 2001 samples, got 200".
        UnknownSignalError: the formula uses a signal not in `names`.
        UndefinedError: a predicate has no value at a sample that is read; a signal is NaN there, or its arithmetic
            has no value.
        TypeError: the formula is no formula, `names` is text, or the trace is a masked array.
        ValueError: shapes, names or policy do not fit.
    """
    return evaluate(compile_margin, formula, trace, names, _checked(policy), full=False)[0]


def robustness_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict"
) -> Floats:
    """Robustness at every t: (..., T+1-horizon) under `strict`, (..., T+1) under `clip`; else as `robustness`."""
    return evaluate(compile_margin, formula, trace, names, _checked(policy), full=True)[0]


def satisfied(formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict") -> Bools:
    """Whether the trace satisfies `formula` at t = 0, bool (...,), by the Boolean semantics; else as `robustness`."""
    return evaluate(compile_signed, formula, trace, names, _checked(policy), full=False)[0] > 0.0


def satisfied_trace(formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict") -> Bools:
    """Satisfaction at every t, shapes as `robustness_trace`."""
    return evaluate(compile_signed, formula, trace, names, _checked(policy), full=True)[0] > 0.0


def robustness_bounds(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> RobustnessBounds:
    """Bounds (...,) of the robustness at t = 0 over all continuations of the trace; else as `robustness`."""
    lower, upper = evaluate(compile_margin, formula, trace, names, "interval", full=False)
    return RobustnessBounds(lower, upper)


def robustness_bounds_trace(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> RobustnessBounds:
    """The bounds at every t of the trace, (..., T+1)."""
    lower, upper = evaluate(compile_margin, formula, trace, names, "interval", full=True)
    return RobustnessBounds(lower, upper)


def satisfaction_bounds(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> SatisfactionBounds:
    """Whether all continuations of the trace satisfy `formula` at t = 0, and whether some may, bool (...,)."""
    lower, upper = evaluate(compile_signed, formula, trace, names, "interval", full=False)
    return SatisfactionBounds(lower > 0.0, upper > 0.0)


def satisfaction_bounds_trace(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> SatisfactionBounds:
    """The same at every t of the trace, (..., T+1)."""
    lower, upper = evaluate(compile_signed, formula, trace, names, "interval", full=True)
    return SatisfactionBounds(lower > 0.0, upper > 0.0)


def _checked(policy: object) -> ShortTraces:
    if policy == "strict":
        return "strict"
    if policy == "clip":
        return "clip"
    hint = "; for bounds call robustness_bounds or satisfaction_bounds" if policy == "interval" else ""
    raise ValueError(f"policy is 'strict' or 'clip', got {policy!r}{hint}")
