"""Means over drawn tasks: by hand, by laws, and how often their intervals cover what is true."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.studies import load
from scipy import stats

from stlbench.statistics import across
from stlbench.statistics.across import Ranking, ranking

TASKS = [*np.array([[0.1, 0.3], [0.4, 0.8], [0.9, 0.7], [0.2, 0.2], [1, 0.6], [0.5, 0.5], [0, 1], [0.3, 0.4]])]


def test_every_task_has_the_same_weight_however_many_seeds_it_has() -> None:
    assert across.sample_mean([np.array([1.0]), np.array([0.0, 0.0, 0.0])]).value == 0.5
    assert across.sample_difference([np.array([1.0, 0.0])], [np.array([0.25])]).value == 0.25


def test_fewer_than_eight_tasks_have_no_interval_and_the_order_changes_nothing() -> None:
    assert across.sample_mean(TASKS[:7]).interval is None
    assert across.sample_mean(TASKS).interval is not None
    assert across.sample_mean([seeds[::-1] for seeds in TASKS]) == across.sample_mean(TASKS)


def test_tasks_without_scatter_of_seeds_have_an_interval_about_as_wide_as_students() -> None:
    values = np.random.default_rng(0).normal(size=40)
    ends = across.sample_mean([np.full(3, value) for value in values]).interval
    half = stats.t.ppf(0.975, 39) * values.std(ddof=1) / 40**0.5
    assert ends == pytest.approx((values.mean() - half, values.mean() + half), abs=0.1 * half)


def test_the_interval_is_of_expanded_percentiles() -> None:
    """Eight tasks with 0 to 7, and one seed: the distribution of the sum of eight draws is a convolution."""
    sums = np.ones(1)
    for _ in range(8):
        sums = np.convolve(sums, np.full(8, 1 / 8))
    outside = stats.norm.cdf(stats.t.ppf(0.025, 7) * (8 / 7) ** 0.5)
    low = int(np.searchsorted(np.cumsum(sums), outside)) / 8
    assert across.sample_mean([np.full(1, value) for value in range(8)]).interval == pytest.approx((low, 7 - low))


def test_a_task_with_fewer_seeds_has_no_more_weight_in_resamples() -> None:
    uneven = [np.full(1 + value % 3, value) for value in range(8)]
    assert across.sample_mean(uneven) == across.sample_mean([np.full(3, value) for value in range(8)])


def test_both_methods_are_drawn_the_same_tasks() -> None:
    """Tasks differ by up to 1, and the methods by .2 on each."""
    more, less = ([np.full(2, at + gain) for at in range(8)] for gain in (0.2, 0.0))
    ends = across.sample_difference(more, less)
    assert ends.value == pytest.approx(0.2)
    assert ends.interval == pytest.approx((0.2, 0.2))


def test_where_all_seeds_learned_the_interval_is_exact() -> None:
    assert across.sample_share([[True, True]] * 8).interval == pytest.approx((0.025 ** (1 / 8), 1.0))
    assert across.sample_share([[False]] * 8).interval == pytest.approx((0.0, 1 - 0.025 ** (1 / 8)))


def test_the_interval_of_a_share_counts_parts_of_a_success() -> None:
    """Of ten tasks one is learned by one of two seeds: half a success of ten trials, by the beta distribution."""
    found = across.sample_share([[True, False]] + [[False, False]] * 9)
    ends = stats.beta.ppf(0.025, 0.5, 10.5), stats.beta.ppf(0.975, 1.5, 9.5)
    assert found.value == 0.05
    assert found.interval == pytest.approx(ends)
    assert across.sample_share([[True]] * 7).interval is None


def test_the_interval_of_a_difference_of_shares_adds_a_task_that_each_method_wins() -> None:
    """Eight tasks, all learned by the first alone; with the two more the mean is .8 and the variance 3.6 / 9."""
    found = across.sample_share_difference([[True, True]] * 8, [[False, False]] * 8)
    low = 0.8 - stats.t.ppf(0.975, 9) * (3.6 / 9 / 10) ** 0.5
    assert found.value == 1.0
    assert found.interval == pytest.approx((low, 1.0))
    assert across.sample_share_difference([[True]] * 7, [[False]] * 7).interval is None


def test_the_interval_of_a_difference_of_shares_has_the_difference_in_it() -> None:
    for won in (0, 1, 50, 100, 400):
        found = across.sample_share_difference([[True]] * won + [[False]] * (400 - won), [[False]] * 400)
        assert found.interval.low <= found.value <= found.interval.high


@pytest.mark.parametrize(
    ("family", "tasks", "least"),
    [("score, normal", 12, 0.9), ("share 0.03", 8, 0.94), ("share 0.6", 24, 0.94), ("shares 0.05 less 0", 12, 0.94)],
)
def test_coverage(family: str, tasks: int, least: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over 400 samples of tasks with one seed: nominal is .95, and its standard error .011.

    Resamples of tasks cover .26 of the samples of a share of .03, and .41 of those of a difference of .05.
    """
    monkeypatch.setattr(across, "SAMPLE_RESAMPLES", 999)
    assert load("interval_coverage").drawn_coverage(family, tasks, 1, 400) >= least


# ------------------------------------------------------------------------------------------------------------ ranks


@pytest.mark.parametrize(("methods", "quantile"), [(3, 2.343), (4, 2.569), (10, 3.164)])
def test_the_critical_difference_is_that_of_demsars_table(methods: int, quantile: float) -> None:
    values = np.random.default_rng(0).normal(size=(14, methods))
    expected = quantile * (methods * (methods + 1) / (6 * 14)) ** 0.5
    assert ranking(values).difference == pytest.approx(expected, abs=1e-3)


def test_ranks_by_hand() -> None:
    """The first is best on three tasks and shares the second place on the fourth."""
    found = ranking(np.array([[3.0, 2.0, 1.0], [3.0, 1.0, 2.0], [9.0, 2.0, 1.0], [1.0, 1.0, 5.0]]))
    assert found.ranks == ((3 * 1 + 2.5) / 4, (2 + 3 + 2 + 2.5) / 4, (3 + 2 + 3 + 1) / 4)
    assert 0.05 < found.chance < 1


def test_methods_that_are_never_apart_are_alike_by_chance_1() -> None:
    found = ranking(np.ones((6, 3)))
    assert found.ranks == (2.0, 2.0, 2.0)
    assert found.chance == 1.0


def test_sets_that_may_be_alike_are_as_large_as_possible() -> None:
    assert Ranking((1.0, 3.5, 1.9, 2.6), 0.01, 1.0).alike == [(0, 2), (2, 3), (3, 1)]
    assert Ranking((1.0, 1.2, 1.9), 0.5, 1.0).alike == [(0, 1, 2)]
    assert Ranking((1.0, 3.0), 0.01, 1.0).alike == []
