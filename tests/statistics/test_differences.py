"""What is said of two methods: the words, the number of seeds that would decide, and corrected p-values."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy import stats

from stlbench.statistics import differences as tested
from stlbench.statistics.differences import MOST_SEEDS, Look, Pair, _statistics, differences, exact_test, holm

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


def test_the_interval_is_that_of_scipys_welch_test():
    one, other = shifted(0.4), shifted(0, 2)[:7]
    (found,) = differences([Pair(one, other)])
    expected = stats.ttest_ind(one, other, equal_var=False)
    assert found.interval == pytest.approx(tuple(expected.confidence_interval(0.95)))
    assert found.value == pytest.approx(np.mean(one) - np.mean(other))
    assert found.alone == found.chance == min(look.chance for look in exact_test(*Pair(one, other).samples))


def test_a_complete_separation_of_ten_seeds_is_decided_among_a_hundred_pairs():
    """Welch's test alone had p = 0.03 here: the seeds that failed have a tail. So it was on `cartpole`."""
    failed = [-0.1, -0.2, -0.2, -0.3, -0.3, -0.4, -0.5, -0.8, -2.0, -6.0]
    learned = [0.09 + 0.001 * i for i in range(10)]
    pair = Pair(failed, learned, learned=([False] * 10, [True] * 10))
    assert stats.ttest_ind(failed, learned, equal_var=False).pvalue > 0.05
    found, *_ = differences([pair, *[Pair(NORMAL, NORMAL)] * 99])
    assert (found.word, found.decided) == ("worse", ("mean", "rank", "learned"))


def test_a_respect_decides_if_it_does_after_the_correction_that_its_pair_paid(monkeypatch):
    """Two pairs have p .01, and .02 by Holm. So the rank's .03 becomes .06, which decides nothing."""
    looks = (Look("mean", 0.01, 1), Look("rank", 0.03, -1), Look("learned", 0.024, 1))
    monkeypatch.setattr(tested, "exact_test", lambda one, other: looks)
    for found in differences([Pair(shifted(1), NORMAL)] * 2):
        assert (found.alone, found.chance, found.word) == (0.01, 0.02, "better")
        assert found.decided == ("mean", "learned")


def test_one_seed_has_a_difference_and_no_more():
    for alike in (False, True):
        (found,) = differences([Pair([1.0], [0.25], alike=alike)])
        assert (found.value, found.interval, found.chance) == (0.75, None, None)
    (same,) = differences([Pair([1.0, 2.0], [0.25, 0.75], alike=True)])
    assert (same.word, same.value) == ("=", 1.0)


@pytest.mark.parametrize(("n", "m"), [(3, 7), (6, 2), (5, 5)])
def test_the_first_statistic_of_the_observed_deal_is_welchs(n, m):
    one, other = shifted(0.4)[:n], shifted(0, 2)[3 : 3 + m]
    first, *_ = _statistics(*Pair(one, other).samples)
    assert first[0] == pytest.approx(stats.ttest_ind(one, other, equal_var=False).statistic, rel=1e-6)


@pytest.mark.parametrize(
    ("one", "other", "margin"),
    [
        (shifted(0.4, 0.5)[:4], NORMAL[2:9], None),
        (shifted(0.1, 0.3), shifted(0, 0.4)[1:9], 0.3),
        (shifted(-0.1, 0.3), shifted(0, 0.4)[1:9], 0.3),
        (shifted(0.01, 0.2), NORMAL[2:8], 0.4),
        (shifted(0.4, 0.5)[3:6], NORMAL[:9], None),  # the most degrees of freedom decide in these two
        (shifted(0.5, 0.5)[3:6], NORMAL[:9], None),
    ],
)
def test_the_number_of_seeds_by_its_definition(one, other, margin):
    """Each number in turn: apart at a third of 5 % by Welch's test, or with an interval within the margin."""
    (found,) = differences([Pair(one, other, margin)])
    assert found.word == "cannot tell"
    freedom = stats.ttest_ind(one, other, equal_var=False).df
    size, variances = np.mean(one) - np.mean(other), np.var(one, ddof=1) + np.var(other, ddof=1)
    for seeds in range(max(len(one), len(other)) + 1, MOST_SEEDS + 1):
        student = stats.t(min(freedom * (seeds - 1) / (min(len(one), len(other)) - 1), 2 * seeds - 2))
        error = math.sqrt(variances / seeds)
        power = student.cdf(abs(size) / error - student.ppf(1 - 0.05 / 3 / 2))
        if margin is not None:
            both = (student.cdf((margin + sign * size) / error - student.ppf(0.975)) for sign in (-1, 1))
            power = max(power, sum(both) - 1)
        if power >= 0.8:
            break
    assert found.seeds == seeds
    assert 10 < seeds < MOST_SEEDS


