"""Operators without an interval on recorded traces: to the last step at which their operands can be told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, formulas, naive, naive_satisfied, told, traces
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench.stl import (
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
    ShortTraceError,
    Since,
    TrueFormula,
    Until,
    holds_trace,
    margin_trace,
    parse,
    robustness,
    robustness_bounds,
    robustness_trace,
    satisfaction_bounds,
    satisfied,
    satisfied_trace,
)

X = [[3.0], [1.0], [-2.0], [4.0], [0.5]]


def defined(formula: Formula, trace: NDArray[np.float64], t: int) -> float:
    """rho at t from the definition, on a trace that is long enough."""
    last = len(trace) - 1
    match formula:
        case TrueFormula() | Predicate():
            return naive(formula, trace, t)
        case Not(arg):
            return -defined(arg, trace, t)
        case And(args):
            return min(defined(arg, trace, t) for arg in args)
        case Or(args):
            return max(defined(arg, trace, t) for arg in args)
        case Implies(left, right):
            return max(-defined(left, trace, t), defined(right, trace, t))
        case Always(a, b, arg):
            return min(defined(arg, trace, s) for s in range(t + a, (told(arg, last) if b == END else t + b) + 1))
        case Eventually(a, b, arg):
            return max(defined(arg, trace, s) for s in range(t + a, (told(arg, last) if b == END else t + b) + 1))
        case Until(a, b, left, right):
            end = min(told(left, last), told(right, last)) if b == END else t + b
            return max(
                min([defined(right, trace, s), *(defined(left, trace, r) for r in range(t, s))])
                for s in range(t + a, end + 1)
            )
        case Release(a, b, left, right):
            return -defined(Until(a, b, Not(left), Not(right)), trace, t)
        case Historically(a, b, arg):
            return min((defined(arg, trace, s) for s in range(max(t - b, 0), t - a + 1)), default=np.inf)
        case Once(a, b, arg):
            return max((defined(arg, trace, s) for s in range(max(t - b, 0), t - a + 1)), default=-np.inf)
        case Since(a, b, left, right):
            values = [
                min([defined(right, trace, s), *(defined(left, trace, r) for r in range(s + 1, t + 1))])
                for s in range(max(t - b, 0), t - a + 1)
            ]
            return max(values, default=-np.inf)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G x >= 0", [-2, -2, -2, 0.5, 0.5]),
        ("F x >= 0", [4, 4, 4, 4, 0.5]),
        ("G F x >= 0", [0.5] * 5),  # what is true at the end
        ("F G x >= 0", [0.5] * 5),
        ("G F[0,1] x >= 0", [1, 1, 4, 4]),  # at 0..3 alone: 3 1 4 4
        ("F[0,1] G x >= 0", [-2, -2, 0.5, 0.5]),
        ("G[1,1] G x >= 0", [-2, -2, 0.5, 0.5]),  # one window over the operand's values, which are worked out backwards
        ("x >= 9 U[1,1] G x >= 0", [-6, -8, -11, -5]),
        ("x >= 2 U x >= 4", [-1, -3, -4, 0, -3.5]),
        ("x >= 0 W x >= 9", [-2, -2, -2, 0.5, 0.5]),
        ("x <= 9 R x >= 1", [2, 0, -3, 3, -0.5]),
    ],
)
def test_by_hand(text: str, expected: list[float]) -> None:
    formula = parse(text)
    assert robustness_trace(formula, X, ["x"]).tolist() == expected
    assert robustness(formula, X, ["x"]) == expected[0]


@given(formulas(longest=3, leaves=5, endless=True), SEEDS, st.integers(0, 4))
def test_equals_the_definition(formula: Formula, seed: int, more: int) -> None:
    trace = traces(1 - told(formula, 0) + more, seed)
    expected = [defined(formula, trace, t) for t in range(1 + more)]
    assert robustness_trace(formula, trace, NAMES).tolist() == pytest.approx(expected, abs=1e-12)
    assert robustness(formula, trace, NAMES) == pytest.approx(expected[0], abs=1e-12)
    assert margin_trace(formula, NAMES)(trace[None])[0].tolist() == pytest.approx(expected, abs=1e-12)
    verdicts = satisfied_trace(formula, trace, NAMES)
    assert np.all(verdicts[np.array(expected) > 0])
    assert not np.any(verdicts[np.array(expected) < 0])
    assert satisfied(formula, trace, NAMES) == verdicts[0]
    assert np.array_equal(holds_trace(formula, NAMES)(trace[None])[0], verdicts)


@given(formulas(longest=4, endless=True), SEEDS, st.integers(1, 8))
def test_clip_equals_the_definition_on_short_traces(formula: Formula, seed: int, steps: int) -> None:
    trace = traces(steps, seed)
    expected = [naive(formula, trace, t) for t in range(steps)]
    np.testing.assert_allclose(robustness_trace(formula, trace, NAMES, "clip"), expected, rtol=1e-12, atol=1e-12)
    verdicts = [naive_satisfied(formula, trace, t) for t in range(steps)]
    assert satisfied_trace(formula, trace, NAMES, "clip").tolist() == verdicts


@given(formulas(longest=3, leaves=5, endless=True), SEEDS, st.integers(0, 6), st.integers(0, 4))
def test_bounds_contain_every_long_continuation(formula: Formula, seed: int, cut: int, more: int) -> None:
    full = traces(cut + 1 - told(formula, 0) + more, seed, (20,))
    full[:, :cut] = full[0, :cut]
    lower, upper = robustness_bounds(formula, full[:, :cut], NAMES)
    certainly, possibly = satisfaction_bounds(formula, full[:, :cut], NAMES)
    rho, verdict = robustness(formula, full, NAMES), satisfied(formula, full, NAMES)
    assert np.all(lower <= rho + 1e-9)
    assert np.all(rho <= upper + 1e-9)
    assert np.all(certainly <= verdict)
    assert np.all(verdict <= possibly)


def test_the_future_stays_open() -> None:
    assert robustness_bounds(parse("G x >= 0"), X, ["x"]) == (-math.inf, -2)
    assert robustness_bounds(parse("F x >= 0"), X, ["x"]) == (4, math.inf)
    assert robustness_bounds(parse("G F x >= 0"), X, ["x"]) == (-math.inf, math.inf)


def test_one_step_at_least_is_needed() -> None:
    with pytest.raises(ShortTraceError, match="needs 6 samples, got 5"):
        robustness(parse("G F[0,5] x >= 0"), X, ["x"])
    assert robustness(parse("G F[0,4] x >= 0"), X, ["x"]) == 4
