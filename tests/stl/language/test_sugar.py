"""Operators that are written with others: what they parse to, against their definitions, and their laws."""

from __future__ import annotations

import pytest
from helpers.generated_formulas import PREDICATES, formulas
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl

P, Q, R = (stl.Predicate(">=", stl.Signal(name), stl.Number(0)) for name in "pqr")
LETTERS = st.builds(
    stl.Predicate,
    st.sampled_from(["<=", ">"]),
    st.sampled_from([stl.Signal(name) for name in ("G", "F", "U", "R", "W", "release", "weak_until")]),
    st.sampled_from([stl.Number(1), stl.Signal("G"), stl.Signal("U")]),
)


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        ("p >= 0 <-> q >= 0", stl.iff(P, Q)),
        ("p >= 0 iff q >= 0", stl.iff(P, Q)),
        ("p >= 0 xor q >= 0", stl.xor(P, Q)),
        ("p >= 0 R[1,3] q >= 0", stl.Release(1, 3, P, Q)),
        ("p >= 0 release [1,3] q >= 0", stl.Release(1, 3, P, Q)),
        ("p >= 0 W[1,3] q >= 0", stl.weak_until(1, 3, P, Q)),
        ("p >= 0 weak_until q >= 0", stl.weak_until(0, stl.END, P, Q)),
        ("p >= 0 R q >= 0", stl.Release(0, stl.END, P, Q)),
        ("p >= 0 <-> q >= 0 -> r >= 0", stl.iff(P, stl.Implies(Q, R))),
        ("p >= 0 -> q >= 0 xor r >= 0", stl.Implies(P, stl.xor(Q, R))),
        ("p >= 0 xor q >= 0 | r >= 0", stl.xor(P, stl.Or((Q, R)))),
        ("p >= 0 xor q >= 0 xor r >= 0", stl.xor(stl.xor(P, Q), R)),
        ("p >= 0 <-> q >= 0 <-> r >= 0", stl.iff(P, stl.iff(Q, R))),
        ("p >= 0 & q >= 0 W[0,1] r >= 0", stl.And((P, stl.weak_until(0, 1, Q, R)))),
        ("p >= 0 R[0,1] q >= 0 W[0,1] r >= 0", stl.Release(0, 1, P, stl.weak_until(0, 1, Q, R))),
    ],
)
def test_what_is_written(text: str, formula: stl.Formula) -> None:
    assert stl.parse(text) == formula
    assert stl.parse(str(formula)) == formula


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
    formula = stl.parse(typed)
    assert stl.parse(str(formula)) == formula
    assert str(formula) == typed
    if longer:
        assert formula == stl.parse(longer)
        assert str(stl.parse(longer)) == longer
        assert str(stl.resolve_end(formula, 9)) == str(stl.resolve_end(stl.parse(longer), 9))


def test_letters_and_words_may_name_signals() -> None:
    names = ("G", "F", "U", "R", "W", "release", "weak_until")
    text = "G R W release weak_until"  # G of "R weakly until weak_until"?  no: signals need comparisons
    with pytest.raises(ValueError, match="comparison"):
        stl.parse(text)
    formula = stl.parse("U <= G R G >= F U U >= R W W >= release release release >= weak_until")
    assert set(stl.signals(formula)) == set(names)
    assert stl.parse("G G >= 1") == stl.parse("always (G >= 1)")
    assert stl.parse("G - 1 >= 0") == stl.Predicate(">=", stl.parse("G - 1 >= 0").left, stl.Number(0))  # type: ignore[union-attr]
    assert not stl.is_temporal(stl.parse("G -x <= 1"))
    assert stl.is_temporal(stl.parse("always -x <= 1"))


@given(formulas(st.one_of(LETTERS, PREDICATES), leaves=10, endless=True))
def test_text_parses_back_to_the_same_value(formula: stl.Formula) -> None:
    again = stl.parse(str(formula))
    assert again == formula
    assert (hash(again), str(again)) == (hash(formula), str(formula))


def test_a_run_by_hand() -> None:
    trace = [[3.0, -1.0], [2.0, -2.0], [-1.0, 4.0], [5.0, -6.0]]
    names = ["p", "q"]
    # min(max(-p, q), max(-q, p))
    assert stl.robustness_trace(stl.parse("p >= 0 <-> q >= 0"), trace, names).tolist() == [-1, -2, -1, -5]
    assert stl.robustness_trace(stl.parse("p >= 0 xor q >= 0"), trace, names).tolist() == [1, 2, 1, 5]
    # t' = 1: max(q, p over 0) = 3; t' = 2: max(4, 3, 2) = 4; t' = 3: max(-6, 3, 2, -1) = 3
    assert stl.robustness(stl.parse("p >= 0 R[1,3] q >= 0"), trace, names) == 3
    # until: t' = 2: min(4, 3, 2) = 2; t' = 0: -1
    assert stl.robustness(stl.parse("p >= 0 W[0,3] q >= 0"), trace, names) == 2
    assert stl.robustness(stl.parse("p >= 0 W[0,1] q >= 0"), trace, names) == 2  # p all the way, at 3 and 2