@pytest.mark.parametrize(("pairs", "seeds"), [(1, 4), (5, 5), (7, 6)])
def test_fewer_seeds_than_could_separate_are_never_enough(pairs, seeds):
    """The least p-value of n seeds each is 2 in 6, 20, 70, 252, 924 deals; the level is 5 % over the pairs."""
    for found in differences([Pair([1.0, 1.001, 1.002], [0.0, 0.001, 0.002])] * pairs):
        assert (found.word, found.seeds) == ("cannot tell", seeds)


def test_the_number_of_seeds_is_above_what_either_method_has():
    pair = Pair([5.0, 5.1], (0.01 * np.arange(9)).tolist())
    for found in differences([pair] * 5):
        assert (found.word, found.seeds) == ("cannot tell", 10)


def test_the_order_of_seeds_changes_nothing_where_deals_are_drawn():
    one, other = (np.random.default_rng(seed).normal(mean, 1, 30).tolist() for seed, mean in enumerate((0.4, 0)))
    forth, back = differences([Pair(one, other), Pair(one[::-1], other[::-1])])
    assert forth.alone == back.alone


def test_what_decided_is_said_and_signs_that_disagree_are_mixed():
    often, rarely = [True] * 10, [False] * 10
    ranked = differences([Pair([*NORMAL[:9], -90.0], [value - 4 for value in NORMAL])])[0]
    assert (ranked.word, ranked.decided) == ("better", ("rank",))
    learned = differences([Pair(NORMAL, NORMAL, learned=(often, rarely))])[0]
    assert (learned.word, learned.decided) == ("better", ("learned",))
    mixed = differences([Pair(shifted(3), NORMAL, learned=(rarely, often))])[0]
    assert (mixed.word, mixed.decided) == ("mixed", ("mean", "rank", "learned"))


def test_within_the_margin_there_is_no_difference_and_outside_nobody_can_tell():
    ends = differences([Pair(shifted(0.05), NORMAL)])[0].interval
    assert ends.low < 0 < ends.high
    wide = max(-ends.low, ends.high)
    assert word(shifted(0.05), NORMAL, wide + 0.01) == "no difference found"
    assert word(shifted(0.05), NORMAL, wide - 0.01).startswith("cannot tell, ")
    assert word(shifted(0.05), NORMAL) == f"cannot tell, over {MOST_SEEDS} seeds would"


def test_no_number_is_computed_beyond_the_most():
    values = np.random.default_rng(0).normal(size=MOST_SEEDS)
    for count in (MOST_SEEDS - 1, MOST_SEEDS):
        assert word(values[:count].tolist(), values[:count].tolist()) == f"cannot tell, over {MOST_SEEDS} seeds would"


def test_holms_correction_is_for_all_pairs_that_are_tested():
    one = shifted(1.3)
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


def test_seeds_that_all_agree_say_no_more_than_their_number_allows():
    """Two seeds that learned against three that did not come about by chance as often as each seed tosses a coin."""
    same = [0.5, 0.5, 0.5]
    (found,) = differences([Pair(same, [0.2, 0.2])])
    assert (found.value, found.interval, found.alone) == (0.3, (0.3, 0.3), pytest.approx(0.1))
    assert str(found) == "cannot tell, 4 seeds would"
    assert word(same, same, 0.1) == "no difference found"
    with warnings.catch_warnings(action="error"):
        assert word(same, same) == f"cannot tell, over {MOST_SEEDS} seeds would"


def test_the_same_seeds_in_another_order_say_the_same():
    assert differences([Pair(shifted(1)[::-1], NORMAL, 0.2)]) == differences([Pair(shifted(1), NORMAL[::-1], 0.2)])


@pytest.mark.parametrize("rounds", [10, pytest.param(30, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("difference", "margin"), [(0.8, None), (0.8, 0.2), (0.0, 0.5)])
def test_the_number_of_seeds_decides_in_four_of_five_cases_or_more(difference, margin, rounds):
    (found,) = differences([Pair(shifted(difference), NORMAL, margin)])
    assert found.word == "cannot tell"
    generator, decided = np.random.default_rng(0), 0
    for _ in range(rounds):
        one, other = generator.normal(difference, 1, found.seeds), generator.normal(0, 1, found.seeds)
        decided += differences([Pair(one.tolist(), other.tolist(), margin)])[0].word != "cannot tell"
    assert decided / rounds >= 0.8 - 3 * math.sqrt(0.8 * 0.2 / rounds)


def test_the_number_of_seeds_is_one_of_which_a_separation_decides_in_the_family():
    apart = Pair([1.0, 1.1, 1.2, 1.3, 1.4], [0.0, 0.1, 0.2, 0.3, 0.4])
    for others in (0, 9, 99):
        found, *_ = differences([apart, *[Pair(NORMAL, NORMAL)] * others])
        if found.seeds:
            level = 0.05 / (others + 1)
            assert math.comb(2 * found.seeds, found.seeds) > 2 / level
            more = Pair(*(np.linspace(low, low + 0.4, found.seeds).tolist() for low in (1.0, 0.0)))
            assert differences([more, *[Pair(NORMAL, NORMAL)] * others])[0].word == "better"
        else:
            assert (others, found.word) == (0, "better")


def test_holm() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []
