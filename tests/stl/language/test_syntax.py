"""Values: equality, printing, validation, and what a formula needs of a trace."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from stlbench import stl

X, Y = stl.Signal("x"), stl.Signal("y")
P, Q = stl.Predicate("<=", X, stl.Number(1)), stl.Predicate(">", Y, stl.Number(0.5))


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (stl.And((P, stl.Or((P, Q)))), "x <= 1 & (x <= 1 | y > 0.5)"),
        (stl.Or((P, stl.And((P, Q)))), "x <= 1 | x <= 1 & y > 0.5"),
        (stl.Not(P), "!x <= 1"),
        (stl.Not(stl.And((P, Q))), "!(x <= 1 & y > 0.5)"),
        (stl.Always(0, 3, stl.And((P, Q))), "G[0,3] (x <= 1 & y > 0.5)"),
        (stl.Until(1, 2, stl.Until(0, 1, P, Q), P), "(x <= 1 U[0,1] y > 0.5) U[1,2] x <= 1"),
        (stl.Until(1, 2, P, stl.Until(0, 1, P, Q)), "x <= 1 U[1,2] x <= 1 U[0,1] y > 0.5"),
        (stl.Not(stl.TrueFormula()), "!True"),
        (stl.Predicate("<", stl.Binary("-", X, stl.Binary("-", X, Y)), stl.Number(1e-9)), "x - (x - y) < 1e-09"),
        (stl.Predicate("<", stl.Binary("**", stl.Binary("*", X, Y), stl.Number(2)), stl.Number(4)), "(x * y) ** 2 < 4"),
    ],
)
def test_prints_with_the_fewest_parentheses(formula: stl.Formula, text: str) -> None:
    assert str(formula) == text
    assert stl.parse(text) == formula


def test_position_does_not_count_in_comparisons() -> None:
    assert stl.parse("x <= 1") == P
    assert stl.parse("  x <= 1").position == stl.Position(1, 3)
    assert stl.Not(P, position=stl.Position(1, 1)) == stl.Not(P)
    assert "position" not in repr(stl.parse("x <= 1"))


def test_conjunctions_flatten() -> None:
    assert stl.And((stl.And((P, Q)), P)) == stl.And((P, Q, P)) == stl.parse("(x <= 1 & y > 0.5) & x <= 1")


def test_values_are_frozen_and_survive_pickling() -> None:
    with pytest.raises(AttributeError):
        P.op = "<"  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(stl.And((P, Q)))) == stl.And((P, Q))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: stl.Predicate("==", X, Y), "equality of reals has no robustness"),
        (lambda: stl.Predicate("!=", X, Y), "equality of reals has no robustness"),
        (lambda: stl.Always(3, 1, P), r"0 <= a <= b, got \[3,1\]"),
        (lambda: stl.Always(-1, 1, P), "0 <= a <= b"),
        (lambda: stl.Always(*(0.5, 1), P), "whole ends"),
        (lambda: stl.Always(False, True, P), r"whole ends .*, got \[False,True\]"),
        (lambda: stl.Until(0, np.True_, P, P), "whole ends"),  # type: ignore[arg-type]
        (lambda: stl.Always(0, np.array([1, 2]), P), "whole ends"),  # type: ignore[arg-type]
        (lambda: stl.Signal("norm"), "reserved"),
        (lambda: stl.Signal("a b"), "identifier"),
        (lambda: stl.Number(-1), "Negative"),
        (lambda: stl.Number(float("inf")), "finite"),
        (lambda: stl.Binary("%", X, Y), "no arithmetic operator"),
        (lambda: stl.Binary("**", X, Y), "whole number"),
        (lambda: stl.Call("cosh", (X,)), "no function 'cosh'"),
        (lambda: stl.Call("sqrt", (X, Y)), "one argument"),
        (lambda: stl.Call("min", ()), "one or more"),
        (lambda: stl.And((P,)), "two or more"),
    ],
)
def test_impossible_values_are_refused(build: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build()


def test_signals_in_order_of_first_appearance() -> None:
    assert stl.signals(stl.parse("F[0,1] z <= x & norm(y, x) <= 1 | a > z")) == ("z", "x", "y", "a")
    assert stl.signals(stl.parse("True")) == ()


def test_is_temporal_counts_operators_not_lengths() -> None:
    assert stl.is_temporal(stl.parse("G[0,0] x <= 1"))
    assert not stl.is_temporal(stl.parse("x <= 1 -> !y > 2"))


def test_a_formula_from_another_process_hashes_as_here() -> None:
    code = "import pickle, sys; from stlbench.stl import parse; f = parse('F[0,3] x >= 1'); hash(f); "
    code += "sys.stdout.buffer.write(pickle.dumps(f))"
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    sent = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=environment).stdout
    assert {stl.parse("F[0,3] x >= 1"): "found"}[pickle.loads(sent)] == "found"


def test_nodes_of_different_kinds_hash_apart() -> None:
    nodes = [stl.Always(0, 3, P), stl.Eventually(0, 3, P), stl.Until(0, 3, P, P), stl.Not(P)]
    nodes += [stl.And((P, Q)), stl.Or((P, Q))]
    assert len({hash(node) for node in nodes}) == len(nodes)


@pytest.mark.parametrize("text", ["x >= 0", "G[0,1] x >= 0 & y < 1", "True", "False"])
def test_a_formula_has_no_truth_value(text: str) -> None:
    """Or `f and g` is g, and `not f` is False, without a word."""
    f, g = stl.parse(text), stl.parse("y >= 1")
    for use in (lambda: f and g, lambda: f or g, lambda: not f, lambda: bool(f), lambda: g if f else f):
        with pytest.raises(TypeError, match=r"has no truth value of its own; join formulas with And\(\(f, g\)\), Or"):
            use()
    with pytest.raises(TypeError, match="has no truth value"):
        bool(stl.parse_expression("x + 1"))
    assert [f, g].index(g) == 1
    assert f == stl.parse(text)


def test_the_ends_of_an_interval_may_be_whole_numbers_of_numpy() -> None:
    formula = stl.Always(np.int64(0), np.uint8(3), P)  # type: ignore[arg-type]
    assert formula == stl.Always(0, 3, P) == stl.parse(str(formula))
    assert (type(formula.a), type(formula.b)) == (int, int)
    assert stl.resolve_end(stl.parse("G x > 0"), np.int64(7)) == stl.parse("G[0,7] x > 0")  # type: ignore[arg-type]


def test_operands_may_come_from_a_generator() -> None:
    assert stl.And(p for p in (P, Q, P)) == stl.And((P, Q, P))  # type: ignore[arg-type]
    assert stl.Or(p for p in (P, Q)) == stl.Or((P, Q))  # type: ignore[arg-type]
