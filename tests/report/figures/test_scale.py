"""Axes that are logarithmic away from 0: when, from where on, and with which numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from stlbench.report.figures.layout import linear_threshold, set_symlog, symlog_ticks


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


def test_a_long_axis_has_a_number_at_each_power_of_ten():
    major, minor = symlog_ticks(0.1, -102, 0.1)
    assert major == [-100, -10, -1, -0.1, 0, 0.1]
    assert minor[:3] == [-90, -80, -70]
    assert len(minor) == 3 * 8


def test_a_short_axis_has_numbers_between():
    assert symlog_ticks(2.0, -40, 0)[0] == [-20, -10, -5, -2, 0]


def test_numbers_do_not_touch_where_the_threshold_is_near_a_power_of_ten():
    assert symlog_ticks(0.05, -102, 0)[0] == [-100, -10, -1, -0.05, 0]


def test_an_axis_shows_all_values_and_says_what_it_does():
    axes = Figure().subplots()
    axes.plot([0, 1], [-102.0, 0.03])
    assert set_symlog(axes, 0.1, -102.0, 0.03) == "logarithmic beyond ±0.1"
    assert axes.get_yscale() == "symlog"
    assert axes.yaxis.get_transform().linthresh == 0.1
    low, high = axes.get_ylim()
    assert low < -102
    assert high > 0.1  # the end of the linear part has a number
    assert [label.get_text() for label in axes.get_yticklabels()] == ["-100", "-10", "-1", "-0.1", "0", "0.1"]
    assert axes.get_xscale() == "linear"


def test_an_end_within_the_linear_part_has_a_number():
    assert symlog_ticks(5.0, -33, 2.3)[0] == [-20, -10, -5, 0, 2]
    assert symlog_ticks(5.0, -33, 0.3)[0] == [-20, -10, -5, 0]
