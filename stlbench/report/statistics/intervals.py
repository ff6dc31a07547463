"""Intervals over seeds: of medians, means, shares and curves. `studies/interval_coverage.py` measures their coverage.

The unit is the seed. The starts of one seed share a policy, so they are averaged before anything here sees them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

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

    interval = stats.binomtest(successes, trials).proportion_ci(level, method="exact")
    return Interval(float(interval.low), float(interval.high))


@lru_cache
def _quantile(freedom: int) -> float:
    """Of Student's t, two-sided."""
    from scipy import stats

    return float(stats.t.ppf((1 + LEVEL) / 2, freedom))


Array = NDArray[np.float64]
Point = tuple[int, float, float]
"""One checkpoint: its environment steps, and what it scored."""


class MeanCurve(NamedTuple):
    """One line: the mean over seeds at common steps (p,), and the ends of its interval where it has one."""

    steps: Array
    mean: Array
    low: Array
    """(p,): NaN where there is no interval."""
    high: Array
    least: float
    """Of all seeds."""
    most: float


def mean_curve(
    curves: Sequence[Sequence[Point]],
    value: Callable[[Point], float],
    possible: tuple[float, float] = (-np.inf, np.inf),
) -> MeanCurve:
    """The mean of the seeds' curves, with its 95 % t interval where there are two seeds or more.

    The interval ends at what is `possible`, and never between the seeds.
    """
    steps, values = aligned(curves, value)
    ends = [mean_interval(column.tolist()) or (np.nan, np.nan) for column in values.T]
    low, high = np.array(ends, dtype=float).reshape(-1, 2).T
    low = np.maximum(low, np.minimum(possible[0], values.min(axis=0)))
    high = np.minimum(high, np.maximum(possible[1], values.max(axis=0)))
    return MeanCurve(steps, values.mean(axis=0), low, high, float(values.min()), float(values.max()))


def aligned(curves: Sequence[Sequence[Point]], value: Callable[[Point], float]) -> tuple[Array, Array]:
    """Curves on common steps: (p,) and (seeds, p), where seeds took checkpoints at other steps linearly interpolated.

    The common steps end where the shortest curve does and begin where the latest one does.
    """
    begin, end = max(curve[0][0] for curve in curves), min(curve[-1][0] for curve in curves)
    steps = np.array(sorted({point[0] for curve in curves for point in curve if begin <= point[0] <= end}), dtype=float)
    values = [np.interp(steps, [point[0] for point in curve], [value(point) for point in curve]) for curve in curves]
    return steps, np.array(values)


_HALF = 0.5
_SMALLEST = 1e-15
"""The distance of a share to 0 or to 1 below which it is not told from it."""


def log_evidence(successes: ArrayLike, trials: ArrayLike, share: ArrayLike) -> Any:
    """Logarithm of the evidence against a share in (0, 1), from so many trials: arrays or numbers, like the arguments.

    If the share is true, it is ever above log(1 / a), after whatever number of trials, with probability a at most.
    """
    import numpy as np
    from scipy import special

    won, lost = np.asarray(successes, dtype=float), np.subtract(trials, successes, dtype=float)
    shares = np.asarray(share, dtype=float)
    mixed = special.betaln(won + _HALF, lost + _HALF) - special.betaln(_HALF, _HALF)
    return mixed - special.xlogy(won, shares) - special.xlog1py(lost, -shares)


def share_sequence(successes: int, trials: int, level: float) -> Interval:
    """Interval of a share, in [0, 1], that covers it with probability `level` at all numbers of trials at once.

    Args:
        successes: how many of the trials.
        trials: so far, at least 0. They are independent, each a success with the probability that is asked for.
        level: confidence, in (0, 1).
    """
    limit = math.log(1 / (1 - level))
    if not trials:
        return Interval(0.0, 1.0)
    share = successes / trials
    low = 0.0 if successes == 0 else _crossing(successes, trials, limit, _SMALLEST, min(share, 1 - _SMALLEST))
    high = 1.0 if successes == trials else _crossing(successes, trials, limit, 1 - _SMALLEST, max(share, _SMALLEST))
    return Interval(low, high)


def _crossing(successes: int, trials: int, limit: float, outer: float, inner: float) -> float:
    """Where, between a share that is refuted and one that is not, the evidence reaches the limit."""
    from scipy import optimize

    def beyond(share: float) -> float:
        return float(log_evidence(successes, trials, share)) - limit

    return outer if beyond(outer) <= 0 else float(optimize.brentq(beyond, outer, inner, xtol=1e-12))
