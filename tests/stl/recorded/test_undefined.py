"""One rule for NaN and undefined arithmetic in all evaluators: what the formula reads counts, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, defined, formulas, traces
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench import stl

Floats = NDArray[np.float64]


def watched(monitor: Any, samples: Iterable[Any]) -> None:
    for sample in samples:
        monitor.update(sample)


def head(formula: stl.Formula, trace: Floats) -> Floats:
    """What the formula reads for t = 0, as a batch."""
    return trace[None, : 1 + stl.horizon(formula)]


#: evaluators that answer for t = 0 alone, and those that answer for every t
FIRST: dict[str, Callable[[stl.Formula, Floats, list[str]], Any]] = {
    "robustness": stl.robustness,
    "clip": lambda formula, trace, names: stl.robustness(formula, trace, names, "clip"),
    "satisfied": stl.satisfied,
    "robustness_bounds": stl.robustness_bounds,
    "satisfaction_bounds": stl.satisfaction_bounds,
    "monitor": lambda formula, trace, names: watched(stl.Monitor(formula, names), trace.tolist()),
    "batch": lambda formula, trace, names: watched(stl.BatchMonitor(formula, names, 1), trace[:, None]),
    "compiled robustness": lambda formula, trace, names: stl.margin_trace(formula, names)(head(formula, trace)),
    "compiled verdict": lambda formula, trace, names: stl.holds_trace(formula, names)(head(formula, trace)),
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


def read_by_definition(formula: stl.Formula, trace: Floats, strict: bool) -> set[tuple[str, int]]:
    """The signals and the steps that the definition names for t = 0."""
    read: set[tuple[str, int]] = set()

    def value(psi: stl.Predicate, step: int) -> float:
        read.update((name, step) for name in stl.signals(psi))
        return 0.0

    defined(formula, 0, len(trace) - 1, strict, value)
    return read


@pytest.mark.parametrize("policy", ["strict", "clip"])
@given(formulas(LIPSCHITZ, 3, 4, endless=True), SEEDS, st.integers(0, 2), st.integers(0, 4))
def test_what_the_definition_reads_is_read_and_nothing_else(
    policy: stl.ShortTraces, formula: stl.Formula, seed: int, column: int, step: int
) -> None:
    trace = traces(5, seed)
    try:
        stl.robustness(formula, trace, list(NAMES), policy)
    except stl.ShortTraceError:
        return
    trace[step, column] = math.nan
    try:
        stl.robustness(formula, trace, list(NAMES), policy)
        refused = False
    except stl.UndefinedError:
        refused = True
    assert refused is ((NAMES[column], step) in read_by_definition(formula, trace, policy == "strict"))


def test_a_since_does_not_read_its_left_operand_where_it_began() -> None:
    """`x S y` at t is y at some t' <= t and x at the steps after t': x at sample 0 is after none."""
    formula, names = stl.parse("x >= 0 S y >= 0"), ["x", "y"]
    assert stl.robustness(formula, [[math.nan, 1.0]], names) == 1.0
    assert stl.Monitor(formula, names).update([math.nan, 1.0]) == (1.0, 1.0, True)
    # t' = 0: min(y 1, x 2) = 1; t' = 1: y = -3
    later = stl.parse("F[1,1] (x >= 0 S y >= 0)")
    assert stl.robustness(later, [[math.nan, 1.0], [2.0, -3.0]], names) == 1.0
    # an interval that lies before sample 0 reads nothing
    assert stl.robustness(stl.parse("x >= 0 S[2,5] y >= 0"), [[math.nan, math.nan]], names) == -math.inf


def test_a_cut_until_does_not_read_its_left_operand_at_the_last_sample() -> None:
    formula, names = stl.parse("x >= 0 U[0,5] y >= 0"), ["x", "y"]
    # t' = 0: -1; t' = 1: min(y 3, x 2) = 2
    assert stl.robustness(formula, [[2.0, -1.0], [math.nan, 3.0]], names, "clip") == 2.0


@pytest.mark.parametrize("text", ["F[0,2] G[0,2] F[0,1] x >= 0", "G (x >= 0 -> O[0,3] y >= 0)"])
def test_a_monitor_of_one_trace_names_no_trace(text: str) -> None:
    monitor = stl.Monitor(stl.parse(text), ["x", "y"])
    monitor.update([1.0, 1.0])
    with pytest.raises(stl.UndefinedError) as caught:
        monitor.update([math.nan, 1.0])
    assert str(caught.value) == "signal 'x' is NaN at sample 1"
    assert (caught.value.sample, caught.value.trace) == (1, None)


BIG = "exp(exp(exp(x))) > 0"


@pytest.mark.parametrize("evaluator", FIRST.values(), ids=FIRST)
@pytest.mark.parametrize(
    ("text", "value"),
    [
        (BIG, 2.0),
        ("x * x > 0", -1e200),
        ("x ** 3 < 0", 1e200),
        ("x + x <= 0", 1e308),
        ("x - y * 1e308 <= 0", -1e308),
        ("norm(x, y) > 1", 1e200),
        ("x / 1e-300 >= 0", 1e20),
        (f"(y > 0 & {BIG}) | y > 2", 2.0),
        (f"!({BIG})", 2.0),
    ],
)
def test_an_overflow_counts_where_it_is_read(evaluator: Any, text: str, value: float) -> None:
    """Like a NaN: an infinity that no sample has is not the value of a predicate."""
    for step in range(6):
        trace = trace_with(0, step, value)
        for window in ("G", "F"):
            formula = stl.parse(f"{window}[1,3] ({text})")
            if step not in (1, 2, 3):
                evaluator(formula, trace, ["x", "y"])
                continue
            with pytest.raises(stl.UndefinedError, match=rf"overflows where x = .* at sample {step}( of trace 0)?$"):
                evaluator(formula, trace, ["x", "y"])


@pytest.mark.parametrize("evaluator", FIRST.values(), ids=FIRST)
@pytest.mark.parametrize(
    "text", ["1 / (1 + exp(x)) >= 0", "tanh(exp(x)) > 0", "min(exp(x), 3) > 1", "max(-exp(x), y) <= 3", "x > 0 | x < 1"]
)
def test_an_overflow_on_the_way_to_a_finite_value_does_not(evaluator: Any, text: str) -> None:
    for formula in (f"G[1,3] ({text})", f"F[0,1] G[0,1] F[1,1] ({text})"):
        evaluator(stl.parse(formula), trace_with(0, 2, 1000.0), ["x", "y"])


@pytest.mark.parametrize("evaluator", FIRST.values(), ids=FIRST)
def test_an_infinite_sample_is_a_value(evaluator: Any) -> None:
    """As of a range sensor that sees nothing."""
    for text in ("x > 0", "x * x + y > 0", "exp(x) > 0", "norm(x, y) > 1", "x + y > 3", "x > 0 & True"):
        evaluator(stl.parse(f"G[1,3] ({text})"), trace_with(0, 2, math.inf), ["x", "y"])
    assert stl.robustness(stl.parse("F[0,3] x + y > 3"), trace_with(0, 2, math.inf), ["x", "y"]) == math.inf


@pytest.mark.parametrize(
    "text",
    [
        "exp(1000) > x",
        "x < 1e200 * 1e200",
        "x * 10 ** 400 > 0",
        "norm(x, 1e200) > 0",
        "norm(x, x, x, x, 1e200) > 0",
    ],
)
def test_a_constant_that_overflows_is_refused(text: str) -> None:
    for use in (stl.margin, stl.holds, stl.Monitor, lambda formula, names: stl.robustness(formula, [[1.0]], names)):
        with pytest.raises(stl.UndefinedError, match="a constant of the formula overflows: "):
            use(stl.parse(text), ["x"])
