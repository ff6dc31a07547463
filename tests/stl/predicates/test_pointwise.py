"""Compiled margins and verdicts per sample."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, PREDICATES, SEEDS, traces
from hypothesis import given

from stlbench.stl import (
    Predicate,
    StlSyntaxError,
    UndefinedError,
    UnknownSignalError,
    holds,
    margin,
    parse,
    parse_expression,
    signals,
    values,
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("norm(x - 1, y) <= 5", 0.0),
        ("norminf(x - 1, y) < 5", 1.0),
        ("abs(y) + sqrt(x) >= 1", 5.0),
        ("x ** 2 / 2 - y * 3 >= 0", 20.0),
        ("min(x, y) >= 0 | max(x, y, 7) <= 6", -1.0),
        ("exp(x - 4) >= cos(y + 4) - 2", 2.0),
        ("sin(pi * x / 8) >= 0", 1.0),
        ("x >= 0 -> y >= 0", -4.0),
        ("!(x >= 0 & y >= 0)", 4.0),
        ("norm(3, 4) <= x", -1.0),
    ],
)
def test_table(text: str, expected: float) -> None:
    # x = 4, y = -4
    assert margin(parse(text), ["x", "y"])(np.array([4.0, -4.0])) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("shape", [(), (5,), (0,), (3, 4)])
@pytest.mark.parametrize("text", ["x >= 1 & y < 2", "True", "1 <= 2", "False | 2 <= 1"])
def test_shapes_follow_the_batch(text: str, shape: tuple[int, ...]) -> None:
    samples = np.ones((*shape, 2))
    rho, verdict = margin(parse(text), ["x", "y"])(samples), holds(parse(text), ["x", "y"])(samples)
    assert np.shape(rho) == np.shape(verdict) == shape
    assert np.asarray(rho).dtype == float
    assert np.asarray(verdict).dtype == bool


def test_is_pure() -> None:
    samples = np.array([[1.0, 2.0]])
    result = margin(parse("x >= 0 & norm(x, y) <= 9"), ["x", "y"])(samples)
    result += 1
    assert samples.tolist() == [[1.0, 2.0]]


def test_float32_stays_float32() -> None:
    samples: Any = np.ones((4, 2), dtype=np.float32)
    assert margin(parse("norm(x - 0.5, y) <= 2 & y >= 0"), ["x", "y"])(samples).dtype == np.float32


def test_unknown_signal() -> None:
    with pytest.raises(UnknownSignalError, match="formula uses signal 'z'; the trace has x, y"):
        margin(parse("z >= 0"), ["x", "y"])


def test_temporal_formulas_are_refused() -> None:
    with pytest.raises(ValueError, match="without temporal operators"):
        margin(parse("G[0,1] x >= 0"), ["x"])


class TestValues:
    """Arithmetic alone, as an environment's signals are written."""

    def test_table(self) -> None:
        nodes = [parse_expression(text) for text in ("atan2(y, x)", "2", "x / y", "-min(x, y) ** 2 + pi")]
        found = values(nodes, ["x", "y"])(np.array([[3.0, 3.0], [-1.0, 0.0]]))
        expected = [[np.pi / 4, 2, 1, np.pi - 9], [np.pi, 2, np.nan, np.pi - 1]]
        np.testing.assert_allclose(found, expected, rtol=1e-14)

    @pytest.mark.parametrize("shape", [(), (5,), (0,), (3, 4)])
    def test_shapes_follow_the_batch(self, shape: tuple[int, ...]) -> None:
        both = values([parse_expression("x"), parse_expression("1")], ["x"])
        assert both(np.ones((*shape, 1))).shape == (*shape, 2)

    @given(PREDICATES, SEEDS)
    def test_a_margin_is_the_difference_of_the_sides(self, psi: Predicate, seed: int) -> None:
        samples = traces(20, seed)
        left, right = values([psi.left, psi.right], NAMES)(samples).T
        expected = right - left if psi.op in ("<=", "<") else left - right
        np.testing.assert_array_equal(margin(psi, NAMES)(samples), expected)

    def test_no_formula_and_no_unknown_name(self) -> None:
        with pytest.raises(StlSyntaxError, match="expected an arithmetic expression but found a formula"):
            parse_expression("x <= 1")
        with pytest.raises(StlSyntaxError, match="line 1, column 3"):
            parse_expression("x y")
        with pytest.raises(UnknownSignalError, match="'z'"):
            values([parse_expression("z")], ["x"])
        with pytest.raises(UndefinedError, match="divides by 0"):
            values([parse_expression("x / 0")], ["x"])
        assert signals(parse_expression("atan2(y, x) + y")) == ("y", "x")
