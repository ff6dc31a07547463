"""Two methods on one task: how far they are apart, and in a word which is better.

One exact test compares the seeds of two methods in three respects: means, ranks, and the seeds that learned. If two
methods are alike, every way to deal their results to the two was equally likely. The test counts over all deals, so it
assumes no distribution: not for seeds that fail, not for ties, not for few seeds. The smallest p-value of the three
counts. The same deals say how often alike methods would have one as small. This corrects for three looks (single-step
minP of Westfall and Young, *Resampling-Based Multiple Testing*, 1993). The statistics are those of Welch (1947), of
Mann and Whitney (1947), and of Fisher's test. Seeds are not paired: that gains nothing.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, combinations
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.statistics.intervals import LEVEL, Interval

Array = NDArray[np.float64]
Sample = tuple[tuple[float, bool], ...]  # for each seed its value, which is finite, and whether it learned the task
Word = Literal["better", "worse", "mixed", "no difference found", "cannot tell", "="]
ALPHA = 0.05  # probability that any pair of one comparison is called better, worse or mixed by chance (Holm)
POWER = 0.8
"""Probability that the number of seeds that is called enough decides, if difference and scatter are as estimated."""
MOST_SEEDS = 1000  # larger numbers of seeds are not computed
_LOOKS = 3  # respects in which a pair is compared


@dataclass(frozen=True)
class Pair:
    """Two methods on one task: one number for each seed; larger is better."""

    one: Sequence[float]
    other: Sequence[float]
    margin: float | None = None  # a smaller difference does not matter; None if nobody knows
    alike: bool = False  # both are paid the same, so that a difference is chance
    learned: tuple[Sequence[bool], Sequence[bool]] | None = None
    """For the same seeds, whether they learned the task; None if nobody knows."""

    @property
    def samples(self) -> tuple[Sample, Sample]:
        learned = self.learned or ([False] * len(self.one), [False] * len(self.other))
        return tuple(zip(self.one, learned[0], strict=True)), tuple(zip(self.other, learned[1], strict=True))


@dataclass(frozen=True)
class Difference:
    """The verdict on a pair. Numbers are None if there are too few seeds to compute them."""

    word: Word  # the first method is that
    value: float | None = None  # mean of the first less that of the second
    interval: Interval | None = None  # 95 % interval of the value, for this pair alone, by Welch
    alone: float | None = None  # P-value of this pair alone
    chance: float | None = None  # P-value after Holm's correction
    decided: tuple[str, ...] = ()
    """The respects, of "mean", "rank" and "learned", in which the pair is apart after the correction."""
    seeds: int | None = None
    """The number of seeds of each method that would decide "cannot tell"; `MOST_SEEDS` + 1 if more would."""

    @property
    def needed(self) -> str:
        """ "14 seeds would"; empty if no number is known."""
        if self.seeds is None:
            return ""
        return f"{f'over {MOST_SEEDS}' if self.seeds > MOST_SEEDS else self.seeds} seeds would"

    def __str__(self) -> str:
        """ "better"; "cannot tell, 14 seeds would". The words of documentation."""
        return f"{self.word}, {self.needed}" if self.needed else self.word


def differences(pairs: Iterable[Pair]) -> list[Difference]:
    """Say of each pair of one comparison whether the first method is better than the second.

    - "=": both are paid the same. Such pairs are not tested.
    - "better", "worse": the exact test has p < 0.05 after Holm's correction for all pairs. Every respect in which the
      pair is that far apart has the same sign.
    - "mixed": the same p, and such respects have different signs.
    - "no difference found": p is larger, and the 95 % interval of the difference lies within the margin.
    - "cannot tell": anything else. If the difference and the scatter are as large as they look, the number of seeds
      would decide with a probability of 80 %.
    """
    tested = [_estimate(pair) for pair in pairs]
    family = [each for each in tested if each.difference.alone is not None]
    chances = iter(holm([each.difference.alone or 0.0 for each in family]))
    return [
        each.difference if each.difference.alone is None else _decide(each, next(chances), len(family))
        for each in tested
    ]


@dataclass(frozen=True)
class _Tested:
    pair: Pair
    difference: Difference
    freedom: float = math.inf  # Welch's degrees of freedom
    looks: tuple[Look, ...] = ()


def _estimate(pair: Pair) -> _Tested:
    """The difference before it is judged, with the p-value of this pair alone, or None if it is not tested."""
    # Sums are over sorted seeds: a float sum depends on the order, and the verdict must not.
    both = (pair.one, pair.other)
    word: Word = "=" if pair.alike else "cannot tell"
    if not all(values and np.isfinite(values).all() for values in both):
        return _Tested(pair, Difference(word))
    value = float(np.mean(sorted(pair.one)) - np.mean(sorted(pair.other)))
    if min(map(len, both)) < 2:
        return _Tested(pair, Difference(word, value))
    ends, freedom = Interval(value, value), math.inf
    if any(map(np.ptp, both)):
        from scipy import stats

        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", RuntimeWarning
            )  # seeds that agree to the last digits: the interval is right
            test = stats.ttest_ind(sorted(pair.one), sorted(pair.other), equal_var=False)
        limits, freedom = test.confidence_interval(LEVEL), float(test.df)
        ends = Interval(float(limits.low), float(limits.high))
    if pair.alike:
        return _Tested(pair, Difference(word, value, ends))
    looks = exact_test(*pair.samples)
    return _Tested(pair, Difference(word, value, ends, min(look.chance for look in looks)), freedom, looks)


def _decide(tested: _Tested, chance: float, family: int) -> Difference:
    difference, margin = replace(tested.difference, chance=chance), tested.pair.margin
    if chance < ALPHA:
        paid = chance / (difference.alone or chance)  # Holm's factor for this pair, which every respect has to pay
        deciding = [look for look in tested.looks if look.chance * paid < ALPHA]
        signs = {look.sign for look in deciding}
        word: Word = "mixed" if len(signs) > 1 else "better" if signs == {1} else "worse"
        return replace(difference, word=word, decided=tuple(look.what for look in deciding))
    ends = difference.interval
    if ends and margin is not None and -margin <= ends.low and ends.high <= margin:
        return replace(difference, word="no difference found")
    return replace(difference, seeds=_enough(tested, ALPHA / family))


def _enough(tested: _Tested, alpha: float) -> int:
    """A number of seeds of each method with which the difference would be decided with a probability of 80 % or more.

    It is the number for Welch's test alone, at a third of the level of Holm's first step, the strictest. So ranks and
    seeds that learned may decide earlier. A shifted t distribution approximates the noncentral one. Fewer seeds
    could not even decide a complete separation.
    """
    from scipy import special

    one, other, margin = tested.pair.one, tested.pair.other, tested.pair.margin
    # Of comb(2n, n) deals, the observed one and its mirror are the farthest apart: no p-value is below 2 / comb(2n, n).
    more = range(max(len(one), len(other)) + 1, MOST_SEEDS + 1)
    fewest = next((n for n in more if math.comb(2 * n, n) > 2 / alpha), None)
    if fewest is None:
        return MOST_SEEDS + 1
    counts = np.arange(fewest, MOST_SEEDS + 1)
    error = np.sqrt((np.var(one, ddof=1) + np.var(other, ddof=1)) / counts)
    size = abs(tested.difference.value or 0.0)
    if not size and not error[0]:  # all seeds have the same value: no number of them says more
        return MOST_SEEDS + 1
    # Welch's degrees of freedom grow with the seeds, up to those of equal variances, 2n - 2.
    freedom = np.minimum(tested.freedom * (counts - 1) / (min(len(one), len(other)) - 1), 2 * counts - 2)
    with np.errstate(divide="ignore"):
        decided = special.stdtr(freedom, size / error - special.stdtrit(freedom, 1 - alpha / _LOOKS / 2))
    if margin is not None and error[0]:
        limit = special.stdtrit(freedom, (1 + LEVEL) / 2)
        within = [special.stdtr(freedom, (margin + sign * size) / error - limit) for sign in (-1, 1)]
        decided = np.maximum(decided, within[0] + within[1] - 1)
    enough = np.flatnonzero(decided >= POWER)
    return int(counts[enough[0]]) if len(enough) else MOST_SEEDS + 1


def holm(chances: Sequence[float]) -> list[float]:
    """P-values corrected for their number by Holm's step-down procedure, in the order given."""
    corrected, least = [1.0] * len(chances), 0.0
    for rank, index in enumerate(sorted(range(len(chances)), key=chances.__getitem__)):
        least = max(least, min(1.0, chances[index] * (len(chances) - rank)))
        corrected[index] = least
    return corrected


