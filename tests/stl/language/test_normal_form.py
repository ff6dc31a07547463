"""Negations pushed inwards: where they stand then, and that nothing changes."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas, traces
from hypothesis import given

from stlbench import stl


@pytest.mark.parametrize(
    ("text", "pushed"),
    [
        ("!G[0,2] x >= 1", "F[0,2] !x >= 1"),
        ("!(F[0,2] x >= 1 & (x <= 1 | y <= 1))", "G[0,2] !x >= 1 | !(x <= 1 | y <= 1)"),
        ("F[0,1] x >= 1 -> G[0,2] !!(y >= 1)", "G[0,1] !x >= 1 | G[0,2] !!y >= 1"),
        ("!(F[0,1] x >= 1 -> y >= 1)", "F[0,1] x >= 1 & !y >= 1"),
        ("!!(x >= 1 U[0,2] !G[0,1] y >= 1)", "x >= 1 U[0,2] F[0,1] !y >= 1"),
        ("!(x >= 1 U[0,2] y >= 1)", "!x >= 1 R[0,2] !y >= 1"),
        ("!(x >= 1 R[0,2] !F[0,1] y >= 1)", "!x >= 1 U[0,2] F[0,1] y >= 1"),
        ("!(H[0,2] x >= 1 | O y >= 1)", "O[0,2] !x >= 1 & H !y >= 1"),
        ("!(x >= 1 S[0,2] !O y >= 1)", "!(x >= 1 S[0,2] H !y >= 1)"),
    ],
)
def test_by_hand(text: str, pushed: str) -> None:
    assert str(stl.negations_inside(stl.parse(text))) == pushed


def test_to_predicates() -> None:
    formula = stl.parse("!(F[0,2] (x >= 1 & !(y <= 1 -> x <= 2)))")
    assert str(stl.negations_inside(formula, to_predicates=True)) == "G[0,2] (!x >= 1 | !y <= 1 | x <= 2)"


@given(formulas(LIPSCHITZ), SEEDS)
def test_values_and_verdicts_stay(formula: stl.Formula, seed: int) -> None:
    samples = traces(stl.horizon(formula) + 2, seed, (3,))
    for to_predicates in (False, True):
        pushed = stl.negations_inside(formula, to_predicates)
        assert np.array_equal(stl.robustness(pushed, samples, NAMES), stl.robustness(formula, samples, NAMES))
        assert np.array_equal(stl.satisfied(pushed, samples, NAMES), stl.satisfied(formula, samples, NAMES))
