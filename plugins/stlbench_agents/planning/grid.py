"""A grid: axes, its states one after the other, and where any states lie on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench_agents.planning.axes import Axis
from stlbench_agents.planning.kernels import interpolate

Floats = NDArray[Any]


class Places(NamedTuple):
    """Where points lie on a grid, for `stlbench_agents.planning.kernels`."""

    at: NDArray[np.int32]
    """(...): the number of the cell's lowest corner; -1 outside the grid."""
    weights: NDArray[np.float32]
    """(..., axes): how far towards the next corner along each axis."""


@dataclass(frozen=True)
class Grid:
    """The points of a grid, numbered with the last axis fastest."""

    axes: tuple[Axis, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Points of each axis."""
        return tuple(map(len, self.axes))

    @cached_property
    def size(self) -> int:
        """Points in all."""
        return int(np.prod(self.shape))

    @cached_property
    def strides(self) -> NDArray[np.int64]:
        """(axes,): from a point's number to that of the next along each axis."""
        return np.array([int(np.prod(self.shape[i + 1 :])) for i in range(len(self.axes))], dtype=np.int64)

    @cached_property
    def points(self) -> Array:
        """All points, (size, axes)."""
        mesh = np.meshgrid(*(axis.points for axis in self.axes), indexing="ij")
        return np.stack([column.ravel() for column in mesh], axis=1)

    def places(self, points: Array, *, clip: bool = False) -> Places:
        """Where points (..., axes) lie; those outside at the border, if they are to be clipped."""
        found = [axis.place(points[..., i], clip=clip) for i, axis in enumerate(self.axes)]
        at, outside = np.zeros(points.shape[:-1], dtype=np.int32), np.zeros(points.shape[:-1], dtype=np.bool_)
        for place, stride in zip(found, self.strides, strict=True):
            at += place.below * np.int32(stride)
            outside |= place.below < 0
        at[outside] = -1
        return Places(at, np.stack([place.weight for place in found], axis=-1))

    def read(self, values: Floats, points: Array, outside: float) -> Array:
        """Values (size,) of the grid between its points, at points (N, axes): (N,)."""
        places = self.places(points)
        found = np.empty(len(points), np.float32)
        interpolate(values, places.at, places.weights, self.strides, outside, found)
        return found.astype(np.float64)

    def __str__(self) -> str:
        return " x ".join(map(str, self.shape))
