"""Formulas in the notations of other tools, and the remedy that the refusal of each names."""
# ruff: noqa: RUF001 - the signs of other languages are what it is about

from __future__ import annotations

import re

import pytest

from stlbench import stl

COMMON = "of several tools"
#: tool -> what a message says, and formulas in the tool's notation of which it says so
NOTATIONS: dict[str, list[tuple[str, ...]]] = {
    "rtamt": [
        ("write always[0,10]", "always[0:10] (x > 0)"),
        ("write eventually[0,10]", "eventually[0:10] (x > 0)"),
        ("write historically[0,10]", "historically[0:10] (x > 0)"),
        ("write once[2,5]", "once[2:5] (x > 0)"),
        ("write until[0,5]", "(x > 0) until[0:5] (y > 0)"),
        ("write since[1,5]", "(x > 0) since[1:5] (y > 0)"),
        ("write W[0,5]", "(x > 0) unless[0,5] (y > 0)"),
        ("write W", "(x > 0) unless (y > 0)"),
        ("write G[0,10]", "G[0:10] (x > 0)"),
        ("write F[0,10]", "F[0:10] (x > 0)"),
        ("write H[0,10]", "H[0:10] (x > 0)"),
        ("write O[0,10]", "O[0:10] (x > 0)"),
        ("write U[0,10]", "(x > 0) U[0:10] (y > 0)"),
        ("write S[0,10]", "(x > 0) S[0:10] (y > 0)"),
        ("write W[0,10]", "(x > 0) W[0:10] (y > 0)"),
        ("write always[0,0.01]; with dt, ends are seconds", "always[0,10ms] (x > 0)"),
        ("write eventually[0,2]; with dt, ends are seconds", "eventually[0:2s] (x > 0)"),
        ("write eventually[0.000001,0.000005]; with dt", "eventually[1us:5us] (x > 0)"),
        ("with dt, ends are seconds", "always[0:10ns] (x > 0)"),
        ("write until[0,0.5]", "(x > 0) until[0:500ms] (y > 0)"),
        ("write eventually[0,5]", "always((x >= 3) implies (eventually[0:5](y >= 3)))"),
        ("write the formula alone, without a name before it", "out = always((x >= 3) implies (y >= 3))"),
        ("write p & O[1,1] !p", "rise(x > 0)"),
        ("write !p & O[1,1] p", "fall(x > 0)"),
        ("write O[1,1]", "prev(x > 0)", "prev (x > 0)", "s_prev (x > 0)", "Y (x > 0)"),
        ("write F[1,1]", "next(x > 0)", "next x > 0", "s_next (x > 0)", "X (x > 0)", "@ topic(x, rtamt)"),
        ("write x ** 2", "pow(x, 2) > 1"),
        ("write log", "ln(x) > 1"),
        ("write log(x) / log(10)", "log(x, 10) > 1"),
        ("abs(x - y) <= tolerance", "always (x !== 3)", "always (x == 3)"),
        ("write True", "always (x > 0 & TRUE)", "TRUE"),
        ("write False", "FALSE or x > 0"),
        ("write always[a,b] with numbers a and b", "always[0:T] (x > 0)", "always[0,T] (x > 0)"),
        ("write always[a,b] with numbers a and b", "always[a:b] (x > 0)"),
        ("a name has letters, digits and _ alone", "x.value > 0"),
        ("without ;", "always (x > 0);"),
        ("without declarations", "input float x", "const float c = 5.0"),
    ],
    "Breach": [
        ("write G", "alw (x[t] > 0)"),
        ("write G[0,10]", "alw_[0,10] (x[t] > 0)", "alw_[0,10] ((x > 0) => (y > 0))"),
        ("write F[0,10]", "ev_[0,10] (x[t] > 0)"),
        ("write F", "ev (x[t] > 0)"),
        ("write x: a signal is read at the step of the formula", "x[t] > 0", "x(t) > 0"),
        ("write x", "G (x[t] > 0)"),
        ("write y", "(x > 0) and (y[t] < 3)"),
        ("write until[0,3]", "(x > 0) until_[0,3] (y > 0)"),
        ("write U[0,3]", "(x > 0) U_[0,3] (y > 0)"),
        ("write H[0,3]", "hist_[0,3] (x > 0)"),
        ("write H", "hist (x > 0)"),
        ("write once[0,3]", "once_[0,3] (x > 0)"),
        ("write always[0,3]", "always_[0,3] (x > 0)"),
        ("write eventually[0,3]", "eventually_[0,3] (x > 0)"),
        ("write G[a,b] with numbers a and b", "alw_[0, t1] (x > 0)", "alw_[t_start, t_end] (x > 0)"),
        ("write G[a,b] with numbers a and b", "alw_[0.1, t1+.1] (x > 0)"),
        ("write F[a,b] with numbers a and b", "ev_[0, 2*tau] (x > 0)"),
        ("write G without an interval", "alw_[0, inf] (x > 0)"),
        ("write G[5,5] G", "alw_[5, inf] (x > 0)"),
        ("write F[5,5] F", "ev_[5, Inf] (x > 0)"),
        ("write the formula alone", "phi := alw (x > 0)", "phi1 := (x > 0) and (y > 0)"),
        ("write -> for implies, >= for at least", "(x > 0) => (y > 0)"),
        ("write ->", "G[0,10] ((x > 0) => (y > 0))"),
        ("a signal alone is no formula: write shift > 0", "not (shift) and ev_[0.01,.02] (x > 0)"),
        ("write O[1,1] before a formula of x", "x[t-1] > 0"),
        ("write F[2,2] before a formula of x", "x[t+2] > 0"),
        ("put the rate into the trace as a signal", "ddt{x}[t] > 0"),
        ("without declarations", "param k=3", "signal x, y"),
        ("a comment begins with #", "% a comment", "x > 0 % positive"),
    ],
    "S-TaLiRo": [
        ("write G", "[] p1", "[](x > 0)", "[]<> (x > 0)", "[ ] (x > 0)"),
        ("write F", "<> (x > 0)", "<>(x > 0)", "< > (x > 0)"),
        ("write G[0,10]", "[]_[0,10] (x > 0)"),
        ("write F[0,10]", "<>_[0,10] (x > 0)"),
        ("write G[0,10]; both ends count", "[]_(0,10) (x > 0)"),
        ("write F[0,5]; both ends count", "<>_(0,5] (x > 0)", "<>_[0,5) (x > 0)"),
        ("write G without an interval", "[]_[0,inf) (x > 0)"),
        ("write F[2,2] F", "<>_[2,inf) (x > 0)"),
        ("write H[0,10]", "[.]_[0,10] (x > 0)"),
        ("write O[0,10]", "<.>_[0,10] (x > 0)"),
        ("write H", "[.] (x > 0)"),
        ("write O", "<.> (x > 0)", "P (x > 0)"),
        ("write &", "(x > 0) /\\ (y > 0)", "!(<>_[0,30] (x > 0) /\\ <>_[0,30] (y > 0))"),
        ("write |", "(x > 0) \\/ (y > 0)"),
        ("write F[0,30]", "!(<>_[0,30] (x > 0) & <>_[0,30] (y > 0))"),
        ("write U[0,1]", "(x > 0) U_[0,1] (y > 0)"),
        ("write R[0,1]", "(x > 0) R_[0,1] (y > 0)"),
        ("write S[0,1]", "(x > 0) S_[0,1] (y > 0)"),
        ("a signal alone is no formula: write p1 > 0", "p1 U p2", "!p1", "G p1"),
        ("write F[1,1]", "N (x > 0)"),
        ("write U[0,1]; both ends count", "(x > 0) U_(0,1) (y > 0)"),
    ],
    "STLCG": [
        ("write G", "Always(subformula=phi, interval=[0,3])"),
        ("write F", "Eventually(x > 0)"),
        ("write F[0,3]", "Eventually[0,3](x > 0)"),
        ("write G[0,3]", "Always[0,3](x > 0)"),
        ("a name has letters, digits and _ alone", "stlcg.Always(x > 0)"),
        ("write U", "Until(x > 0, y > 0)"),
        ("write &", "And(x > 0, y > 0)"),
        ("write |", "Or(x > 0, y > 0)"),
        ("write !", "Not(x > 0)", "(x > 0) & ~(y > 0)", "~(x > 0)"),
        ("write ->", "Implies(x > 0, y > 0)"),
        ("write x < c", "LessThan(lhs='x', val=3)", "LessThan(x, 3)"),
        ("write x > c", "GreaterThan(x, 3)"),
        ("write the comparison", "Expression(x) < 3"),
        ("no quotes", "'x' < 3", '"x" < 3'),
        ("name each component, as x_0", "x[0] > 1"),
    ],
    "FalCAuN": [
        ("write G", "[] (signal(0) < 100)", "alw(x < 3)"),
        ("write the name of the signal", "G (signal(0) < 100)", "signal(0) < 120", "output(1) < 120"),
        ("write the name of the signal", "input(0) < 120"),
        ("write G[0,2]", "alw_[0, 2]((x < 120))"),
        ("write F[0,2]", "ev_[0, 2]((x < 120))"),
        ("write G[0,1]", "G_[0,1] (x < 120)"),
        ("write F[0,1]", "F_[0,1] (x < 120)"),
        ("write R[0,2]", "(x < 3) R_[0,2] (x > 1)"),
        ("a name has letters, digits and _ alone", "$diff < 40"),
        ("write F", "ev x < 3"),
        ("write F[1,1]", "X x < 3", "(X (x < 3)) || (x > 4)"),
    ],
    "reelay": [
        ("write round brackets", "{speed > 20}", "{speed > 20, mode > 1}", "once{speed > 20}"),
        ("write comparisons joined by &", "{lights_on: true}", "{lights_on: true, speed > 20.0}"),
        ("write historically[0,5]", "historically[0:5]{speed > 20}"),
        ("write once[2,4]", "once[2:4]{speed > 20}"),
        ("write O[1,1]", "pre{speed > 20}", "Y (x > 1)", "previously (x > 1)"),
        ("write since[2,4]", "(x > 0) since[2:4] (y > 0)"),
        ("write a comma in an interval", "(x > 0) since[2:] (y > 0)", "H[:5] (x > 0)", 'x > 0 and mode: "on"'),
        ("there are no quantifiers", "forall[r]. (x > 0)", "exists[r]. (x > 0)"),
    ],
    "MoonLight": [
        ("write G", "globally (x > 0)", "globally x > 0", "globally {x > 0}"),
        ("write G[0,5]", "globally [0,5] (x > 0)"),
        ("write eventually[0,5]", "eventually [0 5] (x > 0)"),
        ("write G[a,b] with numbers", "globally [0, T] (x > 0)"),
        ("write ->", "(x > 0) => (y < 1)"),
        ("write <=", "x =< 3"),
        ("write -> for implies, >= for at least", "x => 3"),
        ("write the formula alone", "formula phi = globally (x > 0);", "formula phi(real k) = globally (x > k);"),
        ("no operators of space", "somewhere [0,5] (x > 0)", "everywhere [0,5] (x > 0)", "escape [0,5] (x > 0)"),
        ("no operators of space", "(x > 0) reach [0,5] (y > 0)"),
        ("without declarations", "signal { real x; }", "domain minmax;"),
        ("write norm", "hypot(x, y) < 1"),
        ("a comment begins with #", "/* note */ x > 0", "x % 2 > 0"),
        ("write atan2(x, 1)", "atan(x) > 0"),
        ("abs, sqrt, exp", "floor(x) > 0"),
        ("write eventually without an interval", "eventually[0,inf] (x > 0)"),
    ],
    "py-mtl": [
        ("write !", "~a", "¬(x > 0)"),
        ("a signal alone is no formula: write a > 0", "G a", "(a & b)", "(a U b)"),
        ("write F without an interval", "G(x > 0 -> F[0, inf] y > 0)"),
        ("write F[1,1]", "@(x > 0)", "@ x > 0", "XX x > 0"),
        ("write &", "(x > 0 ∧ y > 0)"),
        ("write |", "(x > 0 ∨ y > 0)"),
        ("write ->", "(x > 0 → y > 0)"),
        ("write <->", "(x > 0 ⇔ y > 0)"),
        ("write xor", "(x > 0 ⊕ y > 0)"),
        ("write False", "FALSE"),
        ("write U without an interval", "(x > 0 U[0, inf] y > 0)"),
        ("write U[2,b] with a last step b", "(x > 0 U[2, inf] y > 0)"),
        ("write F[2,2] before the formula", "(x > 0) >> 2"),
        ("write operators", "a.always()", "(x > 0).eventually()", "a.implies(b)"),
    ],
    COMMON: [
        ("write |", "x > 1 OR y > 1", "x > 1 \\lor y > 1"),
        ("write &", "x > 1 AND y > 1", "x > 1 \\land y > 1", "x > 1 \\wedge y > 1"),
        ("write !", "NOT x > 1", "\\neg x > 1"),
        ("write ->", "x > 1 IMPLIES y > 1", "x > 1 ==> y > 1", "x > 1 \\rightarrow y > 1"),
        ("write <->", "x > 1 IFF y > 1", "x > 1 <=> y > 1"),
        ("write xor", "x > 1 XOR y > 1"),
        ("write q -> p for p <- q", "x > 1 <- y > 1"),
        ("write G without an interval", "G[0,inf] x > 1", "G[0,INF] x > 1", "G[0,∞] x > 1", "G[0,∞) x > 1"),
        ("write G[3,3] G", "G[3,inf] x > 1"),
        ("write H without an interval", "H[0,inf] x > 1"),
        ("write G[0,1]; both ends count", "G(0,1) x > 1"),
        ("write G[0,1]", "G{0,1} x > 1", "G_{[0,1]} x > 1"),
        ("write G[0,5]", "G[0..5] x > 1", "G[0;5] x > 1", "G[0 5] x > 1", "G[5] x > 1", "□_[0,5] x > 1"),
        ("write G[0,5]", "\\square_{[0,5]} x > 1"),
        ("write F[0,5]", "F[<=5] x > 1", "F_{<=5} x > 1", "◊[0,5] x > 1"),
        ("nothing after it", "G[0,1]: x > 1", "G[0,1]. x > 1"),
        ("write G", "GLOBALLY x > 1", "□ x > 1"),
        ("write F[0,2]", "FINALLY[0,2] x > 1", "finally[0,2] x > 1", "EVENTUALLY[0,2] x > 1"),
        ("write G[0,2]", "ALWAYS[0,2] x > 1"),
        ("write U[0,2]", "x > 1 UNTIL[0,2] y > 1"),
        ("write U", "x > 1 Until y > 1"),
        ("write S[0,2]", "x > 1 Since[0,2] y > 1"),
        ("write R", "x > 1 Release y > 1"),
        ("write O[0,2]", "Once[0,2] x > 1"),
        ("write H", "Historically x > 1"),
        ("write F", "◇ x > 1", "\\Diamond x > 1"),
        ("write U[0,5]", "x > 1 \\mathcal{U}_{[0,5]} y > 1"),
        ("write <=", "x \\leq 1", "x ≤ 1"),
        ("write >=", "x \\geq 1", "x ≥ 1"),
        ("write x ** 2", "x² > 1"),
        ("write x ** 3", "x³ > 1"),
        ("write *", "x × y > 1", "x · y > 1"),
        ("write /", "x ÷ y > 1"),
        ("write -", "x > −1"),
        ("write sqrt(x)", "√x > 1"),
        ("write pi", "x > \\pi"),
        ("write 2 * x", "2x > 1", "2 x > 1"),
        ("write abs(x)", "|x| < 1"),
        ("write abs(x - y)", "|x - y| < 1"),
        ("write norm(x)", "||x|| < 1"),
        ("write abs", "Abs(x) < 1", "fabs(x) < 1"),
        ("write log(x) / log(10)", "log10(x) < 1"),
        ("abs, sqrt, exp", "mod(x, 2) < 1"),
        ("write 0 <= x <= 1", "x in [0, 1]", "x ∈ [0, 1]"),
        ("write (c -> p) & (!c -> q)", "if x > 1 then y > 1", "x > 1 ? y > 1 : y < 1"),
        ("there are no quantifiers", "∀ x > 1"),
        ("put the rate into the trace", "x' > 1"),
        ("without ;", "x > 1; y > 1"),
        ("a comment begins with #", "x > 1 // note"),
        ("a name has letters, digits and _ alone", "/robot/x > 1", "robot.x > 1"),
        ("write 10: numbers have no unit", "x > 10ms"),
        ("write 5: numbers have no unit", "x > 5 m"),
        ("write 30: numbers have no unit", "x > 30 deg"),
        ("write True", "⊤"),
        ("write False", "⊥"),
        ("without a name before it", "name: G x > 1"),
        ("no quotes", "`x` > 1"),
        ("a signal needs another name than and", "and <= 1"),
        ("a signal needs another name than not", "x + not > 1"),
    ],
}
ALL = [(tool, text, said) for tool, table in NOTATIONS.items() for said, *texts in table for text in texts]


