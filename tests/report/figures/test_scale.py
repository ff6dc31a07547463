"""Axes that are logarithmic away from 0: when, from where on, and with which numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from stlbench.report.figures.layout import linear_threshold, set_symlog


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
    assert axes.get_xscale() == "linear"
