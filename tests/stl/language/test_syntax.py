"""Values: equality, printing, validation, and what a formula needs of a trace."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from typing import Any

import pytest

from stlbench.stl import (
    Always,
    And,
    Binary,
    Call,
    Formula,
    Not,
    Number,
    Or,
    Position,
    Predicate,
    Signal,
    TrueFormula,
    Until,
    horizon,
    is_temporal,
    parse,
    signals,
)

X, Y = Signal("x"), Signal("y")
P, Q = Predicate("<=", X, Number(1)), Predicate(">", Y, Number(0.5))


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (And((P, Or((P, Q)))), "x <= 1 & (x <= 1 | y > 0.5)"),
        (Or((P, And((P, Q)))), "x <= 1 | x <= 1 & y > 0.5"),
        (Not(P), "!x <= 1"),
        (Not(And((P, Q))), "!(x <= 1 & y > 0.5)"),
        (Always(0, 3, And((P, Q))), "G[0,3] (x <= 1 & y > 0.5)"),
        (Until(1, 2, Until(0, 1, P, Q), P), "(x <= 1 U[0,1] y > 0.5) U[1,2] x <= 1"),
        (Until(1, 2, P, Until(0, 1, P, Q)), "x <= 1 U[1,2] x <= 1 U[0,1] y > 0.5"),
        (Not(TrueFormula()), "!True"),
        (Predicate("<", Binary("-", X, Binary("-", X, Y)), Number(1e-9)), "x - (x - y) < 1e-09"),
        (Predicate("<", Binary("**", Binary("*", X, Y), Number(2)), Number(4)), "(x * y) ** 2 < 4"),
    ],
)
def test_prints_with_the_fewest_parentheses(formula: Formula, text: str) -> None:
    assert str(formula) == text
    assert parse(text) == formula


def test_position_does_not_count_in_comparisons() -> None:
    assert parse("x <= 1") == P
    assert parse("  x <= 1").position == Position(1, 3)
    assert Not(P, position=Position(1, 1)) == Not(P)
    assert "position" not in repr(parse("x <= 1"))


def test_conjunctions_flatten() -> None:
    assert And((And((P, Q)), P)) == And((P, Q, P)) == parse("(x <= 1 & y > 0.5) & x <= 1")


def test_values_are_frozen_and_survive_pickling() -> None:
    with pytest.raises(AttributeError):
        P.op = "<"  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(And((P, Q)))) == And((P, Q))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Predicate("==", X, Y), "equality of reals has no robustness"),
        (lambda: Predicate("!=", X, Y), "equality of reals has no robustness"),
        (lambda: Always(3, 1, P), r"0 <= a <= b, got \[3,1\]"),
        (lambda: Always(-1, 1, P), "0 <= a <= b"),
        (
            lambda: Always(0.5, 1, P),  # type: ignore[arg-type]
            "whole ends",
        ),
        (lambda: Signal("norm"), "reserved"),
        (lambda: Signal("a b"), "identifier"),
        (lambda: Number(-1), "Negative"),
        (lambda: Number(float("inf")), "finite"),
        (lambda: Binary("%", X, Y), "no arithmetic operator"),
        (lambda: Binary("**", X, Y), "whole number"),
        (lambda: Call("cosh", (X,)), "no function 'cosh'"),
        (lambda: Call("sqrt", (X, Y)), "one argument"),
        (lambda: Call("min", ()), "one or more"),
        (lambda: And((P,)), "two or more"),
    ],
)
def test_impossible_values_are_refused(build: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize(
    ("text", "steps"),
    [
        ("x <= 1", 0),
        ("G[2,5] x <= 1", 5),
        ("F[0,3] G[2,5] x <= 1", 8),
        ("x <= 1 U[2,5] y > 0", 5),
        ("(G[0,4] x <= 1) U[2,5] y > 0", 8),
        ("(G[0,4] x <= 1) U[0,0] y > 0", 0),
        ("x <= 1 U[2,5] G[0,4] y > 0", 9),
        ("G[0,1] x <= 1 & !F[0,7] y > 0 -> True", 7),
    ],
)
def test_horizon(text: str, steps: int) -> None:
    assert horizon(parse(text)) == steps


def test_signals_in_order_of_first_appearance() -> None:
    assert signals(parse("F[0,1] z <= x & norm(y, x) <= 1 | a > z")) == ("z", "x", "y", "a")
    assert signals(parse("True")) == ()


def test_is_temporal_counts_operators_not_lengths() -> None:
    assert is_temporal(parse("G[0,0] x <= 1"))
    assert not is_temporal(parse("x <= 1 -> !y > 2"))


def test_a_formula_from_another_process_hashes_as_here() -> None:
    code = "import pickle, sys; from stlbench.stl import parse; f = parse('F[0,3] x >= 1'); hash(f); "
    code += "sys.stdout.buffer.write(pickle.dumps(f))"
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    sent = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=environment).stdout
    assert {parse("F[0,3] x >= 1"): "found"}[pickle.loads(sent)] == "found"


def test_nodes_of_different_kinds_hash_apart() -> None:
    nodes = [Always(0, 3, P), Until(0, 3, P, P), Not(P), parse("F[0,3] x <= 1"), And((P, Q)), Or((P, Q))]
    assert len({hash(node) for node in nodes}) == len(nodes)
