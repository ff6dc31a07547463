"""How often intervals over seeds hold what they say, by simulation: the table in docs/reference/evaluation.md.

    python studies/interval_coverage.py [REPETITIONS]

Four minutes with 4,000 repetitions. Three families stand for what seeds do: all alike (normal), a tail of bad ones
(exponential), and a fifth that did not learn (bimodal).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from stlbench.report.statistics import across
from stlbench.report.statistics.differences import Pair, differences
from stlbench.report.statistics.intervals import interval

Array = NDArray[np.float64]
Sizes = tuple[int, ...]
SEEDS = (3, 5, 10)
TASKS = 12


def _bimodal(generator: np.random.Generator, shape: Sizes) -> Array:
    learned = generator.random(shape) < 0.8
    return np.where(learned, generator.normal(1, 0.1, shape), generator.normal(-1, 0.5, shape))


FAMILIES: dict[str, Callable[[np.random.Generator, Sizes], Array]] = {
    "normal": lambda generator, shape: generator.normal(size=shape),
    "skewed": lambda generator, shape: -generator.exponential(size=shape),
    "bimodal": _bimodal,
}
"""Name -> how robustness of seeds is drawn."""


def iqm(values: Array, axis: int = -1) -> Array:
    """Interquartile means along an axis."""
    means: Array = stats.trim_mean(values, 0.25, axis)
    return means


def true_value(family: str, statistic: Callable[..., Array]) -> float:
    """Of the family itself, as of two million seeds."""
    return float(statistic(FAMILIES[family](np.random.default_rng(1), (2_000_000,)), axis=-1))


def t_covers(samples: Array, true: float, cut: float) -> Array:
    """Whether the interval of each of the samples (R, n) covers the true value: (R,)."""
    ends = np.array([interval(sample, cut) for sample in samples.tolist()])
    return (ends[:, 0] <= true) & (true <= ends[:, 1])


def bootstrap_covers(samples: Array, true: float, statistic: Callable[..., Array], method: str) -> Array:
    """The same of a bootstrap interval with 999 resamples."""
    with np.errstate(all="ignore"):
        found = stats.bootstrap(
            (samples,), statistic, n_resamples=999, batch=20, axis=-1, method=method, rng=np.random.default_rng(2)
        ).confidence_interval
    covered: Array = (found.low <= true) & (true <= found.high)
    return covered


INTERVALS: dict[str, tuple[Callable[..., Array], Callable[[Array, float], Array]]] = {
    "IQM, t (the report's)": (iqm, lambda samples, true: t_covers(samples, true, 0.25)),
    "mean, t": (np.mean, lambda samples, true: t_covers(samples, true, 0)),
    "mean, BCa": (np.mean, lambda samples, true: bootstrap_covers(samples, true, np.mean, "BCa")),
    "IQM, BCa": (iqm, lambda samples, true: bootstrap_covers(samples, true, iqm, "BCa")),
    "IQM, percentile": (iqm, lambda samples, true: bootstrap_covers(samples, true, iqm, "percentile")),
}
"""Name -> the statistic, and from samples (R, n) and its true value to whether the interval covers it."""


def coverage(name: str, family: str, seeds: int, repetitions: int) -> float:
    """The share of the repetitions in which an interval covers the true value."""
    statistic, covers = INTERVALS[name]
    samples = FAMILIES[family](np.random.default_rng(3), (repetitions, seeds))
    return float(covers(samples, true_value(family, statistic)).mean())


def false_alarms(family: str, seeds: int, repetitions: int) -> float:
    """How often one of two methods that are alike is called better."""
    samples = FAMILIES[family](np.random.default_rng(4), (repetitions, 2, seeds)).tolist()
    words = [differences([Pair(one, other)])[0].word for one, other in samples]
    return sum(word in ("better", "worse") for word in words) / repetitions


def aggregate_coverage(family: str, seeds: int, repetitions: int) -> float:
    """Of the interquartile mean over tasks that differ in nothing but their level."""
    generator = np.random.default_rng(5)
    levels = np.linspace(0, 0.5, TASKS)[:, None]
    covered = 0
    many = FAMILIES[family](generator, (TASKS, 200_000)) + levels
    true = float(iqm(many.ravel()))
    for _ in range(repetitions):
        ends = across.middle(list(FAMILIES[family](generator, (TASKS, seeds)) + levels)).interval
        covered += ends is not None and ends.low <= true <= ends.high
    return covered / repetitions


def rows(repetitions: int) -> dict[str, Callable[[str, int], float]]:
    """Name of a row -> from a family and a number of seeds to a share."""

    def covering(name: str) -> Callable[[str, int], float]:
        return lambda family, seeds: coverage(name, family, seeds, repetitions)

    return {name: covering(name) for name in INTERVALS} | {
        "IQM over 12 tasks, stratified bootstrap": lambda *which: aggregate_coverage(*which, repetitions // 10),
        "called better or worse, though alike": lambda *which: false_alarms(*which, repetitions),
    }


def table(repetitions: int) -> Iterator[str]:
    """Lines of Markdown: a column for each family; each entry has the percent with 3, 5 and 10 seeds."""
    yield f"| % of cases, with {', '.join(map(str, SEEDS))} seeds | {' | '.join(FAMILIES)} |"
    yield f"|---|{'---|' * len(FAMILIES)}"
    for name, share in rows(repetitions).items():
        entries = [", ".join(f"{100 * share(family, count):.1f}" for count in SEEDS) for family in FAMILIES]
        yield f"| {name} | {' | '.join(entries)} |"


if __name__ == "__main__":
    for line in table(int(sys.argv[1]) if len(sys.argv) > 1 else 4000):
        print(line, flush=True)
