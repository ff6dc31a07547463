"""The robustness of what is counted as violated."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.episodes import specification
from helpers.generated_formulas import NAMES, SEEDS, formulas, traces
from hypothesis import given, settings

from stlbench import stl
from stlbench.contract import Specification
from stlbench.rollout.early_ends import greatest_and_least


@pytest.mark.parametrize(
    ("formula", "greatest", "least"),
    [
        ("G[0,2] x <= 1", 11.0, -9.0),
        ("!(F[0,2] x <= 1)", 9.0, -11.0),
        ("G[0,1] x >= 0 | G[2,3] x <= 0", 10.0, -10.0),
        ("x >= 0 -> F[0,1] y >= 0", 10.0, -1.0),
        ("x >= 0 U[0,3] y >= 0", 1.0, -10.0),
        ("True", np.inf, np.inf),
    ],
)
def test_table(formula: str, greatest: float, least: float) -> None:
    box = {"x": (-10.0, 10.0), "y": (-1.0, 1.0)}
    found = greatest_and_least(specification(formula, box, steps=5), stl.parse(formula))
    assert found == pytest.approx((greatest, least))


@settings(max_examples=40, deadline=None)
@given(formulas(), SEEDS)
def test_no_trace_within_the_ranges_is_outside(formula: stl.Formula, seed: int) -> None:
    steps = stl.horizon(formula)
    box = Specification(formula, tuple(NAMES), (-3.0,) * 3, (3.0,) * 3, max(steps, 1), 1.0)
    high, low = greatest_and_least(box, formula)
    found = stl.robustness(formula, traces(steps + 1, seed), NAMES)
    assert low - 1e-9 <= found <= high + 1e-9