def test_there_are_many() -> None:
    assert len(ALL) >= 200
    assert all(sum(tool == of for of, *_ in ALL) >= 15 for tool in NOTATIONS)


@pytest.mark.parametrize(("text", "said"), [(text, said) for _, text, said in ALL])
def test_the_remedy_of_a_foreign_notation_is_named_and_its_operator_is_one_of_ours(text: str, said: str) -> None:
    with pytest.raises(stl.StlSyntaxError) as caught:
        stl.parse(text)
    first, remedy = str(caught.value).splitlines()[0], caught.value.remedy
    assert said in first
    assert remedy is None or first.endswith(f"; {remedy}")
    for operator in re.findall(r"write ([a-zA-Z_]+(?:\[[\d.,]+\])?(?: [GFHO])?)(?:;| without|$)", remedy or ""):
        if re.match(r"[GFHO]\b|always|eventually|historically|once", operator):
            stl.parse(f"{operator} x > 1", 1e-9)
        elif re.match(r"[URSW]\b|until|since", operator):
            stl.parse(f"x > 1 {operator} y > 1", 1e-9)


def test_what_parses_is_never_looked_through() -> None:
    for text in ("F <= 10 & G > 1", "O >= P", "X - 1 > next", "ev > alw | x > once", "globally <= finally", "pre < Y"):
        assert not stl.is_temporal(stl.parse(text))


