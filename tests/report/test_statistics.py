"""The interquartile mean and the bootstrap interval, against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from stlbench.report.statistics import interval, iqm

seeds = st.lists(st.floats(-10, 10), min_size=2, max_size=12)


def test_iqm_of_eight_values_is_the_mean_of_the_middle_four():
    assert iqm([100, 1, 2, 3, 4, 5, 6, -100]) == pytest.approx((2 + 3 + 4 + 5) / 4)


def test_iqm_of_three_values_is_the_mean():
    assert iqm([0.1, 0.2, 0.6]) == pytest.approx(0.3)


def test_iqm_works_along_an_axis():
    assert iqm(np.array([[0.0, 1.0, 2.0, 9.0], [4.0, 4.0, 4.0, 4.0]]), axis=1) == pytest.approx([1.5, 4.0])


def test_interval_of_two_values_is_their_range():
    # Means of resamples of {0, 1}: 0, 1/2, 1 with probabilities 1/4, 1/2, 1/4; both 2.5 % tails end at 0 and 1.
    assert interval([0.0, 1.0], np.mean) == (0.0, 1.0)


def test_a_low_level_leaves_the_median_resample():
    assert interval([0.0, 1.0], np.mean, level=0.4) == (0.5, 0.5)


@pytest.mark.parametrize("values", [[], [0.3], [0.3, float("inf")], [float("nan"), 0.1]])
def test_no_interval_without_two_finite_values(values):
    assert interval(values, np.mean) is None


def test_constant_values_have_an_interval_without_width():
    assert interval([0.3, 0.3, 0.3], iqm) == (0.3, 0.3)


@settings(max_examples=25, deadline=None)
@given(seeds, st.randoms())
def test_interval_depends_on_the_values_and_not_on_their_order(values, random):
    shuffled = values.copy()
    random.shuffle(shuffled)
    assert interval(values, iqm) == interval(shuffled, iqm)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_interval_lies_within_the_values(values):
    found = interval(values, np.mean)
    assert found is not None
    assert min(values) - 1e-9 <= found[0] <= found[1] <= max(values) + 1e-9


def test_interval_is_that_of_the_normal_theory_for_many_values():
    values = np.random.default_rng(3).normal(size=400)
    low, high = interval(values, np.mean)
    half = 1.96 * values.std() / 20
    assert (low, high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.01)


@pytest.mark.parametrize("statistic", [iqm, np.mean])
@pytest.mark.parametrize("count", [2, 3, 5, 10, 400])
def test_both_are_those_of_scipy(count, statistic):
    """SciPy draws the same resamples from the same generator, 400 values in batches."""
    values, batch = np.random.default_rng(count).normal(size=count), 1_000_000 // count
    assert iqm(values) == stats.trim_mean(values, 0.25)
    settings = {"method": "percentile", "batch": batch, "rng": np.random.default_rng(7)}
    expected = stats.bootstrap((np.sort(values),), statistic, confidence_level=0.9, **settings).confidence_interval
    assert interval(values, statistic, seed=7, level=0.9) == pytest.approx(tuple(expected), rel=1e-12)
