"""One exact test of two methods' seeds, which looks at three things: means, ranks, and the seeds that learned.

If two methods are alike, every way to deal their results to the two was as likely as the one that was seen. So chances
are counted over all deals, and no distribution is assumed: not for seeds that fail, not for ties, not for few seeds.
The smallest of the three chances counts. How often alike methods would have one as small is counted over the same
deals, which pays for the three looks (the single-step minP procedure of Westfall and Young, *Resampling-Based Multiple
Testing*, 1993). The statistics are those of Welch (1947), of Mann and Whitney (1947), and of Fisher's test.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import chain, combinations
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Sample = tuple[tuple[float, bool], ...]
"""Of each seed its value, which is finite, and whether it learned the task."""

_ALL_DEALS = 200_000
"""So many deals are all looked at: up to 10 seeds against 10. Of more, as many as fit into `_HELD` are drawn."""
_HELD = 4_000_000
"""Numbers that the drawn deals have together."""
_FLOOR, _TIE = 1e-9, 1e-5
"""Of variances, where the spread of all values is 1; and of statistics: closer ones are the same but for rounding."""


class Look(NamedTuple):
    """What the test saw in one respect."""

    what: Literal["mean", "rank", "learned"]
    chance: float
    """That methods that are alike are as far apart, in any of the three respects, as these are in this one; (0, 1]."""
    sign: int
    """1 where the first is better in this respect, -1 where the other is, 0 where neither is."""


@lru_cache(maxsize=4096)
def exact_test(one: Sample, other: Sample) -> tuple[Look, Look, Look]:
    """Compare the seeds of two methods, at least two of each. The smallest chance is the p-value of the pair.

    Cached, since tables and pages ask for the same pairs. Ten seeds against ten take 50 ms.
    """
    statistics = _statistics(one, other)
    chances = [_tail(np.abs(values)) for values in statistics]
    least = np.min(chances, axis=0)
    joint = [float(np.mean(least <= own[0] * (1 + _TIE))) for own in chances]
    mean, rank, learned = ((chance, int(np.sign(values[0]))) for chance, values in zip(joint, statistics, strict=True))
    return Look("mean", *mean), Look("rank", *rank), Look("learned", *learned)


def _statistics(one: Sample, other: Sample) -> list[Array]:
    """Of each deal, the seen one first: Welch's t, the sum of ranks, the seeds that learned, less what is expected."""
    from scipy import stats

    n, m = len(one), len(other)
    pooled = [*sorted(one), *sorted(other)]
    values = np.array([value for value, _ in pooled])
    values -= values.mean()
    values /= np.abs(values).max() or 1.0
    columns = np.column_stack([values, values**2, stats.rankdata(values), [learned for _, learned in pooled]])
    sums, whole = _deals(n, m) @ columns, columns.sum(axis=0)
    rest = whole - sums
    squared_error = sum(
        np.maximum(part[:, 1] - part[:, 0] ** 2 / size, 0) / (size - 1) / size for part, size in ((sums, n), (rest, m))
    )
    welch = (sums[:, 0] / n - rest[:, 0] / m) / np.sqrt(squared_error + _FLOOR)
    return [welch, *((sums[:, i] - n * whole[i] / (n + m)) for i in (2, 3))]


def _tail(sizes: Array) -> Array:
    """Of each deal, the share of deals whose statistic is as large as its own."""
    below = np.searchsorted(np.sort(sizes), sizes * (1 - _TIE), side="left")
    return np.asarray(1 - below / len(sizes))


@lru_cache(maxsize=4)
def _deals(n: int, m: int) -> Array:
    """(deals, n + m): 1 for a seed that is dealt to the first method. The first row is what was seen.

    All deals; of as many seeds of each only half of them, since the others are these with the names exchanged. Where
    there are too many, some that are drawn, always the same.
    """
    count = n + m
    if math.comb(count, n) > _ALL_DEALS:
        drawn = np.random.default_rng(0).random((max(1000, _HELD // count), count)).argsort(axis=1)[:, :n]
        rows = np.vstack([np.arange(n), drawn])
    else:
        fixed = int(n == m)
        ways = chain.from_iterable((*range(fixed), *rest) for rest in combinations(range(fixed, count), n - fixed))
        rows = np.fromiter(ways, dtype=np.int64).reshape(-1, n)
    deals = np.zeros((len(rows), count))
    np.put_along_axis(deals, rows, 1.0, axis=1)
    return deals
