"""Robustness and satisfaction of recorded traces, at t = 0 or as a full trace.

Satisfaction follows from signed margins (see `dialect`), never from the sign of the robustness: at robustness 0 the two
say different things (`x >= 0` holds at x = 0, `x > 0` does not).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import ShortTraceError, UndefinedError
from stlbench.stl.language import structure
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates import as_array
from stlbench.stl.predicates.writer import Reading
from stlbench.stl.recorded.evaluator import End, Evaluator, Traces, evaluator

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
#: how a trace that ends before the horizon is treated
ShortTraces: TypeAlias = Literal["strict", "clip"]


class RobustnessBounds(NamedTuple):
    """Bounds of the robustness over all continuations of a trace; equal from horizon + 1 samples on.

    A predicate to come counts as any number, also where its arithmetic has a limit, as `abs(x) >= 0`.
    """

    lower: Floats
    upper: Floats


class SatisfactionBounds(NamedTuple):
    """Whether the bounds tell that every continuation satisfies the formula, and whether they leave some open."""

    certainly: Bools
    possibly: Bools


def robustness(formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict") -> Floats:
    """Robustness of `formula` at t = 0.

    Args:
        formula: any formula; intervals in steps. An operator without one reads to the end of the trace.
        trace: (..., T+1, k) floats in the signals' units, or a table (T+1, k), which is read by the names of its
            columns. Samples that the formula does not read may be NaN.
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
        TypeError: the formula is no formula, `names` is text, or samples that are read are no real numbers.
        ValueError: shapes, names or policy do not fit, or a whole number that is read would be rounded to a float.
    """
    return _evaluate("margin", formula, trace, names, _checked(policy), full=False)[0]


def robustness_trace(
    formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict"
) -> Floats:
    """Robustness at every t: (..., T+1-horizon) under `strict`, (..., T+1) under `clip`; else as `robustness`."""
    return _evaluate("margin", formula, trace, names, _checked(policy), full=True)[0]


def satisfied(formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict") -> Bools:
    """Whether the trace satisfies `formula` at t = 0, bool (...,), by the Boolean semantics; else as `robustness`."""
    return _evaluate("signed", formula, trace, names, _checked(policy), full=False)[0] > 0.0


def satisfied_trace(formula: Formula, trace: ArrayLike, names: Sequence[str], policy: ShortTraces = "strict") -> Bools:
    """Satisfaction at every t, shapes as `robustness_trace`."""
    return _evaluate("signed", formula, trace, names, _checked(policy), full=True)[0] > 0.0


def robustness_bounds(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> RobustnessBounds:
    """Bounds (...,) of the robustness at t = 0 over all continuations of the trace; else as `robustness`."""
    return RobustnessBounds(*_evaluate("margin", formula, trace, names, "interval", full=False))


def robustness_bounds_trace(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> RobustnessBounds:
    """The bounds at every t of the trace, (..., T+1)."""
    return RobustnessBounds(*_evaluate("margin", formula, trace, names, "interval", full=True))


def satisfaction_bounds(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> SatisfactionBounds:
    """Whether all continuations of the trace satisfy `formula` at t = 0, and whether some may, bool (...,)."""
    lower, upper = _evaluate("signed", formula, trace, names, "interval", full=False)
    return SatisfactionBounds(lower > 0.0, upper > 0.0)


def satisfaction_bounds_trace(formula: Formula, trace: ArrayLike, names: Sequence[str]) -> SatisfactionBounds:
    """The same at every t of the trace, (..., T+1)."""
    lower, upper = _evaluate("signed", formula, trace, names, "interval", full=True)
    return SatisfactionBounds(lower > 0.0, upper > 0.0)


def margin_trace(formula: Formula, names: Sequence[str]) -> Callable[[Floats], Floats]:
    """Compile the robustness of `formula` at every step at which it has a value, for short traces and many calls.

    It is what `margin` is for one sample: without the checks of `robustness_trace`, which cost more than a short trace.

    Args:
        formula: any formula; intervals in steps.
        names: the signals, in the order of the samples' last axis.

    Returns:
        A pure function: traces (n, T+1, k) of floats, T >= horizon, in the signals' units -> rho (n, T+1-horizon), as
        `robustness_trace` says; it raises UndefinedError likewise.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
        ValueError: a name occurs twice.
    """
    return _compiled(formula, names, "margin")


def holds_trace(formula: Formula, names: Sequence[str]) -> Callable[[Floats], Bools]:
    """Compile the Boolean verdict of `formula` likewise, bool (n, T+1-horizon)."""
    signed = _compiled(formula, names, "signed")
    return lambda samples: signed(samples) > 0.0


def _compiled(formula: Formula, names: Sequence[str], reading: Reading) -> Callable[[Floats], Floats]:
    structure.require_formula(formula)
    program = _program(formula, structure.as_names(names, formula), reading)

    def run(samples: Floats) -> Floats:
        last = samples.shape[1] - 1
        return program.values(Traces(samples, "strict", last), last - program.ahead)

    return run


# -------------------------------------------------------------------------------------------------------- an evaluation

#: samples of one signal that are evaluated together; few enough for the cache, many enough to hide the interpreter
SAMPLES = 2**15


@dataclass(frozen=True)
class _Program:
    """A formula on named signals: how far it looks and its evaluator."""

    formula: Formula
    names: tuple[str, ...]
    reading: Reading
    ahead: int
    behind: int
    to_the_end: bool
    read: frozenset[str]
    evaluator: Evaluator

    def values(self, traces: Traces, hi: int, worst: bool = True) -> Floats:
        """Values (n, hi + 1) at steps 0..hi; UndefinedError where a predicate has none at a sample that is read."""
        try:
            with np.errstate(all="ignore", over="raise"):
                values = self.evaluator(traces, 0, hi, worst)
            if not np.isnan(values).any():
                return values
        except FloatingPointError:  # of some operation
            pass
        with np.errstate(all="ignore"):
            return evaluator(self.formula, self.names, self.reading, checked=True)(traces, 0, hi, worst)

    def in_chunks(self, flat: NDArray[Any], end: End, count: int, worst: bool) -> Floats:
        """Values (n, count) at steps 0..count-1 of all traces (n, T+1, k), chunk by chunk."""
        out, steps = np.empty((flat.shape[0], count)), flat.shape[1]
        if count == 0:  # an empty trace
            return out
        last = steps + self.behind if end == "interval" else steps - 1
        if not self.to_the_end and end == "interval":  # a wide window of the past costs no more than what is read
            last = min(last, count - 1 + self.ahead)
        chunk = max(1, SAMPLES // max(1, steps))
        for start in range(0, flat.shape[0], chunk):
            samples = np.asarray(flat[start : start + chunk], dtype=np.float64)
            out[start : start + chunk] = self.values(Traces(samples, end, last, start), count - 1, worst)
        return out


@lru_cache(maxsize=128)
def _program(formula: Formula, names: tuple[str, ...], reading: Reading) -> _Program:
    structure.check_names(formula, names)
    ahead, behind, to_the_end = (
        structure.lookahead(formula),
        structure.lookbehind(formula),
        structure.is_endless(formula),
    )
    read = frozenset(structure.signals(formula))
    return _Program(formula, names, reading, ahead, behind, to_the_end, read, evaluator(formula, names, reading))


def _evaluate(
    reading: Reading, formula: Formula, trace: ArrayLike, names: Sequence[str], end: End, full: bool
) -> list[Floats]:
    """The values of `formula` at t = 0 or (`full`) at every t; under `interval` their lower and upper bounds."""
    structure.require_formula(formula)
    program = _program(formula, structure.as_names(names, formula), reading)
    samples = as_array(trace, program.names, program.read)
    _check_shape(program, samples, end)
    steps = samples.shape[-2]
    count = 1 if not full else steps - program.ahead if end == "strict" else steps
    read = steps if program.to_the_end else min(steps, count + program.ahead)
    flat = samples.reshape(math.prod(samples.shape[:-2]), *samples.shape[-2:])[:, :read]
    shape = (*samples.shape[:-2], count) if full else samples.shape[:-2]
    sides = (True, False) if end == "interval" else (True,)
    try:
        return [program.in_chunks(flat, end, count, worst).reshape(shape) for worst in sides]
    except UndefinedError as error:
        raise UndefinedError(error.what, error.sample, error.trace if samples.ndim > 2 else None) from None


def _checked(policy: object) -> ShortTraces:
    if policy == "strict" or policy == "clip":
        return policy
    hint = "; for bounds call robustness_bounds or satisfaction_bounds" if policy == "interval" else ""
    raise ValueError(f"policy is 'strict' or 'clip', got {policy!r}{hint}")


def _check_shape(program: _Program, samples: NDArray[Any], end: End) -> None:
    count, names = len(program.names), ", ".join(program.names)
    if samples.ndim < 2 or samples.shape[-1] != count:
        raise ValueError(f"a trace has shape (..., T+1, {count}) for signals {names}, got {samples.shape}")
    needed = 1 if end == "clip" else 0 if end == "interval" else program.ahead + 1
    if samples.shape[-2] < needed:
        raise ShortTraceError(needed, samples.shape[-2])
