"""What the outputs of a network of Stable-Baselines3 mean, by the space of actions that it was trained on."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stlbench.contract import ActionBox, ActionGrid, Actions, Array, Integers
from stlbench.errors import UsageError


def meaning_of_outputs(
    path: Path, space: Mapping[str, Any], count: int, actions: Actions, squashed: bool
) -> Callable[[Array], Integers | Array]:
    """Outputs (N, count) to the actions that the referee takes: indices (N,) of a grid, or vectors (N, axes).

    Args:
        path: of the file, for messages.
        space: of actions, in the texts that SB3 writes of it beside its pickle.
        count: of outputs.
        actions: of the task.
        squashed: the outputs' tanh spans the actions; otherwise they are in the actions' units, and clipped.

    Raises:
        UsageError: the policy's actions are not those of the task.
    """
    kind = str(space.get(":type:")).removesuffix("'>").rpartition(".")[2]
    if isinstance(actions, ActionBox) and kind == "Box" and count == len(actions.names):
        return _within(actions, squashed)
    if isinstance(actions, ActionGrid):
        if kind == "Discrete" and count == actions.size:
            return lambda outputs: outputs.argmax(axis=1)
        if (
            kind == "MultiDiscrete"
            and _whole_numbers(space.get("nvec")) == actions.shape
            and count == sum(actions.shape)
        ):
            return _each_axis(actions)
        if kind == "MultiBinary" and actions.shape == (2,) * count:
            return lambda outputs: _index(actions, [axis > 0 for axis in outputs.T])
    raise UsageError(f"{path}: the policy has {count} outputs for {_said(kind, space)}, and the task {_own(actions)}")


def _within(actions: ActionBox, squashed: bool) -> Callable[[Array], Array]:
    low, high = np.array(actions.low), np.array(actions.high)
    if squashed:
        return lambda outputs: low + (np.tanh(outputs) + 1) / 2 * (high - low)
    return lambda outputs: np.clip(outputs, low, high)


def _each_axis(actions: ActionGrid) -> Callable[[Array], Integers]:
    """The greatest of each axis' own outputs."""
    ends = np.cumsum(actions.shape)[:-1]
    return lambda outputs: _index(actions, [axis.argmax(axis=1) for axis in np.split(outputs, ends, axis=1)])


def _index(actions: ActionGrid, places: list[Any]) -> Integers:
    """Of places (N,) along each axis."""
    index: Integers = np.ravel_multi_index([place.astype(np.int64) for place in places], actions.shape)
    return index


def _whole_numbers(text: object) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", str(text))))


def _said(kind: str, space: Mapping[str, Any]) -> str:
    if kind == "MultiDiscrete":
        return f"MultiDiscrete actions, {' x '.join(map(str, _whole_numbers(space.get('nvec'))))}"
    return f"{kind} actions"


def _own(actions: Actions) -> str:
    if isinstance(actions, ActionBox):
        return f"{len(actions.names)} continuous actions"
    product = f", {' x '.join(map(str, actions.shape))}" if len(actions.shape) > 1 else ""
    return f"a grid of {actions.size} actions{product}"
