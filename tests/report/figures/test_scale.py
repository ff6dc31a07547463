"""Axes that are logarithmic away from 0, and axes that end before what is orders of magnitude worse."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from stlbench.report.figures.layout import (
    Zoom,
    arrow_at_left,
    arrows_below,
    linear_threshold,
    number,
    set_symlog,
    window,
)


@pytest.mark.parametrize(
    ("value", "largest", "threshold"),
    [
        (0.0208, 101.9, 0.05),
        (1.66, 33.2, 2),
        (1.005, 50, 1),  # 1 % above
        (1.02, 50, 2),
        (1e-9, 100, 0.01),  # at most four decades
        (1.0, 10, None),  # a linear axis shows 1 beside -9
        (1.0, np.inf, None),
        (1.0, np.nan, None),
    ],
)
def test_the_data_choose_the_linear_part(value, largest, threshold):
    assert linear_threshold(value, largest) == threshold


@given(value=st.floats(1e-6, 1e6), times=st.floats(1, 1e6))
def test_the_value_lies_in_the_linear_part(value, times):
    threshold = linear_threshold(value, value * times)
    if threshold is not None:
        assert value <= 1.01 * threshold
        assert threshold >= value * times / 1.02e4
        assert f"{threshold:e}"[0] in "125"


@pytest.mark.parametrize(
    ("threshold", "low", "high", "numbers"),
    [
        (0.1, -102.0, 0.03, ["-100", "-10", "-1", "0"]),
        (0.05, -102.0, 0.04, ["-100", "-10", "-1", "-0.1", "0"]),
        (2.0, -40.0, 0.0, ["-20", "-10", "-5", "0"]),  # a short axis has numbers between the powers of ten
    ],
)
def test_an_axis_shows_all_values_and_says_what_it_does(threshold, low, high, numbers):
    axes = Figure().subplots()
    axes.plot([0, 1], [low, high])
    assert set_symlog(axes, threshold, low, high) == f"logarithmic beyond ±{threshold:g}"
    assert axes.yaxis.get_transform().linthresh == threshold
    ends = axes.get_ylim()
    assert ends[0] < low <= high <= ends[1]
    assert set(numbers) <= {label.get_text().replace("\N{MINUS SIGN}", "-") for label in axes.get_yticklabels()}
    assert all(tick == 0 or abs(tick) > 0.99 * threshold for tick in axes.get_yticks())
    assert axes.get_xscale() == "linear"


@pytest.mark.parametrize(
    ("groups", "shown"),
    [
        ([[-34.5, -101.9], [-0.0742, 0.03], [0.0043, 0.0208]], (-0.0742, 0.03)),
        ([[-33.2], [1.66], [1.85]], (-0.4625, 1.85)),  # 0 is always shown, and a quarter as much below it
        ([[-50.0, -2.0, 1.5, 1.6, 1.7]], (-2.0, 1.7)),  # a seed alone
        ([[-17.0], [1.8]], (-0.45, 1.8)),
        ([[-16.0], [1.8]], None),  # less than ten times as far
        ([[-30.0], [-33.0]], None),  # all alike
        ([[-1.0], [-30.0]], (-1.0, 0.0)),  # none is positive
        ([[0.0, -1e-4], [-0.001], [-0.06], [-2.0]], (-0.06, 0.0)),  # 0 is the best known
        ([[0.001], [5.0]], None),  # what is better is never cut off
        ([[], [np.nan]], None),
        ([[np.inf, -100.0], [1.0]], (-0.25, 1.0)),
    ],
)
def test_the_axis_ends_where_the_best_can_be_told_apart(groups, shown):
    assert window(groups) == (None if shown is None else pytest.approx(Zoom(*shown)))


@given(groups=st.lists(st.lists(st.floats(-1e6, 1e6), min_size=1), min_size=1))
def test_zero_and_the_best_are_always_shown(groups):
    shown = window(groups)
    if shown is not None:
        low, high = shown.limits
        assert low < 0 <= high
        assert high >= max(value for group in groups for value in group)
        assert any(value < shown.low for group in groups for value in group)


def test_numbers_have_three_digits():
    assert [number(value) for value in (-146.2, -0.01234, -12345.6)] == ["-146", "-0.0123", "-12,346"]


@pytest.mark.parametrize(
    "draw",
    [
        lambda axes: arrow_at_left(axes, 0.5, [("-147", "k"), ("-37.9", "b"), ("-2,100", "r")]),
        lambda axes: arrows_below(axes, [(f"-{i}00", "k") for i in range(1, 8)]),
    ],
    ids=["at the left", "seven below"],
)
def test_numbers_beside_arrows_do_not_touch(draw):
    figure = Figure(figsize=(3.5, 2.5))
    axes = figure.subplots()
    draw(axes)
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert all(first.x1 < second.x0 for first, second in pairwise(boxes))
