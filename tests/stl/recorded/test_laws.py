"""The laws of robustness and satisfaction."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, SEEDS, formulas, intervals, traces
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl

FEW = formulas(LIPSCHITZ, 3, 3)
#: two formulas of the parts p, q, r and the interval a..b that say the same; a1 is a + 1, and so on
LAWS = [
    ("!!{p}", "{p}"),
    ("F[{a},{b}] {p}", "!G[{a},{b}] !{p}"),
    ("G[{a},{b}] {p}", "!F[{a},{b}] !{p}"),
    ("!({p} & {q})", "!{p} | !{q}"),
    ("!({p} | {q})", "!{p} & !{q}"),
    ("{p} -> {q}", "!{p} | {q}"),
    ("G[{a},{b}] ({p} & {q})", "G[{a},{b}] {p} & G[{a},{b}] {q}"),
    ("F[{a},{b}] ({p} | {q})", "F[{a},{b}] {p} | F[{a},{b}] {q}"),
    ("F[{a},{b}] {p}", "True U[{a},{b}] {p}"),
    ("G[{a},{b}] G[1,3] {p}", "G[{a1},{b3}] {p}"),
    ("{p} U[0,{b}] {q}", "{q} | {p} & {p} U[0,{b}] {q}"),
    ("{p} U[{a1},{b1}] {q}", "G[0,{a}] {p} & F[{a1},{a1}] ({p} U[0,{width}] {q})"),
    # Donze et al. 2013
    ("{p} U[{a1},{b1}] {q}", "F[{a1},{b1}] {q} & G[0,{a}] {p} & F[{a1},{a1}] ({p} U[0,40] {q})"),
    ("{p} <-> {q}", "{q} <-> {p}"),
    ("{p} <-> {q}", "{p} & {q} | !{p} & !{q}"),
    ("{p} xor {q}", "{q} xor {p}"),
    ("({p} xor {q}) xor {r}", "{p} xor ({q} xor {r})"),
    ("{p} xor {q}", "!({p} <-> {q})"),
    ("{p} xor True", "!{p}"),
    ("!({p} R[{a},{b}] {q})", "!{p} U[{a},{b}] !{q}"),
    ("False R[{a},{b}] {q}", "G[{a},{b}] {q}"),
    ("{p} W[0,{b}] {q}", "{q} R[0,{b}] ({p} | {q})"),
    ("{p} U[0,{b}] {q}", "({p} W[0,{b}] {q}) & F[0,{b}] {q}"),
    ("{p} R[0,{b}] {q}", "{q} W[0,{b}] ({p} & {q})"),
]


@pytest.mark.parametrize("law", LAWS, ids=" is ".join)
@given(parts=st.tuples(FEW, FEW, FEW), ends=intervals(4), seed=SEEDS)
def test_law(law: tuple[str, str], parts: tuple[stl.Formula, ...], ends: tuple[int, int], seed: int) -> None:
    a, b = ends
    named = {name: f"({part})" for name, part in zip("pqr", parts, strict=True)}
    numbers = {"a": a, "b": b, "a1": a + 1, "b1": b + 1, "b3": b + 3, "width": b - a}
    left, right = (stl.parse(text.format(**named, **numbers)) for text in law)
    batch = traces(1 + max(stl.horizon(left), stl.horizon(right)), seed, (10,))
    np.testing.assert_array_equal(stl.robustness(left, batch, NAMES), stl.robustness(right, batch, NAMES))
    np.testing.assert_array_equal(stl.satisfied(left, batch, NAMES), stl.satisfied(right, batch, NAMES))


@given(formulas(LIPSCHITZ), SEEDS, st.floats(0, 2))
def test_robustness_is_1_lipschitz(formula: stl.Formula, seed: int, size: float) -> None:
    batch = traces(stl.horizon(formula) + 1, seed, (20,))
    noise = np.random.default_rng(seed).uniform(-size, size, batch.shape)
    before, after = stl.robustness(formula, batch, NAMES), stl.robustness(formula, batch + noise, NAMES)
    finite = np.isfinite(before)
    assert np.array_equal(before[~finite], after[~finite])
    assert np.all(np.abs(before[finite] - after[finite]) <= size + 1e-9)


@given(formulas(LIPSCHITZ), intervals(4), SEEDS)
def test_monotone_in_the_interval(p: stl.Formula, ends: tuple[int, int], seed: int) -> None:
    a, b = ends
    batch = traces(stl.horizon(p) + b + 2, seed, (10,))
    wider = stl.Always(a, b + 1, p), stl.Eventually(a, b + 1, p)
    narrow = stl.Always(a, b, p), stl.Eventually(a, b, p)
    assert np.all(stl.robustness(wider[0], batch, NAMES) <= stl.robustness(narrow[0], batch, NAMES))
    assert np.all(stl.robustness(wider[1], batch, NAMES) >= stl.robustness(narrow[1], batch, NAMES))
