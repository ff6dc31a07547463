"""Bounds of a margin over a box: hand-computed extremes, soundness, tolerance, domains."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, pointwise
from hypothesis import given

from stlbench.stl import Formula, UndefinedError, UnknownSignalError, bounds, margin, parse

BOX = {"x": (-1.0, 1.0), "y": (-1.0, 1.0), "z": (0.0, 3.0)}


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    [
        ("x >= 0.5", -1.5, 0.5),
        ("norm(x - 0.25, y - 0.25) <= 0.5", 0.5 - 1.25 * math.sqrt(2), 0.5),
        ("norminf(x - y, z) <= 1", -2, 1),
        ("abs(x) <= 0.05 & abs(y) <= 0.05", -0.95, 0.05),
        ("x >= 0 | y >= 0.5", -1, 1),
        ("x >= 0 -> y >= 0.5", -1, 1),
        ("!z <= 1", -1, 2),
        ("x ** 3 - x >= 0", -2 / 3**1.5, 2 / 3**1.5),
        ("x ** 2 * y >= 0", -1, 1),
        ("x * x >= 0", 0, 1),
        ("x - x >= 0", 0, 0),
        ("x * x - 2 * x * y + y * y >= 0", 0, 4),
        ("x * (1 - x) >= 0", -2, 0.25),
        ("1 / (2 + x) >= y", 1 / 3 - 1, 2),
        ("sqrt(1 - x * x) >= y", -1, 2),
        ("sqrt(x * x - 2 * x * y + y * y) <= 1", -1, 1),
        ("sin(4 * x) >= cos(z)", -2, 1 - math.cos(3)),
        ("exp(-x) * y >= 0", -math.e, math.e),
        ("tan(x) >= y", -math.tan(1) - 1, math.tan(1) + 1),
        ("log(2 + x) <= z", -math.log(3), 3),
        ("tanh(x) * tanh(x) >= 0", 0, math.tanh(1) ** 2),
        ("atan2(y, x + 2) >= 0", -math.pi / 4, math.pi / 4),
        ("atan2(x, y) <= 0", -math.pi, math.pi),
        ("x ** 1000001 >= 0", -1, 1),
        ("min(x, y) >= 0 & max(x, 0.5) <= 2", -1, 1),
        ("1 <= 2", 1, 1),
        ("True", math.inf, math.inf),
    ],
)
def test_extremes(text: str, lower: float, upper: float) -> None:
    proven = bounds(parse(text), BOX, tolerance=1e-5)
    assert proven.low <= lower
    assert proven.high >= upper
    assert (proven.low, proven.high) == pytest.approx((lower, upper), abs=2e-5)
    assert proven.tight


@given(pointwise(), SEEDS)
def test_no_sample_lies_outside(psi: Formula, seed: int) -> None:
    rng = np.random.default_rng(seed)
    ends = np.sort(rng.integers(-8, 9, (3, 2)) / 4.0, axis=1)
    proven = bounds(psi, ends, NAMES, tolerance=1e-3, nodes=500)
    corner = rng.integers(0, 2, (300, 3))
    points = np.concatenate([rng.uniform(ends[:, 0], ends[:, 1], (300, 3)), np.where(corner, ends[:, 1], ends[:, 0])])
    values = margin(psi, NAMES)(points)
    slack = 1e-12 * (1 + np.abs(values[np.isfinite(values)]).max(initial=0))  # the samples round, too
    assert np.all(proven.low - slack <= values)
    assert np.all(values <= proven.high + slack)


def test_two_joints_against_a_fine_grid() -> None:
    psi = parse("norm(sin(x) + sin(x + y) - 2, cos(x) + cos(x + y)) <= 0.1")
    axis = np.linspace(-1, 1, 401)
    values = margin(psi, ["x", "y"])(np.stack(np.meshgrid(axis, axis), axis=-1))
    proven = bounds(psi, BOX)
    assert proven.low <= values.min() <= proven.low + 1e-3
    assert proven.high - 1e-3 <= values.max() <= proven.high


def test_a_poor_budget_widens_but_stays_sound() -> None:
    psi = parse("x * x - 2 * x * y + y * y + sin(9 * x * y) * z >= 0")
    poor, rich = bounds(psi, BOX, nodes=10), bounds(psi, BOX, nodes=20_000)
    assert poor.low <= rich.low <= rich.high <= poor.high
    assert not poor.tight


def test_what_was_proven_of_the_annulus_is_said() -> None:
    # the greatest margin is 1.5, on the circle of radius 3.5; the tolerance is out of reach, for it is a whole circle
    proven = bounds(parse("norm(x - 5, y - 5) >= 2 & norm(x - 5, y - 5) <= 5"), {"x": (0, 15), "y": (0, 15)})
    assert proven.low <= 5 - 10 * math.sqrt(2) <= proven.low + proven.low_error + 1e-12
    assert proven.low_error <= proven.tolerance
    assert proven.high - proven.high_error - 1e-12 <= 1.5 <= proven.high
    assert 1e-6 < proven.high_error < 2e-3
    assert not proven.tight


@pytest.mark.parametrize(
    "text",
    [
        "x ** 1000000 >= 0",
        " + ".join(f"sin({i} * x)" for i in range(1, 21)) + " >= 0",
        " + ".join(f"sin(s{i} * s{(i + 1) % 20})" for i in range(20)) + " >= 0",
        " & ".join(f"norm(x - {i}, s0) >= {i}" for i in range(60)),
        " & ".join(f"sqrt(1 + norm(x - s{i % 20}, s{i // 2}) ** 2) >= {i}" for i in range(40)),
    ],
)
def test_work_is_bounded_and_the_answer_sound(text: str) -> None:
    box = {"x": (-1.5, 1.5)} | {f"s{i}": (-3.0, 3.0) for i in range(20)}
    proven = bounds(parse(text), box)
    ends = np.array(list(box.values()))
    points = np.random.default_rng(0).uniform(ends[:, 0], ends[:, 1], (500, 21))
    with np.errstate(over="ignore"):
        values = margin(parse(text), list(box))(points)
    assert proven.low <= values.min() <= values.max() <= proven.high


def test_a_degenerate_box_is_a_point() -> None:
    proven = bounds(parse("x * y >= 1"), {"x": (2, 2), "y": (3, 3)})
    assert (proven.low, proven.high) == pytest.approx((5, 5), abs=1e-12)


def test_usual_predicates_take_few_boxes() -> None:
    psi = parse("norm(x - 0.25, y - 0.25) <= 0.5 & abs(z) <= 2")
    assert bounds(psi, BOX, nodes=1000) == bounds(psi, BOX)


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(x) >= 0",
        "sqrt(abs(x) - y * y) >= 0",
        "1 / x >= 0",
        "1 / (x * x + y) >= 1",
        "log(z) >= 0",
        "log(x) >= 0 | z >= 0",
        "tan(z) >= 0",
        "tan(3 * x + 2) >= 0",
        "sqrt(x + 0.9999999) >= 0",  # below 0 by less than the tolerance
        "sqrt((x - 0.3) ** 2 - 0.00000001) >= 0",  # and in a tiny part of the box
        "sqrt(log(z + 0.99999999)) >= 0",
        "sqrt(-1 - z) >= 0 & 1 / (-1 - z) <= 0",  # one argument, two domains
        "1 / (-1 - z) <= 0 & sqrt(-1 - z) >= 0",
    ],
)
def test_a_domain_that_the_box_leaves_is_an_error(text: str) -> None:
    with pytest.raises(UndefinedError, match=r"not defined all over the box: .* must be"):
        bounds(parse(text), BOX)


@pytest.mark.parametrize("text", ["x / 0 >= 1", "1 / (2 - 2) >= x", "log(0) >= x", "sqrt(-1) >= x"])
def test_a_constant_without_a_value_is_an_error(text: str) -> None:
    with pytest.raises(UndefinedError, match="no value"):
        bounds(parse(text), BOX)


def test_input_is_checked() -> None:
    with pytest.raises(UnknownSignalError, match="formula uses signal 'w'; the box has x, y, z"):
        bounds(parse("w >= 0"), BOX)
    with pytest.raises(ValueError, match="finite with low <= high"):
        bounds(parse("x >= 0"), {"x": (0, math.inf)})
    with pytest.raises(ValueError, match="finite with low <= high"):
        bounds(parse("x >= 0"), {"x": (1, 0)})
    with pytest.raises(ValueError, match="without temporal operators"):
        bounds(parse("G[0,1] x >= 0"), BOX)
    with pytest.raises(ValueError, match="names"):
        bounds(parse("x >= 0"), [(0, 1)])
    with pytest.raises(ValueError, match="tolerance"):
        bounds(parse("x >= 0"), BOX, tolerance=0)


@pytest.mark.parametrize("psi", ["exp(x) - exp(x) >= 0", "0 * exp(x) >= 1", "(exp(x) - exp(2 * x)) ** 2 >= 0"])
def test_where_floats_have_no_margin_is_an_error_and_no_answer(psi: str) -> None:
    with pytest.raises(UndefinedError, match=r"has no value \(.* inf - inf\) where x = 1500"):
        bounds(parse(psi), {"x": (1000, 2000)})


def test_a_masked_box_is_refused() -> None:
    ends = np.ma.array([[0.0, 1.0]], mask=[[True, False]])
    for box, names in ((ends, ["x"]), ({"x": ends[0]}, None)):
        with pytest.raises(TypeError, match="masked array"):
            bounds(parse("x >= 0"), box, names)


@pytest.mark.parametrize("names", [["x", "x"], ["x", "y", "y"]])
def test_names_of_a_box_differ(names: list[str]) -> None:
    with pytest.raises(ValueError, match="signal names must differ, got x"):
        bounds(parse("x <= 2"), [(0.0, 1.0)] * len(names), names)


def test_one_text_names_no_signals() -> None:
    with pytest.raises(TypeError, match=r"names is a sequence of signal names, got one text; write \['xy'\]"):
        bounds(parse("x <= y"), [(0.0, 1.0), (5.0, 6.0)], "xy")


@pytest.mark.parametrize("ends", [(0, 1, 2), 1, (), [[0, 1]]])
def test_the_ends_of_a_box_are_two_numbers(ends: Any) -> None:
    with pytest.raises(ValueError, match="bounds of 'x' are two numbers, low and high, got "):
        bounds(parse("x <= 2"), {"x": ends})


def test_an_infinite_bound_is_not_tight() -> None:
    found = bounds(parse("exp(x) <= 2"), {"x": (0.0, 800.0)})
    assert (found.low, found.low_error, found.tight) == (-math.inf, math.inf, False)
    assert found.high_error < 1e-6


@pytest.mark.parametrize(("text", "value"), [("True", math.inf), ("False", -math.inf), ("x <= 1 | True", math.inf)])
def test_the_infinity_of_true_is_exact(text: str, value: float) -> None:
    found = bounds(parse(text), {"x": (0.0, 1.0)})
    assert (found.low, found.high, found.tight) == (value, value, True)
