"""What satisfies the terms of a plan satisfies the formula, at all times that keep the rows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from helpers.schedule_checks import (
    NAMES,
    PREDICATES,
    all_traces,
    all_values,
    checked,
    drawn_values,
    parsed,
    random_formula,
    shown,
)

from stlbench import stl
from stlbench.contract import Array, Truth
from stlbench.schedules.plan import conjunction, plans


def test_random_formulas() -> None:
    found = [checked(seed) for seed in range(400)]
    assert [each.counterexample for each in found if each.counterexample] == []
    assert sum(each.traces > 0 for each in found) > 300
    assert sum(each.traces for each in found) > 3000


every_trace = lru_cache(maxsize=None)(all_traces)


@pytest.mark.parametrize(("signals", "steps"), [(1, 10), (2, 5), (3, 3)])
def test_small_formulas_on_every_trace(signals: int, steps: int) -> None:
    """Nothing is left to chance but formulas and times."""
    names, traces, compared = NAMES[:signals], every_trace(signals, steps), 0
    for seed in range(200):
        generator = np.random.default_rng([seed, signals])
        formula = random_formula(generator, 3, 2 if steps < 8 else 3, PREDICATES[:signals])
        if stl.horizon(formula) >= steps:
            continue
        verdicts = stl.satisfied(formula, traces, names)
        for plan in plans(formula, steps - 1)[:12]:
            values = drawn_values(plan, generator, steps - 1)
            if values is None:
                continue
            terms = plan.terms(values)
            own = stl.satisfied(conjunction(terms), traces, names) if terms else np.ones(len(traces), dtype=bool)
            assert not (own & ~verdicts).any(), f"{formula}: {shown(terms)}"
            compared += 1
    assert compared > 200


def satisfied_by_some_schedule(formula: stl.Formula, last: int, traces: Array) -> Truth:
    """Which traces (n, last + 1, 2) satisfy the terms of any alternative with any of its times."""
    covered = np.zeros(len(traces), dtype=bool)
    for plan in plans(formula, last):
        for terms in {plan.terms(values) for values in all_values(plan, last)}:
            covered |= stl.satisfied(conjunction(terms), traces, NAMES[:2])
    return covered


@pytest.mark.parametrize(
    ("text", "last"),
    [
        ("F[1,3] p", 4),
        ("F[0,2] G[1,2] p & G[0,2] (p -> q)", 4),
        ("F[0,2] (p & F[1,2] q)", 4),
        ("F[0,2] (p & G[1,2] q)", 4),
        ("F[0,1] (G[0,1] p & F[1,2] q)", 4),
        ("F[0,1] (F[0,1] p & F[1,2] q)", 4),
        ("F[0,2] p -> G[1,3] q", 4),
        ("F[0,2] p <-> G[1,3] q", 4),
        ("F[0,2] p xor G[1,3] q", 4),
        ("p U[1,3] q", 4),
        ("p U[1,2] F[0,1] q", 4),
        ("p R[1,3] q", 4),
        ("p W[1,3] q", 4),
        ("!(p U[0,3] q)", 4),
        ("G[0,2] F[0,2] p", 4),
        ("G[0,3] F[0,1] p", 4),
        ("G[0,2] (p or F[1,1] q)", 4),
        ("G[0,2] (p -> F[0,2] q)", 4),
        ("F[1,3] (p & O[0,2] q)", 4),
        ("F[1,3] (p & O q)", 4),
        ("F[1,3] (p & H[0,2] q)", 4),
        ("F[1,3] (p S[0,2] q)", 4),
        ("F[2,3] !(p S[1,2] q)", 4),
        ("G[2,3] !(p S q)", 4),
        ("G[1,4] O[0,1] p", 4),
        ("F[0,2] G[0,1] F[0,1] p", 4),
        ("G[0,2] (F[0,1] p or F[1,2] q)", 4),
        ("F[1,3] O[1,2] G[1,2] p", 5),
    ],
)
def test_every_trace_that_satisfies_a_formula_satisfies_a_schedule(text: str, last: int) -> None:
    """These are the formulas of which no alternative is left out."""
    formula, names, traces = parsed(text), NAMES[:2], every_trace(2, last + 1)
    covered = satisfied_by_some_schedule(formula, last, traces)
    assert np.array_equal(covered, stl.satisfied(formula, traces, names))


@pytest.mark.parametrize(
    ("text", "last"),
    [
        ("G[1,2] (p U[0,2] q)", 4),
        ("G[1,3] (p S[0,1] q)", 3),
        ("G[2,3] (p S q)", 4),
        ("F[0,2] G[0,2] (p or F[0,1] q)", 5),
    ],
)
def test_more_traces_satisfy_a_formula_than_its_schedules(text: str, last: int) -> None:
    """Some alternatives are left out of these, for they are too many."""
    formula, names, traces = parsed(text), NAMES[:2], every_trace(2, last + 1)
    covered = satisfied_by_some_schedule(formula, last, traces)
    verdicts = stl.satisfied(formula, traces, names)
    assert not (covered & ~verdicts).any()
    assert covered.any()
    assert not covered[verdicts].all()
