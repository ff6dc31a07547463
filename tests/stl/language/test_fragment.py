"""The funnel fragment: terms of what is inside, reasons for what is not."""

from __future__ import annotations

import pytest

from stlbench.stl import And, Eventually, FragmentError, Not, Term, TrueFormula, fragment, parse

P, Q = parse("x >= 0"), parse("norm(x, y) <= 1 | !y < 2")


def test_the_pendulum_formula() -> None:
    text = "G[400,700] x >= 0 & G[1000,1200] (norm(x, y) <= 1 | !y < 2) & F[1300,1500] G[0,500] x >= 0"
    assert fragment(parse(text)) == (
        Term("G", 400, 700, 0, 0, P),
        Term("G", 1000, 1200, 0, 0, Q),
        Term("FG", 1300, 500, 1500, 0, P),
    )


@pytest.mark.parametrize(
    ("text", "start", "end"), [("F[3,9] x >= 0", 3, 9), ("G[0,200] x >= 0", 0, 200), ("F[1,4] G[2,10] x >= 0", 3, 14)]
)
def test_start_and_end_are_when_psi_is_observed(text: str, start: int, end: int) -> None:
    (term,) = fragment(parse(text))
    assert (term.start, term.end) == (start, end)
    assert term.formula == parse(text)


def test_nested_conjunctions_are_flattened() -> None:
    terms = fragment(parse("(F[0,1] x >= 0 & G[0,2] x >= 0) & (G[1,1] x >= 0 & F[0,3] x >= 0)"))
    assert [(term.kind, term.b) for term in terms] == [("F", 1), ("G", 2), ("G", 1), ("F", 3)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x >= 0     U[0,3] y >= 1", "until at column 12 is not in the funnel fragment: allowed is a conjunction of F"),
        ("F[0,3] (x >= 0 U[0,3] y >= 1)", "until at column 16 .*allowed is"),
        ("F[0,3] x >= 0 | G[0,3] y >= 1", "disjunction of temporal formulas at column 15 .*may stand inside psi"),
        ("F[0,3] x >= 0 -> G[0,3] y >= 1", "implication of temporal formulas at column 15"),
        ("F[0,3] x >= 0 & !G[0,3] y >= 1", "negation of a temporal formula at column 17 .*push it inwards"),
        ("x >= 0 & F[0,3] y >= 1", r"a formula without F or G at column 1 .*write G\[0,0\] \(x >= 0\)"),
        ("True", "a formula without F or G at column 1 "),
        ("G[0,9] F[0,3] x >= 0", "F inside G at column 8 .*no single deadline"),
        ("G[0,9] G[0,3] x >= 0", r"G inside G at column 8 .*G\[a\+c,b\+d\] p"),
        ("F[0,9] F[0,3] x >= 0", r"F inside F at column 8 .*F\[a\+c,b\+d\] p"),
        ("F[0,9] G[0,3] F[0,1] x >= 0", "F inside G at column 15"),
        ("F[0,9] G[0,3] G[0,1] x >= 0", "G inside G at column 15"),
        ("G[0,9] (F[0,1] x >= 0 & y >= 1)", "conjunction of temporal formulas inside G at column 23 .*one by one"),
        ("F[0,9] (G[0,1] x >= 0 & y >= 1)", "conjunction of temporal formulas inside F at column 23 .*allowed is"),
        ("F[0,1] x >= 0 &\n  x >= 0 U[0,3] y >= 1", "until at line 2, column 10"),
    ],
)
def test_outside_says_where_and_why(text: str, message: str) -> None:
    with pytest.raises(FragmentError, match=message) as caught:
        fragment(parse(text))
    assert str(caught.value).endswith(caught.value.reason)
    assert caught.value.position is not None


def test_formulas_built_by_hand_have_no_position() -> None:
    with pytest.raises(FragmentError, match=r"^negation of a temporal formula is not in the funnel fragment") as caught:
        fragment(And((Eventually(0, 1, P), Not(Eventually(0, 1, TrueFormula())))))
    assert caught.value.position is None
