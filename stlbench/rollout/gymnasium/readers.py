"""From what an environment under `stlbench.wrap` returns to the signals of the formula."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Space
from gymnasium.vector.utils import iterate

from stlbench.contract import Array, Integers
from stlbench.errors import UsageError
from stlbench.task.gym_signals import Expressions

SignalsOf: TypeAlias = Callable[[Any, dict[str, Any]], Mapping[str, float]]
"""A user's function: observation and info of one environment to name -> number."""


class Reader(ABC):
    """Reads k signals, in the order of `names`. A message about a bad one says at which step, and of which copy."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names

    def one(self, observation: Any, info: dict[str, Any], t: int, copy: int | None = None) -> Array:
        """The signals (1, k) of one environment at step t. `copy` is its number in a vector environment."""
        places = [place(t, copy)]
        return self._finite(self._one(observation, info, places), places)

    def many(self, observations: Any, infos: dict[str, Any], t: Integers) -> Array:
        """The signals (N, k) of a vector environment whose copies are at steps t (N,)."""
        places = [place(step, copy) for copy, step in enumerate(t.tolist())]
        return self._finite(self._many(observations, [row_of(infos, copy) for copy in range(len(t))], places), places)

    @abstractmethod
    def _one(self, observation: Any, info: dict[str, Any], places: list[str]) -> Array: ...

    @abstractmethod
    def _many(self, observations: Any, infos: list[dict[str, Any]], places: list[str]) -> Array: ...

    def _finite(self, signals: Array, places: Sequence[str]) -> Array:
        if not np.isfinite(signals).all():
            row, column = np.argwhere(~np.isfinite(signals))[0]
            raise UsageError(f"signals: {self.names[column]} is {signals[row, column]} {places[row]}")
        return signals


class FunctionReader(Reader):
    def __init__(self, function: SignalsOf, names: tuple[str, ...], space: Space[Any]) -> None:
        super().__init__(names)
        self._function, self._space = function, space

    def _one(self, observation: Any, info: dict[str, Any], places: list[str]) -> Array:
        given, where = self._function(observation, info), places[0]
        if not isinstance(given, Mapping):
            raise UsageError(f"signals: expected name -> number {where}, got {given!r}")
        if given.keys() != set(self.names):
            rule = f"ranges has {', '.join(self.names)}"
            raise UsageError(f"signals: the function returned {', '.join(map(str, given))} {where}; {rule}")
        try:
            return np.array([[float(given[name]) for name in self.names]])
        except (TypeError, ValueError) as error:
            raise UsageError(f"signals: the function returned no numbers {where}: {error}") from error

    def _many(self, observations: Any, infos: list[dict[str, Any]], places: list[str]) -> Array:
        each = zip(iterate(self._space, observations), infos, places, strict=True)
        return np.concatenate([self._one(row, info, [where]) for row, info, where in each])


class ExpressionReader(Reader):
    def __init__(self, expressions: Expressions) -> None:
        super().__init__(expressions.names)
        self._expressions = expressions

    def _one(self, observation: Any, info: dict[str, Any], places: list[str]) -> Array:
        return self._many(observation, [info], places)

    def _many(self, observations: Any, infos: list[dict[str, Any]], places: list[str]) -> Array:
        named = self._expressions.entries.read(observations, len(infos))
        return self._expressions.values(named, infos, places)


def place(t: int, copy: int | None) -> str:
    return f"at step {t}" if copy is None else f"at step {t} of copy {copy}"


def masked(name: str, values: Array, mask: Any) -> dict[str, Any]:
    """An entry of a vector environment's info, and the mask `_name` of the copies that have it; none without any."""
    if not mask.any():
        return {}
    entry = np.zeros_like(values)
    entry[mask] = values[mask]
    return {name: entry, f"_{name}": mask.copy()}


def row_of(infos: dict[str, Any], copy: int) -> dict[str, Any]:
    """The info of one copy: the inverse of `masked`."""
    return {
        name: _part(value, copy)
        for name, value in infos.items()
        if not (name.startswith("_") and name[1:] in infos)
        if (mask := infos.get(f"_{name}")) is None or mask[copy]
    }


def _part(value: Any, copy: int) -> Any:
    if isinstance(value, dict):
        return row_of(value, copy)
    return value[copy] if isinstance(value, np.ndarray) and value.ndim else value
