"""Means over tasks that are a sample, such as those that a suite draws.

Intervals are for all tasks of this kind, and not for these tasks alone as in `across`. Those of scores come from a
hierarchical bootstrap: a resample draws tasks, and then seeds of each task that it drew. Resamples do not hold what no
task of the sample shows, such as rare learning. So shares of seeds, which have bounds, have intervals that need no
resamples. `studies/interval_coverage.py` measures the coverage of all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import fsum

import numpy as np
from numpy.typing import NDArray

from stlbench.statistics.across import Array, Estimate, Runs
from stlbench.statistics.intervals import LEVEL, Interval, mean_interval, share_interval

Shares = Sequence[Sequence[bool]]
"""For each task, whether each seed succeeded."""
FEWEST = 8
"""Tasks of an interval, at least."""
RESAMPLES = 4999


def mean(runs: Runs) -> Estimate:
    """The mean over the tasks of the mean of their seeds, with its 95 % interval."""
    values = [float(np.mean(seeds)) for seeds in runs]
    return _estimate(values, lambda chosen, generator: _means(runs, chosen, generator))


def share(runs: Shares) -> Estimate:
    """The share of seeds that succeed, mean over the tasks, in [0, 1].

    The interval is that of as many trials as there are tasks, since a task's share varies no more than one seed.
    """
    shares = [float(np.mean(seeds)) for seeds in runs]
    ends = share_interval(fsum(shares), len(shares)) if len(shares) >= FEWEST else None
    return Estimate(float(np.mean(shares)), ends)


def share_difference(one: Shares, other: Shares) -> Estimate:
    """How much greater the one's share of seeds that succeed is, mean over the tasks, in [-1, 1].

    The interval is Student's, with two more tasks, of which each method wins one (as Agresti and Min 2005 do for pairs
    of shares). So it has a width also where no task tells the methods apart.
    """
    values = [float(np.mean(first)) - float(np.mean(second)) for first, second in zip(one, other, strict=True)]
    ends = mean_interval([*values, 1.0, -1.0]) if len(values) >= FEWEST else None
    return Estimate(float(np.mean(values)), ends and Interval(max(ends.low, -1.0), min(ends.high, 1.0)))


def difference(one: Runs, other: Runs) -> Estimate:
    """The mean over the tasks of how much more the one has than the other, with its 95 % interval.

    Both have the same tasks in the same order. A resample draws the same tasks of both, and seeds of each by itself.
    """
    values = [float(np.mean(first) - np.mean(second)) for first, second in zip(one, other, strict=True)]

    def drawn(chosen: NDArray[np.int64], generator: np.random.Generator) -> Array:
        return _means(one, chosen, generator) - _means(other, chosen, generator)

    return _estimate(values, drawn)


def _estimate(values: Sequence[float], drawn: Callable[[NDArray[np.int64], np.random.Generator], Array]) -> Estimate:
    """The mean of the tasks' `values`, and percentiles of what resamples of tasks have.

    Plain percentiles are too narrow for few tasks. These are expanded, so that the interval is as wide as Student's t
    where the values are normal (Hesterberg 2015, What teachers should know about the bootstrap, section 5.2).
    """
    value, count = float(np.mean(values)), len(values)
    if count < FEWEST:
        return Estimate(value, None)
    from scipy import special

    generator = np.random.default_rng(0)
    chosen = generator.integers(count, size=(RESAMPLES, count))
    outside = special.ndtr(special.stdtrit(count - 1, (1 - LEVEL) / 2) * np.sqrt(count / (count - 1)))
    low, high = np.quantile(drawn(chosen, generator), [outside, 1 - outside])
    return Estimate(value, Interval(float(low), float(high)))


def _means(runs: Runs, chosen: NDArray[np.int64], generator: np.random.Generator) -> Array:
    """For each resample the mean over its tasks (resamples, tasks), with seeds drawn anew for each."""
    counts = np.array([len(seeds) for seeds in runs])
    padded = np.zeros((len(runs), counts.max()))
    for task, seeds in enumerate(runs):
        padded[task, : len(seeds)] = np.sort(seeds)  # whatever the order of the seeds
    total = np.zeros(chosen.shape)
    for place in range(counts.max()):
        seeds = (generator.random(chosen.shape) * counts[chosen]).astype(np.int64)
        total += np.where(place < counts[chosen], padded[chosen, seeds], 0.0)
    means: Array = (total / counts[chosen]).mean(axis=1)
    return means
