"""The interquartile mean and its interval, and intervals of shares, against SciPy and values worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from stlbench.report.statistics.intervals import interval, iqm, share_interval

seeds = st.lists(st.floats(-10, 10), min_size=2, max_size=12)


def test_iqm_of_eight_values_is_the_mean_of_the_middle_four():
    assert iqm([100, 1, 2, 3, 4, 5, 6, -100]) == pytest.approx((2 + 3 + 4 + 5) / 4)


def test_iqm_of_three_values_is_the_mean():
    assert iqm([0.1, 0.2, 0.6]) == pytest.approx(0.3)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8, 10, 11])
def test_iqm_is_scipys_trimmed_mean(count):
    values = np.random.default_rng(count).normal(size=count).tolist()
    assert iqm(values) == pytest.approx(stats.trim_mean(values, 0.25), rel=1e-12)


@pytest.mark.parametrize("values", [[], [0.3], [0.3, float("inf")], [float("nan"), 0.1]])
def test_no_interval_without_two_finite_values(values):
    assert interval(values) is None


def test_constant_values_have_an_interval_without_width():
    assert interval([0.5, 0.5, 0.5]) == (0.5, 0.5)


@settings(max_examples=25, deadline=None)
@given(seeds, st.randoms())
def test_interval_depends_on_the_values_and_not_on_their_order(values, random):
    shuffled = values.copy()
    random.shuffle(shuffled)
    assert interval(values) == interval(shuffled)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_without_a_cut_it_is_students_interval_of_the_mean(values):
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    if np.ptp(values) > 1e-6:
        assert interval(values, cut=0) == pytest.approx(tuple(expected), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("count", [3, 4, 5, 9, 10])
def test_the_error_is_that_of_scipys_trimmed_test(count):
    """Its statistic is the difference of the trimmed means by the root of both squared errors, here twice the same."""
    values = np.random.default_rng(count).normal(size=count).tolist()
    low, high = interval(values)
    left = count - 2 * (count // 4)
    error = (high - low) / 2 / stats.t.ppf(0.975, left - 1)
    there = [value + 1 for value in values]
    statistic = stats.ttest_ind(values, there, equal_var=False, trim=0.25).statistic
    assert statistic == pytest.approx(-1 / (error * math.sqrt(2)), rel=1e-9)


def test_a_bad_seed_of_ten_does_not_move_the_interval():
    good = [1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.98, 1.01, 0.99]
    assert interval([*good, 0.9]) == interval([*good, -50.0])


def test_interval_of_a_share():
    low, high = share_interval(10, 10)
    assert (low, high) == (pytest.approx(0.025**0.1), 1.0)  # with p^10 = 2.5 % all ten succeed in 2.5 % of cases
    assert share_interval(0, 10) == pytest.approx((0.0, 1 - 0.025**0.1))
    low, high = share_interval(950, 1000)
    assert stats.binom.sf(949, 1000, low) == pytest.approx(0.025)
    assert stats.binom.cdf(950, 1000, high) == pytest.approx(0.025)
    assert share_interval(0, 0) is None
