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

from stlbench.stl import Always, And, Eventually, Formula, Not, Or, Until, horizon, parse, robustness
from stlbench.stl.language.structure import operands_of

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
    operands = operands_of(formula)
    return by(formula.with_operands([rewritten(part, by) for part in operands])) if operands else formula  # type: ignore[arg-type]


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


NO_Y: list[float] = []


@pytest.mark.parametrize(
    ("formula", "x", "y", "expected"),
    [
        pytest.param(
            *("x >= 0 U[0,2] y >= 0", [2.0, -1.0, -1.0], [-1.0, 1.0, -1.0]),
            {"ours": 1, "rtamt": 1, "breach": -1, "taliro": -1, "stlcgpp": -1},
            id="the left operand at the step of the right one",
        ),
        pytest.param(
            *("G[0,2] x >= 0", [2.0, 1.0, -1.0], NO_Y),
            {"ours": -1, "rtamt": -1, "breach": -1, "taliro": -1, "stlcgpp": -1, "pymtl": 1},
            id="the end of a window",
        ),
        pytest.param(
            *("G[3,4] x >= 0", [2.0, 1.0, -1.0], NO_Y),
            {"ours": np.inf, "rtamt": np.inf, "taliro": np.inf, "breach": -1, "stlcgpp": -1},
            id="a window after the end of the trace",
        ),
        pytest.param(
            *("G[0,1] 3 * x + 4 * y >= 0", [2.0, 1.0], [1.0, 1.0]),
            {"ours": 7, "rtamt": 7, "breach": 7, "pymtl": 10, "stlcgpp": 7, "taliro": 7 / 5},
            id="the unit of a predicate",
        ),
        pytest.param(
            *("G[0,1] x > 0", [0.0, 1.0], NO_Y),
            {"ours": 0, "rtamt": 0, "breach": 0, "taliro": 0, "stlcgpp": 0},
            id="a strict comparison, which only here has another verdict",
        ),
    ],
)
def test_a_row_of_the_table_of_docs(formula: str, x: list[float], y: list[float], expected: dict[str, float]) -> None:
    """The table "where tools differ" in docs/stl.md."""
    parsed, trace = parse(formula), np.stack([x, y or np.zeros(len(x))], axis=-1)
    for tool, value in expected.items():
        ours = tool == "ours"
        found = robustness(parsed, trace, NAMES, policy="clip") if ours else told(tool, parsed, trace[None])[0]
        assert float(found) == pytest.approx(value), tool
