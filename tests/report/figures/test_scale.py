"""Axes that are logarithmic away from 0: when, from where on, and with which numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from stlbench.report.figures.axes import linear_threshold, set_symlog, symlog_ticks


@pytest.mark.parametrize(
    ("groups", "threshold"),
    [
        ([[-34.5, -101.9], [-0.0742, 0.03], [0.0043, 0.0208]], 0.1),  # the pendulum: .0742 is less than 5 x .0208
        ([[-33.2], [1.66], [1.85]], 2),
        ([[-50.0], [1.0], [6.0]], 1),  # 6 is too far from 1 to be in the linear part with it
        ([[-50.0], [1.005]], 1),  # 1 % above
        ([[-50.0], [1.02]], 2),
        ([[-50.0], [0.0], [2.5]], 5),  # a group at 0 asks for nothing
        ([[-100.0], [1e-9]], 0.01),  # at most four decades
        ([[-10.0], [1.0]], None),  # a linear axis shows 1 beside -9
        ([[0.0], [0.0]], None),
        ([], None),
        ([[]], None),
        ([[np.nan], [-50.0, np.inf], [1.0]], 1),
    ],
)
def test_the_data_choose_the_linear_part(groups, threshold):
    largest = max((abs(value) for group in groups for value in group if np.isfinite(value)), default=0.0)
    assert linear_threshold(groups, largest) == threshold


@pytest.mark.parametrize("largest", [np.inf, np.nan])
def test_without_a_largest_value_the_axis_stays_linear(largest):
    assert linear_threshold([[1.0]], largest) is None


FINITE = st.floats(-1e6, 1e6, allow_subnormal=False)


@given(groups=st.lists(st.lists(FINITE, min_size=1), min_size=1))
def test_the_group_nearest_to_zero_lies_in_the_linear_part(groups):
    extents = [max(map(abs, group)) for group in groups]
    threshold = linear_threshold(groups, max(extents))
    if threshold is not None:
        least = min(extent for extent in extents if extent > 0)
        assert least <= 1.01 * threshold
        assert threshold >= max(extents) / 1.02e4
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
    axes.plot([-102.0, 0.03], [0, 1])
    assert set_symlog(axes, "x", 0.1, -102.0, 0.03) == "logarithmic beyond ±0.1"
    assert axes.get_xscale() == "symlog"
    assert axes.xaxis.get_transform().linthresh == 0.1
    low, high = axes.get_xlim()
    assert low < -102
    assert high > 0.1  # the end of the linear part has a number
    assert [label.get_text() for label in axes.get_xticklabels()] == ["-100", "-10", "-1", "-0.1", "0", "0.1"]
    assert axes.get_yscale() == "linear"


def test_an_end_within_the_linear_part_has_a_number():
    assert symlog_ticks(5.0, -33, 2.3)[0] == [-20, -10, -5, 0, 2]
    assert symlog_ticks(5.0, -33, 0.3)[0] == [-20, -10, -5, 0]
