"""Medians, means, shares and curves with their intervals, against SciPy and values by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from stlbench.statistics import intervals

seeds = st.lists(st.floats(-10, 10), min_size=2, max_size=12)


def test_the_median_of_an_even_number_lies_between_the_two_in_the_middle():
    assert intervals.median([5, 1, 3]) == 3
    assert intervals.median([100, 1, 2, 4]) == 3


@pytest.mark.parametrize(("count", "outside"), [(5, 0), (8, 0), (9, 1), (10, 1), (12, 2), (20, 5), (100, 39)])
def test_the_interval_leaves_out_as_many_seeds_as_a_coin_allows(count, outside):
    """By hand: of 10 tosses at most 1 is heads in 11 of 1,024 cases, so 2 * 1.07 % are missed; at most 2, 2 * 5.5 %."""
    values = np.random.default_rng(count).permutation(count).astype(float)
    assert intervals.median_interval(values.tolist()) == (outside, count - 1 - outside)
    missed = 2 * stats.binom.cdf([outside, outside + 1], count, 0.5)
    assert missed[1] > 0.05
    assert missed[0] <= (0.0625 if count == 5 else 0.05)


def test_constant_values_have_an_interval_without_width():
    assert intervals.median_interval([0.5] * 5) == intervals.mean_interval([0.5, 0.5, 0.5]) == (0.5, 0.5)


@settings(max_examples=25, deadline=None)
@given(seeds, st.randoms())
def test_intervals_do_not_depend_on_the_order_and_the_median_s_is_among_the_values(values, random):
    shuffled = values.copy()
    random.shuffle(shuffled)
    assert intervals.mean_interval(values) == intervals.mean_interval(shuffled)
    found = intervals.median_interval(values)
    assert found == intervals.median_interval(shuffled)
    assert found is None or min(values) <= found.low <= intervals.median(values) <= found.high <= max(values)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_the_interval_of_the_mean_is_students(values):
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    if np.ptp(values) > 1e-6:
        assert intervals.mean_interval(values) == pytest.approx(tuple(expected), rel=1e-9, abs=1e-9)


def test_no_interval_of_too_few_values_or_of_what_is_not_finite():
    """Two for the mean, five for the median."""
    for values in ([], [0.3], [0.3, math.inf], [math.nan, 0.1]):
        assert intervals.mean_interval(values) is None
    for values in ([], [0.3] * 4, [-math.inf, 0.1, 0.2, 0.3, 0.4]):
        assert intervals.median_interval(values) is None


def test_interval_of_a_share():
    low, high = intervals.share_interval(10, 10)
    assert (low, high) == (pytest.approx(0.025**0.1), 1.0)  # with p^10 = 2.5 % all ten succeed in 2.5 % of cases
    assert intervals.share_interval(0, 10) == pytest.approx((0.0, 1 - 0.025**0.1))
    low, high = intervals.share_interval(950, 1000)
    assert stats.binom.sf(949, 1000, low) == pytest.approx(0.025)
    assert stats.binom.cdf(950, 1000, high) == pytest.approx(0.025)
    assert intervals.share_interval(0, 0) is None


def test_checkpoints_at_other_steps_are_interpolated_where_all_seeds_have_some():
    curves = [((0, 0.0, 0.0), (100, 1.0, 10.0)), ((50, 0.0, 0.0), (150, 1.0, 10.0))]
    steps, values = intervals.aligned(curves, lambda point: point[2])
    assert list(steps) == [50, 100]
    assert values.tolist() == [[5.0, 10.0], [0.0, 5.0]]


@pytest.mark.parametrize(("first", "common"), [(100, True), (101, False)])
def test_curves_overlap_from_the_latest_first_to_the_earliest_last_checkpoint(first: int, common: bool) -> None:
    curves = [((0, 0.0, 0.0), (100, 1.0, 10.0)), ((first, 0.0, 0.0), (150, 1.0, 10.0))]
    assert intervals.overlap(curves) is intervals.overlap(curves[::-1]) is common
    assert intervals.overlap(curves[:1])


def test_the_mean_has_the_t_interval_of_the_seeds() -> None:
    curves = [((0, 0.0, first), (10, 0.0, last)) for first, last in ((1.0, 2.0), (3.0, 2.5), (5.0, 6.0))]
    found = intervals.mean_curve(curves, lambda point: point[2])
    assert found.mean.tolist() == [3.0, 3.5]
    half = stats.t.ppf(0.975, 2) * 2.0 / np.sqrt(3)  # 1, 3 and 5 have a standard deviation of 2
    assert (found.low[0], found.high[0]) == pytest.approx((3.0 - half, 3.0 + half))
    assert (found.least, found.most) == (1.0, 6.0)
    alone = intervals.mean_curve(curves[:1], lambda point: point[2])
    assert np.isnan([alone.low, alone.high]).all()


def test_the_evidence_is_the_average_likelihood_by_the_likelihood() -> None:
    def weighted(share: float) -> float:
        return share**7 * (1 - share) ** 3 * float(stats.beta.pdf(share, 0.5, 0.5))

    average, _ = integrate.quad(weighted, 0, 1)
    assert math.exp(intervals.log_evidence(7, 10, 0.4)) == pytest.approx(average / (0.4**7 * 0.6**3))


def test_by_hand_after_one_success_and_without_trials() -> None:
    """The average likelihood of one success is 1/2, so shares below 1/2 * (1 - level) are refuted."""
    assert intervals.share_sequence(1, 1, 0.9) == pytest.approx((0.05, 1.0))
    assert intervals.share_sequence(0, 1, 0.9) == pytest.approx((0.0, 0.95))
    assert intervals.share_sequence(0, 0, 0.99) == (0, 1)


@pytest.mark.parametrize(("successes", "trials"), [(0, 50), (50, 50), (7, 50), (499, 500), (3, 5)])
def test_the_ends_are_where_the_evidence_reaches_its_limit(successes: int, trials: int) -> None:
    low, high = intervals.share_sequence(successes, trials, 0.95)
    assert low <= successes / trials <= high
    for end in (low, high):
        if 0 < end < 1:
            assert intervals.log_evidence(successes, trials, end) == pytest.approx(math.log(20), abs=1e-6)
    mirrored = intervals.share_sequence(trials - successes, trials, 0.95)
    assert (1 - mirrored.high, 1 - mirrored.low) == pytest.approx((low, high), abs=1e-9)


def test_it_is_wider_than_the_interval_of_a_fixed_number_and_narrows() -> None:
    exact = intervals.share_interval(90, 100, 0.95)
    assert exact is not None
    one, more = intervals.share_sequence(90, 100, 0.95), intervals.share_sequence(900, 1000, 0.95)
    assert one.low < exact.low < exact.high < one.high
    assert one.low < more.low < 0.9 < more.high < one.high


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_the_share_is_covered_at_all_times_at_once(share: float) -> None:
    """400 sequences of 1,000 trials, each looked at after every trial, at 90 %: at most 10 % may ever miss.

    The exact interval, looked at as often, misses far more.
    """
    successes = (np.random.default_rng(7).random((400, 1000)) < share).cumsum(axis=1)
    trials = np.arange(1, 1001)
    missed = (intervals.log_evidence(successes, trials, share) > math.log(10)).any(axis=1)
    assert missed.mean() <= 0.10
    below = stats.binom.cdf(successes, trials, share)
    assert (below < 0.05).any(axis=1).mean() > 0.13
