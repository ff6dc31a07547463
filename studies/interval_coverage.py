"""How often intervals over seeds hold what they say, by simulation, as docs/reference/evaluation.md sums up.

    python studies/interval_coverage.py [REPETITIONS]

Two minutes with 4,000 repetitions. The families stand for what seeds do: all alike (normal), a tail of bad ones
(exponential), and a share of seeds that fail.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from stlbench.statistics import across
from stlbench.statistics.across import Estimate
from stlbench.statistics.intervals import mean_interval, median_interval

Array = NDArray[np.float64]
Sizes = tuple[int, ...]
Draw = Callable[[np.random.Generator, Sizes], Array]
SEEDS = (5, 10)
TASKS = 12


def _failing(share: float) -> Draw:
    """Seeds that learned are near 1, and a share of seeds, which failed, near -1 with more scatter."""

    def draw(generator: np.random.Generator, shape: Sizes) -> Array:
        failed = generator.random(shape) < share
        return np.where(failed, generator.normal(-1, 0.5, shape), generator.normal(1, 0.1, shape))

    return draw


FAMILIES: dict[str, Draw] = {
    "normal": lambda generator, shape: generator.normal(size=shape),
    "skewed": lambda generator, shape: -generator.exponential(size=shape),
    **{f"{round(100 * share)} % fail": _failing(share) for share in (0.1, 0.2, 0.3, 0.35, 0.4, 0.5)},
}
"""Name -> the function that draws the robustness of seeds."""


INTERVALS: dict[str, tuple[Callable[..., Array], Callable[[list[float]], tuple[float, float] | None]]] = {
    "median, from seed to seed (the report's)": (np.median, median_interval),
    "mean, t": (np.mean, mean_interval),
}
"""Name -> the statistic, and the interval of a sample."""


def coverage(name: str, family: str, seeds: int, repetitions: int) -> float:
    """The share of the repetitions in which an interval covers the statistic of two million seeds."""
    statistic, interval = INTERVALS[name]
    true = float(statistic(FAMILIES[family](np.random.default_rng(1), (2_000_000,)), axis=-1))
    samples = FAMILIES[family](np.random.default_rng(3), (repetitions, seeds))
    ends = np.array([interval(sample) for sample in samples.tolist()])
    return float(np.mean((ends[:, 0] <= true) & (true <= ends[:, 1])))


def aggregate_coverage(family: str, seeds: int, repetitions: int) -> float:
    """The coverage of the interquartile mean's interval, over tasks that differ in nothing but their level."""
    generator = np.random.default_rng(5)
    levels = np.linspace(0, 0.5, TASKS)[:, None]
    covered = 0
    many = FAMILIES[family](generator, (TASKS, 200_000)) + levels
    true = float(stats.trim_mean(many.ravel(), 0.25))
    for _ in range(repetitions):
        ends = across.middle(list(FAMILIES[family](generator, (TASKS, seeds)) + levels)).interval
        covered += ends is not None and ends.low <= true <= ends.high
    return covered / repetitions


def table(repetitions: int) -> Iterator[str]:
    """Lines of Markdown: a column for each family; each entry has the percent with 5 and 10 seeds."""
    yield f"| % of cases, with {', '.join(map(str, SEEDS))} seeds | {' | '.join(FAMILIES)} |"
    yield f"|---|{'---|' * len(FAMILIES)}"
    for name in INTERVALS:
        shares = ([coverage(name, family, count, repetitions) for count in SEEDS] for family in FAMILIES)
        yield f"| {name} | {' | '.join(', '.join(f'{100 * share:.1f}' for share in both) for both in shares)} |"


