"""The actions of a plan, their effects on all states of a grid, and the memory that this takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stlbench.contract import ActionGrid, Actions, Array, Integers, Model, Unsuitable
from stlbench_agents.planning.grid import AxisRecipe, Grid, Places, axes_of

Observer = Callable[[int, Array], None]
"""Is given the number of an action and the signals (H + 1, S, k) while it is held."""


@dataclass(frozen=True)
class ActionSet:
    """The actions of a plan, the smallest first: it is chosen among equally good ones."""

    vectors: Array  # (A, axes)
    choices: Integers | Array
    """What a policy returns for each action: an index (A,) into the task's grid of actions, or the vector."""

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


def prepare(model: Model, recipes: Mapping[str, AxisRecipe], resolution: float, most: int) -> tuple[Grid, ActionSet]:
    grid, actions = Grid(axes_of(model, recipes, resolution)), ActionSet.of(model.actions, most)
    each = len(actions) * grid.size
    dimensions = 4 * (1 + len(grid.axes)), 4 * (1 + len(model.method.specification.signals))
    decisions = model.steps // model.hold
    needed = (each * (dimensions[0] + model.hold * dimensions[1] + 4) + 4 * grid.size * decisions) / 1e9
    refuse_beyond(needed, f"a grid of {grid} points with {len(actions)} actions of {model.hold} samples")
    return grid, actions


def refuse_beyond(gigabytes: float, what: str) -> None:
    if gigabytes > _GIGABYTES:
        raise Unsuitable(
            f"{what} needs {gigabytes:.1f} GB, and may have {_GIGABYTES:g}; choose a lower resolution, or fewer actions"
        )
