"""The normal form: by hand, and what its traces satisfy."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.generated_formulas import formulas, traces
from hypothesis import given
from hypothesis import strategies as st

from stlbench.stl import Formula, parse, robustness
from stlbench.task.forms import normal_form

NAMES = ("x", "y", "z")


@pytest.mark.parametrize(
    ("formula", "expected", "same"),
    [
        ("G[0,9] (F[0,3] x >= 0 & y >= 0 & z >= 0)", "G[0,9] (F[0,3] x >= 0 & G[0,0] (y >= 0 & z >= 0))", True),
        ("G[0,9] F[0,3] x >= 0 & G[0,12] y >= 0", "G[0,9] (F[0,3] x >= 0 & G[0,3] y >= 0)", True),
        ("G[0,12] y >= 0 & G[0,9] F[0,3] x >= 0", "G[0,9] (F[0,3] x >= 0 & G[0,3] y >= 0)", True),
        ("F[0,9] (G[0,3] x >= 0 | G[0,3] y >= 0)", "F[0,9] G[0,3] (x >= 0 | y >= 0)", False),
        *(
            (text, text, True)
            for text in (
                "G[0,9] F[0,3] x >= 0 & G[0,6] y >= 0",
                "F[0,9] (G[0,3] x >= 0 | G[0,4] y >= 0)",
                "F[0,5] x >= 0 & G[2,9] (y >= 0 | z >= 0)",
                "x >= 0 U[0,5] y >= 0",
            )
        ),
    ],
)
def test_by_hand(formula: str, expected: str, same: bool) -> None:
    assert normal_form(parse(formula)) == parse(expected)
    batch = traces(20, 0, (200,))
    own, other = (robustness(parse(text), batch, NAMES) for text in (formula, expected))
    assert (other >= own).all()
    assert np.array_equal(own, other) == same


@given(formulas(longest=3, past=False), st.integers(0, 2**32 - 1))
def test_what_satisfies_a_formula_satisfies_its_form(formula: Formula, seed: int) -> None:
    batch = traces(25, seed, (10,))
    own, other = (robustness(each, batch, NAMES) for each in (formula, normal_form(formula)))
    assert ((other >= own) | np.isnan(own)).all()
