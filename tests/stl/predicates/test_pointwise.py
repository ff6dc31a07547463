"""Compiled margins and verdicts per sample."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, PREDICATES, SEEDS, traces
from hypothesis import given

from stlbench import stl


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
    assert stl.margin(stl.parse(text), ["x", "y"])(np.array([4.0, -4.0])) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("shape", [(), (5,), (0,), (3, 4)])
@pytest.mark.parametrize("text", ["x >= 1 & y < 2", "True", "1 <= 2", "False | 2 <= 1"])
def test_shapes_follow_the_batch(text: str, shape: tuple[int, ...]) -> None:
    samples = np.ones((*shape, 2))
    rho, verdict = stl.margin(stl.parse(text), ["x", "y"])(samples), stl.holds(stl.parse(text), ["x", "y"])(samples)
    assert np.shape(rho) == np.shape(verdict) == shape
    assert np.asarray(rho).dtype == float
    assert np.asarray(verdict).dtype == bool


def test_is_pure() -> None:
    samples = np.array([[1.0, 2.0]])
    result = stl.margin(stl.parse("x >= 0 & norm(x, y) <= 9"), ["x", "y"])(samples)
    result += 1
    assert samples.tolist() == [[1.0, 2.0]]


def test_float32_stays_float32() -> None:
    samples: Any = np.ones((4, 2), dtype=np.float32)
    assert stl.margin(stl.parse("norm(x - 0.5, y) <= 2 & y >= 0"), ["x", "y"])(samples).dtype == np.float32


def test_temporal_formulas_are_refused() -> None:
    with pytest.raises(ValueError, match="without temporal operators"):
        stl.margin(stl.parse("G[0,1] x >= 0"), ["x"])


class TestValues:
    """Arithmetic alone, as an environment's signals are written."""

    def test_table(self) -> None:
        nodes = [stl.parse_expression(text) for text in ("atan2(y, x)", "2", "x / y", "-min(x, y) ** 2 + pi")]
        found = stl.values(nodes, ["x", "y"])(np.array([[3.0, 3.0], [-1.0, 0.0]]))
        expected = [[np.pi / 4, 2, 1, np.pi - 9], [np.pi, 2, np.nan, np.pi - 1]]
        np.testing.assert_allclose(found, expected, rtol=1e-14)

    @pytest.mark.parametrize("shape", [(), (5,), (0,), (3, 4)])
    def test_shapes_follow_the_batch(self, shape: tuple[int, ...]) -> None:
        both = stl.values([stl.parse_expression("x"), stl.parse_expression("1")], ["x"])
        assert both(np.ones((*shape, 1))).shape == (*shape, 2)

    @given(PREDICATES, SEEDS)
    def test_a_margin_is_the_difference_of_the_sides(self, psi: stl.Predicate, seed: int) -> None:
        samples = traces(20, seed)
        left, right = stl.values([psi.left, psi.right], NAMES)(samples).T
        expected = right - left if psi.op in ("<=", "<") else left - right
        np.testing.assert_array_equal(stl.margin(psi, NAMES)(samples), expected)

    def test_no_formula_and_no_unknown_name(self) -> None:
        with pytest.raises(stl.StlSyntaxError, match="expected an arithmetic expression but found a formula"):
            stl.parse_expression("x <= 1")
        with pytest.raises(stl.StlSyntaxError, match="line 1, column 3"):
            stl.parse_expression("x y")
        with pytest.raises(stl.UnknownSignalError, match="'z'"):
            stl.values([stl.parse_expression("z")], ["x"])
        with pytest.raises(stl.UndefinedError, match="divides by 0"):
            stl.values([stl.parse_expression("x / 0")], ["x"])
        assert stl.signals(stl.parse_expression("atan2(y, x) + y")) == ("y", "x")
