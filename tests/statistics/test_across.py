"""Aggregates over tasks, against rliable 1.2.0, whose answers are written down here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from stlbench.statistics import across

ONE = [
    [0.902, 0.874, 0.928, 0.808, 0.934, 0.923],
    [1.008, 0.511, 0.583, 1.07, 0.559, 0.847],
    [0.545, 0.195, 0.449, 0.281, 0.224, 0.259],
]
OTHER = [
    [0.835, 0.699, 0.658, 0.731, 0.94, 0.888],
    [0.769, 0.739, 0.619, 0.551, 0.677, 0.772],
    [0.089, 0.149, 0.21, 0.361, 0.127, 0.26],
]
RLIABLE = {
    ("mean", "ONE"): (0.66111111, 0.59366667, 0.73172222),
    ("mean", "OTHER"): (0.55966667, 0.5173875, 0.60266667),
    ("middle", "ONE"): (0.7001, 0.6017, 0.7865025),
    ("middle", "OTHER"): (0.6064, 0.5562, 0.6527),
}
"""From `get_interval_estimates` with 50,000 resamples: value, low, high."""
RESAMPLING = 0.004
"""What two bootstraps may differ by at the ends of an interval: four standard errors of the quantiles of 10,000."""


def runs(tasks):
    return [np.array(seeds) for seeds in tasks]


@pytest.mark.parametrize(("statistic", "method"), RLIABLE)
def test_aggregates_are_those_of_rliable(statistic, method):
    value, ends = getattr(across, statistic)(runs(globals()[method]))
    expected, low, high = RLIABLE[statistic, method]
    assert value == pytest.approx(expected, abs=1e-8)
    assert ends == pytest.approx((low, high), abs=RESAMPLING)


def test_probability_of_improvement_is_that_of_rliable():
    value, ends = across.improvement(runs(ONE), runs(OTHER))
    assert value == pytest.approx(0.69444444, abs=1e-8)
    assert ends == pytest.approx((0.5, 0.87037037), abs=1 / 54 + 1e-9)  # one pair of runs of 108 twice
    back, mirrored = across.improvement(runs(OTHER), runs(ONE))
    assert back == pytest.approx(1 - value)
    assert mirrored == pytest.approx((1 - ends.high, 1 - ends.low), abs=1 / 54 + 1e-9)


def test_a_profile_is_that_of_rliable():
    found = across.profile(runs(ONE), np.array([0, 0.3, 0.5, 0.7, 0.9]))
    assert [value for value, _ in found] == pytest.approx([1.0, 0.77777778, 0.72222222, 0.5, 0.33333333])
    low, high = zip(*(ends for _, ends in found), strict=True)
    assert low == pytest.approx([1.0, 0.66666667, 0.66666667, 0.38888889, 0.16666667])
    assert high == pytest.approx([1.0, 0.88888889, 0.83333333, 0.61111111, 0.5])


def apart(*methods):
    """Runs of each method -> what `ranks` takes, where all fit every task and no two are paid the same."""
    return [list(enumerate(on_task)) for on_task in zip(*methods, strict=True)]


def test_ranks_by_hand():
    third = [[0.99] * 6, [0.1] * 6, [0.25] * 6]
    first, second, last = across.ranks(apart(runs(ONE), runs(OTHER), runs(third)))
    assert (first.value, second.value, last.value) == pytest.approx(((2 + 1 + 1) / 3, (3 + 2 + 3) / 3, (1 + 3 + 2) / 3))
    assert 1 <= first.interval.low <= first.value <= first.interval.high <= 3


def test_methods_that_are_exactly_as_good_share_a_rank():
    assert [rank.value for rank in across.ranks(apart(runs(ONE), runs(ONE)))] == [1.5, 1.5]


def test_one_run_of_a_task_has_a_value_and_no_interval():
    few = runs([[0.5], [0.2, 0.4]])
    assert across.mean(few) == (pytest.approx(1.1 / 3), None)
    assert across.ranks(apart(few, few))[0] == (1.5, None)
    assert across.profile(few, np.array([0.3]))[0] == (pytest.approx(0.75), None)


def test_the_order_of_seeds_does_not_matter_and_each_call_gives_the_same():
    assert across.middle(runs(ONE)) == across.middle(runs([seeds[::-1] for seeds in ONE])) == across.middle(runs(ONE))


def test_shares_of_pairs_are_those_counted_one_by_one():
    pairs = [([0.0, 1.0, 1.0], [1.0, 0.5], (0 + 0 + 0.5 + 1 + 0.5 + 1) / 6), ([2.0] * 3, [2.0, 3.0], (0.5 * 3 + 0) / 6)]
    for one, other, share in pairs:
        assert across.improvement(runs([one]), runs([other])).value == pytest.approx(share, abs=1e-15)


def test_of_many_runs_no_more_are_drawn_and_no_more_are_held(monkeypatch):
    """As many resamples as draw 50 million runs, 999 at least; 2.5 million runs at a time, but always one resample."""
    calls = []
    real = stats.bootstrap

    def watched(data, statistic, **options):
        calls.append((options["n_resamples"], options["batch"]))
        return real(data, statistic, **options | {"n_resamples": 3, "batch": 1})

    monkeypatch.setattr(stats, "bootstrap", watched)
    for count in (5_000, 20_000, 100_000, 3_000_000):
        across.mean([np.zeros(count)])
    assert calls == [(9999, 500), (2500, 125), (999, 25), (999, 1)]
