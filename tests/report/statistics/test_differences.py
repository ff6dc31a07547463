"""What is said of two methods: the words, and the number of seeds that would decide."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy import stats

from stlbench.report.statistics.differences import MOST_SEEDS, Difference, Pair, differences

NORMAL = (stats.norm.ppf((np.arange(10) + 0.5) / 10) * 1.04).tolist()
"""Ten seeds that look as normal as ten can."""


def shifted(by, scale=1.0):
    return [by + scale * value for value in NORMAL]


def word(one, other, margin=None, **words):
    (found,) = differences([Pair(one, other, margin, **words)])
    return str(found)


def test_a_large_difference_is_better_one_way_and_worse_the_other():
    assert word(shifted(3), NORMAL) == "better"
    assert word(NORMAL, shifted(3)) == "worse"


def test_numbers_are_those_of_scipys_welch_test():
    one, other = shifted(0.4), shifted(0, 2)[:7]
    (found,) = differences([Pair(one, other)])
    expected = stats.ttest_ind(one, other, equal_var=False)
    assert found.chance == pytest.approx(expected.pvalue)
    assert found.interval == pytest.approx(tuple(expected.confidence_interval(0.95)))
    assert found.value == pytest.approx(np.mean(one) - np.mean(other))


def test_within_the_margin_there_is_no_difference_and_outside_nobody_can_tell():
    ends = differences([Pair(shifted(0.05), NORMAL)])[0].interval
    assert ends.low < 0 < ends.high
    wide = max(-ends.low, ends.high)
    assert word(shifted(0.05), NORMAL, wide + 0.01) == "no difference found"
    assert word(shifted(0.05), NORMAL, wide - 0.01).startswith("cannot tell, ")
    assert word(shifted(0.05), NORMAL) == f"cannot tell, over {MOST_SEEDS} seeds would"


def test_holms_correction_is_for_all_pairs_that_are_tested():
    one = shifted(1.2)
    (alone,) = differences([Pair(one, NORMAL)])
    assert 0.01 < alone.chance < 0.05
    assert alone.word == "better"
    many = differences([Pair(one, NORMAL), *[Pair(NORMAL, NORMAL)] * 4])
    assert many[0].chance == pytest.approx(5 * alone.chance)
    assert many[0].word == "cannot tell"
    alike = differences([Pair(one, NORMAL), *[Pair(NORMAL, NORMAL, alike=True)] * 4, Pair([1.0], NORMAL)])
    assert alike[0] == alone


def test_methods_that_are_paid_the_same_are_not_told_apart():
    (found,) = differences([Pair(shifted(3), NORMAL, alike=True)])
    assert (str(found), found.chance) == ("=", None)
    assert found.interval.low > 0


@pytest.mark.parametrize("few", [[], [0.3], [0.3, float("inf")]])
def test_too_few_seeds_can_tell_nothing(few):
    assert word(few, NORMAL, 10.0) == "cannot tell"


def test_seeds_that_all_agree():
    same = [0.5, 0.5, 0.5]
    assert differences([Pair(same, [0.2, 0.2])])[0] == Difference("better", 0.3, (0.3, 0.3), 0.0)
    assert word(same, same, 0.1) == "no difference found"
    with warnings.catch_warnings(action="error"):
        assert word(same, same) == f"cannot tell, over {MOST_SEEDS} seeds would"


def test_the_same_seeds_in_another_order_say_the_same():
    assert differences([Pair(shifted(1)[::-1], NORMAL, 0.2)]) == differences([Pair(shifted(1), NORMAL[::-1], 0.2)])


@pytest.mark.parametrize(("difference", "margin"), [(0.5, None), (0.8, 0.2), (0.0, 0.5)])
def test_the_number_of_seeds_decides_in_about_four_of_five_cases(difference, margin):
    (found,) = differences([Pair(shifted(difference), NORMAL, margin)])
    assert found.word == "cannot tell"
    generator, decided, rounds = np.random.default_rng(0), 0, 300
    for _ in range(rounds):
        one, other = generator.normal(difference, 1, found.seeds), generator.normal(0, 1, found.seeds)
        decided += differences([Pair(one.tolist(), other.tolist(), margin)])[0].word != "cannot tell"
    assert 0.68 < decided / rounds < 0.92  # 80 %, four standard errors of 300 cases, and what ten seeds hide
