"""Ranks over tasks, and how far apart the ranks of two methods must be that they differ (Demsar 2006, JMLR 7)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stlbench.statistics.across import Array
from stlbench.statistics.intervals import LEVEL


class Ranking(NamedTuple):
    """The mean ranks of methods, and what tests over tasks say of them."""

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
