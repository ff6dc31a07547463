"""A refused sample leaves a monitor as it was, and so do all rows of a batch."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas, traces
from hypothesis import given

from stlbench import stl
from stlbench.stl.running.unfolding import Recent

HALF = stl.parse("G[0,2] y >= 0 & G[0,2] sqrt(x) >= 0")
ROOT = stl.Predicate(">=", stl.Call("sqrt", (stl.Signal("root"),)), stl.Signal("x"))


def watch(monitor: Any, samples: Any, bad: Any) -> list[Any]:
    """The answers, each sample after one that is refused."""
    answers = []
    for sample in samples:
        before = copy.deepcopy(monitor)
        with pytest.raises(stl.UndefinedError):
            monitor.update(bad)
        assert np.array_equal(monitor.steps, before.steps)
        if isinstance(monitor, stl.Monitor):
            assert shown(monitor) == shown(before)
        else:
            assert all(np.array_equal(*ends) for ends in zip(monitor._bounds(), before._bounds(), strict=True))
        answers.append(monitor.update(sample))
    return answers


def shown(monitor: stl.Monitor) -> dict[str, str]:
    """All that a monitor keeps; of its samples those that were taken."""
    state = vars(monitor._state).items()
    return {name: repr(each.rows[:, : each.size] if isinstance(each, Recent) else each) for name, each in state}


@given(formulas(LIPSCHITZ, 3, 4, endless=True), SEEDS)
def test_as_if_it_had_never_come(formula: stl.Formula, seed: int) -> None:
    names, steps = [*NAMES, "root"], 7
    both: stl.Formula = stl.And(
        (formula, stl.parse(f"G[0,{steps}] sqrt(root) >= 0"), stl.Until(0, steps, ROOT, stl.parse("x >= 100")))
    )
    good = np.concatenate([traces(steps, seed), np.ones((steps, 1))], axis=1)
    bad = [-9.0, 9.0, -9.0, -1.0]
    plain = stl.Monitor(both, names)
    assert watch(stl.Monitor(both, names), good.tolist(), bad) == [plain.update(sample) for sample in good.tolist()]
    other = np.concatenate([traces(steps, seed + 1), np.ones((steps, 1))], axis=1)
    batch, rows = stl.BatchMonitor(both, names, 2), np.stack([good, other], axis=1)
    expected = [batch.update(samples) for samples in rows]
    answers = watch(stl.BatchMonitor(both, names, 2), rows, np.array([[1.0, 1.0, 1.0, 1.0], bad]))
    for now, then in zip(answers, expected, strict=True):
        assert all(np.array_equal(*pair) for pair in zip(now, then, strict=True))


@pytest.mark.parametrize("bad", [[1.0], [1.0, 2.0, 3.0], "12", np.ma.masked_array([1.0, 2.0], [False, True])])
def test_so_do_samples_of_another_shape_or_kind(bad: Any) -> None:
    monitor = stl.Monitor(HALF, ["x", "y"])
    with pytest.raises((ValueError, TypeError)):
        monitor.update(bad)
    assert monitor.steps == 0
    assert monitor.update([4.0, 3.0]).upper == 2.0


class TestRestart:
    def monitor(self) -> stl.BatchMonitor:
        monitor = stl.BatchMonitor(stl.parse("G[0,2] x >= 0"), ["x"], 3)
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

    @pytest.mark.parametrize(
        "wrong", [None, [2**53 + 1], [2**64], {1}, np.ma.array([True] * 3, mask=[False, False, True])]
    )
    def test_what_is_no_sample_is_told_as_a_choice(self, wrong: Any) -> None:
        monitor = self.monitor()
        with pytest.raises(ValueError, match=r"which traces: a mask of 3 booleans, or indices from 0 to 2; got \["):
            monitor.restart(wrong)
        assert monitor.steps.tolist() == [1, 1, 1]


class TestWhatIsNoFormula:
    @pytest.mark.parametrize("value", ["G[0,1] x >= 0", b"x >= 0", None, 3, stl.Signal("x")])
    def test_is_named(self, value: Any) -> None:
        for call in (
            lambda: stl.Monitor(value, ["x"]),
            lambda: stl.BatchMonitor(value, ["x"], 1),
            lambda: stl.robustness(value, [[1.0]], ["x"]),
            lambda: stl.margin(value, ["x"]),
            lambda: stl.holds(value, ["x"]),
        ):
            with pytest.raises(TypeError, match=rf"expected a formula, got {type(value).__name__} "):
                call()

    def test_text_gets_a_hint(self) -> None:
        with pytest.raises(TypeError, match=r"expected a formula, got str 'x >= 0'; parse\(text\) makes one"):
            stl.robustness("x >= 0", [[1.0]], ["x"])  # type: ignore[arg-type]

    def test_names_are_no_single_text(self) -> None:
        for call in (
            lambda: stl.Monitor(stl.parse("x >= 0"), "xy"),
            lambda: stl.robustness(stl.parse("x >= 0"), [[1.0, 2.0]], "xy"),
        ):
            with pytest.raises(TypeError, match=r"names is a sequence of signal names, got one text; write \['xy'\]"):
                call()

    @pytest.mark.parametrize("kind", [set, frozenset])
    def test_names_have_an_order(self, kind: Any) -> None:
        formula, names = stl.parse("x >= y"), kind(["x", "y"])
        for call in (
            lambda: stl.Monitor(formula, names),
            lambda: stl.BatchMonitor(formula, names, 1),
            lambda: stl.robustness(formula, [[1.0, 2.0]], names),
            lambda: stl.witness(formula, [[1.0, 2.0]], names),
            lambda: stl.margin(formula, names),
            lambda: stl.values([stl.parse_expression("x - y")], names),
            lambda: stl.bounds(formula, [[0.0, 1.0]] * 2, names),
        ):
            with pytest.raises(TypeError, match=f"names, got a {kind.__name__}, which has no order; write a list"):
                call()

    def test_keys_of_a_dict_are_names(self) -> None:
        assert stl.robustness(stl.parse("x >= y"), [[1.0, 3.0]], {"x": 0, "y": 1}.keys()) == -2.0  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "text", ["F[0,2] x >= 0", "F[0,2] G[0,2] F[0,1] x >= 0", "x >= 0 S x >= 1", "G (x >= 0 -> F x >= 1)"]
)
def test_what_no_predicate_reads_may_be_anything(text: str) -> None:
    formula = stl.parse(text)
    plain, beside = stl.Monitor(formula, ["x"]), stl.Monitor(formula, ["x", "note"])
    batch = stl.BatchMonitor(formula, ["x", "note"], 2)
    for x in (1, 2.0, np.float32(-1)):
        bounds = plain.update([x])
        assert beside.update([x, "start"]) == bounds
        both = batch.update([[x, "start"], [x, None]])
        assert (both.lower.tolist(), both.upper.tolist()) == ([bounds.lower] * 2, [bounds.upper] * 2)
    assert stl.robustness(stl.parse("F[0,1] x >= 0"), [[1.0, "start"], [2, None]], ["x", "note"]) == 2.0
