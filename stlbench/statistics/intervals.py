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

LEVEL = 0.95  # confidence of every interval in tables and figures; the median of five seeds has 93.75 %
FEWEST = 5  # seeds of an interval of the median, at least: the ends of four seeds cover it in 87.5 % of cases only


class Interval(NamedTuple):
    """Both ends, in the unit of the values."""

    low: float
    high: float

    @property
    def percent(self) -> Interval:
        """The interval of a share, in percent."""
        return Interval(100 * self.low, 100 * self.high)


def median(values: Sequence[float]) -> float:
    return float(np.median(values))


def mean(values: Sequence[float]) -> float | None:
    """The mean; None without values."""
    return float(np.mean(values)) if values else None


def median_interval(values: Sequence[float]) -> Interval | None:
    """Interval of the median: from one seed to another (Thompson 1936, Annals of Mathematical Statistics 7).

    The number of seeds below the median is binomial with probability 1/2, whatever the distribution is, also if many
    seeds fail. The interval leaves out as many seeds at either end as a coverage of 95 % allows. The coverage is
    93.75 % for five values, 97.9 % for ten, at least 95 % for any other number. The interval is None for fewer values
    than `FEWEST`, or if one is not finite.
    """
    if len(values) < FEWEST or not np.isfinite(values).all():
        return None
    data, outside = sorted(values), _outside(len(values))
    return Interval(float(data[outside]), float(data[-1 - outside]))


@lru_cache
def _outside(count: int) -> int:
    """The number of seeds that may be outside at either end."""
    from scipy import stats

    return max(0, int(stats.binom.ppf((1 - LEVEL) / 2, count, 0.5)) - 1)


def mean_interval(values: Sequence[float]) -> Interval | None:
    """Student's 95 % t interval of the mean; None for fewer than two values, or if one is not finite."""
    if len(values) < 2 or not np.isfinite(values).all():
        return None
    data = np.sort(np.asarray(values, dtype=np.float64))  # the same sums in whatever order the seeds come
    half = float(data.std(ddof=1)) / math.sqrt(len(data)) * _quantile(len(data) - 1)
    return Interval(float(data.mean()) - half, float(data.mean()) + half)


@lru_cache(maxsize=4096)
def share_interval(successes: float, trials: int, level: float = LEVEL) -> Interval | None:
    """Exact interval of a share (Clopper and Pearson 1934), in [0, 1]; None without any trial.

    Each trial adds from 0 to 1 to the successes. Parts of a success vary less than a coin, so that the interval is then
    wider than need be.
    """
    from scipy import special

    if not trials:
        return None
    outside, failures = (1 - level) / 2, trials - successes
    low = float(special.betaincinv(successes, failures + 1, outside)) if successes > 0 else 0.0
    high = float(special.betaincinv(successes + 1, failures, 1 - outside)) if failures > 0 else 1.0
    return Interval(low, high)


@lru_cache
def _quantile(freedom: int) -> float:
    """A quantile of Student's t, two-sided."""
    from scipy import stats

    return float(stats.t.ppf((1 + LEVEL) / 2, freedom))


Array = NDArray[np.float64]
Point = tuple[int, float, float]  # one checkpoint: its environment steps, and what it scored


class MeanCurve(NamedTuple):
    """One line: the mean over seeds at common steps (p,), and the ends of its interval if it has one."""

    steps: Array
    mean: Array
    low: Array  # (p,): NaN where there is no interval
    high: Array
    least: float  # the least and the greatest value of any seed at a common step
    most: float


def mean_curve(
    curves: Sequence[Sequence[Point]],
    value: Callable[[Point], float],
    possible: tuple[float, float] = (-np.inf, np.inf),
) -> MeanCurve:
    """The mean of the seeds' curves, with its 95 % t interval if there are two seeds or more.

    The interval is cut at what is `possible`, but never between the seeds. The curves `overlap`.
    """
    steps, values = aligned(curves, value)
    ends = [mean_interval(column.tolist()) or (np.nan, np.nan) for column in values.T]
    low, high = np.array(ends, dtype=float).reshape(-1, 2).T
    low = np.maximum(low, np.minimum(possible[0], values.min(axis=0)))
    high = np.minimum(high, np.maximum(possible[1], values.max(axis=0)))
    return MeanCurve(steps, values.mean(axis=0), low, high, float(values.min()), float(values.max()))


def overlap(curves: Sequence[Sequence[Point]]) -> bool:
    """Whether the curves have common steps: the latest first checkpoint is no later than the earliest last one."""
    return max(curve[0][0] for curve in curves) <= min(curve[-1][0] for curve in curves)


def aligned(curves: Sequence[Sequence[Point]], value: Callable[[Point], float]) -> tuple[Array, Array]:
    """Curves on common steps: (p,) and (seeds, p), interpolated for seeds with checkpoints at other steps.

    The common steps begin with the latest first checkpoint, and end with the earliest last one.
    """
    begin, end = max(curve[0][0] for curve in curves), min(curve[-1][0] for curve in curves)
    steps = np.array(sorted({point[0] for curve in curves for point in curve if begin <= point[0] <= end}), dtype=float)
    values = [np.interp(steps, [point[0] for point in curve], [value(point) for point in curve]) for curve in curves]
    return steps, np.array(values)


_SMALLEST = 1e-15  # a share that is closer to 0 or to 1 is not told from it


def log_evidence(successes: ArrayLike, trials: ArrayLike, share: ArrayLike) -> Any:
    """Logarithm of the evidence against a share in (0, 1), from so many trials: arrays or numbers, like the arguments.

    It is the likelihood of the trials, averaged over shares with the weight Beta(1/2, 1/2), over that of the share. If
    the share is true, the probability is at most a that the evidence is ever above 1 / a (Robbins 1970, Annals of
    Mathematical Statistics 41).
    """
    from scipy import special

    won, lost = np.asarray(successes, dtype=float), np.subtract(trials, successes, dtype=float)
    shares = np.asarray(share, dtype=float)
    mixed = special.betaln(won + 0.5, lost + 0.5) - special.betaln(0.5, 0.5)
    return mixed - special.xlogy(won, shares) - special.xlog1py(lost, -shares)


def share_sequence(successes: int, trials: int, level: float) -> Interval:
    """Interval of a share, in [0, 1], that covers it with probability `level` at all numbers of trials at once.

    The trials are independent, and the share is the probability of a success. The interval has the shares that
    `log_evidence` does not refute.
    """
    if not trials:
        return Interval(0.0, 1.0)
    from scipy import optimize

    def beyond(share: float) -> float:
        return float(log_evidence(successes, trials, share)) - math.log(1 / (1 - level))

    def end(outer: float, inner: float) -> float:
        """Between a share that is refuted and one that is not."""
        return outer if beyond(outer) <= 0 else float(optimize.brentq(beyond, outer, inner, xtol=1e-12))

    share = successes / trials
    low = 0.0 if successes == 0 else end(_SMALLEST, min(share, 1 - _SMALLEST))
    high = 1.0 if successes == trials else end(1 - _SMALLEST, max(share, _SMALLEST))
    return Interval(low, high)
