"""Numbers over seeds: the interquartile mean and bootstrap intervals.

The unit is the seed. The starts of one seed share a policy, so they are averaged before anything here sees them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Interval", "Statistic", "interval", "iqm"]

Statistic = Callable[..., Any]
"""A function of values and `axis`, such as `np.mean`, `np.median` or `iqm`."""

RESAMPLES = 9999
"""Of one bootstrap."""


class Interval(NamedTuple):
    """Both ends, in the unit of the values."""

    low: float
    high: float


def iqm(values: Iterable[float] | NDArray[np.float64], axis: int = 0) -> Any:
    """Interquartile mean: the mean of what is left without the lowest and the highest quarter.

    A quarter of n is rounded down, so up to 3 values nothing is cut: with 3 seeds the IQM equals the mean.
    """
    data = np.moveaxis(_array(values), axis, -1)
    cut, count = data.shape[-1] // 4, data.shape[-1]
    return np.partition(data, (cut, count - cut - 1))[..., cut : count - cut].mean(axis=-1)


def interval(values: Iterable[float], statistic: Statistic, seed: int = 0, level: float = 0.95) -> Interval | None:
    """Percentile bootstrap interval of a statistic, one value per seed.

    The same values give the same interval, in whatever order they come. With few seeds the interval is narrow by
    construction: with 3 it lies between the smallest and the largest value, whatever the level.

    Args:
        values: one number per seed.
        statistic: applied to the resampled values, along `axis`.
        seed: of the resampling.
        level: share of the resampled statistics inside, in (0, 1).

    Returns:
        Lower and upper end; None for fewer than two values, or where one is not finite.
    """
    data = np.sort(_array(values))
    if len(data) < 2 or not np.isfinite(data).all():
        return None
    if data[0] == data[-1]:
        return Interval(float(data[0]), float(data[0]))
    return _bootstrapped(tuple(data.tolist()), statistic, seed, level)


@lru_cache(maxsize=4096)
def _bootstrapped(values: tuple[float, ...], statistic: Statistic, seed: int, level: float) -> Interval:
    """Cached, since a report shows an interval on screen, in files and in a figure, and each takes milliseconds."""
    rng, data, resampled = np.random.default_rng(seed), np.array(values), list[NDArray[np.float64]]()
    batch = max(1, 1_000_000 // len(values))  # resamples held in memory at a time
    for begin in range(0, RESAMPLES, batch):
        places = rng.integers(0, len(values), (min(batch, RESAMPLES - begin), len(values)))
        resampled.append(statistic(data[places], axis=-1))
    tail = (1 - level) / 2
    low, high = np.quantile(np.concatenate(resampled), (tail, 1 - tail))
    return Interval(float(low), float(high))


def _array(values: Iterable[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(values if isinstance(values, np.ndarray) else list(values), dtype=np.float64)
