"""The initial states of a task as a space to search: a unit cube of the coordinates that are free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Truth
from stlbench.errors import UsageError
from stlbench.task import starts
from stlbench.task.region import Region
from stlbench.task.start_sets import StateStarts
from stlbench.task.task import Task

__all__ = ["Space"]


@dataclass(frozen=True)
class Space:
    """Points (N, n) of the task's region of initial states, reached by a unit cube of `size` dimensions."""

    task: Task

    @property
    def region(self) -> Region:
        """Where the task's initial states lie. Raises `UsageError` where starts are seeds."""
        if not isinstance(self.task.starts, StateStarts):
            raise UsageError(f"task {self.task.name} has no states to search: its starts are seeds")
        return self.task.starts.initial

    @property
    def names(self) -> tuple[str, ...]:
        """Of the n coordinates of a point."""
        return tuple(self.region.box)

    @cached_property
    def free(self) -> Integers:
        """Which of the coordinates are not fixed, (size,)."""
        region = self.region
        return np.flatnonzero(region.low < region.high)

    @property
    def size(self) -> int:
        """How many coordinates are free; with none, the task has a single start."""
        return len(self.free)

    def points(self, unit: Array) -> Array:
        """From the unit cube (N, size) to points (N, n) of the box, which may break the region's condition."""
        region = self.region
        points = np.tile(region.low, (len(unit), 1))
        points[:, self.free] += np.clip(unit, 0.0, 1.0) * (region.high - region.low)[self.free]
        return np.minimum(points, region.high)

    def inside(self, points: Array) -> Truth:
        """Which of the points (N, n) fulfil the region's condition, (N,)."""
        where = self.region.where
        if where is None:
            return np.ones(len(points), dtype=np.bool_)
        return np.asarray(stl.holds(where, self.names)(points))

    def violation(self, points: Array) -> Array:
        """How far points (N, n) that are not inside break the condition, (N,), at least 0."""
        where = self.region.where
        assert where is not None
        with np.errstate(all="ignore"):
            return np.nan_to_num(np.maximum(-stl.margin(where, self.names)(points), 0.0))

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        """Points (count, n), uniformly at random from the region."""
        return starts.sample(self.region, generator, count)

    def starts(self, points: Array) -> Array:
        """From points (N, n) to what the simulator resets to."""
        return self.task.system.initial_states(points)
