"""A refused sample leaves a monitor as it was, and so do all rows of a batch."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas, traces
from hypothesis import given

from stlbench.stl import (
    And,
    BatchMonitor,
    Call,
    Formula,
    Monitor,
    Predicate,
    Signal,
    UndefinedError,
    Until,
    parse,
    robustness,
)
from stlbench.stl.running.unfolding import Recent

HALF = parse("G[0,2] y >= 0 & G[0,2] sqrt(x) >= 0")
ROOT = Predicate(">=", Call("sqrt", (Signal("root"),)), Signal("x"))


def test_a_monitor_by_hand() -> None:
    monitor = Monitor(HALF, ["x", "y"])
    monitor.update([1.0, 5.0])
    for _ in range(2):
        with pytest.raises(UndefinedError, match=r"^sqrt\(x\) >= 0 has no value .* where x = -1 at sample 1$"):
            monitor.update([-1.0, -7.0])
    assert monitor.steps == 1
    monitor.update([1.0, 5.0])
    now = monitor.update([1.0, 5.0])
    assert (now.lower, now.upper, now.verdict) == (1.0, 1.0, True)
    assert now.lower == robustness(HALF, [[1.0, 5.0]] * 3, ["x", "y"])


def test_a_batch_by_hand() -> None:
    batch = BatchMonitor(HALF, ["x", "y"], 2)
    batch.update([[1.0, 5.0], [4.0, 3.0]])
    with pytest.raises(UndefinedError, match="at sample 1 of trace 1"):
        batch.update([[0.25, -9.0], [-1.0, -7.0]])
    assert batch.steps.tolist() == [1, 1]
    batch.update([[1.0, 5.0], [4.0, 3.0]])
    now = batch.update([[1.0, 5.0], [4.0, 3.0]])
    assert (now.lower.tolist(), now.certainly.tolist()) == ([1.0, 2.0], [True, True])


def watch(monitor: Any, samples: Any, bad: Any) -> list[Any]:
    """The answers, each sample after one that is refused."""
    answers = []
    for sample in samples:
        before = copy.deepcopy(monitor)
        with pytest.raises(UndefinedError):
            monitor.update(bad)
        assert np.array_equal(monitor.steps, before.steps)
        if isinstance(monitor, Monitor):
            assert shown(monitor) == shown(before)
        else:
            assert all(np.array_equal(*ends) for ends in zip(monitor._bounds(), before._bounds(), strict=True))
        answers.append(monitor.update(sample))
    return answers


def shown(monitor: Monitor) -> dict[str, str]:
    """All that a monitor keeps; of its samples those that were taken."""
    state = vars(monitor._state).items()
    return {name: repr(each.rows[:, : each.size] if isinstance(each, Recent) else each) for name, each in state}


@given(formulas(LIPSCHITZ, 3, 4, endless=True), SEEDS)
def test_as_if_it_had_never_come(formula: Formula, seed: int) -> None:
    names, steps = [*NAMES, "root"], 7
    both: Formula = And((formula, parse(f"G[0,{steps}] sqrt(root) >= 0"), Until(0, steps, ROOT, parse("x >= 100"))))
    good = np.concatenate([traces(steps, seed), np.ones((steps, 1))], axis=1)
    bad = [-9.0, 9.0, -9.0, -1.0]
    plain = Monitor(both, names)
    assert watch(Monitor(both, names), good.tolist(), bad) == [plain.update(sample) for sample in good.tolist()]
    other = np.concatenate([traces(steps, seed + 1), np.ones((steps, 1))], axis=1)
    batch, rows = BatchMonitor(both, names, 2), np.stack([good, other], axis=1)
    expected = [batch.update(samples) for samples in rows]
    answers = watch(BatchMonitor(both, names, 2), rows, np.array([[1.0, 1.0, 1.0, 1.0], bad]))
    for now, then in zip(answers, expected, strict=True):
        assert all(np.array_equal(*pair) for pair in zip(now, then, strict=True))


@pytest.mark.parametrize("bad", [[1.0], [1.0, 2.0, 3.0], "12", np.ma.masked_array([1.0, 2.0], [False, True])])
def test_so_do_samples_of_another_shape_or_kind(bad: Any) -> None:
    monitor = Monitor(HALF, ["x", "y"])
    with pytest.raises((ValueError, TypeError)):
        monitor.update(bad)
    assert monitor.steps == 0
    assert monitor.update([4.0, 3.0]).upper == 2.0


def test_masked_arrays_are_named() -> None:
    masked = np.ma.masked_array([[1.0, 2.0]], [[False, True]])
    for call in (
        lambda: Monitor(HALF, ["x", "y"]).update(masked[0]),
        lambda: BatchMonitor(HALF, ["x", "y"], 1).update(masked),
        lambda: robustness(HALF, masked, ["x", "y"]),
    ):
        with pytest.raises(TypeError, match="a masked array has samples without a value"):
            call()


class TestRestart:
    def monitor(self) -> BatchMonitor:
        monitor = BatchMonitor(parse("G[0,2] x >= 0"), ["x"], 3)
        monitor.update([[1.0], [2.0], [3.0]])
        return monitor

    @pytest.mark.parametrize("nobody", [[], (), np.array([]), [False] * 3, np.zeros(3, dtype=bool)])
    def test_nobody(self, nobody: Any) -> None:
        monitor = self.monitor()
        monitor.restart(nobody)
        assert monitor.steps.tolist() == [1, 1, 1]
        assert monitor.update([[9.0]] * 3).upper.tolist() == [1, 2, 3]

    @pytest.mark.parametrize("some", [[2, 0], [True, False, True], np.array([0, 2]), (0, 2, 2)])
    def test_some(self, some: Any) -> None:
        monitor = self.monitor()
        monitor.restart(some)
        assert monitor.steps.tolist() == [0, 1, 0]
        assert monitor.update([[9.0]] * 3).upper.tolist() == [9, 2, 9]

    def test_one(self) -> None:
        monitor = self.monitor()
        monitor.restart(1)
        assert monitor.steps.tolist() == [1, 0, 1]

    @pytest.mark.parametrize("wrong", [[True], [True] * 4, [3], [-1], [0.0], [[True] * 3], "0", [[0]]])
    def test_what_is_no_choice_is_refused(self, wrong: Any) -> None:
        monitor = self.monitor()
        with pytest.raises((ValueError, TypeError)) as caught:
            monitor.restart(wrong)
        assert monitor.steps.tolist() == [1, 1, 1]
        if isinstance(caught.value, ValueError):
            assert "a mask of 3 booleans, or indices from 0 to 2; got" in str(caught.value)


class TestWhatIsNoFormula:
    @pytest.mark.parametrize("value", ["G[0,1] x >= 0", b"x >= 0", None, 3, Signal("x")])
    def test_is_named(self, value: Any) -> None:
        for call in (
            lambda: Monitor(value, ["x"]),
            lambda: BatchMonitor(value, ["x"], 1),
            lambda: robustness(value, [[1.0]], ["x"]),
        ):
            with pytest.raises(TypeError, match=rf"expected a formula, got {type(value).__name__} "):
                call()

    def test_text_gets_a_hint(self) -> None:
        with pytest.raises(TypeError, match=r"expected a formula, got str 'x >= 0'; parse\(text\) makes one"):
            robustness("x >= 0", [[1.0]], ["x"])  # type: ignore[arg-type]

    def test_names_are_no_single_text(self) -> None:
        for call in (lambda: Monitor(parse("x >= 0"), "xy"), lambda: robustness(parse("x >= 0"), [[1.0, 2.0]], "xy")):
            with pytest.raises(TypeError, match=r"names is a sequence of signal names, got one text; write \['xy'\]"):
                call()


def test_nan_where_nothing_is_read_is_no_matter() -> None:
    monitor = Monitor(parse("G[1,1] x >= 0"), ["x", "y"])
    for sample in ([math.nan, 1.0], [2.0, math.nan], [math.nan, math.nan]):
        now = monitor.update(sample)
    assert now.lower == now.upper == 2.0
