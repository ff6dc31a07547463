"""Axes that end before what is orders of magnitude worse."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from stlbench.report.figures.layout import Window, arrow_at_left, arrows_below, number, window


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
    assert window(groups) == (None if shown is None else pytest.approx(Window(*shown)))


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


def test_numbers_beside_a_row_do_not_touch():
    figure = Figure()
    axes = figure.subplots()
    arrow_at_left(axes, 0.5, [("-147", "k"), ("-37.9", "b"), ("-2,100", "r")])
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert all(first.x1 < second.x0 for first, second in pairwise(boxes))


def test_seven_numbers_under_an_axis_do_not_touch():
    figure = Figure(figsize=(3.5, 2.5))
    axes = figure.subplots()
    arrows_below(axes, [(f"-{i}00", "k") for i in range(1, 8)])
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert all(first.x1 < second.x0 for first, second in pairwise(boxes))
