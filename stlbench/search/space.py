"""The space of starts of a search: a box of initial states, or seeds of an environment.

Each of its points (N, n) stands for a start (N, s) of the simulator.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, System, Truth
from stlbench.task import starts
from stlbench.task.entry import Region
from stlbench.task.starts import SeedStarts, StateStarts
from stlbench.task.task import Task


def space_of(task: Task) -> Box | Seeds:
    if isinstance(task.starts, StateStarts):
        return Box(task.starts.initial, task.system)
    return Seeds(task.starts)


@dataclass(frozen=True)
class Seeds:
    """Seeds, other than the seeds of training, selection and report. An optimiser cannot search them."""

    sets: SeedStarts
    single = False
    names = ("seed",)

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        return self.sets.fresh(int(generator.integers(2**31)), count)

    def starts(self, points: Array) -> Array:
        return points


@dataclass(frozen=True)
class Box:
    """A region of a system's initial states; a unit cube spans its `size` free coordinates."""

    region: Region
    system: System

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.region.box)

    @property
    def single(self) -> bool:
        return self.size == 0

    @cached_property
    def free(self) -> Integers:
        return np.flatnonzero(self.region.low < self.region.high)

    @property
    def size(self) -> int:
        return len(self.free)

    def points(self, unit: Array) -> Array:
        """Points (N, n) of the box from the unit cube (N, size); they may break the region's condition."""
        low, high = self.region.low, self.region.high
        points = np.tile(low, (len(unit), 1))
        points[:, self.free] += np.clip(unit, 0.0, 1.0) * (high - low)[self.free]
        return np.minimum(points, high)

    def inside(self, points: Array) -> Truth:
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
        return starts.sample(self.region, generator, count)

    def starts(self, points: Array) -> Array:
        return self.system.initial_states(points)