@pytest.mark.parametrize(
    "text",
    [
        "G[0,1e99999999ms] x > 1",
        "G[0:1e99999999999999999999] x > 1",
        "G[0," + "9" * 5000 + "ms] x > 1",
        "G[-1:2] x > 1",
        "(" * 3000 + "|" * 3000,
        "x[t" * 5000,
        "x." * 50_000,
        "0 " * 5000 + "'",
    ],
    ids=lambda text: text[:20],
)
def test_hostile_text_costs_little(text: str) -> None:
    with pytest.raises(stl.StlSyntaxError) as caught:
        stl.parse(text)
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize(
    "text", ["x > 0 and and y > 0", "G[0,5] x > 0 iff", "F[0,5] x > 0 U", "x > 0 | | y > 0", "x > 0 || || y > 0"]
)
def test_an_operator_without_an_operand_has_no_remedy(text: str) -> None:
    with pytest.raises(stl.StlSyntaxError) as caught:
        stl.parse(text)
    assert caught.value.remedy is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x <> 0", "there is no equality"),
        ("(x + 1) <> 0", "there is no equality"),
        ("x > 0 and <> y > 0", "write F"),
        ("G <> x > 0", "write F"),
        ("2F > 0", "write 2 * F"),
    ],
)
def test_signs_are_read_by_what_stands_before_them(text: str, said: str) -> None:
    with pytest.raises(stl.StlSyntaxError) as caught:
        stl.parse(text)
    assert str(caught.value.remedy).startswith(said)
