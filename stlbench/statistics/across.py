"""Aggregates over the tasks of a comparison, with stratified bootstrap intervals (Agarwal et al. 2021, `rliable`).

A method's *runs* are one array for each task, with one normalised score for each seed. A bootstrap draws seeds anew
within each task, and never tasks: intervals are for these tasks alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.statistics.intervals import LEVEL, Interval

Array = NDArray[np.float64]
Runs = Sequence[Array]  # one array (n,) per task
RESAMPLES, FEWEST_RESAMPLES = 9999, 999
_DRAWN = 50_000_000
"""Runs that all resamples of a bootstrap draw together, about. More than 5,000 runs have fewer resamples."""
_BATCH, _HELD = 500, 2_500_000  # resamples held in memory at a time, and the runs in them, at most


class Estimate(NamedTuple):
    """A number with its 95 % interval, None if a task has fewer than two runs."""

    value: float
    interval: Interval | None


def mean(runs: Runs) -> Estimate:
    return _estimates(lambda *drawn, axis: np.concatenate(drawn, axis).mean(axis), runs)[0]


def middle(runs: Runs) -> Estimate:
    """The interquartile mean of all runs of all tasks together."""
    from scipy import stats

    return _estimates(lambda *drawn, axis: stats.trim_mean(np.concatenate(drawn, axis), 0.25, axis), runs)[0]


def improvement(one: Runs, other: Runs) -> Estimate:
    """Probability that a run of the one is better than a run of the other on the same task, mean over the tasks.

    Equal runs count half. 0.5 says that neither is better.
    """
    from scipy import stats

    def share(first: Array, second: Array, axis: int) -> Array:
        """The share among all pairs, by the sum of ranks (Mann and Whitney 1947)."""
        n, m = first.shape[axis], second.shape[axis]
        ranks = stats.rankdata(np.concatenate([first, second], axis), axis=axis)
        return np.asarray((ranks[..., :n].sum(axis) - n * (n + 1) / 2) / (n * m))

    def wins(*drawn: Array, axis: int) -> Array:
        pairs = zip(drawn[: len(one)], drawn[len(one) :], strict=True)
        return np.asarray(np.mean([share(*pair, axis) for pair in pairs], axis=0))

    return _estimates(wins, [*one, *other])[0]


def ranks(tasks: Sequence[Sequence[tuple[int, Array] | None]]) -> list[Estimate]:
    """The mean rank of each method over the tasks that it fits, among the methods that fit them; 1 is the best.

    For each task and method: its class and its runs, or None if it does not fit. Methods of one class are paid the
    same. Classes are sorted by the median of all their runs, and their methods share the mean of their places. So do
    methods that are exactly as good.
    """
    from scipy import stats

    strata, at = list[Array](), list[list[int | None]]()
    for methods in tasks:
        classes = dict[int, list[Array]]()
        for method in methods:
            if method is not None:
                classes.setdefault(method[0], []).append(method[1])
        first = {kind: len(strata) + i for i, kind in enumerate(classes)}
        strata += [np.concatenate(runs) for runs in classes.values()]
        at.append([None if method is None else first[method[0]] for method in methods])

    def places(*drawn: Array, axis: int) -> Array:
        """-> (methods, ...)."""
        centres = np.stack([np.median(runs, axis) for runs in drawn])
        placed = np.full((len(at), len(at[0]), *centres.shape[1:]), np.nan)
        for task, methods in enumerate(at):
            fitting = {method: where for method, where in enumerate(methods) if where is not None}
            placed[task, list(fitting)] = stats.rankdata(-centres[list(fitting.values())], axis=0)
        return np.asarray(np.nanmean(placed, axis=0))

    return _estimates(places, strata)


def profile(runs: Runs, thresholds: Array) -> list[Estimate]:
    """The share of runs whose score is above each threshold, every task with the same weight."""

    def above(*drawn: Array, axis: int) -> Array:
        shares = [[(scores > threshold).mean(axis) for threshold in thresholds] for scores in drawn]
        return np.asarray(np.mean(shares, axis=0))

    return _estimates(above, runs)


def _estimates(statistic: Callable[..., Any], strata: Runs) -> list[Estimate]:
    """The numbers that a statistic of the strata has, with their intervals, whatever the order of the seeds.

    Time and memory are bounded, except for the time of `FEWEST_RESAMPLES` resamples of many runs.
    """
    data = [np.sort(np.asarray(seeds, dtype=np.float64)) for seeds in strata]
    values = np.atleast_1d(statistic(*data, axis=-1)).tolist()
    if min(map(len, data)) < 2:
        return [Estimate(value, None) for value in values]
    from scipy import stats

    count = sum(map(len, data))
    interval = stats.bootstrap(
        data,
        statistic,
        n_resamples=min(RESAMPLES, max(FEWEST_RESAMPLES, _DRAWN // count)),
        batch=min(_BATCH, max(1, _HELD // count)),
        vectorized=True,
        axis=-1,
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    ends = zip(np.atleast_1d(interval.low).tolist(), np.atleast_1d(interval.high).tolist(), strict=True)
    return [Estimate(value, Interval(*end)) for value, end in zip(values, ends, strict=True)]
