"""Robustness and satisfaction: hand-computed tables, the definition, and the laws."""

from __future__ import annotations

import math
import tracemalloc
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, formulas, naive, naive_satisfied, traces
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench.stl import (
    Formula,
    ShortTraceError,
    horizon,
    parse,
    robustness,
    robustness_bounds,
    robustness_trace,
    satisfaction_bounds,
    satisfied,
    satisfied_trace,
)

X = [[3.0], [1.0], [-2.0], [4.0], [0.0]]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x >= 0", 3),
        ("x <= 1", -2),
        ("!x >= 0", -3),
        ("True", math.inf),
        ("False", -math.inf),
        ("G[0,1] x >= 0", 1),
        ("G[1,4] x >= 0", -2),
        ("F[1,2] x >= 0", 1),
        ("F[2,3] x >= 5", -1),
        ("F[0,2] G[0,1] x >= 0", 1),
        ("G[0,2] F[0,1] x >= 0", 1),
        ("F[0,3] G[1,1] x >= 0", 4),
        ("x >= 2 -> F[1,3] x >= 3", 1),
        ("x >= 0 U[0,3] x >= 4", -1),  # candidates 3-4, min(3, -3), min(1, -6), min(-2, 0)
        ("x >= -3 U[0,3] x >= 4", 0),  # at t' = 3: right 0, left over 0..2 is 1
        ("x >= 0 U[2,2] x <= -1", 1),  # t' = 2: right 1, left over 0..1 is 1; left(2) = -2 does not count
        ("x >= 9 U[0,4] x >= 1", 2),  # at t' = 0 nothing is asked of left
        ("x >= 9 U[1,4] x >= 1", -6),
    ],
)
def test_table(text: str, expected: float) -> None:
    formula = parse(text)
    assert robustness(formula, X, ["x"]) == expected
    assert satisfied(formula, X, ["x"]) == (expected >= 0)


def test_full_trace_by_hand() -> None:
    assert robustness_trace(parse("G[0,1] x >= 0"), X, ["x"]).tolist() == [1, -2, -2, 0]
    assert robustness_trace(parse("F[1,2] x >= 0"), X, ["x"]).tolist() == [1, 4, 4]
    clipped = robustness_trace(parse("F[1,2] x >= 0"), X, ["x"], "clip")
    assert clipped.tolist() == [1, 4, 4, 0, -math.inf]


def test_at_margin_zero_the_comparison_decides() -> None:
    trace = [[0.0], [0.0]]
    for text, verdict in [("G[0,1] x >= 0", True), ("G[0,1] x > 0", False), ("!x > 0", True), ("!x >= 0", False)]:
        assert robustness(parse(text), trace, ["x"]) == 0
        assert satisfied(parse(text), trace, ["x"]) == verdict


def test_a_comparison_with_the_strongest_operators() -> None:
    psi = parse("norm(x - 1, y) <= 2 & norminf(x, y) < 3 & min(x, y) >= -1 & max(x, 2) <= 4 & x / 2 - y ** 2 >= -1")
    value = robustness(psi, [[1.0, 1.5]], ["x", "y"])
    assert value == min(2 - 1.5, 3 - 1.5, 1 + 1, 4 - 2, 0.5 - 2.25 + 1)


@given(formulas(longest=4), SEEDS)
def test_equals_the_definition(formula: Formula, seed: int) -> None:
    trace = traces(horizon(formula) + 3, seed)
    expected = [naive(formula, trace, t) for t in range(3)]
    np.testing.assert_allclose(robustness_trace(formula, trace, NAMES), expected, rtol=1e-12, atol=1e-12)
    verdicts = [naive_satisfied(formula, trace, t) for t in range(3)]
    assert satisfied_trace(formula, trace, NAMES).tolist() == verdicts


