"""Two methods on one task: how far they are apart, and in a word which is better.

The test is exact and looks at means, at ranks, and at the seeds that learned (`exact`). The seeds of two methods are
not paired, since pairing them was measured to buy nothing.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stlbench.report.statistics.exact import Look, Sample, exact_test
from stlbench.report.statistics.intervals import LEVEL, Interval

Word = Literal["better", "worse", "mixed", "no difference found", "cannot tell", "="]

ALPHA = 0.05
"""Probability that, among all the pairs of one comparison, any is called better, worse or mixed by chance (Holm)."""
POWER = 0.8
"""Probability with which the number of seeds that is said to be enough decides, if all is as it looks."""
MOST_SEEDS = 1000
"""More are not counted."""
_LOOKS = 3
"""Respects in which a pair is compared."""


@dataclass(frozen=True)
class Pair:
    """Two methods on one task, and one number of each seed, which is the better the larger it is."""

    one: Sequence[float]
    other: Sequence[float]
    margin: float | None = None
    """Differences up to it are none that matters; None where nobody knows."""
    alike: bool = False
    """Both are paid the same, so that a difference says nothing of what they are paid for."""
    learned: tuple[Sequence[bool], Sequence[bool]] | None = None
    """Of the same seeds, whether they learned the task; None where nobody knows."""

    @property
    def samples(self) -> tuple[Sample, Sample]:
        """What the test compares."""
        learned = self.learned or ([False] * len(self.one), [False] * len(self.other))
        return tuple(zip(self.one, learned[0], strict=True)), tuple(zip(self.other, learned[1], strict=True))


@dataclass(frozen=True)
class Difference:
    """What is said of a pair. Numbers are None where there are too few seeds to compute them."""

    word: Word
    """Of the first method."""
    value: float | None = None
    """Mean of the first less that of the second."""
    interval: Interval | None = None
    """Of this difference, 95 %, of this pair alone, by Welch."""
    alone: float | None = None
    """P-value of this pair alone."""
    chance: float | None = None
    """P-value after Holm's correction."""
    decided: tuple[str, ...] = ()
    """In which respects the pair is apart after the correction: of "mean", "rank" and "learned"."""
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
    - "better", "worse": the exact test has p < 0.05 after Holm's correction for all pairs, and every respect in which
      the pair is that far apart has the same sign.
    - "mixed": the same p, and such respects have different signs.
    - "no difference found": p is larger, and the 95 % interval of the difference lies within the margin.
    - "cannot tell": anything else, with a number of seeds that would decide with a probability of 80 %, if the
      difference and the scatter are as large as they look.
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
    freedom: float = math.inf
    """Welch's degrees of freedom."""
    looks: tuple[Look, ...] = ()


def _estimate(pair: Pair) -> _Tested:
    """The difference before it is judged, with the p-value of this pair alone; without, where it is not tested."""
    both = (pair.one, pair.other)
    word: Word = "=" if pair.alike else "cannot tell"
    if not all(values and np.isfinite(values).all() for values in both):
        return _Tested(pair, Difference(word))
    value = float(np.mean(sorted(pair.one)) - np.mean(sorted(pair.other)))
    if min(map(len, both)) < 2:
        return _Tested(pair, Difference(word, value))
    ends, freedom = _welch(*both) if any(map(np.ptp, both)) else (Interval(value, value), math.inf)
    if pair.alike:
        return _Tested(pair, Difference(word, value, ends))
    looks = exact_test(*pair.samples)
    return _Tested(pair, Difference(word, value, ends, min(look.chance for look in looks)), freedom, looks)


def _welch(one: Sequence[float], other: Sequence[float]) -> tuple[Interval, float]:
    """95 % interval of the difference, degrees of freedom."""
    from scipy import stats

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # seeds that agree to the last digits: the interval is right
        test = stats.ttest_ind(sorted(one), sorted(other), equal_var=False)
    ends = test.confidence_interval(LEVEL)
    return Interval(float(ends.low), float(ends.high)), float(test.df)


def _decide(tested: _Tested, chance: float, family: int) -> Difference:
    difference, margin = replace(tested.difference, chance=chance), tested.pair.margin
    if chance < ALPHA:
        paid = chance / (difference.alone or chance)  # what Holm's correction asks of this pair, in all respects
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

    It is that of Welch's test alone, at a third of the level of Holm's first step, the strictest; so ranks and seeds
    that learned may decide earlier. A shifted t distribution stands for the noncentral one. The number is at least that
    from which a complete separation can be decided.
    """
    from scipy import special

    one, other, margin = tested.pair.one, tested.pair.other, tested.pair.margin
    fewest = next(n for n in range(max(len(one), len(other)) + 1, MOST_SEEDS) if math.comb(2 * n, n) > 2 / alpha)
    counts = np.arange(fewest, MOST_SEEDS + 1)
    error = np.sqrt((np.var(one, ddof=1) + np.var(other, ddof=1)) / counts)
    size = abs(tested.difference.value or 0.0)
    if not size and not error[0]:  # all seeds have the same value: no number of them says more
        return MOST_SEEDS + 1
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
