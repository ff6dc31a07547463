"""What seeds say of two methods on one task: how far they are apart, and in a word which is better.

The test is Welch's, of the means: a seed that failed counts in full here, while an interquartile mean leaves it out.
The seeds of two methods are not paired, since pairing them was measured to buy nothing.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stlbench.report.statistics.holm import holm
from stlbench.report.statistics.intervals import LEVEL, Interval

__all__ = ["MOST_SEEDS", "Difference", "Pair", "Word", "differences"]

Word = Literal["better", "worse", "no difference found", "cannot tell", "="]

ALPHA = 0.05
"""Probability that, among all the pairs of one comparison, any is called better or worse by chance (Holm)."""
POWER = 0.8
"""Probability with which the number of seeds that is said to be enough decides, if all is as it looks."""
MOST_SEEDS = 1000
"""More are not counted."""


@dataclass(frozen=True)
class Pair:
    """Two methods on one task, and one number of each seed, which is the better the larger it is."""

    one: Sequence[float]
    other: Sequence[float]
    margin: float | None = None
    """Differences up to it are none that matters; None where nobody knows."""
    alike: bool = False
    """Both are paid the same, so that a difference says nothing of what they are paid for."""


@dataclass(frozen=True)
class Difference:
    """What is said of a pair. Numbers are None where there are too few seeds to compute them."""

    word: Word
    """Of the first method."""
    value: float | None = None
    """Mean of the first less that of the second."""
    interval: Interval | None = None
    """95 %, of this pair alone."""
    chance: float | None = None
    """P-value after Holm's correction."""
    seeds: int | None = None
    """Of each method: how many would decide, where the word is "cannot tell"; `MOST_SEEDS` + 1 where more would."""

    def __str__(self) -> str:
        """ "better"; "cannot tell, 14 seeds would". The words of tables and documentation."""
        if self.seeds is None:
            return self.word
        count = f"over {MOST_SEEDS}" if self.seeds > MOST_SEEDS else str(self.seeds)
        return f"{self.word}, {count} seeds would"


def differences(pairs: Iterable[Pair]) -> list[Difference]:
    """Say of each pair of one comparison whether the first method is better than the second.

    - "=": both are paid the same. Such pairs are not tested.
    - "better", "worse": Welch's test has p < 0.05, after Holm's correction for all pairs.
    - "no difference found": not so, and the 95 % interval of the difference lies within the margin.
    - "cannot tell": anything else, with the number of seeds that would decide with a probability of 80 %, if the
      difference and the scatter are as large as they look.
    """
    tested = [_estimate(pair) for pair in pairs]
    family = [each for each in tested if each.difference.chance is not None]
    chances = iter(holm([each.difference.chance or 0.0 for each in family]))
    return [
        each.difference if each.difference.chance is None else _decide(each, next(chances), len(family))
        for each in tested
    ]


@dataclass(frozen=True)
class _Tested:
    pair: Pair
    difference: Difference
    freedom: float = math.nan
    """Degrees of freedom of the test."""


def _estimate(pair: Pair) -> _Tested:
    """The difference before it is judged, with the p-value of this pair alone; without, where it is not tested."""
    both = (pair.one, pair.other)
    if not all(values and np.isfinite(values).all() for values in both):
        return _Tested(pair, Difference("=" if pair.alike else "cannot tell"))
    value = float(np.mean(sorted(pair.one)) - np.mean(sorted(pair.other)))
    if min(map(len, both)) < 2:
        return _Tested(pair, Difference("=" if pair.alike else "cannot tell", value))
    if not any(map(np.ptp, both)):  # all seeds agree: there is nothing to be tested
        chance, ends, freedom = float(value == 0), Interval(value, value), math.inf
    else:
        chance, ends, freedom = _welch(*both)
    if pair.alike:
        return _Tested(pair, Difference("=", value, ends))
    return _Tested(pair, Difference("cannot tell", value, ends, chance), freedom)


def _welch(one: Sequence[float], other: Sequence[float]) -> tuple[float, Interval, float]:
    """P-value, 95 % interval of the difference, degrees of freedom."""
    from scipy import stats

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # seeds that agree to the last digits: the p-value is right
        found = stats.ttest_ind(sorted(one), sorted(other), equal_var=False)
    ends = found.confidence_interval(LEVEL)
    return float(found.pvalue), Interval(float(ends.low), float(ends.high)), float(found.df)


def _decide(tested: _Tested, chance: float, family: int) -> Difference:
    found, margin = replace(tested.difference, chance=chance), tested.pair.margin
    if chance < ALPHA:
        return replace(found, word="better" if (found.value or 0.0) > 0 else "worse")
    if found.interval and margin is not None and -margin <= found.interval.low and found.interval.high <= margin:
        return replace(found, word="no difference found")
    return replace(found, seeds=_enough(tested, ALPHA / family))


def _enough(tested: _Tested, alpha: float) -> int:
    """The least number of seeds of each method with which the difference would be decided with a probability of 80 %.

    A shifted t distribution stands for the noncentral one. The level is that of Holm's first step, the strictest.
    """
    from scipy import stats

    one, other, margin = tested.pair.one, tested.pair.other, tested.pair.margin
    counts = np.arange(max(len(one), len(other)) + 1, MOST_SEEDS + 1)
    spread = np.var(one, ddof=1) + np.var(other, ddof=1)
    if not spread:  # all seeds have the same value: no number of them says more
        return MOST_SEEDS + 1
    error = np.sqrt(spread / counts)
    freedom = tested.freedom * (counts - 1) / (min(len(one), len(other)) - 1)
    size = abs(tested.difference.value or 0.0)
    decided = stats.t.cdf(size / error - stats.t.ppf(1 - alpha / 2, freedom), freedom)
    if margin is not None:
        limit = stats.t.ppf((1 + LEVEL) / 2, freedom)
        within = [stats.t.cdf((margin + sign * size) / error - limit, freedom) for sign in (-1, 1)]
        decided = np.maximum(decided, within[0] + within[1] - 1)
    enough = np.flatnonzero(decided >= POWER)
    return int(counts[enough[0]]) if len(enough) else MOST_SEEDS + 1
