"""From what an environment returns to the signals that the formula is read from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Space
from gymnasium.vector.utils import iterate

from stlbench.contract import Array, Integers
from stlbench.errors import UsageError
from stlbench.rollout.wrapping.rows import has, row_of
from stlbench.task.entries import Entries
from stlbench.task.expressions import compiled, parsed, unknown

SignalsOf: TypeAlias = Callable[[Any, dict[str, Any]], Mapping[str, float]]
"""A user's function: observation and info of one environment to name -> number."""


class Reader(ABC):
    """Reads k signals, in the order of `names`. A message about a bad one says at which step, and of which copy."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names

    @abstractmethod
    def one(self, observation: Any, info: dict[str, Any], t: int, copy: int | None = None) -> Array:
        """Of one environment at step t: (1, k). `copy` is its number in a vector environment."""

    @abstractmethod
    def many(self, observations: Any, infos: dict[str, Any], t: Integers) -> Array:
        """Of a vector environment whose copies are at steps t (N,): (N, k)."""

    def checked(self, signals: Array, t: Integers, copy: int | None = None) -> Array:
        """The same signals. Raises `UsageError` where one is NaN or infinite."""
        if not np.isfinite(signals).all():
            row, column = np.argwhere(~np.isfinite(signals))[0]
            which = row if len(t) > 1 else copy
            raise UsageError(f"signals: {self.names[column]} is {signals[row, column]} {place(int(t[row]), which)}")
        return signals


class Function(Reader):
    """By a function of the user's, which is called for one copy at a time."""

    def __init__(self, function: SignalsOf, names: tuple[str, ...], space: Space[Any]) -> None:
        """Args: `space` that of the observations, of a vector environment the batched one."""
        super().__init__(names)
        self._function, self._space = function, space

    def one(self, observation: Any, info: dict[str, Any], t: int, copy: int | None = None) -> Array:
        """See `Reader`."""
        given = self._function(observation, info)
        if not isinstance(given, Mapping):
            raise UsageError(f"signals: expected name -> number {place(t, copy)}, got {given!r}")
        if given.keys() != set(self.names):
            rule = f"ranges has {', '.join(self.names)}"
            raise UsageError(f"signals: the function returned {', '.join(map(str, given))} {place(t, copy)}; {rule}")
        try:
            signals = np.array([[float(given[name]) for name in self.names]])
        except (TypeError, ValueError) as error:
            raise UsageError(f"signals: the function returned no numbers {place(t, copy)}: {error}") from error
        return self.checked(signals, np.array([t]), copy)

    def many(self, observations: Any, infos: dict[str, Any], t: Integers) -> Array:
        """See `Reader`."""
        each = enumerate(iterate(self._space, observations))
        return np.concatenate([self.one(row, row_of(infos, copy), int(t[copy]), copy) for copy, row in each])


class Expressions(Reader):
    """By expressions over named entries of the observation; other names in them are those of entries of the info."""

    def __init__(self, texts: Mapping[str, str], entries: Entries) -> None:
        super().__init__(tuple(texts))
        self._texts, self._entries = dict(texts), entries
        nodes = [parsed(f"signals: {name}", text) for name, text in texts.items()]
        self._from_info, self._values = compiled(nodes, entries)

    def __reduce__(self) -> tuple[Any, ...]:
        """What is compiled cannot be pickled, and is compiled again."""
        return Expressions, (self._texts, self._entries)

    def one(self, observation: Any, info: dict[str, Any], t: int, copy: int | None = None) -> Array:
        """See `Reader`."""
        for name in self._from_info:
            if name not in info:
                raise unknown(name, self._entries, info, f" {place(t, copy)}")
        return self.checked(self._read(observation, info, 1, place(t, copy)), np.array([t]), copy)

    def many(self, observations: Any, infos: dict[str, Any], t: Integers) -> Array:
        """See `Reader`."""
        for name in self._from_info:
            for copy in range(len(t)):
                if not has(infos, name, copy):
                    raise unknown(name, self._entries, row_of(infos, copy), f" {place(int(t[copy]), copy)}")
        return self.checked(self._read(observations, infos, len(t), "of some copy"), t)

    def _read(self, observation: Any, info: dict[str, Any], count: int, where: str) -> Array:
        parts = [self._entries.read(observation, count)]
        for name in self._from_info:
            try:
                parts.append(np.asarray(info[name], dtype=np.float64).reshape(count, 1))
            except (TypeError, ValueError) as error:
                raise UsageError(f"signals: '{name}' of the info is no number {where}, but {info[name]!r}") from error
        return self._values(np.concatenate(parts, axis=1) if len(parts) > 1 else parts[0])


def place(t: int, copy: int | None) -> str:
    """Where something was wrong, for a message."""
    return f"at step {t}" if copy is None else f"at step {t} of copy {copy}"
