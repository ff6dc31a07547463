"""What a policy from outside answers, checked: actions of the task, or one line that says what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Actions, Array, Integers, Policy, StatePolicy
from stlbench.contract_parts.texts import cause
from stlbench.errors import UsageError
from stlbench.rollout.controller import nearest
from stlbench.rollout.faults import out_of_range

__all__ = ["OnObservation", "OnState", "actions_of"]


@dataclass(frozen=True)
class OnObservation(Policy):
    """A function of observations (N, D), float64, to actions, as a policy."""

    function: Callable[[Array], Any]
    actions: Actions
    source: str
    """For messages."""

    def act(self, observation: Array) -> Integers | Array:
        """The function's actions. Raises `UsageError` where they are none of the task's, or it fails."""
        return _asked(self.source, self.actions, len(observation), lambda: self.function(observation.copy()))


@dataclass(frozen=True)
class OnState(StatePolicy):
    """A function of states (N, n) and step counts t (N,) to actions, as a policy."""

    function: Callable[[Array, Integers], Any]
    actions: Actions
    source: str

    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        """The function's actions. Raises `UsageError` where they are none of the task's, or it fails."""

        def act(state: Array, t: Integers, memory: Array) -> Integers | Array:
            return _asked(self.source, self.actions, len(state), lambda: self.function(state.copy(), t.copy()))

        return act


def _asked(source: str, actions: Actions, count: int, answer: Callable[[], Any]) -> Integers | Array:
    try:
        found = answer()
    except UsageError:
        raise
    except Exception as error:
        raise UsageError(f"{source} failed: {cause(error)}") from error
    return actions_of(found, actions, count, source)


def actions_of(found: Any, actions: Actions, count: int, source: str) -> Integers | Array:
    """What a policy answers, as the referee takes it.

    Of a grid, whole numbers (N,) are indices; vectors (N, axes) are taken to the nearest action, axis by axis. Of
    continuous actions there are only vectors, in the actions' units and between their ends.

    Args:
        found: the answer.
        actions: of the task.
        count: N.
        source: the policy, for messages.

    Raises:
        UsageError: it has another shape, is no number, is NaN, or is outside the actions' ends.
    """
    try:
        array: NDArray[Any] = np.asarray(found)
    except ValueError as error:
        raise UsageError(f"{source}: its actions are no array: {error}") from error
    if isinstance(actions, ActionGrid) and array.dtype.kind in "iu" and array.shape == (count,):
        return _indices(array.astype(np.int64), actions.size, source)
    if array.dtype.kind not in "iuf" or array.shape != (count, len(actions.names)):
        indices = f"whole numbers ({count},), or " if isinstance(actions, ActionGrid) else ""
        expected = f"{indices}({count}, {len(actions.names)}) for {', '.join(actions.names)}"
        raise UsageError(f"{source}: its actions are {array.dtype} {array.shape}; expected are {expected}")
    vectors = _vectors(array.astype(np.float64), actions, source)
    return nearest(actions, vectors) if isinstance(actions, ActionGrid) else vectors


def _indices(array: Integers, size: int, source: str) -> Integers:
    outside = array[(array < 0) | (array >= size)]
    if len(outside):
        raise UsageError(f"{source}: action {outside[0]}; the task's are 0 to {size - 1}")
    return array


def _vectors(array: Array, actions: Actions, source: str) -> Array:
    if wrong := out_of_range(actions, array):
        raise UsageError(f"{source}: {wrong}")
    return np.clip(array, actions.low, actions.high)
