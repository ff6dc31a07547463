"""A grid of states: its axes, its points, the places of other states between them, and the steps of a plan's actions
from all its states.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from stlbench.contract import ActionGrid, Actions, Array, Integers, Model, Unsuitable

Indices = NDArray[np.int32]

_POINTS = {1: 2001, 2: 301, 3: 61, 4: 25}
"""Default points of an axis, by the dimensions of the state."""
_MOST = 10_000_000
"""The most points of an axis."""


class AxisRecipe(BaseModel):
    """One axis of a planner's grid, as a recipe gives it."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    low: float
    high: float
    points: Annotated[int, Field(ge=2)] | None = None
    periodic: bool = False
    """Whether `high` is the same state as `low`, as for an angle; states then never leave the axis."""
    near: tuple[float, ...] = ()
    """Values near which points are closer together, such as the borders of predicates."""
    width: Annotated[float, Field(gt=0)] = 0.1
    """How far around them, in the axis' unit."""
    density: Annotated[float, Field(ge=1)] = 10.0
    """How many times closer together they are there."""

    @model_validator(mode="after")
    def _ordered(self) -> AxisRecipe:
        if not self.low < self.high:
            raise ValueError(f"low = {self.low:g} must be less than high = {self.high:g}")
        if self.periodic and self.near:
            raise ValueError("a periodic axis has evenly spaced points, and takes no near")
        return self


class Place(NamedTuple):
    below: Indices
    """The number of the point below each; -1 for a value outside."""
    weight: NDArray[np.float32]
    """In [0, 1]: the share of the way to the next point."""


@dataclass(frozen=True)
class Axis:
    """Points in rising order. On a periodic axis the last one is the first again."""

    points: Array
    periodic: bool = False

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def of(cls, recipe: AxisRecipe, points: int) -> Axis:
        even = np.linspace(recipe.low, recipe.high, points)
        return cls(_gathered(recipe, points) if recipe.near else even, recipe.periodic)

    def finer(self, parts: int) -> Axis:
        at = np.arange((len(self) - 1) * parts + 1) / parts
        return Axis(np.interp(at, np.arange(len(self)), self.points), self.periodic)

    def place(self, values: Array, *, clip: bool = False) -> Place:
        """The places of values (...); `clip` moves those outside to the ends."""
        low, high = self.points[0], self.points[-1]
        if self.periodic:
            values = low + (values - low) % (high - low)
        inside = np.clip(values, low, high)
        index = np.clip(np.searchsorted(self.points, inside, side="right") - 1, 0, len(self) - 2)
        weight = (inside - self.points[index]) / np.diff(self.points)[index]
        if not clip:
            index = np.where(inside == values, index, -1)
        return Place(index.astype(np.int32), weight.astype(np.float32))


def _gathered(recipe: AxisRecipe, points: int) -> Array:
    """Points whose density is `density` at the values in `near`, which are among them, and falls to 1 over `width`."""
    fine = np.linspace(recipe.low, recipe.high, 20_001)
    away = np.abs(fine[:, None] - recipe.near).min(axis=1) / recipe.width
    density = 1 + (recipe.density - 1) / (1 + away**4)
    share = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2)])
    values = np.interp(np.linspace(0, share[-1], points), share, fine)
    for value in recipe.near:
        inner = values[1:-1]
        if values[1] <= value <= values[-2]:
            inner[np.abs(inner - value).argmin()] = value
    return values


def axes_of(model: Model, grid: Mapping[str, AxisRecipe], resolution: float) -> tuple[Axis, ...]:
    """One axis per column of the state, with `resolution` times its recipe's points.

    A column without a recipe has the range of the signal of that name. Raises `Unsuitable` if there is no such range,
    or if a recipe names no column. So it does for more than four axes, or an axis of more than ten million points.
    """
    names = model.system.state
    if len(names) > max(_POINTS):
        raise Unsuitable(f"a state of {len(names)} dimensions; a grid has at most {max(_POINTS)}")
    if unknown := [name for name in grid if name not in names]:
        raise Unsuitable(f"grid: the state has no column '{unknown[0]}', it has {', '.join(names)}")
    axes = []
    for name in names:
        recipe = grid.get(name) or _range(model, name)
        points = max(2, round(((recipe.points or _POINTS[len(names)]) - 1) * resolution) + 1)
        if points > _MOST:
            raise Unsuitable(f"an axis {name} of {points} points; it may have {_MOST}")
        axes.append(Axis.of(recipe, points))
    return tuple(axes)


def _range(model: Model, name: str) -> AxisRecipe:
    specification = model.method.specification
    if name not in specification.signals:
        raise Unsuitable(f"the state's {name} is no signal, so it has no range; give it one: grid: {{{name}: ...}}")
    column = specification.signals.index(name)
    return AxisRecipe(low=specification.low[column], high=specification.high[column])


Floats = NDArray[Any]


class Places(NamedTuple):
    """The places of points on a grid, for `stlbench_planning.loops`."""

    at: NDArray[np.int32]
    """(...): the number of the cell's lowest corner; -1 outside the grid."""
    weights: NDArray[np.float32]
    """(..., axes): the share of the way to the next corner along each axis."""


