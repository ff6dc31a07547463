"""Signals as expressions over named entries of an observation, and over entries of the info by their own names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from stlbench import stl
from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.task.entries import Entries


class Compiled(NamedTuple):
    """What reads k signals."""

    from_info: tuple[str, ...]
    """The names that are none of the observation's, and so those of entries of the info."""
    values: Callable[[Array], Array]
    """Samples (..., e + i), the named entries and then `from_info`, to signals (..., k)."""


def parsed(place: str, text: str) -> stl.Expression:
    """An expression. Raises `UsageError`, with the place, where it is none."""
    try:
        return stl.parse_expression(text)
    except (TypeError, stl.StlSyntaxError) as error:
        raise UsageError(f"{place}: {error}") from error


def compiled(nodes: Iterable[stl.Expression], entries: Entries) -> Compiled:
    """What reads these expressions, in their order. Raises `UsageError` where a constant has no value."""
    nodes = tuple(nodes)
    used = dict.fromkeys(each for node in nodes for each in stl.signals(node))
    from_info = tuple(name for name in used if name not in entries.names)
    try:
        return Compiled(from_info, stl.values(nodes, (*entries.names, *from_info)))
    except stl.UndefinedError as error:
        raise UsageError(f"signals: {error}") from error


def unknown(name: str, entries: Entries, info: Mapping[str, Any], where: str = "") -> UsageError:
    """What is said of a name that is neither in the observation nor in the info."""
    known, there = ", ".join(entries.names) or "no names", ", ".join(map(str, info)) or "nothing"
    return UsageError(f"signals: no '{name}'{where}: the observation has {known}, the info {there}")
