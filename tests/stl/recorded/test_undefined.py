"""One rule for NaN and undefined arithmetic in all evaluators: what the formula reads counts, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas, traces
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench import stl

Floats = NDArray[np.float64]


def watched(monitor: Any, samples: Iterable[Any]) -> None:
    for sample in samples:
        monitor.update(sample)


#: evaluators that answer for t = 0 alone, and those that answer for every t
FIRST: dict[str, Callable[[stl.Formula, Floats, list[str]], Any]] = {
    "robustness": stl.robustness,
    "clip": lambda formula, trace, names: stl.robustness(formula, trace, names, "clip"),
    "satisfied": stl.satisfied,
    "robustness_bounds": stl.robustness_bounds,
    "satisfaction_bounds": stl.satisfaction_bounds,
    "monitor": lambda formula, trace, names: watched(stl.Monitor(formula, names), trace.tolist()),
    "batch": lambda formula, trace, names: watched(stl.BatchMonitor(formula, names, 1), trace[:, None]),
    "compiled robustness": lambda formula, trace, names: stl.margin_trace(formula, names)(
        trace[None, : 1 + stl.horizon(formula)]
    ),
    "compiled verdict": lambda formula, trace, names: stl.holds_trace(formula, names)(
        trace[None, : 1 + stl.horizon(formula)]
    ),
}
ALL: dict[str, Callable[[stl.Formula, Floats, list[str]], Any]] = {
    "robustness": stl.robustness_trace,
    "satisfied": stl.satisfied_trace,
    "robustness_bounds": stl.robustness_bounds_trace,
    "satisfaction_bounds": stl.satisfaction_bounds_trace,
    "compiled robustness": lambda formula, trace, names: stl.margin_trace(formula, names)(trace[None]),
    "compiled verdict": lambda formula, trace, names: stl.holds_trace(formula, names)(trace[None]),
}


def trace_with(column: int, step: int, value: float = math.nan) -> Floats:
    """x, y = 1 at six steps, but for one value."""
    trace = np.ones((6, 2))
    trace[step, column] = value
    return trace


@pytest.mark.parametrize("evaluator", FIRST.values(), ids=FIRST)
@pytest.mark.parametrize(
    ("text", "steps"),
    [
        ("G[1,3] x >= 0", {1, 2, 3}),
        ("F[1,3] x >= 0", {1, 2, 3}),
        ("F[0,1] G[2,3] x >= 0", {2, 3, 4}),
        ("G[1,1] F[1,2] x >= 0", {2, 3}),
        ("y >= 0 U[2,3] x >= 0", {2, 3}),
        ("x >= 0 U[2,3] y >= 0", {0, 1, 2}),
        ("!(x >= 0 U[0,2] x >= 0)", {0, 1, 2}),
        ("x >= 0", {0}),
        ("G[2,4] (y >= 0 | x >= 0)", {2, 3, 4}),
        ("G[2,4] (y >= 0 & True -> max(y, x) >= 0)", {2, 3, 4}),
        ("F[0,1] (y >= 0 U[1,2] x >= 0)", {1, 2, 3}),
        ("G[0,4] y >= 0", set()),
        ("y >= 0 | G[3,3] True", set()),
    ],
)
def test_a_nan_counts_where_it_is_read(evaluator: Any, text: str, steps: set[int]) -> None:
    formula = stl.parse(text)
    for step in range(6):
        if step not in steps:
            evaluator(formula, trace_with(0, step), ["x", "y"])
            continue
        with pytest.raises(stl.UndefinedError, match=f"^signal 'x' is NaN at sample {step}( of trace 0)?$"):
            evaluator(formula, trace_with(0, step), ["x", "y"])


@pytest.mark.parametrize("evaluator", FIRST.values(), ids=FIRST)
def test_so_does_arithmetic_without_a_value(evaluator: Any) -> None:
    trace = trace_with(0, 2, -4.0)
    evaluator(stl.parse("G[3,5] sqrt(x) >= 0 & G[0,5] sqrt(y) >= 0"), trace, ["x", "y"])
    with pytest.raises(
        stl.UndefinedError, match=r"^sqrt\(x\) >= y has no value \(.*\) where x = -4, y = 1 at sample 2"
    ):
        evaluator(stl.parse("G[0,5] y >= 0 & F[1,4] sqrt(x) >= y"), trace, ["x", "y"])


@pytest.mark.parametrize("evaluator", ALL.values(), ids=ALL)
def test_every_step_is_read_for_a_full_trace(evaluator: Any) -> None:
    for step in range(6):
        evaluator(stl.parse("G[0,2] y >= 0"), trace_with(0, step), ["x", "y"])
        with pytest.raises(stl.UndefinedError, match=f"^signal 'x' is NaN at sample {step}( of trace 0)?$"):
            evaluator(stl.parse("G[0,2] x >= 0"), trace_with(0, step), ["x", "y"])
    evaluator(stl.parse("G[1,2] x >= 0"), trace_with(0, 0), ["x", "y"])


def test_the_cause_is_not_a_nan_that_is_not_read() -> None:
    trace = np.array([[math.nan, 1.0], [-1.0, 1.0]])
    for evaluate in FIRST.values():
        with pytest.raises(stl.UndefinedError, match=r"has no value .* at sample 1"):
            evaluate(stl.parse("G[1,1] sqrt(x) >= 0"), trace, ["x", "y"])


def test_the_trace_of_a_batch_is_named() -> None:
    batch = np.ones((70, 1001, 1))  # more samples than are evaluated together
    batch[69, 7] = math.nan
    for evaluate in (stl.robustness, stl.satisfied, stl.robustness_trace, stl.robustness_bounds):
        with pytest.raises(stl.UndefinedError) as caught:
            evaluate(stl.parse("G[0,9] x >= 0"), batch, ["x"])  # type: ignore[operator]
        assert (caught.value.what, caught.value.sample, caught.value.trace) == ("signal 'x' is NaN", 7, 69)


@pytest.mark.parametrize("text", ["F G x >= 0", "G F x >= 0", "!F[0,2] G x >= 0", "y >= 9 | F[1,3] G[1,2] G x >= 0"])
def test_windows_to_the_end_are_read_from_the_first_on(text: str) -> None:
    """Though the last of them alone decides."""
    for name in ("robustness_bounds", "monitor", "batch"):
        with pytest.raises(stl.UndefinedError, match=r"^signal 'x' is NaN at sample 2"):
            FIRST[name](stl.parse(text), trace_with(0, 2), ["x", "y"])


@given(formulas(LIPSCHITZ, 3, 4, endless=True), SEEDS, st.integers(0, 2), st.integers(0, 9))
def test_all_evaluators_agree_about_what_is_read(formula: stl.Formula, seed: int, column: int, step: int) -> None:
    trace = traces(10, seed)
    trace[step, column] = math.nan
    refused = []
    for evaluate in (stl.robustness_bounds, stl.satisfaction_bounds, FIRST["monitor"], FIRST["batch"]):
        try:
            evaluate(formula, trace, list(NAMES))  # type: ignore[operator]
        except stl.UndefinedError as error:
            refused.append(f"signal {NAMES[column]!r} is NaN at sample {step}" in str(error))
    assert refused in ([], [True] * 4)
