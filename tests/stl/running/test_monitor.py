"""The online monitor against the recorded-trace evaluation, step by step."""

from __future__ import annotations

import copy
import math
import pickle
from collections import deque

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, WATCHED, traces
from hypothesis import given

from stlbench import stl
from stlbench.stl.running import batch as batch_source
from stlbench.stl.running.tree import last_step
from stlbench.stl.running.unfolding import Recent


def test_a_run_by_hand() -> None:
    monitor = stl.Monitor(stl.parse("G[1,2] x >= 0"), ["x"])
    assert monitor.update([-5.0]) == stl.Interval(-math.inf, math.inf, None)
    assert monitor.update([3.0]) == stl.Interval(-math.inf, 3.0, None)
    assert monitor.update([1.0]) == stl.Interval(1.0, 1.0, True)
    assert monitor.update([-9.0]) == stl.Interval(1.0, 1.0, True)


def test_the_verdict_comes_as_soon_as_nothing_can_change_it() -> None:
    always = stl.Monitor(stl.parse("G[0,9] x >= 0"), ["x"])
    assert always.update([-1.0]) == stl.Interval(-math.inf, -1.0, False)
    eventually = stl.Monitor(stl.parse("F[0,9] x >= 0"), ["x"])
    assert eventually.update([1.0]) == stl.Interval(1.0, math.inf, True)
    nested = stl.Monitor(stl.parse("F[0,2] G[0,1] x > 0"), ["x"])
    assert [nested.update([x]).verdict for x in (1.0, 0.0, 2.0, 0.0)] == [None, None, None, False]


@given(WATCHED, SEEDS)
def test_equals_the_interval_policy_at_every_step(formula: stl.Formula, seed: int) -> None:
    trace = traces(min(last_step(formula), 9) + 3, seed)
    monitor = stl.Monitor(formula, NAMES)
    for n in range(1, len(trace) + 1):
        now = monitor.update(trace[n - 1])
        lower, upper = stl.robustness_bounds(formula, trace[:n], NAMES)
        np.testing.assert_allclose(now[:2], (lower, upper), rtol=1e-12, atol=1e-12)
        certainly, possibly = stl.satisfaction_bounds(formula, trace[:n], NAMES)
        assert now.verdict == (True if certainly else None if possibly else False)
    if len(trace) > last_step(formula):
        np.testing.assert_allclose(now[:2], [stl.robustness(formula, trace, NAMES)] * 2, rtol=1e-12, atol=1e-12)
        assert now.verdict == stl.satisfied(formula, trace, NAMES)


def test_without_intervals_at_most_a_window_is_kept() -> None:
    texts = ("G x >= 0", "F G x >= 0", "G F[0,3] x >= 0", "F[0,9] G x >= 0", "G[1,2] G x >= 0", "x >= 0 U x >= 9")
    for text in (*texts, "x >= 0 W x >= 9", "x >= 9 R x >= 0", "G[0,3] G[1,2] x >= 0", "F[0,3] F[1,2] x >= 0"):
        assert not any(name.startswith("samples") for name in vars(stl.Monitor(stl.parse(text), ["x"])._state)), text
    monitor = stl.Monitor(stl.parse("G F[0,3] x >= 0"), ["x"])
    for x in range(500):
        monitor.update([float(-x)])
    assert max(len(each) for each in vars(monitor._state).values() if isinstance(each, deque)) <= 5


def test_a_margin_of_zero_keeps_its_side_through_every_operator() -> None:
    for text, verdict in [
        ("x >= 0 & x < 1", True),
        ("x > 0 & x < 1", False),
        ("x > 0 | x <= 0", True),
        ("!(x > 0) & !(x < 0)", True),
        ("x >= 0 -> x > 0", False),
        ("F[0,0] G[0,0] !(x > 0)", True),
        ("!(x >= 0 U[0,0] x > 0)", True),
        ("x >= 0 * x", True),
    ]:
        assert stl.Monitor(stl.parse(text), ["x"]).update([0.0]) == stl.Interval(0.0, 0.0, verdict), text


def test_fragment_formulas_keep_no_samples() -> None:
    monitor = stl.Monitor(stl.parse("F[0,9] x >= 0 & G[0,9] x >= 0 & F[0,9] G[3,700] x >= 0"), ["x"])
    assert not any(name.startswith("samples") for name in vars(monitor._state))
    for x in np.random.default_rng(0).normal(size=600):
        monitor.update([x])
    queues = [each for each in vars(monitor._state).values() if isinstance(each, deque)]
    assert max(map(len, queues)) < 40  # records of a random sequence: about its logarithm


