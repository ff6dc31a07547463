"""The objective of a search: the robustness of the task's formula as a function of the start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stlbench.contract import Array
from stlbench.search.actor import VERDICTS, Actor, Verdict
from stlbench.search.space import Box, Seeds

FAR = 1e6  # the value of a point outside the region of starts, plus its distance: worse than all points inside
_OUTSIDE = 20  # the most points for each evaluation. Points outside the region are not simulated


class Enough(Exception):
    """The search is over: a counterexample was found, all evaluations are used, or a simulation failed."""


@dataclass(frozen=True)
class Worst:
    """The least robust start so far of those with the worst verdict."""

    point: Array  # (n,), of the space of starts
    trace: Array  # (T + 1, k), as it was recorded
    robustness: float
    verdict: Verdict

    @property
    def _order(self) -> tuple[int, float]:
        return VERDICTS.index(self.verdict), self.robustness

    def __lt__(self, other: Worst) -> bool:
        return self._order < other._order


class Objective:
    """Robustness from points, in batches; keeps the worst, and says by `Enough` when to stop."""

    def __init__(
        self, actor: Actor, space: Box | Seeds, evaluations: int, least: bool, progress: Callable[[int, float], None]
    ) -> None:
        self.actor, self.space, self.evaluations, self.least = actor, space, evaluations, least
        self._progress = progress
        self.count = self._points = 0
        self.worst: Worst | None = None
        self.firsts: dict[Verdict, int] = {}
        """The first evaluation, from 1, with each verdict."""
        self.failure: Exception | None = None
        """An exception of a simulation. SciPy would take some of them for its own."""

    @property
    def box(self) -> Box:
        assert isinstance(self.space, Box)
        return self.space

    def of_cube(self, unit: Array) -> Array:
        """Values (N,) at points (N, size) of the unit cube. Raises `Enough` when the search is over."""
        box = self.box
        points = box.points(unit)
        inside = box.inside(points)
        values = np.empty(len(points))
        if not inside.all():
            values[~inside] = FAR + box.violation(points[~inside])
        self._points += len(points)
        if inside.any():
            values[inside] = np.minimum(self.of_points(points[inside]), FAR)
        if self._points >= _OUTSIDE * self.evaluations:
            raise Enough
        return values

    def of_points(self, points: Array) -> Array:
        """Robustness (N,) from points (N, n) of the region. Raises `Enough` as `of_cube` does."""
        parts = []
        for first in range(0, len(points), self.actor.rows):
            part = points[first : first + self.actor.rows][: self.evaluations - self.count]
            try:
                parts.append(self._simulate(part))
            except Exception as error:
                self.failure = error
                raise Enough from error
            if self.count >= self.evaluations or (self.firsts.keys() - {"satisfied"} and not self.least):
                raise Enough
        return np.concatenate(parts)

    def _simulate(self, points: Array) -> Array:
        played = self.actor.play(points)
        traces, robustness, verdicts = played.traces, played.robustness, played.verdicts
        least = int(np.lexsort((robustness, verdicts))[0])
        worst = Worst(points[least], traces[least].copy(), float(robustness[least]), VERDICTS[verdicts[least]])
        if self.worst is None or worst < self.worst:
            self.worst = worst
        for place, row in zip(*np.unique(verdicts, return_index=True), strict=True):
            self.firsts.setdefault(VERDICTS[place], self.count + int(row) + 1)
        self.count += len(points)
        self._progress(self.count, self.worst.robustness)
        return robustness
