"""Observations with the time and the method's memory in them, and actions as numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space
from numpy.typing import NDArray

from stlbench.contract import Array, Integers
from stlbench.environments.entries import outside_space
from stlbench.errors import UsageError
from stlbench.wrapping.reading import place

__all__ = ["KEY", "Observing", "action_rows", "check_actions"]

KEY = "stl"
"""Under which a Dict observation has the time and the memory."""


class Observing:
    """Extends observations by `size` numbers, about in [-1, 1], the first of them the time.

    A vector gets them at its end. A Dict has them under one more key, `KEY`; every other observation becomes a Dict of
    itself, `observation`, and of them.
    """

    def __init__(self, space: Space[Any], size: int) -> None:
        """Args: `space` of one environment."""
        self._vector = isinstance(space, Box) and len(space.shape) == 1
        self._dict = isinstance(space, Dict)
        self._shape = space.shape
        self._dtype = space.dtype if isinstance(space, Box) and np.issubdtype(space.dtype, np.floating) else np.float32
        ends = np.full(size, np.inf)
        ends[0] = 1.0
        if isinstance(space, Box) and self._vector:
            low, high = np.concatenate([space.low, -ends]), np.concatenate([space.high, ends])
            self.space: Space[Any] = Box(low.astype(self._dtype), high.astype(self._dtype), dtype=self._dtype)
            return
        inner = dict(space.spaces) if isinstance(space, Dict) else {"observation": space}
        if KEY in inner:
            raise UsageError(f"the observation has a key '{KEY}', which is where time and memory go")
        self.space = Dict({**inner, KEY: Box(-ends.astype(np.float32), ends.astype(np.float32))})

    def join(self, observation: Any, own: Array, t: Integers, copy: int | None = None) -> Any:
        """One observation and `own` (size,), or N batched ones and (N, size).

        Args:
            observation: of the environment.
            own: time and inputs.
            t: the steps, (1,) or (N,).
            copy: which one it is of a vector environment, where it is one of several.

        Raises:
            UsageError: a vector of another length, or a number that is NaN or infinite.
        """
        for part in _floats(observation):
            if not np.isfinite(part).all():
                _tell(part if own.ndim == 2 else part[None], t, copy)
        if self._vector:
            if (given := np.shape(observation)[-1:]) != self._shape:
                raise outside_space(f"{given} numbers in place of {self._shape}")
            return np.concatenate([observation, own], axis=-1, dtype=self._dtype)
        inner = observation if self._dict else {"observation": observation}
        return {**inner, KEY: own.astype(np.float32)}


def _floats(observation: Any) -> Iterator[NDArray[Any]]:
    """The arrays of floats that an observation consists of."""
    if isinstance(observation, dict | tuple):
        for part in observation.values() if isinstance(observation, dict) else observation:
            yield from _floats(part)
    elif isinstance(observation, np.ndarray | np.floating) and observation.dtype.kind == "f":
        yield np.asarray(observation)


def _tell(part: NDArray[Any], t: Integers, copy: int | None) -> None:
    """Of numbers (N, ...) of which some are not finite."""
    where = tuple(np.argwhere(~np.isfinite(part))[0].tolist())
    which = place(int(t[where[0]]), where[0] if len(t) > 1 else copy)
    raise UsageError(f"the environment returned an observation with {part[where]} {which}; numbers are finite")


def check_actions(space: Space[Any]) -> None:
    """Raises `UsageError` where actions are no numbers that a method could be told."""
    if not isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete):
        raise UsageError(
            f"actions are numbers, a Box, Discrete, MultiDiscrete or MultiBinary; the environment has {space}"
        )


def action_rows(action: Any, count: int) -> Array:
    """One action, or N batched ones, as numbers (count, axes)."""
    return np.asarray(action, dtype=np.float64).reshape(count, -1)
