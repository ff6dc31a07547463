"""What a policy from outside answers, checked: actions of the task, or one line that says what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Actions, Array, Integers, Policy, StatePolicy
from stlbench.errors import UsageError, cause
from stlbench.rollout.controller import nearest
from stlbench.rollout.faults import out_of_range
from stlbench.share.table import ActionTable

_ROUNDING = 1e-6
"""Share of an axis' span by which rounding may take an action off the grid."""


@dataclass
class Moved:
    """How many answers of a policy were no actions of the task's grid, and how far the nearest ones are."""

    asked: int = 0
    moved: int = 0
    farthest: Array = field(default_factory=lambda: np.zeros(0))
    """Of each axis, (axes,), in its unit."""

    def add(self, actions: ActionGrid, vectors: Array, nearest_ones: Integers) -> None:
        """Count answers (N, axes) and the indices (N,) that were taken in their place."""
        away = np.abs(actions.vectors[nearest_ones] - vectors)
        span = np.array(actions.high) - np.array(actions.low)
        self.asked += len(vectors)
        self.moved += int((away > _ROUNDING * span).any(axis=1).sum())
        self.farthest = np.maximum(self.farthest if self.farthest.size else 0.0, away.max(axis=0, initial=0.0))

    def said(self, units: Mapping[str, str], names: Sequence[str]) -> str:
        """In words, by the names of the axes; nothing where all were actions of the grid."""
        if not self.moved:
            return ""
        far = zip(names, self.farthest.tolist(), strict=True)
        each = ", ".join(f"{name} by up to {value:.3g} {units.get(name, '')}".rstrip() for name, value in far if value)
        share = f"{self.moved} of {self.asked} actions ({100 * self.moved / self.asked:.3g} %)"
        return f"{share} are not on the task's grid, and were moved to the nearest: {each}"


@dataclass(frozen=True)
class OnObservation(Policy):
    """A function of observations (N, D), float64, to actions, as a policy."""

    function: Callable[[Array], Any]
    actions: Actions
    source: str
    """For messages."""
    table: ActionTable | None = None
    """Of its own actions, which it answers numbers of."""
    moved: Moved = field(default_factory=Moved)

    def act(self, observation: Array) -> Integers | Array:
        """The function's actions. Raises `UsageError` where they are none of the task's, or it fails."""
        return _asked(self, len(observation), lambda: self.function(observation.copy()))


@dataclass(frozen=True)
class OnState(StatePolicy):
    """A function of states (N, n) and step counts t (N,) to actions, as a policy."""

    function: Callable[[Array, Integers], Any]
    actions: Actions
    source: str
    table: ActionTable | None = None
    moved: Moved = field(default_factory=Moved)

    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        """The function's actions. Raises `UsageError` where they are none of the task's, or it fails."""

        def act(state: Array, t: Integers, memory: Array) -> Integers | Array:
            return _asked(self, len(state), lambda: self.function(state.copy(), t.copy()))

        return act


def _asked(policy: OnObservation | OnState, count: int, answer: Callable[[], Any]) -> Integers | Array:
    try:
        found = answer()
    except UsageError:
        raise
    except Exception as error:
        raise UsageError(f"{policy.source} failed: {cause(error)}") from error
    if policy.table is not None:
        rounded = Moved()
        chosen = policy.table.chosen(actions_of(found, policy.table.numbers, count, policy.source, rounded))
        if rounded.moved:
            raise UsageError(f"{policy.source}: its answers are no whole numbers of the rows of its table of actions")
        return chosen
    return actions_of(found, policy.actions, count, policy.source, policy.moved)


def actions_of(found: Any, actions: Actions, count: int, source: str, moved: Moved | None = None) -> Integers | Array:
    """What a policy answers, as the referee takes it.

    Of a grid, whole numbers (N,) are indices; numbers (N, A), one for each action, are values, and the action with the
    greatest is taken; vectors (N, axes) are taken to the nearest action, axis by axis. Of continuous actions there are
    only vectors, in the actions' units and between their ends.

    Args:
        found: the answer.
        actions: of the task.
        count: N.
        source: the policy, for messages.
        moved: counts which vectors are not on the grid.

    Raises:
        UsageError: it has another shape, is no number, is NaN, or is outside the actions' ends.
    """
    try:
        array: NDArray[Any] = np.asarray(found)
    except ValueError as error:
        raise UsageError(f"{source}: its actions are no array: {error}") from error
    if isinstance(actions, ActionGrid) and array.dtype.kind in "iu" and array.shape == (count,):
        return _indices(array.astype(np.int64), actions.size, source)
    if isinstance(actions, ActionGrid) and array.dtype.kind == "f" and _are_values(array, actions, count):
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
    index = nearest(actions, vectors)
    if moved is not None:
        moved.add(actions, vectors, index)
    return index


def _are_values(array: NDArray[Any], actions: ActionGrid, count: int) -> bool:
    """Whether there is a number for each action, and not one for each axis."""
    return array.shape == (count, actions.size) and actions.size != len(actions.names)


def _indices(array: Integers, size: int, source: str) -> Integers:
    outside = array[(array < 0) | (array >= size)]
    if len(outside):
        raise UsageError(f"{source}: action {outside[0]}; the task's are 0 to {size - 1}")
    return array


def _vectors(array: Array, actions: Actions, source: str) -> Array:
    if wrong := out_of_range(actions, array):
        raise UsageError(f"{source}: {wrong}")
    return np.clip(array, actions.low, actions.high)
