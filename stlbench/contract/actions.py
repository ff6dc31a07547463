"""The actions of a task: a grid of finitely many, or a box of continuous ones. Import them from `stlbench.contract`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ActionGrid:
    """A finite set of actions: the product of evenly spaced axes. Index i runs over the last axis fastest."""

    names: tuple[str, ...]
    axes: tuple[tuple[float, ...], ...]
    robots: tuple[int, ...] = ()
    """How many of the axes, in their order, are each robot's: (2, 2, 2). Empty where the task has one robot."""

    @cached_property
    def parts(self) -> tuple[ActionGrid, ...]:
        """Each robot's own grid, in the order of the axes; the index of a joint action is `np.ravel_multi_index` of
        the robots' own indices, as the last robot's runs fastest.
        """
        ends = np.cumsum([0, *(self.robots or [len(self.axes)])]).tolist()
        return tuple(ActionGrid(self.names[i:j], self.axes[i:j]) for i, j in pairwise(ends))

    @cached_property
    def low(self) -> tuple[float, ...]:
        """Least value of each axis."""
        return tuple(min(axis) for axis in self.axes)

    @cached_property
    def high(self) -> tuple[float, ...]:
        """Greatest value of each axis."""
        return tuple(max(axis) for axis in self.axes)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Actions along each axis: (21, 13)."""
        return tuple(len(axis) for axis in self.axes)

    @cached_property
    def size(self) -> int:
        """The number A of actions: 273."""
        return math.prod(self.shape)

    @cached_property
    def vectors(self) -> NDArray[np.float64]:
        """All actions, (A, number of axes), in the actions' units."""
        return np.stack([mesh.ravel() for mesh in np.meshgrid(*self.axes, indexing="ij")], axis=-1)


@dataclass(frozen=True)
class ActionBox:
    """Continuous actions: every vector between `low` and `high`, in the actions' units."""

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


Actions = ActionGrid | ActionBox
"""The actions of a task: a grid where its task file counts values along each axis, else a box."""