_HELD = 4_000_000
"""Numbers that the deals have together, at most. All deals are computed if these have no more, up to 10 seeds against
10. Else as many as fit are drawn."""
_FLOOR, _TIE = 1e-9, 1e-5
"""The least variance, where the spread of all values is 1; statistics closer than the second number are the same."""


Respect = Literal["mean", "rank", "learned"]


class Look(NamedTuple):
    """The test's result in one respect."""

    what: Respect
    chance: float  # P-value, in (0, 1]: alike methods are as far apart in any of the three respects
    sign: int  # 1 if the first is better in this respect, -1 if the other is, 0 if neither is


@lru_cache(maxsize=4096)
def exact_test(one: Sample, other: Sample) -> tuple[Look, ...]:
    """Compare the seeds of two methods, at least two of each. The smallest chance is the p-value of the pair.

    Cached, since tables and pages ask for the same pairs. Ten seeds against ten take 50 ms.
    """
    statistics = _statistics(one, other)
    sizes = [np.abs(values) for values in statistics]
    # For each deal, the share of deals whose statistic is as large as its own. Equal deals round differently, hence
    # the tolerance: without it a tie would count for or against by chance.
    chances = [1 - np.searchsorted(np.sort(each), each * (1 - _TIE), side="left") / len(each) for each in sizes]
    least = np.min(chances, axis=0)
    respects: tuple[Respect, ...] = ("mean", "rank", "learned")
    return tuple(
        Look(what, float(np.mean(least <= own[0] * (1 + _TIE))), int(np.sign(values[0])))
        for what, own, values in zip(respects, chances, statistics, strict=True)
    )


