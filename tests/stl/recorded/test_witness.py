"""The witness of a robustness: by hand, and the laws that it has on any formula and trace."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, formulas, told, traces
from hypothesis import assume, given, reject
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench import stl
from stlbench.stl import robustness

X = [[3.0], [1.0], [-2.0], [4.0], [0.0]]
ANY = formulas(endless=True)


def found_or_skipped(formula: stl.Formula, trace: NDArray[np.float64]) -> stl.Witness:
    if np.isfinite(robustness(formula, trace, NAMES)):
        return stl.witness(formula, trace, NAMES)
    try:
        return stl.witness(formula, trace, NAMES)
    except ValueError:  # the window of a past operator has no step
        reject()


@pytest.mark.parametrize(
    ("text", "predicate", "step", "robustness"),
    [
        ("x >= 1", "x >= 1", 0, 2),
        ("!x >= 1", "x >= 1", 0, -2),
        ("G[0,4] x >= 0", "x >= 0", 2, -2),
        ("F[0,4] x >= 0", "x >= 0", 3, 4),
        ("F[1,2] x >= 0", "x >= 0", 1, 1),
        ("F[0,3] G[0,1] x >= 0", "x >= 0", 1, 1),  # min(3, 1) at 0, -2 at 1 and 2, min(4, 0) at 3
        ("x >= 0 U[0,3] x >= 4", "x >= 4", 0, -1),
        ("x >= 1 U[3,3] x >= 3", "x >= 1", 2, -3),  # the goal is met by 1 at step 3, x >= 1 is lost at step 2
        ("x >= -5 U[0,3] x >= 3.5", "x >= 3.5", 3, 0.5),
        ("x >= 5 -> x >= 9", "x >= 5", 0, 2),  # vacuous
        ("x >= 1 -> x >= 9", "x >= 1", 0, -2),
        ("G x >= -1 & F[0,1] x >= 3.5", "x >= -1", 2, -1),
        ("G[3,4] O[1,2] x >= 0", "x >= 0", 1, 1),  # at 3: max(-2, 1), at 4: max(4, -2)
        ("F[2,2] H x >= 0", "x >= 0", 2, -2),
        ("F[3,3] (x >= 0 S[0,3] x >= 2)", "x >= 2", 3, 2),
        ("F[2,2] (x >= 0 S[1,2] x >= 0)", "x >= 0", 2, -2),
        ("x >= 2 R[0,2] x >= 0", "x >= 0", 1, 1),  # 3, max(1, 1), and max(-2, 1)
        ("x >= 1 R[0,2] x >= 0", "x >= 1", 0, 2),  # 3, max(1, 2), and max(-2, 2)
        ("G[0,4] (0 <= x <= 3)", "0 <= x", 2, -2),
    ],
)
def test_by_hand(text: str, predicate: str, step: int, robustness: float) -> None:
    found = stl.witness(stl.parse(text), X, ["x"])
    assert (str(found.predicate), found.step, found.robustness) == (predicate, step, robustness)


def test_the_path_and_the_conjunct() -> None:
    formula = stl.parse("G[0,1] x <= 9 & (G[1,2] !(x <= 0 | x >= 5) & F[0,4] x >= 4)")
    found = stl.witness(formula, X, ["x"])
    texts = [(str(link.formula), link.step) for link in found.path[1:]]
    assert texts == [("G[1,2] !(x <= 0 | x >= 5)", 0), ("!(x <= 0 | x >= 5)", 2), ("x <= 0 | x >= 5", 2), ("x <= 0", 2)]
    assert str(found.conjunct) == "G[1,2] !(x <= 0 | x >= 5)"
    assert (found.margin, found.sign, found.robustness) == (2, -1, -2)


def test_where_there_is_no_conjunction_the_conjunct_is_the_formula() -> None:
    formula = stl.parse("G[0,2] (x >= 0 & x <= 9)")
    assert stl.witness(formula, X, ["x"]).conjunct == formula


def test_of_equals_the_first() -> None:
    trace = [[1.0, 1.0], [1.0, 1.0], [2.0, 2.0]]
    found = stl.witness(stl.parse("G[0,2] (y >= 0 & x >= 0)"), trace, ["x", "y"])
    assert (str(found.predicate), found.step) == ("y >= 0", 0)


def test_at_zero_it_is_one_that_decides() -> None:
    """Both operands have the margin 0, and only the second is violated."""
    found = stl.witness(stl.parse("x >= 0 & x > 0"), [[0.0]], ["x"])
    assert (str(found.predicate), found.robustness) == ("x > 0", 0)


def test_true_has_the_margin_inf() -> None:
    found = stl.witness(stl.parse("False"), X, ["x"])
    assert (str(found.predicate), found.margin, found.robustness) == ("True", np.inf, -np.inf)


@given(ANY, st.integers(1, 12), SEEDS)
def test_the_margin_is_the_robustness_up_to_the_sign(formula: stl.Formula, steps: int, seed: int) -> None:
    assume(told(formula, steps - 1) >= 0)
    trace = traces(steps, seed)
    found = found_or_skipped(formula, trace)
    assert found.robustness == robustness(formula, trace, NAMES)
    assert found.margin == robustness(found.predicate, trace[found.step :], NAMES)


@given(ANY, st.integers(1, 12), SEEDS)
def test_the_predicate_has_the_verdict(formula: stl.Formula, steps: int, seed: int) -> None:
    assume(told(formula, steps - 1) >= 0)
    trace = traces(steps, seed)
    found = found_or_skipped(formula, trace)
    there = bool(np.asarray(stl.holds(found.predicate, NAMES)(trace[found.step])))
    assert stl.satisfied(formula, trace, NAMES) == (there if found.sign > 0 else not there)


@given(formulas(endless=True, past=False), st.integers(1, 12), SEEDS)
def test_every_part_of_the_path_has_the_same_value(formula: stl.Formula, steps: int, seed: int) -> None:
    assume(told(formula, steps - 1) >= 0)
    trace = traces(steps, seed)
    found = stl.witness(formula, trace, NAMES)
    assert found.path[0] == (formula, 0)
    for (above, at), (part, step) in zip(found.path, found.path[1:], strict=False):
        assert part in above.operands
        assert abs(robustness(part, trace[step:], NAMES)) == abs(found.robustness)
        if isinstance(above, stl.Always | stl.Eventually):
            assert at + above.a <= step <= at + above.b
        elif isinstance(above, stl.Until | stl.Release):
            assert at <= step <= at + above.b
        else:
            assert step == at


def test_what_is_refused() -> None:
    with pytest.raises(stl.ShortTraceError):
        stl.witness(stl.parse("G[0,9] x >= 0"), X, ["x"])
    with pytest.raises(ValueError, match=r"one trace \(T\+1, k\), got the shape \(1, 5, 1\)"):
        stl.witness(stl.parse("x >= 0"), [X], ["x"])
    with pytest.raises(ValueError, match=r"no sample decides: at step 0, O\[2,3\] looks before sample 0 alone"):
        stl.witness(stl.parse("F[0,1] O[2,3] x >= 0"), X, ["x"])
    with pytest.raises(stl.UndefinedError, match="sqrt"):
        stl.witness(stl.parse("G[0,4] sqrt(x) >= 0"), X, ["x"])


@pytest.mark.parametrize("text", ["x >= 0 U[1,1] y >= 0", "x >= 0 R[1,1] y >= 0", "F[1,1] (x >= 0 S[1,1] y >= 0)"])
def test_of_equals_of_an_until_the_right_operand_comes_first(text: str) -> None:
    found = stl.witness(stl.parse(text), [[1.0, 1.0], [1.0, 1.0]], ["x", "y"])
    assert str(found.predicate) == "y >= 0"