def test_general_formulas_keep_at_most_the_horizon() -> None:
    monitor = stl.Monitor(stl.parse("F[0,3] x >= 1 U[0,2] x >= 2"), ["x"])
    for _ in range(50):
        monitor.update([0.5])
    (recent,) = (each for each in vars(monitor._state).values() if isinstance(each, Recent))
    assert recent.rows.shape[1] <= 2 * 6 + 2


NESTED = [
    *("G[0,30] (x >= 0 -> F[0,4] y >= 0)", "G (x >= 0 -> F[1,4] y >= 0)", "F[2,30] (x >= 1 & (y >= 0 U[0,3] x >= 2))"),
    *("(F[0,2] x >= 0) U[0,25] (G[0,3] y >= 0)", "(F[0,2] x >= 0) U[6,25] (G[0,3] y >= 0)"),
    *("(x >= 0 R[0,2] y >= 0) R (F[0,3] x >= 1)", "F[0,20] G[0,4] F[0,5] x >= 1", "G (x >= 0 -> G y >= -2)"),
    *("F (x >= 1 & F (y >= 1 & F x <= 0))", "G (x >= 1 -> y >= 0 U x >= 2)", "F (x >= 1 & (y >= 0 R x >= -1))"),
    *("G (x >= 1 -> F y >= 1)", "G (x >= 0 -> (y >= 0 S x <= 0))", "F[3,20] (H[1,4] x >= 0 | (O[0,2] F[0,3] y >= 2))"),
    "G[0,15] (H (x >= -2 | O[2,3] y >= 0) | F[0,2] (x >= 0 S[1,3] y >= 1))",
    *("H[0,3] x >= 0 & O F[0,3] y >= 0", "F (F[0,2] x >= 2 & F[1,3] y >= 2)"),
]
#: what is decided in one pass, by each rule of `pulling`
STREAMED = [
    *("G (x >= 0 -> F[0,4] y >= 0)", "G (x >= 0 -> F[2,4] (y >= 0 | x >= 1))", "G F[0,6] G[0,3] x >= 0"),
    *("G F[1,3] G[2,6] x >= 0", "F G[2,9] F[1,3] x >= 1", "G F G x >= 0", "G (x >= 0 -> F (y >= 0 & O[0,3] x <= 1))"),
    *("G (x >= 0 -> x >= 0 U y >= 0)", "G (x >= 1 -> y >= 0 U[0,4] x <= -1)", "G (x >= 0 -> !(y >= 0 U[0,4] z >= 1))"),
    *("F (x >= 1 & (y >= 0 R[0,3] z >= -1))", "G (x >= 0 -> O y >= 0)", "G[2,9] (x >= 0 -> O (y >= 0 & H x >= -1))"),
    *("G (x >= 0 -> O[2,5] y >= 0)", "G[0,20] (x >= 0 -> O[0,5] y >= 0)", "G (x >= 0 -> H[0,3] y >= -1)"),
    "G[3,30] (x >= 0 & O[0,2] z >= 0 -> O[0,40] y >= 0 | H[0,4] y <= 1 & (x >= -2 S[0,3] z >= 1))",
    *("G (x >= 0 S y >= 0)", "G !(x >= 0 S[0,4] y >= 0)", "G (z >= 2 -> (x >= 0 S[0,4] y >= 0))"),
    *("F (x >= 0 & F y >= 0 & F z >= 0)", "F (x >= 1 & F y >= 1 & F z >= 1 & F (x <= -1 & O y <= 0))"),
    *("F (x >= 2 & F[2,5] y >= 1)", "G (x >= 0 -> (F[0,3] y >= 0 & F[0,6] z >= 0))"),
    *("G (sqrt(x + 3) >= 1 -> F[1,3] sqrt(y + 3) >= 1)", "G[0,30] (x >= 0 -> F[0,4] y >= 0)", "F[0,9] O[1,4] y >= 0"),
    *("F[2,30] (x >= 1 & (y >= 0 U[0,3] x >= 2))", "F[2,30] (x >= 1 & (y >= 0 U[2,3] x >= 2))", "O H[1,3] x >= 0"),
    *("G[3,20] (x >= 0 -> y >= 0 R[1,4] z >= 0)", "F[0,20] (x >= 1 & F[1,6] (y >= 1 & F[0,3] z >= 1))"),
    *("x >= -2 U (y >= 0 & G[0,3] z >= -1)", "x >= -1 R[2,20] (y >= 0 | z >= 1)"),
    *("F[1,9] (x >= 0 & G[2,5] y >= -2)", "F[0,9] (x >= 1 & F y >= 1)", "G[0,9] (x >= 1 -> H[1,4] y >= 0)"),
    *("F[2,8] G[0,2] G[1,2] x >= 0", "G (y >= 0 S[2,4] z >= 0 | x >= 1)"),
]


