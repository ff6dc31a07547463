"""Intervals of formulas and of their derivatives: each contains what it is at points inside."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.generated_formulas import EXPRESSIONS, NAMES, SEEDS, pointwise
from hypothesis import given
from numpy.typing import NDArray

from stlbench.stl import Expression, Formula, margin, parse
from stlbench.stl.arithmetic.intervals import Range
from stlbench.stl.boxes import Enclosure, mean_value_range

OPERATIONS = [
    "x + y", "x - y", "x * y", "x / (z + 1)", "x ** 0", "x ** 1", "x ** 2", "x ** 3", "x ** 4", "-x", "x * x",
    "abs(x)", "sqrt(z)", "sin(9 * x)", "cos(9 * x)", "exp(3 * x)", "min(x, y)", "max(x, y, z)", "norm(x, y)",
    "norminf(x, y)", "norm(x)", "sqrt(abs(x * y))", "tan(x)", "tan(5 * x)", "log(z + 0.25)", "tanh(2 * x)",
    "atan2(x, y)", "atan2(y, z)", "atan2(x * y, z - 1)", "x ** 9", "x ** 40",
]  # fmt: skip


def random_boxes(seed: int, count: int = 40) -> dict[str, Range]:
    """x, y in [-2, 2] and z in [0, 4]; some boxes are points, some touch 0."""
    ends = np.sort(np.random.default_rng(seed).integers(-8, 9, (3, 2, count)) / 4.0, axis=1)
    return {"x": tuple(ends[0]), "y": tuple(ends[1]), "z": tuple(ends[2] + 2)}


def inside(boxes: dict[str, Range], rng: np.random.Generator) -> NDArray[np.float64]:
    """One random point of each box (m, 3), often on the boundary."""
    share = np.clip(rng.uniform(-0.5, 1.5, (3, len(boxes["x"][0]))), 0, 1)
    columns = [low + part * (high - low) for (low, high), part in zip(boxes.values(), share, strict=True)]
    return np.stack([np.clip(c, *boxes[name]) for name, c in zip(NAMES, columns, strict=True)], axis=-1)


def assert_contains(range_: Range, values: NDArray[np.float64]) -> None:
    slack = 1e-12 * (1 + np.abs(np.where(np.isfinite(values), values, 0)))  # the values at points round
    assert np.all(np.isnan(range_[0]) | (range_[0] <= values + slack))
    assert np.all(np.isnan(range_[1]) | (values - slack <= range_[1]))


def check_margins(psi: Formula, seed: int, points: int) -> None:
    """The plain intervals and the mean-value form contain the margins at points inside."""
    boxes, rng = random_boxes(seed), np.random.default_rng(seed)
    with np.errstate(all="ignore"):
        natural, centred = Enclosure(boxes, {}).range(psi), mean_value_range(psi, boxes, {})
    for _ in range(points):
        values = margin(psi, NAMES)(inside(boxes, rng))
        assert_contains(natural, values)
        assert_contains(centred, values)


@pytest.mark.parametrize("text", OPERATIONS)
def test_operation_contains_its_values(text: str) -> None:
    for seed in range(10):
        check_margins(parse(f"{text} >= 0"), seed, 10)


@given(pointwise(), SEEDS)
def test_formula_contains_its_margins(psi: Formula, seed: int) -> None:
    check_margins(psi, seed, 10)


@given(EXPRESSIONS, SEEDS)
def test_slopes_contain_difference_quotients(node: Expression, seed: int) -> None:
    psi = parse(f"{node} >= 0")
    boxes, rng = random_boxes(seed), np.random.default_rng(seed)
    h = margin(psi, NAMES)
    with np.errstate(all="ignore"):
        slopes = Enclosure(boxes, {}, with_derivatives=True).derivatives(psi)
        for column, name in enumerate(NAMES):
            here, there = inside(boxes, rng), inside(boxes, rng)
            there[:, [i for i in range(3) if i != column]] = here[:, [i for i in range(3) if i != column]]
            apart = np.abs(there - here)[:, column] > 1e-3
            quotient = ((h(there) - h(here)) / (there - here)[:, column])[apart]
            low, high = slopes.get(name, (np.zeros(40), np.zeros(40)))
            bounds = np.broadcast_to(low, 40)[apart], np.broadcast_to(high, 40)[apart]
            size = 1e-9 * (1 + np.abs(h(there)) + np.abs(h(here)))[apart]
            assert np.all(np.isnan(bounds[0]) | (bounds[0] <= quotient + size + 1e-9 * np.abs(quotient)))
            assert np.all(np.isnan(bounds[1]) | (quotient - size - 1e-9 * np.abs(quotient) <= bounds[1]))


def test_exact_operations_are_tight() -> None:
    box = {"x": (np.array([-1.0]), np.array([2.0])), "y": (np.array([3.0]), np.array([4.0]))}
    for text, low, high in [
        ("x * x", 0, 4),
        ("x ** 3", -1, 8),
        ("norm(x, y)", 3, math.sqrt(20)),
        ("sin(y)", math.sin(4), math.sin(3)),
        ("cos(x)", math.cos(2), 1),
        ("min(x, y)", -1, 2),
        ("tan(x / 2)", math.tan(-0.5), math.tan(1)),
        ("tan(x)", -math.inf, math.inf),
        ("log(y)", math.log(3), math.log(4)),
        ("tanh(x)", math.tanh(-1), math.tanh(2)),
        ("atan2(y, x)", math.atan2(3, 2), math.atan2(3, -1)),
        ("atan2(x, y)", math.atan2(-1, 3), math.atan2(2, 3)),
        ("atan2(x, -y)", -math.pi, math.pi),  # across the branch cut
        ("atan2(-y, x)", math.atan2(-3, -1), math.atan2(-3, 2)),
    ]:
        lower, upper = Enclosure(box, {}).range(parse(f"{text} >= 0"))
        assert (lower.item(), upper.item()) == pytest.approx((low, high), abs=1e-14)
