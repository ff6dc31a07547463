"""Intervals over seeds, and of shares. Their coverage is measured: `studies/interval_coverage.py`.

The unit is the seed. The starts of one seed share a policy, so they are averaged before anything here sees them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVEL", "Interval", "interval", "iqm", "share_interval"]

LEVEL = 0.95
"""Confidence of every interval in tables and figures."""
QUARTER = 0.25
"""What an interquartile mean leaves out at either end; a quarter of n is rounded down."""


class Interval(NamedTuple):
    """Both ends, in the unit of the values."""

    low: float
    high: float


def iqm(values: Sequence[float], cut: float = QUARTER) -> float:
    """Interquartile mean: the mean of what is left without the lowest and the highest quarter.

    Up to 3 values nothing is left out: there it is the mean. Another `cut` leaves out that share; 0 is the mean.
    """
    return float(_sorted(values)[_kept(len(values), cut)].mean())


def interval(values: Sequence[float], cut: float = QUARTER) -> Interval | None:
    """95 % t interval of the interquartile mean (Tukey and McLaughlin 1963, with the error of Yuen 1974).

    The error is that of `scipy.stats.ttest_ind(trim=0.25)`. Where nothing is cut, which is so up to 3 values and where
    `cut` is 0, it is Student's interval of the mean.

    Args:
        values: one number per seed.
        cut: share that is left out at either end, in [0, 0.5).

    Returns:
        Lower and upper end; None for fewer than two values, or where one is not finite.
    """
    if len(values) < 2 or not np.isfinite(values).all():
        return None
    centre, error = iqm(values, cut), math.sqrt(_squared_error(values, cut))
    half = error * _quantile(_kept_count(len(values), cut) - 1)
    return Interval(centre - half, centre + half)


def _squared_error(values: Sequence[float], cut: float = QUARTER) -> float:
    """Squared error of a trimmed mean: (n - 1) s^2 / (h (h - 1)), for at least two values.

    s is the standard deviation of the values with the lowest and the highest replaced by the outermost of those that
    are left; h are left.
    """
    data, kept = _sorted(values), _kept_count(len(values), cut)
    inner = data[_kept(len(data), cut)]
    squares = float(np.clip(data, inner[0], inner[-1]).var(ddof=1))
    return (len(data) - 1) * squares / (kept * (kept - 1))


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


def _sorted(values: Sequence[float]) -> NDArray[np.float64]:
    """The same sums in whatever order the seeds come."""
    return np.sort(np.asarray(values, dtype=np.float64))


def _kept(count: int, cut: float) -> slice:
    left_out = int(cut * count)
    return slice(left_out, count - left_out)


def _kept_count(count: int, cut: float) -> int:
    return count - 2 * int(cut * count)
