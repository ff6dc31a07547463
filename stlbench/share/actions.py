"""Actions of a policy from outside, checked and taken to the task's actions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Actions, Array, Integers, Policy, StatePolicy
from stlbench.errors import UsageError, cause, did_you_mean
from stlbench.share.trace_table import read_table
from stlbench.simulation.faults import out_of_range

_ROUNDING = 1e-6  # share of an axis' span by which rounding may take an action off the grid


@dataclass
class Moved:
    """Counts the actions of a policy that were not on the task's grid, and their distance from it."""

    total: int = 0
    moved: int = 0
    farthest: Array = field(default_factory=lambda: np.zeros(0))  # of each axis, (axes,), in its unit

    def add(self, actions: ActionGrid, vectors: Array, nearest_ones: Integers) -> None:
        """Count actions (N, axes), and the indices (N,) of the nearest ones on the grid."""
        away = np.abs(actions.vectors[nearest_ones] - vectors)
        span = np.array(actions.high) - np.array(actions.low)
        self.total += len(vectors)
        self.moved += int((away > _ROUNDING * span).any(axis=1).sum())
        self.farthest = np.maximum(self.farthest if self.farthest.size else 0.0, away.max(axis=0, initial=0.0))

    def text(self, units: Mapping[str, str], names: Sequence[str]) -> str:
        """In words, by the names of the axes; empty if all actions were on the grid."""
        if not self.moved:
            return ""
        far = zip(names, self.farthest.tolist(), strict=True)
        each = ", ".join(f"{name} by up to {value:.3g} {units.get(name, '')}".rstrip() for name, value in far if value)
        share = f"{self.moved} of {self.total} actions ({100 * self.moved / self.total:.3g} %)"
        return f"{share} are not on the task's grid, and were moved to the nearest: {each}"


@dataclass(frozen=True)
class _Outside:
    function: Callable[..., Any]
    actions: Actions
    source: str  # for messages
    table: Array | None = None
    """The policy's own actions (A, axes), in the task's units, if it answers with their numbers."""
    moved: Moved = field(default_factory=Moved)

    def call(self, *seen: Array | Integers) -> Integers | Array:
        """The function's actions. Raises `UsageError` if it fails, or if they are not the task's."""
        try:
            answer = self.function(*(each.copy() for each in seen))
        except UsageError:
            raise
        except Exception as error:
            raise UsageError(f"{self.source} failed: {cause(error)}") from error
        if self.table is None:
            return actions_of(answer, self.actions, len(seen[0]), self.source, self.moved)
        rounded = Moved()
        chosen: Array = self.table[actions_of(answer, numbers_of(self.table), len(seen[0]), self.source, rounded)]
        if rounded.moved:
            raise UsageError(f"{self.source}: its answers are no whole numbers of the rows of its table of actions")
        return chosen


class OnObservation(_Outside, Policy):
    """A policy from a function of observations (N, D), float64."""

    def act(self, observation: Array) -> Integers | Array:
        return self.call(observation)


class OnState(_Outside, StatePolicy):
    """A policy from a function of states (N, n) and step counts t (N,)."""

    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        return lambda state, t, memory: self.call(state, t)


def actions_of(answer: Any, actions: Actions, count: int, source: str, moved: Moved | None = None) -> Integers | Array:
    """A policy's answer for N observations as actions of the task.

    For a grid of A actions, whole numbers (N,) are indices; numbers (N, A) are values, and the greatest wins; vectors
    (N, axes) go to the nearest action, which `moved` counts. Continuous actions are vectors, in the actions' units.
    Raises `UsageError` if the answer has another shape, is no number or NaN, or is outside the actions' ends.
    """
    try:
        array: NDArray[Any] = np.asarray(answer)
    except ValueError as error:
        raise UsageError(f"{source}: its actions are no array: {error}") from error
    if isinstance(actions, ActionGrid) and array.dtype.kind in "iu" and array.shape == (count,):
        return _indices(array.astype(np.int64), actions.size, source)
    each_action = isinstance(actions, ActionGrid) and array.shape == (count, actions.size)  # or is it for each axis?
    if each_action and array.dtype.kind == "f" and array.shape != (count, len(actions.names)):
        if np.isnan(array).any():
            raise UsageError(f"{source}: a value of an action is NaN")
        best: Integers = array.argmax(axis=1)
        return best
    if array.dtype.kind not in "iuf" or array.shape != (count, len(actions.names)):
        expected = f"({count}, {len(actions.names)}) for {', '.join(actions.names)}"
        if isinstance(actions, ActionGrid):
            expected = f"whole numbers ({count},), values {count, actions.size}, or {expected}"
        raise UsageError(f"{source}: its actions are {array.dtype} {array.shape}; expected are {expected}")
    vectors = _vectors(array.astype(np.float64), actions, source)
    if not isinstance(actions, ActionGrid):
        return vectors
    index = actions.nearest(vectors)
    if moved is not None:
        moved.add(actions, vectors, index)
    return index


def _indices(array: Integers, size: int, source: str) -> Integers:
    outside = array[(array < 0) | (array >= size)]
    if len(outside):
        raise UsageError(f"{source}: action {outside[0]}; the task's are 0 to {size - 1}")
    return array


def _vectors(array: Array, actions: Actions, source: str) -> Array:
    if wrong := out_of_range(actions, array):
        raise UsageError(f"{source}: {wrong}")
    return np.clip(array, actions.low, actions.high)


def numbers_of(table: Array) -> ActionGrid:
    """The numbers of the actions in a table (A, axes), as a grid."""
    return ActionGrid(("action",), (tuple(map(float, range(len(table)))),))


def read_actions(path: Path, actions: Actions) -> Array:
    """A table of text: a column for each axis of the task's actions, a row for each action, in the network's order.

    Raises `UsageError` if it has other columns, or an action beyond the ends of the task's.
    """
    table = read_table(path)
    for name in (*actions.names, *table.names):
        if name not in actions.names:
            raise UsageError(f"{path}: the task's actions have no '{name}'{did_you_mean(name, actions.names)}")
        if name not in table.names:
            raise UsageError(f"{path}: there is no column '{name}'; the task's actions have {', '.join(actions.names)}")
    vectors = np.column_stack([table.column(name) for name in actions.names])
    return _vectors(vectors, actions, str(path))