@dataclass(frozen=True)
class Grid:
    """The points of a grid, numbered with the last axis fastest."""

    axes: tuple[Axis, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(map(len, self.axes))

    @cached_property
    def size(self) -> int:
        return int(np.prod(self.shape))

    @cached_property
    def strides(self) -> NDArray[np.int64]:
        """(axes,): from a point's number to that of the next along each axis."""
        return np.array([int(np.prod(self.shape[i + 1 :])) for i in range(len(self.axes))], dtype=np.int64)

    @cached_property
    def points(self) -> Array:
        mesh = np.meshgrid(*(axis.points for axis in self.axes), indexing="ij")
        return np.stack([column.ravel() for column in mesh], axis=1)

    def places(self, points: Array, *, clip: bool = False) -> Places:
        """The places of points (..., axes); `clip` moves those outside to the border."""
        places = [axis.place(points[..., i], clip=clip) for i, axis in enumerate(self.axes)]
        at, outside = np.zeros(points.shape[:-1], dtype=np.int32), np.zeros(points.shape[:-1], dtype=np.bool_)
        for place, stride in zip(places, self.strides, strict=True):
            at += place.below * np.int32(stride)
            outside |= place.below < 0
        at[outside] = -1
        return Places(at, np.stack([place.weight for place in places], axis=-1))

    def read(self, values: Floats, points: Array, outside: float) -> Array:
        """Values (size,) of the grid between its points, at points (N, axes): (N,)."""
        from stlbench_planning.loops import interpolate  # imports Numba, which `stlbench list` does not need

        places = self.places(points)
        result = np.empty(len(points), np.float32)
        interpolate(values, places.at, places.weights, self.strides, outside, result)
        return result.astype(np.float64)

    def __str__(self) -> str:
        return " x ".join(map(str, self.shape))


Observer = Callable[[int, Array], None]
"""Is given the number of an action and the signals (H + 1, S, k) while it is held."""


@dataclass(frozen=True)
class ActionSet:
    """The actions of a plan, the smallest first: it is chosen among equally good ones."""

    vectors: Array  # (A, axes)
    choices: Integers | Array
    """The return of a policy for each action: an index (A,) into the task's grid of actions, or the vector."""

    def __len__(self) -> int:
        return len(self.vectors)

    @classmethod
    def of(cls, actions: Actions, most: int) -> ActionSet:
        """About `most` actions, or all: evenly chosen on each axis, with its ends and the value nearest to 0."""
        each = max(2, int(most ** (1 / len(actions.names)) + 1e-9))
        if isinstance(actions, ActionGrid):
            chosen = [_evenly(np.array(axis), each) for axis in actions.axes]
            places = np.meshgrid(*chosen, indexing="ij")
            indices = np.ravel_multi_index([place.ravel() for place in places], actions.shape)
            vectors = actions.vectors[indices]
            order = _by_size(vectors, actions)
            return cls(vectors[order], indices[order])
        # An odd number of values has the middle of each axis among them, which is 0 in most tasks.
        axes = [np.linspace(low, high, each | 1) for low, high in zip(actions.low, actions.high, strict=True)]
        vectors = np.stack([column.ravel() for column in np.meshgrid(*axes, indexing="ij")], axis=1)
        vectors = vectors[_by_size(vectors, actions)]
        return cls(vectors, vectors)


def _evenly(values: Array, count: int) -> Integers:
    """The numbers of `count` values of an axis, and of the value that is nearest to 0."""
    chosen = np.linspace(0, len(values) - 1, min(count, len(values))).round().astype(np.int64)
    return np.unique([*chosen, np.abs(values).argmin()])


def _by_size(vectors: Array, actions: Actions) -> Integers:
    largest = np.maximum(np.abs(actions.low), np.abs(actions.high))
    largest[largest == 0] = 1
    order: Integers = np.argsort(np.linalg.norm(vectors / largest, axis=1), kind="stable")
    return order


def simulated(model: Model, states: Array, vectors: Array) -> tuple[Array, Array]:
    """States (N, n) under actions (N, axes), held: all states (H + 1, N, n) and their signals (H + 1, N, k)."""
    path = np.empty((model.hold + 1, *states.shape))
    path[0] = states
    for h in range(model.hold):
        path[h + 1] = model.system.step(path[h], vectors)
    return path, model.system.signals(path)


def sweep(model: Model, grid: Grid, actions: ActionSet, observers: Sequence[Observer] = ()) -> Places:
    """Hold each action once from all states of the grid. Returns the places on the grid to which it leads, (A, S)."""
    at = np.empty((len(actions), grid.size), np.int32)
    weights = np.empty((*at.shape, len(grid.axes)), np.float32)
    for a, vector in enumerate(actions.vectors):
        path, samples = simulated(model, grid.points, np.tile(vector, (grid.size, 1)))
        at[a], weights[a] = grid.places(path[-1])
        for observe in observers:
            observe(a, samples)
    return Places(at, weights)


_GIGABYTES = 4.0
"""The most memory of a plan, so that a grid that is too fine is refused at once and fills no machine."""


def prepare(model: Model, recipes: Mapping[str, AxisRecipe], resolution: float, most: int) -> tuple[Grid, ActionSet]:
    grid, actions = Grid(axes_of(model, recipes, resolution)), ActionSet.of(model.actions, most)
    each = len(actions) * grid.size
    # Four bytes each: places and weights of the next states, and those of the samples on the grid of signals.
    dimensions = 4 * (1 + len(grid.axes)), 4 * (1 + len(model.method.specification.signals))
    needed = (each * (dimensions[0] + model.hold * dimensions[1] + 4) + 4 * grid.size * model.decisions) / 1e9
    refuse_beyond(needed, f"a grid of {grid} points with {len(actions)} actions of {model.hold} samples")
    return grid, actions


def refuse_beyond(gigabytes: float, what: str) -> None:
    if gigabytes > _GIGABYTES:
        raise Unsuitable(
            f"{what} needs {gigabytes:.1f} GB, and may have {_GIGABYTES:g}; choose a lower resolution, or fewer actions"
        )
