"""The batch monitor against as many scalar monitors, with restarts."""

from __future__ import annotations

import copy
import math
import pickle
from collections import deque
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, WATCHED, traces
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.stl.running.batch import SlidingLeast, SlidingQueue
from stlbench.stl.running.tree import last_step
from stlbench.stl.running.unfolding import Unfolding


@given(WATCHED, SEEDS, st.booleans())
def test_equals_scalar_monitors(formula: stl.Formula, seed: int, restarts: bool) -> None:
    count, rng = 4, np.random.default_rng(seed)
    batch, single = stl.BatchMonitor(formula, NAMES, count), [stl.Monitor(formula, NAMES) for _ in range(count)]
    for samples in traces(2 * min(last_step(formula), 20) + 4, seed, (count,)).swapaxes(0, 1):
        which = rng.random(count) < (0.2 if restarts else 0.0)
        batch.restart(which)
        single = [stl.Monitor(formula, NAMES) if anew else one for anew, one in zip(which, single, strict=True)]
        now = batch.update(samples)
        expected = [one.update(sample) for one, sample in zip(single, samples.tolist(), strict=True)]
        np.testing.assert_allclose(now.lower, [one.lower for one in expected], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(now.upper, [one.upper for one in expected], rtol=1e-12, atol=1e-12)
        assert now.certainly.tolist() == [one.verdict is True for one in expected]
        assert now.possibly.tolist() == [one.verdict is not False for one in expected]


def test_a_run_by_hand() -> None:
    monitor = stl.BatchMonitor(stl.parse("G[1,2] x >= 0"), ["x"], 2)
    monitor.update([[-5.0], [0.0]])
    now = monitor.update([[3.0], [-2.0]])
    assert (now.lower.tolist(), now.upper.tolist()) == ([-math.inf] * 2, [3, -2])
    assert (now.certainly.tolist(), now.possibly.tolist()) == ([False, False], [True, False])
    monitor.restart([1])
    now = monitor.update([[1.0], [-9.0]])
    assert (now.lower.tolist(), now.upper.tolist()) == ([1, -math.inf], [1, math.inf])
    assert (now.certainly.tolist(), now.possibly.tolist()) == ([True, False], [True, True])


@pytest.mark.parametrize("kind", [SlidingLeast, SlidingQueue])
@pytest.mark.parametrize("trend", [0.0, 0.3, -0.3])
def test_long_windows_slide(kind: type[SlidingLeast | SlidingQueue], trend: float) -> None:
    values = np.random.default_rng(0).normal(size=(400, 3)).round(1) + trend * np.arange(400)[:, None]
    sliding = kind(3, 37)
    for t, row in enumerate(values):
        least = sliding.step(row)
        if t >= 36:
            np.testing.assert_array_equal(least, values[t - 36 : t + 1].min(axis=0))


def test_wide_windows_keep_what_may_still_count() -> None:
    monitor = stl.BatchMonitor(stl.parse("F[0,10000000] G[0,1000000] x >= 0"), ["x"], 64)
    for samples in np.random.default_rng(0).normal(size=(300, 64, 1)):
        known = monitor.update(samples)
    assert len(pickle.dumps(monitor._tree.leaves[0].window)) < 1e6  # type: ignore[attr-defined]
    assert (known.lower == -math.inf).all()


def test_traces_of_different_age_are_read_together() -> None:
    for text in ("G (x >= 0 -> F[1,4] y >= 0)", "G[2,90] (x >= 0 -> O[0,3] y >= 0)"):
        assert len(set(Unfolding(stl.parse(text), NAMES).phases(np.array([40, 60, 80])).tolist())) == 1


def test_wide_windows_of_nested_formulas_keep_what_may_still_count() -> None:
    formula = stl.parse("G (x >= 0 -> O[0,1000000] y >= 0) & G[0,9000000] (x >= 0 -> F[0,1000000] y >= 0)")
    monitor, samples = stl.BatchMonitor(formula, NAMES, 100), np.random.default_rng(0).normal(size=(200, 100, 3))
    for rows in samples:
        monitor.update(rows)
    states = [vars(state).values() for leaf in monitor._tree.leaves for state in leaf.states]  # type: ignore[attr-defined]
    assert max(len(each) for state in states for each in state if isinstance(each, deque)) < 40


def test_earlier_answers_do_not_change() -> None:
    monitor = stl.BatchMonitor(stl.parse("F[0,3] x >= 0"), ["x"], 1)
    before = [monitor.update([[-1.0]]), monitor.update([[2.0]])]
    kept = copy.deepcopy(before)
    monitor.restart([True])
    monitor.update([[-3.0]])
    for one, other in zip(before, kept, strict=True):
        assert all(np.array_equal(left, right) for left, right in zip(one, other, strict=True))


def test_a_copy_is_a_fork() -> None:
    formula = stl.parse("F[0,4] G[0,2] x >= 0 & x >= -1 U[1,5] x >= 1")
    batch = traces(stl.horizon(formula) + 1, 5, (3,))[..., :1]
    monitor = stl.BatchMonitor(formula, ["x"], 3)
    for samples in batch[:, :3].swapaxes(0, 1):
        monitor.update(samples)
    fork = copy.deepcopy(monitor)
    for _ in range(4):
        monitor.update(np.full((3, 1), -7.0))
    now: stl.Intervals = fork.update(batch[:, 3])
    for samples in batch[:, 4:].swapaxes(0, 1):
        now = fork.update(samples)
    assert now.certainly.tolist() == now.possibly.tolist() == stl.satisfied(formula, batch, ["x"]).tolist()


def test_undefined_samples_are_errors_while_a_trace_is_read() -> None:
    monitor = stl.BatchMonitor(stl.parse("G[0,1] sqrt(x) >= 0"), ["x"], 3)
    with pytest.raises(stl.UndefinedError, match="'x' is NaN at sample 0 of trace 2"):
        monitor.update([[0.0], [1.0], [math.nan]])
    with pytest.raises(
        stl.UndefinedError, match=r"^sqrt\(x\) >= 0 has no value .* where x = -1 at sample 0 of trace 1$"
    ):
        monitor.update([[0.0], [-1.0], [0.0]])
    late = stl.BatchMonitor(stl.parse("G[0,0] sqrt(x) >= 0"), ["x"], 2)
    late.update([[1.0], [2.0]])
    late.restart([0])
    assert late.update([[9.0], [math.nan]]).lower.tolist() == [3, math.sqrt(2)]
    assert late.update([[-1.0], [-1.0]]).lower.tolist() == [3, math.sqrt(2)]


def test_shape_names_and_count_are_checked() -> None:
    with pytest.raises(ValueError, match=r"shape \(2, 1\) for x, got \(1, 1\)"):
        stl.BatchMonitor(stl.parse("x >= 0"), ["x"], 2).update([[1.0]])
    with pytest.raises(stl.UnknownSignalError):
        stl.BatchMonitor(stl.parse("y >= 0"), ["x"], 2)
    with pytest.raises(ValueError, match="at least 1"):
        stl.BatchMonitor(stl.parse("x >= 0"), ["x"], 0)
    count: Any
    for count in ("2", 2.0, None, [2]):
        with pytest.raises(TypeError, match=r"^count is a whole number of traces, got "):
            stl.BatchMonitor(stl.parse("x >= 0"), ["x"], count)
    assert stl.BatchMonitor(stl.parse("x >= 0"), ["x"], np.int64(2)).update([[1.0], [2.0]]).lower.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    "text",
    [
        "F[0,3] x >= 0",
        "F[0,3] 1 >= 0",
        "G[0,2] (x > 0 -> F[0,3] x > 1)",
        "x > 0 U[0,3] x > 1",
        "G[0,2] F[0,2] (x >= 0 U[0,3] x >= 1)",
        "G (x >= 0 -> O[0,2] x <= -1)",
        "G (x >= 0 S[0,2] x <= -1)",
    ],
)
def test_a_pickled_batch_goes_on(text: str) -> None:
    monitor = stl.BatchMonitor(stl.parse(text), ["x"], 3)
    for samples in np.random.default_rng(0).normal(size=(6, 3, 1)):
        stored = pickle.loads(pickle.dumps(monitor))
        for end, other in zip(stored.update(samples), monitor.update(samples), strict=True):
            np.testing.assert_array_equal(end, other)
        monitor.restart([1])
