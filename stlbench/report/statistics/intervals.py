"""Intervals over seeds, and of shares. Their coverage is measured: `studies/interval_coverage.py`.

The unit is the seed. The starts of one seed share a policy, so they are averaged before anything here sees them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

LEVEL = 0.95
"""Confidence of every interval in tables and figures, but for that of the median of five seeds: 93.75 %."""
FEWEST = 5
"""Seeds of which an interval of the median is said: of four, no two seeds cover it in more than 87.5 % of cases."""


class Interval(NamedTuple):
    """Both ends, in the unit of the values."""

    low: float
    high: float


def median(values: Sequence[float]) -> float:
    """What half of the seeds reach; of an even number of them the middle between the two in the middle."""
    return float(np.median(values))


def median_interval(values: Sequence[float]) -> Interval | None:
    """Interval of the median: from one seed to another (Thompson 1936, Annals of Mathematical Statistics 7).

    The median is outside if too few seeds lie on one side of it, and how many do is a binomial number with probability
    1/2. So the interval covers it whatever the distribution is, also where any share of the seeds fails, and it never
    leaves what seeds have reached. It has as many seeds outside at either end as leave a coverage of 95 %, or none.

    Args:
        values: one number per seed.

    Returns:
        Lower and upper end; None for fewer than `FEWEST` values, or where one is not finite. Coverage is 93.75 % for
        five values, 97.9 % for ten, and at least 95 % for any other number.
    """
    if len(values) < FEWEST or not np.isfinite(values).all():
        return None
    data, outside = sorted(values), _outside(len(values))
    return Interval(float(data[outside]), float(data[-1 - outside]))


@lru_cache
def _outside(count: int) -> int:
    """How many of so many seeds may lie outside at either end."""
    chance, total = 1 - LEVEL, 2**count
    outside, below = 0, 1 + count
    while 2 * below / total <= chance:
        outside += 1
        below += math.comb(count, outside + 1)
    return outside


def mean_interval(values: Sequence[float]) -> Interval | None:
    """Student's 95 % t interval of the mean; None for fewer than two values, or where one is not finite."""
    if len(values) < 2 or not np.isfinite(values).all():
        return None
    data = np.sort(np.asarray(values, dtype=np.float64))  # the same sums in whatever order the seeds come
    half = float(data.std(ddof=1)) / math.sqrt(len(data)) * _quantile(len(data) - 1)
    return Interval(float(data.mean()) - half, float(data.mean()) + half)


def share_interval(successes: int, trials: int, level: float = LEVEL) -> Interval | None:
    """Exact interval of a share (Clopper and Pearson 1934), in [0, 1]; None without any trial."""
    return _exact(successes, trials, level) if trials else None


@lru_cache(maxsize=4096)
def _exact(successes: int, trials: int, level: float) -> Interval:
    from scipy import stats

    found = stats.binomtest(successes, trials).proportion_ci(level, method="exact")
    return Interval(float(found.low), float(found.high))


@lru_cache
def _quantile(freedom: int) -> float:
    """Of Student's t, two-sided."""
    from scipy import stats

    return float(stats.t.ppf((1 + LEVEL) / 2, freedom))
