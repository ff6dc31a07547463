"""The laws of robustness and satisfaction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas, intervals, traces
from hypothesis import given
from hypothesis import strategies as st

from stlbench.stl import (
    Always,
    And,
    Eventually,
    Formula,
    Implies,
    Not,
    Or,
    TrueFormula,
    Until,
    horizon,
    robustness,
    satisfied,
)

LAWS: list[tuple[str, Any]] = [
    ("double negation", lambda p, q, a, b: (Not(Not(p)), p)),
    ("F is not G not", lambda p, q, a, b: (Eventually(a, b, p), Not(Always(a, b, Not(p))))),
    ("G is not F not", lambda p, q, a, b: (Always(a, b, p), Not(Eventually(a, b, Not(p))))),
    ("De Morgan and", lambda p, q, a, b: (Not(And((p, q))), Or((Not(p), Not(q))))),
    ("De Morgan or", lambda p, q, a, b: (Not(Or((p, q))), And((Not(p), Not(q))))),
    ("implication", lambda p, q, a, b: (Implies(p, q), Or((Not(p), q)))),
    ("G distributes over and", lambda p, q, a, b: (Always(a, b, And((p, q))), And((Always(a, b, p), Always(a, b, q))))),
    ("F distributes over or", lambda p, q, a, b: (
        Eventually(a, b, Or((p, q))),
        Or((Eventually(a, b, p), Eventually(a, b, q))),
    )),
    ("F from until", lambda p, q, a, b: (Eventually(a, b, p), Until(a, b, TrueFormula(), p))),
    ("G G adds intervals", lambda p, q, a, b: (Always(a, b, Always(1, 3, p)), Always(a + 1, b + 3, p))),
    ("prompt until", lambda p, q, a, b: (Until(0, b, p, q), Or((q, And((p, Until(0, b, p, q))))))),
    ("until splits at a", lambda p, q, a, b: (
        Until(a + 1, b + 1, p, q),
        And((Always(0, a, p), Eventually(a + 1, a + 1, Until(0, b - a, p, q)))),
    )),
    ("timed until, Donze et al. 2013", lambda p, q, a, b: (
        Until(a + 1, b + 1, p, q),
        And((
            Eventually(a + 1, b + 1, q),
            Always(0, a, p),
            Eventually(a + 1, a + 1, Until(0, 40, p, q)),
        )),
    )),
]  # fmt: skip


@pytest.mark.parametrize(("name", "law"), LAWS, ids=[name for name, _ in LAWS])
@given(p=formulas(LIPSCHITZ, 3, 3), q=formulas(LIPSCHITZ, 3, 3), ends=intervals(4), seed=SEEDS)
def test_law(name: str, law: Any, p: Formula, q: Formula, ends: tuple[int, int], seed: int) -> None:
    left, right = law(p, q, *ends)
    batch = traces(1 + max(horizon(left), horizon(right)), seed, (10,))
    np.testing.assert_array_equal(robustness(left, batch, NAMES), robustness(right, batch, NAMES))
    np.testing.assert_array_equal(satisfied(left, batch, NAMES), satisfied(right, batch, NAMES))


@given(formulas(LIPSCHITZ), SEEDS, st.floats(0, 2))
def test_robustness_is_1_lipschitz(formula: Formula, seed: int, size: float) -> None:
    batch = traces(horizon(formula) + 1, seed, (20,))
    noise = np.random.default_rng(seed).uniform(-size, size, batch.shape)
    before, after = robustness(formula, batch, NAMES), robustness(formula, batch + noise, NAMES)
    finite = np.isfinite(before)
    assert np.array_equal(before[~finite], after[~finite])
    assert np.all(np.abs(before[finite] - after[finite]) <= size + 1e-9)


@given(formulas(LIPSCHITZ), intervals(4), SEEDS)
def test_monotone_in_the_interval(p: Formula, ends: tuple[int, int], seed: int) -> None:
    a, b = ends
    batch = traces(horizon(p) + b + 2, seed, (10,))
    wider = Always(a, b + 1, p), Eventually(a, b + 1, p)
    narrow = Always(a, b, p), Eventually(a, b, p)
    assert np.all(robustness(wider[0], batch, NAMES) <= robustness(narrow[0], batch, NAMES))
    assert np.all(robustness(wider[1], batch, NAMES) >= robustness(narrow[1], batch, NAMES))
