"""Robustness and satisfaction: hand-computed tables, the definition, and the laws."""

from __future__ import annotations

import math
import tracemalloc
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, formulas, naive, naive_satisfied, told, traces
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench import stl
from stlbench.stl.language.structure import unbounded

X = [[3.0], [1.0], [-2.0], [4.0], [0.0]]
ENDING = [[3.0], [1.0], [-2.0], [4.0], [0.5]]


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
    formula = stl.parse(text)
    assert stl.robustness(formula, X, ["x"]) == expected
    assert stl.satisfied(formula, X, ["x"]) == (expected >= 0)


def test_full_trace_by_hand() -> None:
    assert stl.robustness_trace(stl.parse("G[0,1] x >= 0"), X, ["x"]).tolist() == [1, -2, -2, 0]
    assert stl.robustness_trace(stl.parse("F[1,2] x >= 0"), X, ["x"]).tolist() == [1, 4, 4]
    clipped = stl.robustness_trace(stl.parse("F[1,2] x >= 0"), X, ["x"], "clip")
    assert clipped.tolist() == [1, 4, 4, 0, -math.inf]


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
def test_operators_without_an_interval_by_hand(text: str, expected: list[float]) -> None:
    formula = stl.parse(text)
    assert stl.robustness_trace(formula, ENDING, ["x"]).tolist() == expected
    assert stl.robustness(formula, ENDING, ["x"]) == expected[0]


def test_at_margin_zero_the_comparison_decides() -> None:
    trace = [[0.0], [0.0]]
    for text, verdict in [("G[0,1] x >= 0", True), ("G[0,1] x > 0", False), ("!x > 0", True), ("!x >= 0", False)]:
        assert stl.robustness(stl.parse(text), trace, ["x"]) == 0
        assert stl.satisfied(stl.parse(text), trace, ["x"]) == verdict


def test_a_comparison_with_the_strongest_operators() -> None:
    psi = stl.parse("norm(x - 1, y) <= 2 & norminf(x, y) < 3 & min(x, y) >= -1 & max(x, 2) <= 4 & x / 2 - y ** 2 >= -1")
    value = stl.robustness(psi, [[1.0, 1.5]], ["x", "y"])
    assert value == min(2 - 1.5, 3 - 1.5, 1 + 1, 4 - 2, 0.5 - 2.25 + 1)


@given(formulas(longest=3, leaves=5, endless=True), SEEDS, st.integers(0, 4))
def test_equals_the_definition(formula: stl.Formula, seed: int, more: int) -> None:
    """At every step at which the formula can be told, whichever function is asked."""
    trace = traces(1 - told(formula, 0) + more, seed)
    expected = pytest.approx([naive(formula, trace, t, strict=True) for t in range(1 + more)], abs=1e-12)
    assert stl.robustness_trace(formula, trace, NAMES).tolist() == expected
    assert stl.margin_trace(formula, NAMES)(trace[None])[0].tolist() == expected
    assert stl.robustness(formula, trace, NAMES) == stl.robustness_trace(formula, trace, NAMES)[0]
    verdicts = [naive_satisfied(formula, trace, t, strict=True) for t in range(1 + more)]
    assert stl.satisfied_trace(formula, trace, NAMES).tolist() == verdicts
    assert stl.holds_trace(formula, NAMES)(trace[None])[0].tolist() == verdicts
    assert stl.satisfied(formula, trace, NAMES) == verdicts[0]


