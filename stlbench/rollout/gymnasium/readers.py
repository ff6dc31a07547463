"""From what an environment under `stlbench.wrap` returns to the signals of the formula."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Space
from gymnasium.vector.utils import iterate

from stlbench.contract import Array, Integers
from stlbench.errors import UsageError
from stlbench.task.gym_signals import Expressions, number

SignalsOf: TypeAlias = Callable[[Any, dict[str, Any]], Mapping[str, float]]
"""A user's function: observation and info of one environment to name -> number."""


class Reader:
    """Reads k signals, in the order of `names`. A message about a bad one says at which step, and of which copy."""

    def __init__(self, signals: SignalsOf | Expressions, names: tuple[str, ...], space: Space[Any]) -> None:
        """Args: `space` that of the observations, of a vector environment the batched one."""
        self.names, self._signals, self._space = names, signals, space

    def one(self, observation: Any, info: dict[str, Any], t: int, copy: int | None = None) -> Array:
        """The signals (1, k) of one environment at step t. `copy` is its number in a vector environment."""
        return self._read([observation], observation, [info], [place(t, copy)])

    def many(self, observations: Any, infos: dict[str, Any], t: Integers) -> Array:
        """The signals (N, k) of a vector environment whose copies are at steps t (N,)."""
        places = [place(step, copy) for copy, step in enumerate(t.tolist())]
        rows = [row_of(infos, copy) for copy in range(len(t))]
        return self._read(iterate(self._space, observations), observations, rows, places)

    def _read(self, each: Iterable[Any], together: Any, infos: list[dict[str, Any]], places: list[str]) -> Array:
        """The signals of observations, which are given one by one for a function and together for expressions."""
        if isinstance(self._signals, Expressions):
            signals = self._signals.values(self._signals.entries.read(together, len(infos)), infos, places)
        else:
            samples = zip(each, infos, places, strict=True)
            signals = np.array([self._returned(self._signals(row, info), where) for row, info, where in samples])
        if not np.isfinite(signals).all():
            row, column = np.argwhere(~np.isfinite(signals))[0]
            raise UsageError(f"signals: {self.names[column]} is {signals[row, column]} {places[row]}")
        return signals

    def _returned(self, given: Any, where: str) -> list[float]:
        if not isinstance(given, Mapping):
            raise UsageError(f"signals: expected name -> number {where}, got {given!r}")
        if given.keys() != set(self.names):
            rule = f"ranges has {', '.join(self.names)}"
            raise UsageError(f"signals: the function returned {', '.join(map(str, given))} {where}; {rule}")
        try:
            return [number(given[name]) for name in self.names]
        except (TypeError, ValueError) as error:
            raise UsageError(f"signals: the function returned no numbers {where}: {error}") from error


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
