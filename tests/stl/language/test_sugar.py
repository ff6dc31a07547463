"""Operators that are written with others: what they parse to, against their definitions, and their laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import LIPSCHITZ, NAMES, PREDICATES, SEEDS, formulas, intervals, naive, traces
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench.stl import (
    END,
    And,
    Formula,
    Implies,
    Not,
    Number,
    Or,
    Predicate,
    Release,
    Signal,
    TrueFormula,
    horizon,
    iff,
    is_temporal,
    parse,
    resolve_end,
    robustness,
    robustness_trace,
    satisfied,
    signals,
    weak_until,
    xor,
)

P, Q, R = (Predicate(">=", Signal(name), Number(0)) for name in "pqr")
LETTERS = st.builds(
    Predicate,
    st.sampled_from(["<=", ">"]),
    st.sampled_from([Signal(name) for name in ("G", "F", "U", "R", "W", "release", "weak_until")]),
    st.sampled_from([Number(1), Signal("G"), Signal("U")]),
)


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        ("p >= 0 <-> q >= 0", iff(P, Q)),
        ("p >= 0 iff q >= 0", iff(P, Q)),
        ("p >= 0 xor q >= 0", xor(P, Q)),
        ("p >= 0 R[1,3] q >= 0", Release(1, 3, P, Q)),
        ("p >= 0 release [1,3] q >= 0", Release(1, 3, P, Q)),
        ("p >= 0 W[1,3] q >= 0", weak_until(1, 3, P, Q)),
        ("p >= 0 weak_until q >= 0", weak_until(0, END, P, Q)),
        ("p >= 0 R q >= 0", Release(0, END, P, Q)),
        ("p >= 0 <-> q >= 0 -> r >= 0", iff(P, Implies(Q, R))),
        ("p >= 0 -> q >= 0 xor r >= 0", Implies(P, xor(Q, R))),
        ("p >= 0 xor q >= 0 | r >= 0", xor(P, Or((Q, R)))),
        ("p >= 0 xor q >= 0 xor r >= 0", xor(xor(P, Q), R)),
        ("p >= 0 <-> q >= 0 <-> r >= 0", iff(P, iff(Q, R))),
        ("p >= 0 & q >= 0 W[0,1] r >= 0", And((P, weak_until(0, 1, Q, R)))),
        ("p >= 0 R[0,1] q >= 0 W[0,1] r >= 0", Release(0, 1, P, weak_until(0, 1, Q, R))),
    ],
)
def test_what_is_written(text: str, formula: Formula) -> None:
    assert parse(text) == formula
    assert parse(str(formula)) == formula


@pytest.mark.parametrize(
    ("typed", "longer"),
    [
        ("p >= 0 <-> q >= 0", "(p >= 0 -> q >= 0) & (q >= 0 -> p >= 0)"),
        ("p >= 0 xor q >= 0", "(p >= 0 | q >= 0) & !(p >= 0 & q >= 0)"),
        ("p >= 0 W[1,2] q >= 0", "p >= 0 U[1,2] q >= 0 | G[0,2] p >= 0"),
        ("p >= 0 W q >= 0", "p >= 0 U q >= 0 | G p >= 0"),
        ("(p >= 0 <-> q >= 0) & r >= 0", "(p >= 0 -> q >= 0) & (q >= 0 -> p >= 0) & r >= 0"),
        ("r >= 0 | p >= 0 W q >= 0", "r >= 0 | p >= 0 U q >= 0 | G p >= 0"),
        ("!(p >= 0 xor (q >= 0 xor r >= 0)) -> p >= 0 W q >= 0 W r >= 0", None),
        ("(p >= 0 <-> q >= 0) <-> p >= 0 -> q >= 0 <-> r >= 0", None),
    ],
)
def test_prints_as_typed_and_is_the_longer_form(typed: str, longer: str | None) -> None:
    formula = parse(typed)
    assert parse(str(formula)) == formula
    assert str(formula) == typed
    if longer:
        assert formula == parse(longer)
        assert str(parse(longer)) == longer
        assert str(resolve_end(formula, 9)) == str(resolve_end(parse(longer), 9))


def test_letters_and_words_may_name_signals() -> None:
    names = ("G", "F", "U", "R", "W", "release", "weak_until")
    text = "G R W release weak_until"  # G of "R weakly until weak_until"?  no: signals need comparisons
    with pytest.raises(ValueError, match="comparison"):
        parse(text)
    formula = parse("U <= G R G >= F U U >= R W W >= release release release >= weak_until")
    assert set(signals(formula)) == set(names)
    assert parse("G G >= 1") == parse("always (G >= 1)")
    assert parse("G - 1 >= 0") == Predicate(">=", parse("G - 1 >= 0").left, Number(0))  # type: ignore[union-attr]
    assert not is_temporal(parse("G -x <= 1"))
    assert is_temporal(parse("always -x <= 1"))


@given(formulas(st.one_of(LETTERS, PREDICATES), leaves=10, endless=True))
def test_text_parses_back_to_the_same_value(formula: Formula) -> None:
    again = parse(str(formula))
    assert again == formula
    assert (hash(again), str(again)) == (hash(formula), str(formula))


def rho(formula: Formula, trace: NDArray[np.float64]) -> float:
    return robustness(formula, trace, NAMES, "clip").item()


@given(formulas(LIPSCHITZ, 3, 3), formulas(LIPSCHITZ, 3, 3), intervals(4), SEEDS)
def test_the_definitions(p: Formula, q: Formula, ends: tuple[int, int], seed: int) -> None:
    trace, (a, b) = traces(7, seed), ends
    at = [(naive(p, trace, t), naive(q, trace, t)) for t in range(7)]
    (left, right), window = at[0], range(a, min(b, 6) + 1)
    assert rho(iff(p, q), trace) == min(max(-left, right), max(-right, left))
    assert rho(xor(p, q), trace) == min(max(left, right), max(-left, -right))
    released = [max([at[s][1], *(at[r][0] for r in range(s))]) for s in window]
    assert rho(Release(a, b, p, q), trace) == min(released, default=np.inf)
    reached = [min([at[s][1], *(at[r][0] for r in range(s))]) for s in window]
    throughout = min(at[s][0] for s in range(min(b, 6) + 1))
    assert rho(weak_until(a, b, p, q), trace) == max([throughout, *reached])


LAWS: list[tuple[str, Callable[..., tuple[Formula, Formula]]]] = [
    ("iff commutes", lambda p, q, r, a, b: (iff(p, q), iff(q, p))),
    ("iff is both or none", lambda p, q, r, a, b: (iff(p, q), Or((And((p, q)), And((Not(p), Not(q))))))),
    ("xor commutes", lambda p, q, r, a, b: (xor(p, q), xor(q, p))),
    ("xor is associative", lambda p, q, r, a, b: (xor(xor(p, q), r), xor(p, xor(q, r)))),
    ("xor is not iff", lambda p, q, r, a, b: (xor(p, q), Not(iff(p, q)))),
    ("xor with True negates", lambda p, q, r, a, b: (xor(p, TrueFormula()), Not(p))),
    ("release is dual to until", lambda p, q, r, a, b: (
        Not(Release(a, b, p, q)), parse(f"({Not(p)}) U[{a},{b}] ({Not(q)})")
    )),
    ("False releases G", lambda p, q, r, a, b: (
        Release(a, b, Not(TrueFormula()), q), parse(f"G[{a},{b}] ({q})")
    )),
    ("weak until by release", lambda p, q, r, a, b: (weak_until(0, b, p, q), Release(0, b, q, Or((p, q))))),
    ("until is weak until and F", lambda p, q, r, a, b: (
        parse(f"({p}) U[0,{b}] ({q})"), And((weak_until(0, b, p, q), parse(f"F[0,{b}] ({q})")))
    )),
    ("release by weak until", lambda p, q, r, a, b: (Release(0, b, p, q), weak_until(0, b, q, And((p, q))))),
]  # fmt: skip
FEW = formulas(LIPSCHITZ, 2, 3)


@pytest.mark.parametrize(("name", "law"), LAWS, ids=[name for name, _ in LAWS])
@given(p=FEW, q=FEW, r=FEW, ends=intervals(4), seed=SEEDS)
def test_law(name: str, law: Any, p: Formula, q: Formula, r: Formula, ends: tuple[int, int], seed: int) -> None:
    left, right = law(p, q, r, *ends)
    batch = traces(1 + max(horizon(left), horizon(right)), seed, (10,))
    np.testing.assert_array_equal(robustness(left, batch, NAMES), robustness(right, batch, NAMES))
    np.testing.assert_array_equal(satisfied(left, batch, NAMES), satisfied(right, batch, NAMES))


def test_a_run_by_hand() -> None:
    trace = [[3.0, -1.0], [2.0, -2.0], [-1.0, 4.0], [5.0, -6.0]]
    names = ["p", "q"]
    # min(max(-p, q), max(-q, p))
    assert robustness_trace(parse("p >= 0 <-> q >= 0"), trace, names).tolist() == [-1, -2, -1, -5]
    assert robustness_trace(parse("p >= 0 xor q >= 0"), trace, names).tolist() == [1, 2, 1, 5]
    # t' = 1: max(q, p over 0) = 3; t' = 2: max(4, 3, 2) = 4; t' = 3: max(-6, 3, 2, -1) = 3
    assert robustness(parse("p >= 0 R[1,3] q >= 0"), trace, names) == 3
    # until: t' = 2: min(4, 3, 2) = 2; t' = 0: -1
    assert robustness(parse("p >= 0 W[0,3] q >= 0"), trace, names) == 2
    assert robustness(parse("p >= 0 W[0,1] q >= 0"), trace, names) == 2  # p all the way, at 3 and 2
