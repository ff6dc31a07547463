"""The median and the mean with their intervals, and intervals of shares, against SciPy and values by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from stlbench.report.statistics.intervals import mean_interval, median, median_interval, share_interval

seeds = st.lists(st.floats(-10, 10), min_size=2, max_size=12)


def test_the_median_of_an_even_number_lies_between_the_two_in_the_middle():
    assert median([5, 1, 3]) == 3
    assert median([100, 1, 2, 4]) == 3


@pytest.mark.parametrize(("count", "outside"), [(5, 0), (8, 0), (9, 1), (10, 1), (12, 2), (20, 5), (100, 39)])
def test_the_interval_leaves_out_as_many_seeds_as_a_coin_allows(count, outside):
    """By hand: of 10 tosses at most 1 is heads in 11 of 1,024 cases, so 2 * 1.07 % are missed; at most 2, 2 * 5.5 %."""
    values = np.random.default_rng(count).permutation(count).astype(float)
    assert median_interval(values.tolist()) == (outside, count - 1 - outside)
    missed = 2 * stats.binom.cdf([outside, outside + 1], count, 0.5)
    assert missed[1] > 0.05
    assert missed[0] <= (0.0625 if count == 5 else 0.05)


@pytest.mark.parametrize("values", [[], [0.3] * 4, [float("-inf"), 0.1, 0.2, 0.3, 0.4]])
def test_no_interval_of_fewer_than_five_seeds_or_of_no_number(values):
    assert median_interval(values) is None


def test_constant_values_have_an_interval_without_width():
    assert median_interval([0.5] * 5) == mean_interval([0.5, 0.5, 0.5]) == (0.5, 0.5)


@settings(max_examples=25, deadline=None)
@given(seeds, st.randoms())
def test_intervals_depend_on_the_values_and_not_on_their_order_and_that_of_the_median_stays_among_them(values, random):
    shuffled = values.copy()
    random.shuffle(shuffled)
    assert mean_interval(values) == mean_interval(shuffled)
    found = median_interval(values)
    assert found == median_interval(shuffled)
    assert found is None or min(values) <= found.low <= median(values) <= found.high <= max(values)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_the_interval_of_the_mean_is_students(values):
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    if np.ptp(values) > 1e-6:
        assert mean_interval(values) == pytest.approx(tuple(expected), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("values", [[], [0.3], [0.3, float("inf")], [float("nan"), 0.1]])
def test_no_interval_of_the_mean_without_two_finite_values(values):
    assert mean_interval(values) is None


def test_interval_of_a_share():
    low, high = share_interval(10, 10)
    assert (low, high) == (pytest.approx(0.025**0.1), 1.0)  # with p^10 = 2.5 % all ten succeed in 2.5 % of cases
    assert share_interval(0, 10) == pytest.approx((0.0, 1 - 0.025**0.1))
    low, high = share_interval(950, 1000)
    assert stats.binom.sf(949, 1000, low) == pytest.approx(0.025)
    assert stats.binom.cdf(950, 1000, high) == pytest.approx(0.025)
    assert share_interval(0, 0) is None
