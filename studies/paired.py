"""Two methods on the tasks that both take: Wilcoxon's signed-rank test over tasks, with Holm's correction.

The scores of a task are means over its seeds, so a task is one pair. Pairs that are tested together are corrected
together.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import NamedTuple

import numpy as np
import recorded
from recorded import markdown

from stlbench.records.result import LEARNED
from stlbench.statistics import across
from stlbench.statistics.across import Estimate
from stlbench.statistics.differences import holm

Runs = Mapping[str, Mapping[str, Sequence[float]]]
"""Method -> task -> a number for each seed."""
STATED = (("funnel", "raw"), ("bhnr", "raw"))
"""The comparisons of `studies/suite-fresh.yaml`."""


class Paired(NamedTuple):
    """How much more one method has than another, on the tasks that both take."""

    pairs: Sequence[tuple[Sequence[float], Sequence[float]]]

    @property
    def told(self) -> str:
        """ "0.11 [0.04, 0.19]": the mean over tasks, with its interval where tasks are many."""
        return _told(across.sample_difference(*(list(map(np.array, each)) for each in zip(*self.pairs, strict=True))))

    @property
    def shares_told(self) -> str:
        """The same of runs that learned."""
        return _told(across.sample_share_difference(*zip(*self.pairs, strict=True)))

    @property
    def chance(self) -> float:
        """The p-value of Wilcoxon's test, two-sided; 1 where no task differs."""
        from scipy.stats import wilcoxon

        more = np.array([fmean(one) - fmean(other) for one, other in self.pairs])
        return float(wilcoxon(more).pvalue) if more.any() else 1.0


def _told(found: Estimate) -> str:
    value, *ends = (recorded.number(str(each), 2) for each in (found.value, *(found.interval or ())))
    return f"{value} [{', '.join(ends)}]" if ends else value


def compared(runs: Runs, one: str, other: str) -> Paired:
    """Two methods, on the tasks that both take."""
    return Paired([(own, runs[other][task]) for task, own in runs[one].items() if task in runs[other]])


def runs(folder: str, column: str = "score") -> Runs:
    """The score of a folder's finished cells, or whether each `learned`."""
    found = defaultdict[str, dict[str, list[float]]](dict)
    for row in recorded.table(folder, "cells"):
        if row["status"] == "done":
            score = recorded.scored(row["task"], float(row["robustness_mean"]))
            value = score if column == "score" else float(float(row["satisfaction"]) >= LEARNED)
            found[row["method"]].setdefault(row["task"], []).append(value)
    return found


def stated(folder: str = "suite-fresh") -> str:
    """One row per comparison that was stated before: scores and runs that learned, and the p-values of the scores."""
    own, learned = runs(folder), runs(folder, "learned")
    found = [compared(own, *pair) for pair in STATED]
    body = [
        [
            f"`{one}` less `{other}`",
            str(len(each.pairs)),
            each.told,
            compared(learned, one, other).shares_told,
            _p(chance),
        ]
        for (one, other), each, chance in zip(STATED, found, holm([each.chance for each in found]), strict=True)
    ]
    return markdown(["new and hard tasks", "tasks", "score", "share learned", "p, Holm"], body, right=4)


def _p(chance: float) -> str:
    return "< 0.001" if chance < 0.001 else f"{chance:.3f}"
