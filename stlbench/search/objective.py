"""What is minimised: the robustness of the task's formula, from points of the space of starts, counted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stlbench.contract import Array
from stlbench.search.space import Box, Seeds
from stlbench.search.subject import VERDICTS, Subject, Verdict

FAR = 1e6
"""The value of a point outside the region of starts, to which comes how far outside it is: worse than all inside."""
_OUTSIDE = 20
"""So many times the evaluations may points be asked for, those outside among them, which are not simulated."""


class Enough(Exception):
    """The search is over: a counterexample was found, all evaluations are used, or a simulation failed."""


@dataclass(frozen=True)
class Worst:
    """The least robust start so far of those with the worst verdict."""

    point: Array
    """(n,), of the region of initial states."""
    trace: Array
    """(T + 1, k), as it was recorded."""
    robustness: float
    verdict: Verdict

    @property
    def _order(self) -> tuple[int, float]:
        return VERDICTS.index(self.verdict), self.robustness

    def __lt__(self, other: Worst) -> bool:
        """Whether it is worse."""
        return self._order < other._order


class Objective:
    """Robustness from points, in batches; keeps the worst, and says by `Enough` when to stop.

    Args:
        subject: what acts.
        space: of its task.
        evaluations: how many episodes may be simulated.
        least: go on after a counterexample, for the least robustness.
        told: is called after each batch with the evaluations and the least robustness so far.
    """

    def __init__(
        self, subject: Subject, space: Box | Seeds, evaluations: int, least: bool, told: Callable[[int, float], None]
    ) -> None:
        self.subject, self.space, self.evaluations, self.least, self._told = subject, space, evaluations, least, told
        self.count = self._asked = 0
        self.worst: Worst | None = None
        self.firsts: dict[Verdict, int] = {}
        """Which evaluation, from 1, was the first of each verdict."""
        self.failure: Exception | None = None
        """What a simulation raised; kept here, as SciPy takes some errors for its own."""

    @property
    def box(self) -> Box:
        """The space, which an optimiser can search."""
        assert isinstance(self.space, Box)
        return self.space

    def of_cube(self, unit: Array) -> Array:
        """Values (N,) at points (N, size) of the unit cube: those outside the region are worse than all inside.

        Raises:
            Enough: the search is over.
        """
        box = self.box
        points = box.points(unit)
        inside = box.inside(points)
        values = np.empty(len(points))
        if not inside.all():
            values[~inside] = FAR + box.violation(points[~inside])
        self._asked += len(points)
        if inside.any():
            values[inside] = np.minimum(self.of_points(points[inside]), FAR)
        if self._asked >= _OUTSIDE * self.evaluations:
            raise Enough
        return values

    def of_points(self, points: Array) -> Array:
        """Robustness (N,) from points (N, n) of the region. Raises `Enough` as `of_cube` does."""
        parts = []
        for first in range(0, len(points), self.subject.rows):
            part = points[first : first + self.subject.rows][: self.evaluations - self.count]
            try:
                parts.append(self._simulate(part))
            except Exception as error:
                self.failure = error
                raise Enough from error
            if self.count >= self.evaluations or (self.firsts.keys() - {"satisfied"} and not self.least):
                raise Enough
        return np.concatenate(parts)

    def _simulate(self, points: Array) -> Array:
        played = self.subject.play(points)
        traces, robustness, verdicts = played.traces, played.robustness, played.verdicts
        least = int(np.lexsort((robustness, verdicts))[0])
        found = Worst(points[least], traces[least].copy(), float(robustness[least]), VERDICTS[verdicts[least]])
        if self.worst is None or found < self.worst:
            self.worst = found
        for place, row in zip(*np.unique(verdicts, return_index=True), strict=True):
            self.firsts.setdefault(VERDICTS[place], self.count + int(row) + 1)
        self.count += len(points)
        self._told(self.count, self.worst.robustness)
        return robustness