@pytest.mark.parametrize("text", ["G (x >= 0 -> F[0,3] (y >= 0 | 0.5 <= 1))", "F (O (x >= 0 & 0.5 <= 1) & y >= 0)"])
def test_what_a_constant_bounds_is_known_at_once(text: str) -> None:
    formula, trace = stl.parse(text), traces(6, 1)
    monitor = stl.Monitor(formula, NAMES)
    for n, sample in enumerate(trace, 1):
        bounds = stl.robustness_bounds(formula, trace[:n], NAMES)
        assert monitor.update(sample)[:2] == tuple(end.item() for end in bounds)


@pytest.mark.parametrize("text", NESTED + STREAMED)
@pytest.mark.parametrize("seed", range(3))
def test_nested_operators_equal_the_interval_policy(text: str, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is kept beside the samples stands for all of them: traces are longer than any operand looks."""
    monkeypatch.setattr(batch_source, "MANY", seed % 2)  # two traces as streams, or evaluated together
    formula, trace = stl.parse(text), traces(40, seed)
    monitor, batch = stl.Monitor(formula, NAMES), stl.BatchMonitor(formula, NAMES, 2)
    for n in range(1, len(trace) + 1):
        now = monitor.update(trace[n - 1])
        if n == 15:
            batch.restart([1])
        known = batch.update([trace[n - 1], trace[n - 1]])
        bounds = stl.robustness_bounds(formula, trace[:n], NAMES)
        assert now[:2] == tuple(end.item() for end in bounds)
        later = stl.robustness_bounds(formula, trace[14 if n >= 15 else 0 : n], NAMES)
        assert (known.lower.tolist(), known.upper.tolist()) == tuple([a, b] for a, b in zip(bounds, later, strict=True))
        certainly, possibly = stl.satisfaction_bounds(formula, trace[:n], NAMES)
        assert now.verdict == (True if certainly else None if possibly else False)


def kept(text: str, steps: int) -> dict[str, int]:
    """Of each part of the state that holds several values, how many."""
    monitor = stl.Monitor(stl.parse(text), NAMES)
    for sample in traces(steps, 0):
        monitor.update(sample)
    state = vars(monitor._state).items()
    queues = {name: len(each) for name, each in state if isinstance(each, deque)}
    return queues | {name: each.rows.shape[1] for name, each in state if isinstance(each, Recent)}


@pytest.mark.parametrize("text", NESTED + STREAMED)
def test_what_is_kept_does_not_grow_with_the_trace(text: str) -> None:
    assert all(count <= 40 for count in kept(text, 300).values())


@pytest.mark.parametrize("text", STREAMED)
def test_what_one_pass_decides_is_evaluated_once(text: str) -> None:
    assert not any(name.startswith("samples") for name in kept(text, 1))


@pytest.mark.parametrize("text", ["G (x >= 0 -> O[0,1000000000] y >= 0)", "G[0,5] (x >= 0 -> O[0,1000000000] y >= 0)"])
def test_a_wide_window_of_the_past_costs_what_is_in_it(text: str) -> None:
    formula, trace = stl.parse(text), traces(5, 0)
    narrow = stl.parse(text.replace("000000000", "0"))
    monitor, other = stl.Monitor(formula, NAMES), stl.Monitor(narrow, NAMES)
    for n, sample in enumerate(trace, 1):
        assert monitor.update(sample) == other.update(sample)
        if "G[0,5]" in text:
            assert stl.robustness_bounds(formula, trace[:n], NAMES) == stl.robustness_bounds(narrow, trace[:n], NAMES)


def test_what_overflows_on_the_way_counts_as_in_arrays() -> None:
    trace = np.array([[0.0], [1.0]])
    formula = stl.parse("G[0,1] 3 / exp(1000 * x) <= 3")
    monitor = stl.Monitor(formula, ["x"])
    monitor.update(trace[0])
    assert monitor.update(trace[1]).lower == stl.robustness(formula, trace, ["x"]) == 0


def test_samples_of_any_kind_are_read_alike() -> None:
    formula = stl.parse("x >= y")
    for sample in ([3, 1], (3.0, 1.0), np.array([3, 1]), np.array([3, 1], dtype=np.float32), (np.float64(3), 1.0)):
        assert stl.Monitor(formula, ["x", "y"]).update(sample) == stl.Interval(2.0, 2.0, True)
    assert stl.Monitor(formula, ["x", "y"]).update([math.inf, -math.inf]) == stl.Interval(math.inf, math.inf, True)


def test_the_samples_are_not_kept_by_reference() -> None:
    monitor, sample = stl.Monitor(stl.parse("F[0,2] (x >= 0 U[0,3] x >= 1)"), ["x"]), [2.0]
    monitor.update(sample)
    sample[0] = -5.0
    assert monitor.update(sample).lower == 1.0


def test_a_copy_is_a_fork() -> None:
    monitor = stl.Monitor(stl.parse("F[0,1] G[0,1] x >= 0"), ["x"])
    monitor.update([2.0])
    fork = copy.deepcopy(monitor)
    assert monitor.update([-1.0]) == stl.Interval(-1.0, -1.0, False)  # both windows have this sample
    assert fork.update([5.0]).lower == 2.0
    assert fork.update([4.0]) == stl.Interval(4.0, 4.0, True)


@pytest.mark.parametrize(
    "text",
    [
        "F[0,1] G[0,1] x >= 0",
        "F[0,2] (x >= 0 U[0,3] x >= 1)",
        "G (x >= 0 -> O[0,2] x <= -1)",
        "F[0,2] (x <= 0 | G x >= 1)",
    ],
)
def test_a_pickled_monitor_goes_on(text: str) -> None:
    monitor = stl.Monitor(stl.parse(text), ["x"])
    for value in (2.0, -1.0, 3.0, 0.5, -2.0, 1.5):
        stored = pickle.loads(pickle.dumps(monitor))
        assert (stored.steps, stored.horizon, stored.formula) == (monitor.steps, monitor.horizon, monitor.formula)
        assert stored.update([value]) == monitor.update([value])


@pytest.mark.parametrize("sample", [[math.inf], [-1e-320]])
def test_infinite_and_tiny_samples(sample: list[float]) -> None:
    now = stl.Monitor(stl.parse("x > 0"), ["x"]).update(sample)
    assert now.verdict == (sample[0] > 0)
    np.testing.assert_allclose(now.lower, sample[0], atol=1e-300)


def test_a_nan_inside_a_minimum_is_an_error_as_in_arrays() -> None:
    least = [f"{name}({args}) <= 1" for name in ("min", "max") for args in ("0, x - y", "x - y, 0")]
    for text in (*least, "x - y >= 0 | True & x >= 0"):
        with pytest.raises(stl.UndefinedError, match="has no value"):
            stl.Monitor(stl.parse(text), ["x", "y"]).update([math.inf, math.inf])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G[1,3] (x > 0 U[0,1] True)", (math.inf, math.inf, True)),
        ("F[0,2] (False U[3,4] y < 0)", (-math.inf, -math.inf, False)),
        ("G[0,1] (1 <= 2 R[3,5] y < 0)", (1.0, math.inf, True)),
        ("G[1,2] !(1 <= 2 W[1,1] abs(x) <= 1)", (-1.0, -1.0, False)),
    ],
)
def test_constants_beside_an_until_bound_it(text: str, expected: tuple[float, float, bool]) -> None:
    formula, sample = stl.parse(text), [2.0, 0.5]
    assert stl.Monitor(formula, ["x", "y"]).update(sample) == expected
    both = stl.BatchMonitor(formula, ["x", "y"], 1).update([sample])
    assert (both.lower[0], both.upper[0]) == expected[:2] == stl.robustness_bounds(formula, [sample], ["x", "y"])


def test_steps_stop_after_the_horizon() -> None:
    monitor = stl.Monitor(stl.parse("G[0,1] x >= 0"), ["x"])
    for _ in range(5):
        monitor.update([1.0])
    assert monitor.steps == 2
