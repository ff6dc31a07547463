"""The entries of an observation by names that the user gives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Dict, Space

from stlbench.contract import Array
from stlbench.errors import UsageError, did_you_mean

Names: TypeAlias = Sequence[str] | Mapping[str, Sequence[str]]
"""Of all entries of an array, in their order; of a Dict observation, key -> those of its array."""


@dataclass(frozen=True)
class Entries:
    """Which numbers of an observation have names."""

    names: tuple[str, ...] = ()
    keys: tuple[str, ...] | None = ()
    """Of a Dict observation, the keys of the arrays that are named; None where the observation is one array."""

    def of(self, space: Space[Any], key: str) -> Entries:
        """Those of one array of an observation from `space`, as if it were the whole; of a Dict the one at `key`."""
        if self.keys is None:
            return self
        if key not in self.keys or not isinstance(space, Dict):
            return Entries()
        begin = sum(prod(space[each].shape or ()) for each in self.keys[: self.keys.index(key)])
        return Entries(self.names[begin : begin + prod(space[key].shape or ())], None)

    def read(self, observation: Any, count: int) -> Array:
        """The named entries of one observation or of `count` batched ones: (count, n).

        Raises `UsageError` where there are not as many numbers as names.
        """
        parts = [observation] if self.keys is None else [observation[key] for key in self.keys]
        try:
            rows = [np.asarray(part, dtype=np.float64).reshape(count, -1) for part in parts]
        except (TypeError, ValueError) as error:
            raise outside_space(str(error)) from error
        found = rows[0] if len(rows) == 1 else np.concatenate([np.empty((count, 0)), *rows], axis=1)
        if found.shape[1] != len(self.names):
            raise outside_space(f"{found.shape[1]} numbers in place of {len(self.names)}")
        return found


def outside_space(what: str) -> UsageError:
    """Of an observation that is not of the space that the environment has said."""
    return UsageError(f"the environment returned an observation outside its space: {what}")


def entries_of(space: Space[Any], names: Names | None) -> Entries:
    """The entries of observations from `space`. Raises `UsageError` where the names do not fit."""
    if names is None:
        return Entries()
    if isinstance(names, str):
        raise UsageError(f"names: expected a list of names, got the text '{names}'")
    parts = list(_named_parts(space, names))
    for place, part, given in parts:
        size = None if part.shape is None else prod(part.shape)
        if size != len(given):
            raise UsageError(f"names: {len(given)} for {place}, which has {'no' if size is None else size} entries")
    together = tuple(name for _, _, given in parts for name in given)
    for name in together:
        if together.count(name) > 1:
            raise UsageError(f"names: '{name}' stands for two entries")
    return Entries(together, tuple(names) if isinstance(names, Mapping) else None)


def _named_parts(space: Space[Any], names: Names) -> Iterator[tuple[str, Space[Any], Sequence[str]]]:
    """What is named in words, its space, and the names."""
    if not isinstance(names, Mapping):
        if isinstance(space, Dict):
            raise UsageError("names: the observation is a Dict; give a mapping, {key: names of its entries}")
        yield "the observation", space, names
        return
    if not isinstance(space, Dict):
        raise UsageError("names: the observation is no Dict; give a list of names")
    for key, given in names.items():
        if key not in space.spaces:
            raise UsageError(f"names: the observation has no '{key}'{did_you_mean(key, space.spaces)}")
        yield f"'{key}'", space[key], given
