"""Numbers over the tasks of a comparison: aggregates with stratified bootstrap intervals (Agarwal et al. 2021,
`rliable`), ranks and their critical difference (Demsar 2006, JMLR 7), and means over tasks that are a sample.

A method's *runs* are one array for each task, with one normalised score for each seed. A bootstrap draws seeds anew
within each task, and never tasks: intervals are for these tasks alone.

Intervals of a sample of tasks (`sample_mean` and its like) are for all tasks of this kind. Those of scores come from a
hierarchical bootstrap: a resample draws tasks, and then seeds of each task that it drew. Resamples do not hold what no
task of the sample shows, such as rare learning. So shares of seeds, which have bounds, have intervals that need no
resamples. `studies/interval_coverage.py` measures the coverage of all.
"""

from collections.abc import Callable, Sequence
from math import fsum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.statistics.intervals import LEVEL, Interval, mean_interval, share_interval

Array = NDArray[np.float64]
Runs = Sequence[Array]  # one array (n,) per task
RESAMPLES, FEWEST_RESAMPLES = 9999, 999
_DRAWN = 50_000_000
"""About the number of runs that all resamples of a bootstrap draw. More than 5,000 runs have fewer resamples."""
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


class Ranking(NamedTuple):
    """The mean ranks of methods, and the results of tests over tasks."""

    ranks: tuple[float, ...]
    """The mean over the tasks of each method's place; 1 is the best, and equal values share a place."""
    chance: float
    """P-value of Friedman's test: that the places differ so much if all methods are alike."""
    difference: float
    """Nemenyi's critical difference at 5 %: ranks that are farther apart differ, corrected for all pairs."""

    @property
    def alike(self) -> list[tuple[int, ...]]:
        """The largest sets of methods, by their places, whose ranks are not farther apart than that; two or more."""
        order = sorted(range(len(self.ranks)), key=lambda method: self.ranks[method])
        sets, last = list[tuple[int, ...]](), -1
        for first, best in enumerate(order):
            near = [i for i, each in enumerate(order) if i >= first and self._near(best, each)]
            if near[-1] > max(first, last):
                sets.append(tuple(order[i] for i in near))
                last = near[-1]
        return sets

    def _near(self, one: int, other: int) -> bool:
        return abs(self.ranks[other] - self.ranks[one]) <= self.difference


def ranking(values: Array) -> Ranking:
    """Rank three methods or more by their values, (tasks, methods); larger is better."""
    from scipy import stats

    tasks, methods = values.shape
    places = stats.rankdata(-values, axis=1)
    alike = (places == places[:, :1]).all()  # Friedman's statistic is 0 / 0
    chance = 1.0 if alike else float(stats.friedmanchisquare(*values.T).pvalue)
    quantile = float(stats.studentized_range.ppf(LEVEL, methods, np.inf)) / np.sqrt(2)
    difference = quantile * np.sqrt(methods * (methods + 1) / (6 * tasks))
    return Ranking(tuple(places.mean(axis=0).tolist()), chance, float(difference))


Shares = Sequence[Sequence[bool]]
"""For each task, whether each seed succeeded."""
FEWEST = 8
"""The fewest tasks of an interval."""
SAMPLE_RESAMPLES = 4999


def sample_mean(runs: Runs) -> Estimate:
    """The mean over the tasks of the mean of their seeds, with its 95 % interval."""
    values = [float(np.mean(seeds)) for seeds in runs]
    return _estimate(values, lambda chosen, generator: _means(runs, chosen, generator))


def sample_share(runs: Shares) -> Estimate:
    """The share of seeds that succeed, mean over the tasks, in [0, 1].

    The interval is that of as many trials as there are tasks, since a task's share varies no more than one seed.
    """
    shares = [float(np.mean(seeds)) for seeds in runs]
    ends = share_interval(fsum(shares), len(shares)) if len(shares) >= FEWEST else None
    return Estimate(float(np.mean(shares)), ends)


def sample_share_difference(one: Shares, other: Shares) -> Estimate:
    """How much greater the one's share of seeds that succeed is, mean over the tasks, in [-1, 1].

    The interval is Student's, with two more tasks, of which each method wins one (as Agresti and Min 2005 do for pairs
    of shares). So it has a width even if no task tells the methods apart.
    """
    values = [float(np.mean(first)) - float(np.mean(second)) for first, second in zip(one, other, strict=True)]
    ends = mean_interval([*values, 1.0, -1.0]) if len(values) >= FEWEST else None
    return Estimate(float(np.mean(values)), ends and Interval(max(ends.low, -1.0), min(ends.high, 1.0)))


def sample_difference(one: Runs, other: Runs) -> Estimate:
    """The mean over the tasks of how much more the one has than the other, with its 95 % interval.

    Both have the same tasks in the same order. A resample draws the same tasks of both, and seeds of each by itself.
    """
    values = [float(np.mean(first) - np.mean(second)) for first, second in zip(one, other, strict=True)]

    def drawn(chosen: NDArray[np.int64], generator: np.random.Generator) -> Array:
        return _means(one, chosen, generator) - _means(other, chosen, generator)

    return _estimate(values, drawn)


def _estimate(values: Sequence[float], drawn: Callable[[NDArray[np.int64], np.random.Generator], Array]) -> Estimate:
    """The mean of the tasks' `values`, and percentiles of what resamples of tasks have.

    Plain percentiles are too narrow for few tasks. These are expanded: for normal values the interval is as wide as
    Student's t (Hesterberg 2015, What teachers should know about the bootstrap, section 5.2).
    """
    value, count = float(np.mean(values)), len(values)
    if count < FEWEST:
        return Estimate(value, None)
    from scipy import special

    generator = np.random.default_rng(0)
    chosen = generator.integers(count, size=(SAMPLE_RESAMPLES, count))
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