def over_tasks(repetitions: int) -> Iterator[str]:
    """One line per family: how often the bootstrap over 12 tasks covers."""
    for family in ("normal", "skewed", "20 % fail"):
        shares = (aggregate_coverage(family, count, repetitions // 10) for count in SEEDS)
        yield f"IQM over {TASKS} tasks, {family}: {', '.join(f'{100 * share:.1f}' for share in shares)} %"


Sample = Callable[[np.random.Generator, int, int], Array]


class Drawn(NamedTuple):
    """An estimate on tasks that a suite draws: its true value, and values (..., tasks, seeds) of a sample."""

    estimate: Callable[[Array], Estimate]
    true: float
    sample: Sample


def _score(true: float, sample: Sample) -> Drawn:
    return Drawn(lambda runs: across.sample_mean(list(runs)), true, sample)


def _jumps(height: float) -> Drawn:
    """Scores of .3 with little scatter; on a twentieth of the tasks they are higher by the height."""

    def sample(make: np.random.Generator, tasks: int, seeds: int) -> Array:
        return 0.3 + height * (make.random((tasks, 1)) < 0.05) + make.normal(0, 0.02, (tasks, seeds))

    return _score(0.3 + 0.05 * height, sample)


def _share(true: float, alike: bool = False) -> Drawn:
    """Seeds that learned: tasks are all as hard, or most of them are learned by all seeds or by none."""

    def sample(make: np.random.Generator, tasks: int, seeds: int) -> Array:
        return make.random((tasks, seeds)) < (true if alike else make.beta(true, 1 - true, (tasks, 1)))

    return Drawn(lambda runs: across.sample_share(runs.tolist()), true, sample)


def _difference(one: float, other: float) -> Drawn:
    """Seeds of two methods that learned such shares. A task that is hard for the one is hard for the other."""
    hard = stats.norm.isf([one, other]).reshape(2, 1, 1)

    def sample(make: np.random.Generator, tasks: int, seeds: int) -> Array:
        both, own, seed = (make.normal(size=size) for size in ((tasks, 1), (2, tasks, 1), (2, tasks, seeds)))
        return np.greater(0.8 * both + 0.45 * own + (1 - 0.8**2 - 0.45**2) ** 0.5 * seed, hard)

    return Drawn(lambda runs: across.sample_share_difference(*runs.tolist()), one - other, sample)


DRAWN: dict[str, Drawn] = {
    "score, normal": _score(
        0.0, lambda make, tasks, seeds: make.normal(size=(tasks, 1)) + make.normal(size=(tasks, seeds))
    ),
    "score, seeds alone": _score(0.0, lambda make, tasks, seeds: make.normal(size=(tasks, seeds))),
    "score, skewed": _score(-1.0, lambda make, tasks, seeds: -make.exponential(size=(tasks, 1)) * np.ones(seeds)),
    "score, rare rise": _jumps(0.7),
    "score, rare fall": _jumps(-0.7),
    **{f"share {true:g}": _share(true) for true in (0.03, 0.05, 0.1, 0.2, 0.6)},
    **{f"share {true:g}, tasks alike": _share(true, alike=True) for true in (0.1, 0.5)},
    **{
        f"shares {one:g} less {other:g}": _difference(one, other)
        for one, other in ((0.05, 0.05), (0.05, 0.0), (0.1, 0.02), (0.2, 0.1), (0.5, 0.5), (0.6, 0.4), (0.9, 0.5))
    },
}
"""Name -> the sample. Tasks differ as much as seeds do (normal), or seeds alone do, or tasks alone (skewed)."""


def drawn_coverage(family: str, tasks: int, seeds: int, repetitions: int) -> float:
    """How often the interval covers the mean over all tasks, where a suite drew so many."""
    (estimate, true, sample), make, covered = DRAWN[family], np.random.default_rng(7), 0
    for _ in range(repetitions):
        ends = estimate(sample(make, tasks, seeds).astype(np.float64)).interval
        covered += ends is not None and ends.low <= true <= ends.high
    return covered / repetitions


def over_drawn_tasks(repetitions: int) -> Iterator[str]:
    """One line per family and number of tasks: with one and with two seeds."""
    for family in DRAWN:
        for tasks in (across.FEWEST, 12, 24, 100):
            shares = (drawn_coverage(family, tasks, seeds, repetitions // 4) for seeds in (1, 2))
            yield f"{tasks} drawn tasks, {family}: {', '.join(f'{100 * each:.1f}' for each in shares)} %"


if __name__ == "__main__":
    REPETITIONS = int(sys.argv[1]) if len(sys.argv) > 1 else 4000
    for line in chain(table(REPETITIONS), over_tasks(REPETITIONS), over_drawn_tasks(REPETITIONS)):
        print(line, flush=True)
