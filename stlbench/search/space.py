"""Where a search may begin episodes: a box of initial states, or seeds of an environment."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, System, Truth
from stlbench.task import starts
from stlbench.task.entry import Region
from stlbench.task.starts import SeedStarts, StateStarts
from stlbench.task.task import Task


class Space(ABC):
    """Points (N, n), each of which says where an episode begins."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Of the n numbers of a point."""

    @property
    def single(self) -> bool:
        """Whether there is one point alone."""
        return False

    @abstractmethod
    def draw(self, generator: np.random.Generator, count: int) -> Array:
        """Points (count, n), uniformly at random."""

    @abstractmethod
    def starts(self, points: Array) -> Array:
        """From points (N, n) to what the simulator resets to, (N, s)."""


def space_of(task: Task) -> Box | Seeds:
    """Where episodes of the task may begin."""
    if isinstance(task.starts, StateStarts):
        return Box(task.starts.initial, task.system)
    return Seeds(task.starts)


@dataclass(frozen=True)
class Seeds(Space):
    """Seeds, which have no order to search by. None is one of training, of selection or of the report."""

    sets: SeedStarts

    @property
    def names(self) -> tuple[str, ...]:
        """See `Space`."""
        return ("seed",)

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        """See `Space`."""
        return self.sets.fresh(int(generator.integers(2**31)), count)

    def starts(self, points: Array) -> Array:
        """They are the points."""
        return points


@dataclass(frozen=True)
class Box(Space):
    """A region of a system's initial states, reached by a unit cube of `size` dimensions: its free coordinates."""

    region: Region
    system: System

    @property
    def names(self) -> tuple[str, ...]:
        """See `Space`."""
        return tuple(self.region.box)

    @property
    def single(self) -> bool:
        """See `Space`."""
        return self.size == 0

    @cached_property
    def free(self) -> Integers:
        """Which of the coordinates are not fixed, (size,)."""
        return np.flatnonzero(self.region.low < self.region.high)

    @property
    def size(self) -> int:
        """How many coordinates are free."""
        return len(self.free)

    def points(self, unit: Array) -> Array:
        """From the unit cube (N, size) to points (N, n) of the box, which may break the region's condition."""
        low, high = self.region.low, self.region.high
        points = np.tile(low, (len(unit), 1))
        points[:, self.free] += np.clip(unit, 0.0, 1.0) * (high - low)[self.free]
        return np.minimum(points, high)

    def inside(self, points: Array) -> Truth:
        """Which of the points (N, n) fulfil the region's condition, (N,)."""
        where = self.region.where
        if where is None:
            return np.ones(len(points), dtype=np.bool_)
        return np.asarray(stl.holds(where, self.names)(points))

    def violation(self, points: Array) -> Array:
        """How far points (N, n) that are not inside break the condition, (N,), at least 0."""
        assert self.region.where is not None
        with np.errstate(all="ignore"):
            return np.nan_to_num(np.maximum(-stl.margin(self.region.where, self.names)(points), 0.0))

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        """See `Space`."""
        return starts.sample(self.region, generator, count)

    def starts(self, points: Array) -> Array:
        """See `Space`."""
        return self.system.initial_states(points)