@given(formulas(longest=6), SEEDS, st.integers(1, 9))
def test_clip_equals_the_definition_on_short_traces(formula: Formula, seed: int, steps: int) -> None:
    trace = traces(steps, seed)
    expected = [naive(formula, trace, t) for t in range(steps)]
    np.testing.assert_allclose(robustness_trace(formula, trace, NAMES, "clip"), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(robustness(formula, trace, NAMES, "clip"), expected[0], rtol=1e-12, atol=1e-12)
    verdicts = [naive_satisfied(formula, trace, t) for t in range(steps)]
    assert satisfied_trace(formula, trace, NAMES, "clip").tolist() == verdicts


@given(formulas(past=False), SEEDS)
def test_full_trace_is_shift_invariant(formula: Formula, seed: int) -> None:
    trace = traces(horizon(formula) + 4, seed)
    shifted = robustness_trace(formula, trace[2:], NAMES)
    np.testing.assert_allclose(robustness_trace(formula, trace, NAMES)[2:], shifted, rtol=1e-12, atol=1e-12)


@given(formulas(), SEEDS)
def test_batch_is_the_loop(formula: Formula, seed: int) -> None:
    batch = traces(horizon(formula) + 2, seed, (7, 10))  # 70 traces: more than two chunks
    each = [[robustness(formula, trace, NAMES) for trace in row] for row in batch]
    np.testing.assert_allclose(robustness(formula, batch, NAMES), each, rtol=1e-12, atol=1e-12)
    assert robustness_trace(formula, batch, NAMES).shape == (7, 10, 2)
    assert satisfied(formula, batch, NAMES).shape == (7, 10)


@given(formulas(), SEEDS)
def test_the_sign_of_robustness_is_sound(formula: Formula, seed: int) -> None:
    batch = traces(horizon(formula) + 1, seed, (20,))
    rho, verdict = robustness(formula, batch, NAMES), satisfied(formula, batch, NAMES)
    assert np.all(verdict[rho > 0])
    assert not np.any(verdict[rho < 0])


@given(formulas(), SEEDS, st.data())
def test_interval_contains_every_continuation(formula: Formula, seed: int, data: st.DataObject) -> None:
    full = traces(horizon(formula) + 1, seed, (20,))
    cut = data.draw(st.integers(0, full.shape[1]))
    full[:, :cut] = full[0, :cut]  # one beginning, many continuations
    lower, upper = robustness_bounds(formula, full[:, :cut], NAMES)
    rho, verdict = robustness(formula, full, NAMES), satisfied(formula, full, NAMES)
    assert np.all(lower <= rho + 1e-9)
    assert np.all(rho <= upper + 1e-9)
    certainly, possibly = satisfaction_bounds(formula, full[:, :cut], NAMES)
    assert np.all(certainly <= verdict)
    assert np.all(verdict <= possibly)
    if cut == full.shape[1]:
        np.testing.assert_allclose(lower, rho, atol=1e-12)
        np.testing.assert_allclose(upper, rho, atol=1e-12)


def test_interval_of_no_samples_is_what_the_formula_alone_says() -> None:
    lower, upper = robustness_bounds(parse("G[0,2] (True | x >= 0)"), np.empty((0, 1)), ["x"])
    assert (lower.item(), upper.item()) == (math.inf, math.inf)


def test_huge_intervals_cost_no_memory_on_short_traces() -> None:
    formula = parse("G[0,1000000000000] F[5,2000000000000] x >= 0 & (x >= 0 U[3,1000000000000] x >= 1)")
    assert robustness(formula, X, ["x"], "clip") == -math.inf
    lower, upper = robustness_bounds(formula, X, ["x"])
    assert (lower.item(), upper.item()) == (-math.inf, -2)  # x < 0 at step 2 comes before any t' >= 3 of the until


def test_short_trace_is_an_error() -> None:
    with pytest.raises(ShortTraceError, match="needs 2001 samples, got 200") as caught:
        robustness(parse("F[0,2000] x >= 0"), np.zeros((200, 1)), ["x"])
    assert (caught.value.needed, caught.value.got) == (2001, 200)
    assert robustness(parse("F[0,2000] x >= 0"), np.zeros((200, 1)), ["x"], "clip") == 0


@pytest.mark.parametrize(
    ("trace", "names", "message"),
    [
        (np.zeros((5, 2)), ["x"], "shape"),
        (np.zeros(5), ["x"], "shape"),
        (np.zeros((5, 2)), ["x", "x"], "differ"),
    ],
)
def test_shapes_and_names_are_checked(trace: Any, names: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        robustness(parse("x >= 0"), trace, names)


def test_policy_is_checked() -> None:
    with pytest.raises(ValueError, match="'strict' or 'clip', got 'lenient'"):
        robustness(parse("x >= 0"), X, ["x"], "lenient")  # type: ignore[arg-type]


def test_integer_and_strided_traces_are_read() -> None:
    trace = np.arange(40).reshape(10, 4)[::-1, ::2]
    assert robustness(parse("G[0,9] y - x <= 2"), trace, ["x", "y"]) == 0


def working_set(batch: NDArray[np.float64]) -> int:
    formula = parse("F[0,1000] G[0,50] x >= 0.5 & x >= -1 U[100,900] x >= 1")
    robustness_trace(formula, batch[:1], ["x"], "clip")
    tracemalloc.start()
    answer = robustness_trace(formula, batch, ["x"], "clip")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak - answer.nbytes


def test_memory_is_linear_in_the_trace_and_bounded_in_the_batch() -> None:
    batch = np.random.default_rng(0).normal(size=(256, 2001, 1))
    few, many = working_set(batch[:32]), working_set(batch)
    assert many < 1.5 * few
    assert few < 10 * batch[:32].nbytes
    short, long = working_set(batch.reshape(1, -1, 1)[:, :64_000]), working_set(batch.reshape(1, -1, 1)[:, :512_000])
    assert long < 1.5 * 8 * short


def test_chunks_are_put_together_in_order() -> None:
    batch = np.random.default_rng(1).normal(size=(70, 1001, 1))  # more samples than are evaluated together
    formula = parse("F[0,300] G[0,7] x >= 0")
    together = robustness_trace(formula, batch, ["x"])
    np.testing.assert_array_equal(together, [robustness_trace(formula, trace, ["x"]) for trace in batch])
    np.testing.assert_array_equal(robustness(formula, batch, ["x"]), together[:, 0])
