"""The exact test of a pair, against SciPy, against all deals counted one by one, and by simulation."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from stlbench.statistics.differences import _deals, exact_test

COMPUTED = exact_test.__wrapped__
"""Without its cache, which simulations would fill."""


def sample(values, learned_above=0.5):
    return tuple((float(value), bool(value > learned_above)) for value in values)


def p_value(one, other):
    return min(look.chance for look in COMPUTED(sample(one), sample(other)))


def one_by_one(one, other):
    """What the test says, from its definition: every deal, three p-values of each, the smallest, and its chance."""
    pooled, n = [*one, *other], len(one)
    ranks = stats.rankdata([value for value, _ in pooled])
    found = []
    for chosen in combinations(range(len(pooled)), n):
        rest = [i for i in range(len(pooled)) if i not in chosen]
        first, second = ([pooled[i][0] for i in part] for part in (chosen, rest))
        error = math.sqrt(np.var(first, ddof=1) / n + np.var(second, ddof=1) / len(second))
        welch = (np.mean(first) - np.mean(second)) / error
        rank = ranks[list(chosen)].sum() - n * ranks.mean()
        learned = sum(pooled[i][1] for i in chosen) - n * np.mean([passed for _, passed in pooled])
        found.append([abs(welch), abs(rank), abs(learned)])
    table = np.array(found)
    chances = np.array([[np.mean(column >= value - 1e-6) for value in column] for column in table.T])
    return [float(np.mean(chances.min(axis=0) <= own + 1e-9)) for own in chances[:, 0]]


@pytest.mark.parametrize(("n", "m", "seed"), [(3, 3, 0), (3, 4, 1), (4, 3, 2), (4, 5, 3)])
def test_it_is_what_counting_every_deal_one_by_one_says_also_with_ties(n, m, seed):
    values = np.random.default_rng(seed).normal(0.5, 1, n + m).round(1 if seed % 2 else 3)
    one, other = sample(values[:n]), sample(values[n:])
    assert [look.chance for look in exact_test(one, other)] == pytest.approx(one_by_one(one, other))


@pytest.mark.parametrize("seed", range(4))
def test_three_looks_cost_something_and_never_more_than_three_times(seed):
    generator = np.random.default_rng(seed)
    one, other = generator.normal(1.3, 1, 6), generator.normal(0, 1, 9)
    counts = [[int((values > 0.5).sum()), int((values <= 0.5).sum())] for values in (one, other)]
    _, rank, learned = exact_test(sample(one), sample(other))
    ranked = stats.mannwhitneyu(one, other, method="exact").pvalue
    fisher = stats.fisher_exact(counts).pvalue
    assert ranked <= rank.chance * (1 + 1e-9) <= 3 * ranked
    assert fisher <= learned.chance * 1.5  # SciPy's second tail is of rarer tables, here of those as far away
    assert min(rank.chance, learned.chance) <= 3 * min(ranked, fisher)


def test_ten_seeds_that_are_all_better_are_the_rarest_deal_and_its_mirror():
    good, bad = 1 + np.arange(10) / 100, -1 - np.arange(10) ** 2
    there, back = exact_test(sample(good), sample(bad)), exact_test(sample(bad), sample(good))
    assert [look.chance for look in (*there, *back)] == pytest.approx([2 / math.comb(20, 10)] * 6)
    assert [look.sign for look in (*there, *back)] == [1, 1, 1, -1, -1, -1]


def test_seeds_without_scatter_say_no_more_than_their_number_allows():
    assert p_value([1, 1], [0, 0]) == pytest.approx(1 / 3)
    assert p_value([1, 1, 1], [0, 0, 0]) == p_value([1, 1 + 1e-12, 1], [0, 0, -1e-12]) == pytest.approx(0.1)
    assert p_value([1, 1, 1], [1, 1, 1]) == 1


def test_the_looks_differ_where_one_seed_of_the_better_method_is_very_bad():
    usual = [0.9, 0.91, 0.92, 0.93, 0.94, 0.95, 0.96, -40.0]
    mean, rank, learned = exact_test(sample(usual), sample([0.6 + 0.01 * i for i in range(8)]))
    assert (mean.sign, rank.sign, learned.sign) == (-1, 1, -1)
    assert rank.chance < 0.05 < mean.chance


def test_ranks_see_the_other_seeds_beside_one_whose_robustness_is_huge():
    usual, other = [0.9, 0.91, 0.92, 0.93, 0.94, 0.95, 0.96], sample([0.6 + 0.01 * i for i in range(8)])
    _, rank, _ = exact_test(sample([*usual, -1e18]), other)
    assert rank.sign == 1
    assert rank.chance < 0.05


def test_of_many_seeds_deals_are_drawn_and_the_answer_is_close_to_that_of_scipy():
    generator = np.random.default_rng(3)
    one, other = generator.normal(0.65, 1, 30), generator.normal(0, 1, 30)
    mean, rank, _ = exact_test(sample(one), sample(other))
    alone = stats.ttest_ind(one, other, equal_var=False).pvalue, stats.mannwhitneyu(one, other).pvalue
    assert alone[0] / 1.3 < mean.chance < 3 * alone[0]
    assert alone[1] / 1.3 < rank.chance < 3 * alone[1]


@pytest.mark.parametrize(("n", "m", "all_of_them"), [(10, 10, True), (2, 150, True), (2, 400, False), (5, 26, False)])
def test_the_deals_have_no_more_numbers_than_can_be_held(n, m, all_of_them):
    deals = _deals.__wrapped__(n, m)
    assert deals.size <= 4_000_000 + n + m
    assert (len(deals) == math.comb(n + m, n) / (2 if n == m else 1)) is all_of_them
    assert (deals.sum(axis=1) == n).all()


def failing(share, good=0.1, bad=0.5):
    """Seeds near 1, but for a share of them near -1."""
    return lambda draw, n: np.where(draw.random(n) < share, draw.normal(-1, bad, n), draw.normal(1, good, n))


ALIKE = {
    "normal": lambda generator, n: generator.normal(0.5, 1, n),
    "a fifth fails": failing(0.2),
    "a third fails": failing(0.35),
    "half fail, all alike": failing(0.5, 0.02, 0.02),
    "ties": lambda generator, n: generator.integers(0, 3, n).astype(float),
}


@pytest.mark.parametrize("name", ALIKE)
@pytest.mark.parametrize(("n", "m", "rounds"), [(5, 5, 150), pytest.param(4, 8, 600, marks=pytest.mark.slow)])
def test_methods_that_are_alike_are_apart_as_rarely_as_the_p_value_says(name, n, m, rounds):
    """An exact test has P(p <= a) <= a. Four standard errors of the simulation are allowed for."""
    generator = np.random.default_rng(7)
    found = np.array([p_value(ALIKE[name](generator, n), ALIKE[name](generator, m)) for _ in range(rounds)])
    for level in (0.01, 0.05, 0.1, 0.3):
        assert np.mean(found <= level) <= level + 4 * math.sqrt(level * (1 - level) / rounds)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "m", "most"), [(5, 5, 0.10), (10, 5, 0.13), (5, 10, 0.13)])
def test_methods_that_differ_in_scatter_alone_are_called_apart_somewhat_more_often(n, m, most):
    """Deals are not as likely as one another then: measured at four times the scatter, as the documentation says."""
    generator, rounds = np.random.default_rng(8), 400
    found = [p_value(generator.normal(0, 1, n), generator.normal(0, 4, m)) for _ in range(rounds)]
    assert np.mean(np.array(found) < 0.05) <= most
