"""The actions of an environment as vectors of numbers, whatever its space is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiBinary, MultiDiscrete, Space

from stlbench.contract import Array
from stlbench.errors import UsageError


class ActionAxis(NamedTuple):
    """One number of an action."""

    name: str
    low: float
    high: float
    values: int | None
    """How many whole numbers from `low` to `high`; None where all between are actions."""

    @property
    def ends(self) -> dict[str, Any]:
        """`low`, `high` and `count`, as a task file has them."""
        return {"low": self.low, "high": self.high, "count": self.values}


def action_axes(space: Space[Any]) -> tuple[ActionAxis, ...]:
    """The numbers that an action consists of; some may be without ends. Raises `UsageError` where it is no numbers."""
    if isinstance(space, Box):
        low, high = space.low.ravel().astype(float).tolist(), space.high.ravel().astype(float).tolist()
        names = _names(len(low))
        return tuple(ActionAxis(name, least, most, None) for name, least, most in zip(names, low, high, strict=True))
    starts, counts = _whole(space)
    ends = zip(_names(len(counts)), starts, counts, strict=True)
    return tuple(ActionAxis(name, float(start), float(start + count - 1), count) for name, start, count in ends)


def _whole(space: Space[Any]) -> tuple[list[int], list[int]]:
    """The least value of each axis, and how many there are."""
    match space:
        case Discrete():
            return [int(space.start)], [int(space.n)]
        case MultiDiscrete():
            return np.ravel(space.start).tolist(), np.ravel(space.nvec).tolist()
        case MultiBinary():
            size = int(np.prod(space.shape))
            return [0] * size, [2] * size
    raise UsageError(f"its actions should be a Box, Discrete, MultiDiscrete or MultiBinary, it has {space}")


def _names(count: int) -> tuple[str, ...]:
    return ("action",) if count == 1 else tuple(f"action_{i}" for i in range(count))


def as_action(space: Space[Any], vector: Array) -> Any:
    """What an environment with that action space takes, for a vector (axes,)."""
    if isinstance(space, Discrete):
        return np.int64(vector[0])
    return vector.reshape(space.shape).astype(space.dtype)
