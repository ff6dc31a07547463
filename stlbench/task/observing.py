"""What a policy sees of an observation: all of its numbers, brought to about [-1, 1]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import prod
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench.errors import UsageError, did_you_mean
from stlbench.records.observation import MOST, Observation
from stlbench.task.entries import Entries

LARGE = 1e4
"""Ends of a space beyond this say nothing of what an entry is about: some environments write the largest float32."""


class Observed:
    """Flattens observations of a space, and scales them.

    An entry with finite ends goes from -1 to 1. One without is divided by its scale, where it has one. A Discrete
    observation becomes one number for each value, 1 for the one that it has.
    """

    def __init__(self, space: spaces.Space[Any], entries: Entries, scale: Mapping[str, float]) -> None:
        """Args: `scale` named entry -> about its largest magnitude. Raises `UsageError`."""
        flat = _flat(space)
        self.size, self._type = flat.shape[0], flat.dtype
        self._space, self._plain = space, isinstance(space, spaces.Box) and len(space.shape) == 1
        low, high = flat.low.astype(np.float64), flat.high.astype(np.float64)
        known = (np.abs(low) <= LARGE) & (np.abs(high) <= LARGE) & (low < high)
        low, high = np.where(known, low, -1.0), np.where(known, high, 1.0)
        self._middle, self._reach = (low + high) / 2, (high - low) / 2
        self._names = {place: name for name, place in _named(space, entries).items()}
        for name, place in _places(space, entries, scale).items():
            self._middle[place], self._reach[place] = 0.0, scale[name]

    def name(self, place: int) -> str:
        """What the number at a place of the flat observation is called: 'v', or number 3 of the observation."""
        return f"'{self._names[place]}'" if place in self._names else f"number {place} of the observation"

    def described(self, beside: Observation) -> Observation:
        """The record of what a policy sees; `beside` is what it is shown beside these numbers."""
        if self.size > MOST:
            return replace(beside, size=self.size)
        names = tuple(self._names.get(place, "") for place in range(self.size))
        middle, reach = tuple(self._middle.tolist()), tuple(self._reach.tolist())
        return replace(beside, size=self.size, names=names, middle=middle, reach=reach)

    def flat(self, observation: Any) -> Array:
        """The numbers (d,) of one observation, as they are."""
        flat: Any = observation if self._plain else spaces.flatten(self._space, observation)
        return cast(Array, flat)

    def scaled(self, flat: Array) -> Array:
        """What the policy sees: (N, d) -> (N, d)."""
        seen: Array = (flat - self._middle) / self._reach
        return seen

    def own(self, seen: Array) -> NDArray[Any]:
        """What the environment itself shows, from what the policy sees: (N, d) -> (N, d), of the space's own type."""
        flat = seen * self._reach + self._middle
        return (flat if self._type.kind == "f" else np.rint(flat)).astype(self._type)


def _flat(space: spaces.Space[Any]) -> spaces.Box:
    try:
        flat: Any = spaces.flatten_space(space)
    except NotImplementedError:
        flat = None
    if not isinstance(flat, spaces.Box):
        raise UsageError(f"its observations cannot be written as a fixed number of numbers: {space}")
    return flat


def _places(space: spaces.Space[Any], entries: Entries, scale: Mapping[str, float]) -> dict[str, int]:
    """Named entry that has a scale -> its place in the flat observation."""
    named = _named(space, entries)
    for name in scale:
        if name not in named:
            raise UsageError(f"scale: no entry '{name}'{did_you_mean(name, named)}")
    return {name: named[name] for name in scale}


def _named(space: spaces.Space[Any], entries: Entries) -> dict[str, int]:
    return dict(zip(entries.names, _offsets(space, entries), strict=True))


def _offsets(space: spaces.Space[Any], entries: Entries) -> list[int]:
    if entries.keys is None or not isinstance(space, spaces.Dict):
        return list(range(len(entries.names)))
    begin, places = 0, dict[str, list[int]]()
    for key, part in space.spaces.items():
        places[key] = list(range(begin, begin + prod(part.shape or ())))
        begin += spaces.flatdim(part)
    return [place for key in entries.keys for place in places[key]]
