"""Confidence sequences of a share: by hand, and their coverage at all times by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, stats

from stlbench.report.statistics.intervals import log_evidence, share_interval, share_sequence


def test_the_evidence_is_the_average_likelihood_by_the_likelihood() -> None:
    def weighted(share: float) -> float:
        return share**7 * (1 - share) ** 3 * float(stats.beta.pdf(share, 0.5, 0.5))

    average, _ = integrate.quad(weighted, 0, 1)
    assert math.exp(log_evidence(7, 10, 0.4)) == pytest.approx(average / (0.4**7 * 0.6**3))


def test_by_hand_after_one_success() -> None:
    """The average likelihood of one success is 1/2, so shares below 1/2 * (1 - level) are refuted."""
    assert share_sequence(1, 1, 0.9) == pytest.approx((0.05, 1.0))
    assert share_sequence(0, 1, 0.9) == pytest.approx((0.0, 0.95))


def test_without_trials_nothing_is_known() -> None:
    assert share_sequence(0, 0, 0.99) == (0, 1)


@pytest.mark.parametrize(("successes", "trials"), [(0, 50), (50, 50), (7, 50), (499, 500), (3, 5)])
def test_the_ends_are_where_the_evidence_reaches_its_limit(successes: int, trials: int) -> None:
    low, high = share_sequence(successes, trials, 0.95)
    assert low <= successes / trials <= high
    for end in (low, high):
        if 0 < end < 1:
            assert log_evidence(successes, trials, end) == pytest.approx(math.log(20), abs=1e-6)
    mirrored = share_sequence(trials - successes, trials, 0.95)
    assert (1 - mirrored.high, 1 - mirrored.low) == pytest.approx((low, high), abs=1e-9)


def test_it_is_wider_than_the_interval_of_a_fixed_number_and_narrows() -> None:
    exact = share_interval(90, 100, 0.95)
    assert exact is not None
    one, more = share_sequence(90, 100, 0.95), share_sequence(900, 1000, 0.95)
    assert one.low < exact.low < exact.high < one.high
    assert one.low < more.low < 0.9 < more.high < one.high


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_the_share_is_covered_at_all_times_at_once(share: float) -> None:
    """2,000 sequences of 1,000 trials, each looked at after every trial, at 90 %: at most 10 % may ever miss.

    The exact interval, looked at as often, misses far more.
    """
    successes = (np.random.default_rng(7).random((2000, 1000)) < share).cumsum(axis=1)
    trials = np.arange(1, 1001)
    missed = (log_evidence(successes, trials, share) > math.log(10)).any(axis=1)
    assert missed.mean() <= 0.10
    below, above = stats.binom.cdf(successes, trials, share), stats.binom.sf(successes - 1, trials, share)
    assert ((below < 0.05) | (above < 0.05)).any(axis=1).mean() > 0.25
