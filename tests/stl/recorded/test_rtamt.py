"""The oracle: rtamt 0.4.10's discrete-time offline monitor on generated formulas and traces.

rtamt (semantics/stl/discrete_time/offline/ast_visitor.py) reads windows as the `clip` policy does: it pads always with
+inf, eventually and the right operand of until with -inf, the left operand of until with +inf, and returns a value at
every sample. Its until takes the left operand over [t, t') without t', as here. Where the horizon fits, clip and strict
agree, so the head of its answer is also compared with the strict trace. Differences that the comparison avoids:

- rtamt has `==` and `!=` (robustness -|x - y| and |x - y|); there is no counterpart here. Its iff and xor are -|p - q|
  and |p - q| of the robustness, whose signs are not the verdicts.
- rtamt treats `<` as `<=` and has no Boolean verdict, so satisfaction is compared only where the robustness is not 0.
- rtamt has no `True`, sin, cos, min, max or norms, and reads `!` only as `not`.
"""

from __future__ import annotations

import importlib
import logging
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stlbench import stl
from stlbench.stl.language.structure import unbounded

if sys.version_info >= (3, 13):
    pytest.skip("rtamt 0.4.10 needs Python < 3.13", allow_module_level=True)
rtamt = importlib.import_module("rtamt")

NAMES = ("x", "y", "z")
COMPARED = 2400


def random_expression(rng: np.random.Generator) -> stl.Expression:
    signal: stl.Expression = stl.Signal(str(rng.choice(NAMES)))
    other = stl.Signal(str(rng.choice(NAMES)))
    number = stl.Number(float(rng.integers(0, 12)) / 4)
    return [
        signal,
        stl.Call("abs", (signal,)),
        stl.Binary("-", signal, other),
        stl.Binary("*", number, signal),
        stl.Call("sqrt", (stl.Call("abs", (stl.Binary("+", signal, number),)),)),
    ][rng.integers(5)]


def random_formula(rng: np.random.Generator, depth: int) -> stl.Formula:
    if depth == 0 or rng.random() < 0.15:
        op = str(rng.choice(["<=", ">=", "<", ">"]))
        return stl.Predicate(op, random_expression(rng), stl.Number(float(rng.integers(0, 12)) / 4))

    def inner() -> stl.Formula:
        return random_formula(rng, depth - 1)

    a, b = sorted(rng.integers(0, 7, 2).tolist()) if rng.random() < 0.8 else (0, stl.END)
    choices: list[Callable[[], stl.Formula]] = [
        lambda: stl.Not(inner()),
        lambda: stl.And((inner(), inner())),
        lambda: stl.Or((inner(), inner(), inner())),
        lambda: stl.Implies(inner(), inner()),
        lambda: stl.Always(a, b, inner()),
        lambda: stl.Eventually(a, b, inner()),
        lambda: stl.Until(a, b, inner(), inner()),
        lambda: stl.Until(a, b, inner(), inner()),
        lambda: stl.Historically(a, b, inner()),
        lambda: stl.Once(a, b, inner()),
        lambda: stl.Since(a, b, inner(), inner()),
    ]
    return choices[rng.integers(len(choices))]()


def rtamt_text(node: stl.Formula | stl.Expression) -> str:
    match node:
        case stl.Number(value):
            return repr(value)
        case stl.Signal(name):
            return name
        case stl.Call(name, args):
            return f"{name}({', '.join(map(rtamt_text, args))})"
        case stl.Binary(op, left, right) | stl.Predicate(op, left, right):
            return f"({rtamt_text(left)} {op} {rtamt_text(right)})"
        case stl.Not(arg):
            return f"(not ({rtamt_text(arg)}))"
        case stl.And(args):
            return f"({' and '.join(map(rtamt_text, args))})"
        case stl.Or(args):
            return f"({' or '.join(map(rtamt_text, args))})"
        case stl.Implies(left, right):
            return f"({rtamt_text(left)} implies {rtamt_text(right)})"
        case stl.Always(a, b, arg):
            return f"(always{interval(a, b)} {rtamt_text(arg)})"
        case stl.Eventually(a, b, arg):
            return f"(eventually{interval(a, b)} {rtamt_text(arg)})"
        case stl.Historically(a, b, arg):
            return f"(historically{interval(a, b)} {rtamt_text(arg)})"
        case stl.Once(a, b, arg):
            return f"(once{interval(a, b)} {rtamt_text(arg)})"
        case stl.Since(a, b, left, right):
            return f"({rtamt_text(left)} since{interval(a, b)} {rtamt_text(right)})"
        case stl.Until(a, b, left, right):
            return f"({rtamt_text(left)} until{interval(a, b)} {rtamt_text(right)})"
        case _:
            raise AssertionError(node)


def interval(a: int, b: int) -> str:
    return "" if b == stl.END else f"[{a},{b}]"


def rtamt_robustness(formula: stl.Formula, trace: NDArray[np.float64]) -> NDArray[np.float64]:
    spec: Any = rtamt.StlDiscreteTimeOfflineSpecification()
    for name in NAMES:
        spec.declare_var(name, "float")
    spec.spec = rtamt_text(formula)
    spec.parse()
    columns = {name: trace[:, i].tolist() for i, name in enumerate(NAMES)}
    values = spec.evaluate({"time": list(range(len(trace))), **columns})
    return np.array([value for _, value in values])


@pytest.mark.slow
def test_equals_rtamt(record_property: Any) -> None:
    logging.getLogger().setLevel(logging.ERROR)
    rng = np.random.default_rng(20240607)
    operators = {kind: 0 for kind in (stl.Always, stl.Eventually, stl.Until, stl.Historically, stl.Once, stl.Since)}
    compared = shorter = endless = 0
    while compared < COMPARED:
        formula = random_formula(rng, depth=int(rng.integers(1, 4)))
        trace = rng.integers(-12, 13, (int(rng.integers(2, 30)), 3)) / 4.0
        expected = rtamt_robustness(formula, trace)
        message = f"{formula} on {trace.tolist()}"
        clipped = stl.robustness_trace(formula, trace, NAMES, "clip")
        np.testing.assert_allclose(clipped, expected, rtol=1e-12, atol=1e-12, err_msg=message)
        verdict = stl.satisfied_trace(formula, trace, NAMES, "clip")
        np.testing.assert_array_equal(verdict[expected != 0], expected[expected != 0] > 0, err_msg=message)
        if unbounded(formula) is not None:
            endless += 1
        elif len(trace) > stl.horizon(formula):
            strict = stl.robustness_trace(formula, trace, NAMES)
            np.testing.assert_allclose(strict, expected[: len(strict)], rtol=1e-12, atol=1e-12, err_msg=message)
            np.testing.assert_allclose(stl.robustness(formula, trace, NAMES), expected[0], rtol=1e-12, atol=1e-12)
        else:
            shorter += 1
        compared += 1
        for kind in operators:
            operators[kind] += kind.__name__ in repr(formula)
    counts = ", ".join(f"{kind.__name__} in {count}" for kind, count in operators.items())
    print(f"\ncompared {compared} formulas and traces with rtamt ({counts}; {shorter} traces shorter than the horizon)")
    record_property("rtamt_compared", compared)
    assert compared >= 2000
    assert min(operators.values()) >= 200
    assert shorter >= 100
    assert endless >= 300
