"""Signals as expressions over named entries of an observation, and over entries of the info by their own names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stlbench import stl
from stlbench.contract import Array
from stlbench.errors import UsageError, one_line
from stlbench.task.gym_spaces import Entries


class Expressions:
    """Reads k signals. Names in an expression that are no entry of the observation are entries of the info."""

    def __init__(self, texts: Mapping[str, str], entries: Entries) -> None:
        """Args: `texts` signal -> expression. Raises `UsageError`: a text is none, or a constant has no value."""
        self.names, self._texts, self.entries = tuple(texts), dict(texts), entries
        nodes = tuple(_parsed(f"signals.{name}", text) for name, text in texts.items())
        used = dict.fromkeys(each for node in nodes for each in stl.signals(node))
        self.from_info = tuple(name for name in used if name not in entries.names)
        try:
            self._values = stl.values(nodes, (*entries.names, *self.from_info))
        except ValueError as error:
            raise UsageError(f"signals: {error}") from error

    def __reduce__(self) -> tuple[Any, ...]:
        """Compiled code cannot be pickled: the copy compiles the texts."""
        return Expressions, (self._texts, self.entries)

    def values(self, named: Array, infos: Sequence[Mapping[str, Any]], places: Sequence[str] = ()) -> Array:
        """The signals (N, k).

        Args:
            named: the named entries (N, e).
            infos: of each of the N observations.
            places: of each, for messages, such as "at step 3".

        Raises:
            UsageError: an entry of the info is missing, or is no number.
        """
        if not self.from_info:
            return self._values(named)
        at = [f" {place}" for place in places] or [""] * len(infos)
        from_info = [[self._number(name, *each) for name in self.from_info] for each in zip(infos, at, strict=True)]
        return self._values(np.concatenate([named, np.array(from_info)], axis=1))

    def _number(self, name: str, info: Mapping[str, Any], place: str) -> float:
        if name not in info:
            known, there = ", ".join(self.entries.names) or "no names", ", ".join(map(str, info)) or "nothing"
            raise UsageError(f"signals: no '{name}'{place}: the observation has {known}, the info {there}")
        try:
            return number(info[name])
        except (TypeError, ValueError) as error:
            raise UsageError(f"signals: '{name}' of the info is no number{place}, but {info[name]!r}") from error


def _parsed(place: str, text: object) -> stl.Expression:
    if not isinstance(text, str):
        rule = "one function gives all signals, (observation, info) -> {name: number}"
        instead = f"a function; {rule}" if callable(text) else one_line(text)
        raise UsageError(f"{place}: expected an expression as text, such as 'x - y', got {instead}")
    try:
        return stl.parse_expression(text)
    except stl.StlSyntaxError as error:
        raise UsageError(f"{place}: {error}") from error


def number(given: Any) -> float:
    """A number, also one in an array of one number. Raises `TypeError` or `ValueError` for anything else."""
    return float(given.item() if isinstance(given, np.ndarray) and given.size == 1 else given)


def numbers(given: Any, count: int) -> Array:
    """The values that a task's class returned as `count` signals. Raises `UsageError`."""
    try:
        signals = np.array([number(value) for value in given])
    except (TypeError, ValueError) as error:
        raise UsageError(f"signals: expected {count} numbers, got {given!r}") from error
    if len(signals) != count:
        raise UsageError(f"signals: expected {count} numbers, got {len(signals)}")
    return signals
