"""Text to values, and errors that point at the place."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stlbench import stl

P, Q, R = (stl.Predicate(">=", stl.Signal(name), stl.Number(0)) for name in "pqr")


def test_spellings() -> None:
    short = stl.parse("G[0,1] !p >= 0 & (F[1,2] q >= 0 | p >= 0 U[0,3] r >= 0) -> True")
    long = stl.parse("always[0,1] not p >= 0 and (eventually [1,2] q >= 0 || p >= 0 until[0,3] r >= 0)\n  implies true")
    assert short == long
    assert short == stl.Implies(
        stl.And((stl.Always(0, 1, stl.Not(P)), stl.Or((stl.Eventually(1, 2, Q), stl.Until(0, 3, P, R))))),
        stl.TrueFormula(),
    )


@pytest.mark.parametrize(
    ("text", "grouped"),
    [
        ("!p >= 0 & q >= 0", "(!(p >= 0)) & (q >= 0)"),
        ("G[0,1] p >= 0 & q >= 0", "(G[0,1] (p >= 0)) & (q >= 0)"),
        ("!p >= 0 U[0,1] q >= 0", "(!(p >= 0)) U[0,1] (q >= 0)"),
        ("p >= 0 & q >= 0 U[0,1] r >= 0", "(p >= 0) & ((q >= 0) U[0,1] (r >= 0))"),
        ("p >= 0 | q >= 0 & r >= 0", "(p >= 0) | ((q >= 0) & (r >= 0))"),
        ("p >= 0 -> q >= 0 -> r >= 0", "(p >= 0) -> ((q >= 0) -> (r >= 0))"),
        ("p >= 0 U[0,1] q >= 0 U[0,1] r >= 0", "(p >= 0) U[0,1] ((q >= 0) U[0,1] (r >= 0))"),
        ("p - q - r >= 0", "((p - q) - r) >= 0"),
        ("p / q * r >= 0", "((p / q) * r) >= 0"),
        ("-p ** 2 >= 0", "(-(p ** 2)) >= 0"),
        ("-p * q >= 0", "((-p) * q) >= 0"),
        ("p + q * r ^ 2 >= 0", "(p + (q * (r ** 2))) >= 0"),
        ("0 <= p < q", "(0 <= p) & (p < q)"),
        ("G[0,1] 0 <= p <= 1", "G[0,1] ((0 <= p) & (p <= 1))"),
        ("1 > x >= 0 > y", "1 > x & x >= 0 & 0 > y"),
        ("x <-1", "x < -1"),
        ("+x > +1 & y <= 2 - +3 * +y", "x > 1 & y <= 2 - 3 * y"),
        ("G[0,1] +x > -+-1", "G[0,1] x > --1"),
        ("G[0e-99,0.0] x >= 1", "G[0,0] x >= 1"),
    ],
)
def test_what_is_read_alike(text: str, grouped: str) -> None:
    assert stl.parse(text) == stl.parse(grouped)


def test_letters_are_operators_only_before_a_bracket() -> None:
    assert stl.parse("G[0,1] F >= U") == stl.Always(0, 1, stl.Predicate(">=", stl.Signal("F"), stl.Signal("U")))


def test_constants() -> None:
    assert stl.parse("x >= pi") == stl.Predicate(">=", stl.Signal("x"), stl.Number(math.pi))
    assert stl.parse("x >= .5e1") == stl.Predicate(">=", stl.Signal("x"), stl.Number(5))
    assert stl.parse("False") == stl.Not(stl.TrueFormula())


def test_comments_and_line_breaks() -> None:
    text = "# both\nG[0,1] x > 1 # up\n  &   # and\n\n  y < 2#down\n#\n"
    assert stl.parse(text) == stl.parse("G[0,1] x > 1 & y < 2")
    with pytest.raises(stl.StlSyntaxError, match="line 2, column 11: expected a comparison"):
        stl.parse("x > 1 & # see below\n  y # >= 1")
    with pytest.raises(stl.StlSyntaxError, match="found the end of the formula"):
        stl.parse("# x > 1")


def test_seconds_become_steps() -> None:
    assert stl.parse("F[0.3,2] x >= 1", dt=0.1) == stl.parse("F[3,20] x >= 1")
    assert stl.parse("F[0.3,2] x >= 1", dt=np.float64(0.1)) == stl.parse("F[3,20] x >= 1")
    assert stl.parse("G[4, 7] x >= 1", dt=0.01) == stl.parse("G[400,700] x >= 1")
    said = "whole number of steps of dt=0.1 seconds but found 1.25 seconds = 12.5 steps"
    with pytest.raises(stl.StlSyntaxError, match=said):
        stl.parse("G[0.5,1.25] x >= 1", dt=0.1)
    with pytest.raises(ValueError, match="dt"):
        stl.parse("G[0,1] x >= 1", dt=0.0)


@pytest.mark.parametrize(
    ("text", "dt", "found"),
    [
        ("G[0,1000000.4] x >= 1", None, "'1000000.4'"),
        (f"G[0,1.{'0' * 40}1] x >= 1", None, f"'1.{'0' * 40}1'"),
        ("G[0,1e-9999999] x >= 1", None, "'1e-9999999'"),
        ("G[0,1000000.4] x >= 1", 1.0, "1000000.4 seconds = 1000000.4 steps"),
        ("G[0,1000000.00001] x >= 1", 1.0, "1000000.00001 seconds = 1000000.00001 steps"),
        ("G[0,100000.04] x >= 1", 0.1, "100000.04 seconds = 1000000.4 steps"),
        ("G[0,9007199254740991.4] x >= 1", None, "'9007199254740991.4'"),
        ("G[0,0.5] x >= 1", None, "'0.5'"),
    ],
)
def test_interval_ends_are_never_rounded(text: str, dt: float | None, found: str) -> None:
    with pytest.raises(stl.StlSyntaxError, match="expected a whole number of steps") as caught:
        stl.parse(text, dt=dt)
    assert f"but found {found}" in str(caught.value)


def test_intervals_of_hardly_any_length() -> None:
    for text in ("G[0,1e-300] x >= 1", "G[0,1e-99999] x >= 1", "G[0,1e-99999999999999999999] x >= 1"):
        with pytest.raises(stl.StlSyntaxError, match=r"a whole number of steps|at least 1e-300"):
            stl.parse(text)


def test_intervals_of_many_steps() -> None:
    assert stl.parse("G[0,1000000.4] x >= 1", dt=0.1) == stl.parse("G[0,10000004] x >= 1")
    assert stl.parse("G[0,1e6] x >= 1", dt=1 / 30) == stl.parse("G[0,30000000] x >= 1")
    with pytest.raises(stl.StlSyntaxError, match="an interval end of at most 9007199254740992 steps"):
        stl.parse("G[0,1e16] x >= 1")


@pytest.mark.parametrize(
    ("text", "line", "column", "expected", "found"),
    [
        ("G(0,1) x > 0", 1, 4, "')' (an interval has square brackets, as in G[0,1])", "','"),
        ("x > 0 U(0,1) y > 0", 1, 10, "square brackets", "','"),
        ("x", 1, 2, "a comparison", "the end"),
        ("", 1, 1, "a formula", "the end"),
        ("x & y >= 1", 1, 3, "a comparison", "'&'"),
        ("(x >= 1 & y >= 2", 1, 17, "')'", "the end"),
        ("norm(x, y & z) <= 1", 1, 11, "',' or ')'", "'&'"),
        ("(x >= 1) + 2 >= 3", 1, 10, "'&', '|', '->', 'U[a,b]'", "'+'"),
        ("x >= 1 y", 1, 8, "'&', '|', '->', 'U[a,b]'", "'y'"),
        ("x >= 1)", 1, 7, "end of the formula", "')'"),
        ("G[3,1] x >= 1", 1, 2, "a <= b", "[3,1]"),
        ("G[0,1.5] x >= 1", 1, 5, "a whole number of steps", "'1.5'"),
        ("G[-1,2] x >= 1", 1, 3, "at least 0", "'-'"),
        ("G[0 1] x >= 1", 1, 5, "','", "'1'"),
        ("G[0,1 x >= 1", 1, 7, "']'", "'x'"),
        ("x == 1", 1, 3, "abs(x - y) <= tolerance", "'=='"),
        ("x != 1", 1, 3, "abs(x - y) <= tolerance", "'!='"),
        ("x => 1", 1, 3, "an operator or a comparison", "'=>'"),
        ("x =< 1", 1, 3, "an operator or a comparison", "'=<'"),
        ("x\u00b2 > 1", 1, 2, "a name, a number or an operator", "'\u00b2'"),
        ("x > 1 <- y > 1", 1, 7, "'>' or '>=' (a chain of comparisons has one direction", "'<'"),
        ("0 <= x > 1", 1, 8, "'<' or '<=' (a chain", "'>'"),
        ("+(x > 1)", 1, 2, "an arithmetic expression", "a formula"),
        ("abs >= 1", 1, 5, "'('", "'>='"),
        ("cosh(x) >= 1", 1, 1, "a function (abs", "'cosh'"),
        ("sqrt(x, y) >= 1", 1, 5, "one argument", "2"),
        ("norm() >= 1", 1, 6, "a formula or an expression", "')'"),
        ("x ** 0.5 >= 1", 1, 6, "whole number", "'0.5'"),
        ("x ** 2 ** 2 >= 1", 1, 8, "parentheses", "'**'"),
        ("min(x >= 1, 2) >= 1", 1, 7, "',' or ')'", "'>='"),
        ("x >= (y >= 1)", 1, 6, "an arithmetic expression", "a formula"),
        ("x >= @", 1, 6, "a name", "'@'"),
        ("x >= 1e999", 1, 6, "finite", "'1e999'"),
        ("x >= 1 &\n  G[0,3] y", 2, 11, "a comparison", "the end"),
    ],
)
def test_errors_point_at_the_place(text: str, line: int, column: int, expected: str, found: str) -> None:
    with pytest.raises(stl.StlSyntaxError) as caught:
        stl.parse(text)
    error = caught.value
    assert (error.line, error.column) == (line, column)
    assert expected in error.expected
    first, source, caret = str(error).split("\n")
    remedy = f"; {error.remedy}" if error.remedy else ""
    assert first.startswith(f"line {line}, column {column}: expected {error.expected} but found {found}")
    assert first.endswith(remedy)
    assert source[4:] == (text.splitlines() or [""])[line - 1]
    assert caret == " " * (3 + column) + "^"


@pytest.mark.parametrize("name", ["e\u0301", "\u0924\u093e\u092a\u092e\u093e\u0928", "x\u0301_1"])
def test_marks_that_combine_with_letters_belong_to_a_name(name: str) -> None:
    formula = stl.parse(f"{name} > 0")
    assert stl.signals(formula) == (name,)
    assert stl.parse(str(formula)) == formula


def test_a_dot_between_letters_is_no_part_of_a_name() -> None:
    with pytest.raises(stl.StlSyntaxError, match="write \\*"):
        stl.parse("a\u00b7b > 0")
    with pytest.raises(ValueError, match="a signal name is an identifier without '\u00b7'"):
        stl.Signal("a\u00b7b")


def test_an_end_that_dt_makes_too_many_steps_is_a_syntax_error() -> None:
    with pytest.raises(stl.StlSyntaxError, match="an interval end of at most 9007199254740992 steps"):
        stl.parse("F[0,900719925474099.3] x > 0", dt=0.1)


@pytest.mark.parametrize("dt", [None, 0.1])
def test_an_end_that_decimals_make_0_is_refused(dt: float | None) -> None:
    with pytest.raises(stl.StlSyntaxError, match=r"a whole number of steps|at least 1e-300"):
        stl.parse("F[0,1e-2000000] x > 0", dt=dt)
    assert stl.parse("F[0,0e-2000000] x > 0", dt=dt) == stl.parse("F[0,0] x > 0")