@given(formulas(longest=5, endless=True), SEEDS, st.integers(1, 9))
def test_clip_equals_the_definition_on_short_traces(formula: stl.Formula, seed: int, steps: int) -> None:
    trace = traces(steps, seed)
    expected = [naive(formula, trace, t) for t in range(steps)]
    np.testing.assert_allclose(stl.robustness_trace(formula, trace, NAMES, "clip"), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(stl.robustness(formula, trace, NAMES, "clip"), expected[0], rtol=1e-12, atol=1e-12)
    verdicts = [naive_satisfied(formula, trace, t) for t in range(steps)]
    assert stl.satisfied_trace(formula, trace, NAMES, "clip").tolist() == verdicts


@given(formulas(), SEEDS)
def test_batch_is_the_loop(formula: stl.Formula, seed: int) -> None:
    batch = traces(stl.horizon(formula) + 2, seed, (7, 10))  # 70 traces: more than two chunks
    each = [[stl.robustness(formula, trace, NAMES) for trace in row] for row in batch]
    np.testing.assert_allclose(stl.robustness(formula, batch, NAMES), each, rtol=1e-12, atol=1e-12)
    assert stl.robustness_trace(formula, batch, NAMES).shape == (7, 10, 2)
    assert stl.satisfied(formula, batch, NAMES).shape == (7, 10)


@given(formulas(longest=3, leaves=5, endless=True), SEEDS, st.data())
def test_bounds_contain_every_continuation(formula: stl.Formula, seed: int, data: st.DataObject) -> None:
    full = traces(1 - told(formula, 0) + 2, seed, (20,))
    cut = data.draw(st.integers(0, full.shape[1]))
    full[:, :cut] = full[0, :cut]  # one beginning, many continuations
    lower, upper = stl.robustness_bounds(formula, full[:, :cut], NAMES)
    rho, verdict = stl.robustness(formula, full, NAMES), stl.satisfied(formula, full, NAMES)
    assert np.all(lower <= rho + 1e-9)
    assert np.all(rho <= upper + 1e-9)
    certainly, possibly = stl.satisfaction_bounds(formula, full[:, :cut], NAMES)
    assert np.all(certainly <= verdict)
    assert np.all(verdict <= possibly)
    if cut == full.shape[1] and unbounded(formula) is None:
        np.testing.assert_allclose(lower, rho, atol=1e-12)
        np.testing.assert_allclose(upper, rho, atol=1e-12)


def test_huge_intervals_cost_no_memory_on_short_traces() -> None:
    formula = stl.parse("G[0,1000000000000] F[5,2000000000000] x >= 0 & (x >= 0 U[3,1000000000000] x >= 1)")
    assert stl.robustness(formula, X, ["x"], "clip") == -math.inf
    lower, upper = stl.robustness_bounds(formula, X, ["x"])
    assert (lower.item(), upper.item()) == (-math.inf, -2)  # x < 0 at step 2 comes before any t' >= 3 of the until


@pytest.mark.parametrize(
    ("text", "trace", "bounds"),
    [
        ("G x >= 0", ENDING, (-math.inf, -2)),
        ("F x >= 0", ENDING, (4, math.inf)),
        ("G F x >= 0", ENDING, (-math.inf, math.inf)),
        ("G[0,2] (True | x >= 0)", np.empty((0, 1)), (math.inf, math.inf)),
    ],
)
def test_the_future_stays_open(text: str, trace: Any, bounds: tuple[float, float]) -> None:
    assert stl.robustness_bounds(stl.parse(text), trace, ["x"]) == bounds
    lower, upper = stl.robustness_bounds_trace(stl.parse("G[0,2] x >= 0"), [[1.0], [3.0], [2.0]], ["x"])
    assert (lower.tolist(), upper.tolist()) == ([1, -math.inf, -math.inf], [1, 2, 2])


def test_one_step_at_least_is_needed() -> None:
    with pytest.raises(stl.ShortTraceError, match="needs 6 samples, got 5"):
        stl.robustness(stl.parse("G F[0,5] x >= 0"), ENDING, ["x"])
    assert stl.robustness(stl.parse("G F[0,4] x >= 0"), ENDING, ["x"]) == 4
    assert stl.robustness(stl.parse("x >= 9 U x >= 1"), ENDING[:1], ["x"]) == 2


def test_short_trace_is_an_error() -> None:
    with pytest.raises(stl.ShortTraceError, match="needs 2001 samples, got 200") as caught:
        stl.robustness(stl.parse("F[0,2000] x >= 0"), np.zeros((200, 1)), ["x"])
    assert (caught.value.needed, caught.value.got) == (2001, 200)
    assert stl.robustness(stl.parse("F[0,2000] x >= 0"), np.zeros((200, 1)), ["x"], "clip") == 0


@pytest.mark.parametrize(
    ("trace", "words", "message"),
    [
        (np.zeros((5, 2)), (["x"],), "shape"),
        (np.zeros(5), (["x"],), "shape"),
        (np.zeros((5, 2)), (["x", "x"],), "differ"),
        (X, (["x"], "lenient"), "'strict' or 'clip', got 'lenient'"),
    ],
)
def test_shapes_names_and_the_policy_are_checked(trace: Any, words: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        stl.robustness(stl.parse("x >= 0"), trace, *words)


def test_integer_and_strided_traces_are_read() -> None:
    trace = np.arange(40).reshape(10, 4)[::-1, ::2]
    assert stl.robustness(stl.parse("G[0,9] y - x <= 2"), trace, ["x", "y"]) == 0


def working_set(batch: NDArray[np.float64]) -> int:
    formula = stl.parse("F[0,1000] G[0,50] x >= 0.5 & x >= -1 U[100,900] x >= 1")
    stl.robustness_trace(formula, batch[:1], ["x"], "clip")
    tracemalloc.start()
    answer = stl.robustness_trace(formula, batch, ["x"], "clip")
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
    formula = stl.parse("F[0,300] G[0,7] x >= 0")
    together = stl.robustness_trace(formula, batch, ["x"])
    np.testing.assert_array_equal(together, [stl.robustness_trace(formula, trace, ["x"]) for trace in batch])
    np.testing.assert_array_equal(stl.robustness(formula, batch, ["x"]), together[:, 0])


def test_compiled_functions_read_what_is_asked() -> None:
    samples = np.array([[[1.0], [1.0], [np.nan]]])
    for compiled in (
        stl.margin_trace(stl.parse("G[0,1] x >= 0"), ["x"]),
        stl.holds_trace(stl.parse("G[0,1] x >= 0"), ["x"]),
    ):
        with pytest.raises(stl.UndefinedError, match=r"^signal 'x' is NaN at sample 2 of trace 0$"):
            compiled(samples)
        assert compiled(samples[:, :2]).shape == (1, 1)


@pytest.mark.parametrize("text", ["x > 0 U[1,3] x < 1", "x > 0 R[1,3] x < 1", "G[0,3] x > 0", "x > 0 S[1,2] x < 1"])
def test_an_empty_trace_has_bounds_at_no_step(text: str) -> None:
    formula, empty = stl.parse(text), np.empty((0, 1))
    assert [each.shape for each in stl.robustness_bounds_trace(formula, empty, ["x"])] == [(0,), (0,)]
    assert [each.shape for each in stl.satisfaction_bounds_trace(formula, empty, ["x"])] == [(0,), (0,)]
