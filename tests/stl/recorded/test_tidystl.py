"""Five tools as tidystl-compat 0.1.0 re-implements them, on generated formulas: where they agree, and how they differ.

Each difference is a rewriting of the formula under which the tool agrees again, so it is all that differs. Traces have
a sample each second, which all of them read alike. The table in docs/stl.md says the same for people.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stlbench.stl import Always, And, Eventually, Formula, Not, Or, Predicate, Until, horizon, parse, robustness

tidystl: Any = pytest.importorskip("tidystl")
tidystl.use(importlib.import_module("tidystl_compat"))

NAMES = ("x", "y")
PREDICATES = ("x >= 1", "x <= 0.5", "y >= 0", "y < 1")
Traces = NDArray[np.float64]


def written(node: Formula) -> str:
    """The formula in their grammar."""
    match node:
        case Not(arg):
            return f"(not {written(arg)})"
        case And(args):
            return reduce(lambda left, right: f"({left} and {right})", map(written, args))
        case Or(args):
            return reduce(lambda left, right: f"({left} or {right})", map(written, args))
        case Always(a, b, arg):
            return f"(G[{a},{b}] {written(arg)})"
        case Eventually(a, b, arg):
            return f"(F[{a},{b}] {written(arg)})"
        case Until(a, b, left, right):
            return f"({written(left)} U[{a},{b}] {written(right)})"
        case _:
            return f"({node})"


def told(tool: str, formula: Formula, traces: Traces) -> Traces:
    """The robustness at step 0 by a tool, (n,)."""
    columns = {name: traces[..., i] for i, name in enumerate(NAMES)}
    signal = tidystl.Signal.from_dict(np.arange(traces.shape[1], dtype=float), columns)
    values = np.asarray(tidystl.robustness(tidystl.parse(written(formula)), signal, backend=tool))
    return values[:, 0] if values.ndim == 2 else values


def rewritten(formula: Formula, by: Callable[[Formula], Formula]) -> Formula:
    """The formula with each node, from the leaves up, given to `by`."""
    match formula:
        case Not(arg):
            return by(Not(rewritten(arg, by)))
        case And(args) | Or(args):
            return by(type(formula)(tuple(rewritten(arg, by) for arg in args)))
        case Always(a, b, arg) | Eventually(a, b, arg):
            return by(type(formula)(a, b, rewritten(arg, by)))
        case Until(a, b, left, right):
            return by(Until(a, b, rewritten(left, by), rewritten(right, by)))
        case _:
            return formula


def inclusive(node: Formula) -> Formula:
    """p U q that asks for p at the step of q as well."""
    return Until(node.a, node.b, node.left, And((node.left, node.right))) if isinstance(node, Until) else node


def half_open(node: Formula) -> Formula:
    """Windows [t + a, t + b) in place of [t + a, t + b]."""
    return type(node)(node.a, node.b - 1, node.arg) if isinstance(node, Always | Eventually) else node


def same(node: Formula) -> Formula:
    return node


def generated(rng: np.random.Generator, depth: int, until: bool) -> Formula:
    if depth == 0:
        return parse(PREDICATES[rng.integers(4)])
    a, b = sorted(rng.choice(5, 2, replace=False).tolist())

    def inner() -> Formula:
        return generated(rng, depth - 1, until)

    kinds: list[Callable[[], Formula]] = [
        lambda: Always(a, b, inner()),
        lambda: Eventually(a, b, inner()),
        lambda: And((inner(), inner())),
        lambda: Or((inner(), inner())),
        lambda: Not(inner()),
        lambda: Until(a, b, inner(), inner()),
    ]
    return kinds[rng.integers(6 if until else 5)]()


@pytest.mark.parametrize("samples", ["the horizon", "more"])
@pytest.mark.parametrize(
    ("tool", "reading", "until"),
    [
        ("rtamt", same, True),
        ("breach", inclusive, True),
        ("taliro", inclusive, True),
        ("stlcgpp", inclusive, True),
        ("pymtl", half_open, False),
    ],
)
def test_a_tool_agrees_but_for_its_reading(
    tool: str, reading: Callable[[Formula], Formula], until: bool, samples: str
) -> None:
    rng = np.random.default_rng(7)
    for i in range(16):
        formula = generated(rng, 1 + i % 2, until)
        length = max(2, horizon(formula) + (3 if samples == "more" else 1))
        traces = rng.integers(-8, 9, (6, length, 2)) / 4
        expected = robustness(rewritten(formula, reading), traces, NAMES)
        assert told(tool, formula, traces) == pytest.approx(expected, abs=1e-9), str(formula)


def one(tool: str, formula: str, x: list[float], y: list[float] | None = None) -> float:
    trace = np.stack([x, y if y is not None else np.zeros(len(x))], axis=-1)[None]
    return float(told(tool, parse(formula), trace)[0])


def ours(formula: str, x: list[float], y: list[float] | None = None, policy: Any = "strict") -> float:
    trace = np.stack([x, y if y is not None else np.zeros(len(x))], axis=-1)
    return float(robustness(parse(formula), trace, NAMES, policy=policy))


class TestTheTableOfDocs:
    """Each row of the table "where tools differ" in docs/stl.md."""

    def test_the_left_operand_at_the_step_of_the_right_one(self) -> None:
        case = "x >= 0 U[0,2] y >= 0", [2.0, -1.0, -1.0], [-1.0, 1.0, -1.0]
        assert (ours(*case), one("rtamt", *case)) == (1, 1)
        assert [one(tool, *case) for tool in ("breach", "taliro", "stlcgpp")] == [-1, -1, -1]

    def test_the_end_of_a_window(self) -> None:
        case = "G[0,2] x >= 0", [2.0, 1.0, -1.0]
        assert [ours(*case), *(one(tool, *case) for tool in ("rtamt", "breach", "taliro", "stlcgpp"))] == [-1] * 5
        assert one("pymtl", *case) == 1

    def test_a_window_after_the_end_of_the_trace(self) -> None:
        case = "G[3,4] x >= 0", [2.0, 1.0, -1.0]
        assert [one(tool, *case) for tool in ("rtamt", "taliro")] == [np.inf, np.inf]
        assert ours(*case, policy="clip") == np.inf
        assert [one(tool, *case) for tool in ("breach", "stlcgpp")] == [-1, -1]

    def test_the_unit_of_a_predicate(self) -> None:
        case = "G[0,1] 3 * x + 4 * y >= 0", [2.0, 1.0], [1.0, 1.0]
        assert [ours(*case), *(one(tool, *case) for tool in ("rtamt", "breach", "pymtl", "stlcgpp"))] == [
            7,
            7,
            7,
            10,
            7,
        ]
        assert one("taliro", *case) == pytest.approx(7 / 5)

    def test_a_strict_comparison(self) -> None:
        """At x = 0 all have the robustness 0 for x > 0 and for x >= 0; only here is there a verdict beside it."""
        for tool in ("rtamt", "breach", "taliro", "stlcgpp"):
            assert one(tool, "G[0,1] x > 0", [0.0, 1.0]) == one(tool, "G[0,1] x >= 0", [0.0, 1.0]) == 0
        assert isinstance(parse("x > 0"), Predicate)