def _statistics(one: Sample, other: Sample) -> list[Array]:
    """For each deal, the observed one first: Welch's t; sum of ranks and seeds that learned, less what is expected."""
    from scipy import stats

    n, m = len(one), len(other)
    pooled = [*sorted(one), *sorted(other)]
    values = np.array([value for value, _ in pooled])
    ranks = stats.rankdata(values)  # before they are rounded: beside a huge failure the others look equal
    values -= values.mean()
    values /= np.abs(values).max() or 1.0
    columns = np.column_stack([values, values**2, ranks, [learned for _, learned in pooled]])
    sums, whole = _deals(n, m) @ columns, columns.sum(axis=0)
    rest = whole - sums
    squared_error = sum(
        np.maximum(part[:, 1] - part[:, 0] ** 2 / size, 0) / (size - 1) / size for part, size in ((sums, n), (rest, m))
    )
    welch = (sums[:, 0] / n - rest[:, 0] / m) / np.sqrt(squared_error + _FLOOR)
    return [welch, *((sums[:, i] - n * whole[i] / (n + m)) for i in (2, 3))]


@lru_cache(maxsize=4)
def _deals(n: int, m: int) -> Array:
    """(deals, n + m): 1 for a seed that is dealt to the first method. The first row is the observed deal.

    If n = m, half of the deals are enough: the others have the names exchanged. If there are too many, some are drawn,
    always the same.
    """
    count = n + m
    if math.comb(count, n) * count > _HELD:
        drawn = np.random.default_rng(0).random((max(1000, _HELD // count), count)).argsort(axis=1)[:, :n]
        rows = np.vstack([np.arange(n), drawn])
    else:
        fixed = int(n == m)
        ways = chain.from_iterable((*range(fixed), *rest) for rest in combinations(range(fixed, count), n - fixed))
        rows = np.fromiter(ways, dtype=np.int64).reshape(-1, n)
    deals = np.zeros((len(rows), count))
    np.put_along_axis(deals, rows, 1.0, axis=1)
    return deals
