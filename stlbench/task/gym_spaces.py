"""The spaces of an environment as numbers: its actions, the named entries of its observation, signals as expressions
over these, what a policy sees.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import prod
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Space
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array
from stlbench.errors import UsageError, did_you_mean, one_line
from stlbench.records.observation import MOST, Observation


class ActionAxis(NamedTuple):
    """One number of an action."""

    name: str
    low: float
    high: float
    values: int | None
    """The count of whole numbers from `low` to `high`; None if all numbers between are actions."""

    @property
    def ends(self) -> dict[str, Any]:
        """`low`, `high` and `count`, as a task file has them."""
        return {"low": self.low, "high": self.high, "count": self.values}


def action_axes(space: Space[Any]) -> tuple[ActionAxis, ...]:
    """The numbers that an action consists of; some may be without ends. Raises `UsageError` if it is no numbers."""
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
    """The action that an environment with that action space takes, for a vector (axes,)."""
    if isinstance(space, Discrete):
        return np.int64(vector[0])
    shaped = vector.reshape(space.shape)
    return (np.rint(shaped) if np.issubdtype(space.dtype, np.integer) else shaped).astype(space.dtype)


Names: TypeAlias = Sequence[str] | Mapping[str, Sequence[str]]
"""The names of all entries of an array, in their order; for a Dict observation, key -> those of its array."""


@dataclass(frozen=True)
class Entries:
    """Which numbers of an observation have names."""

    names: tuple[str, ...] = ()
    keys: tuple[str, ...] | None = ()
    """The keys of the arrays of a Dict observation that are named; None if the observation is one array."""

    def of(self, space: Space[Any], key: str) -> Entries:
        """The entries of one array of an observation, as if it were the whole; for a Dict the array at `key`."""
        if self.keys is None:
            return self
        if key not in self.keys or not isinstance(space, Dict):
            return Entries()
        begin = sum(prod(space[each].shape or ()) for each in self.keys[: self.keys.index(key)])
        return Entries(self.names[begin : begin + prod(space[key].shape or ())], None)

    def read(self, observation: Any, count: int) -> Array:
        """The named entries of one observation or of `count` batched ones: (count, n).

        Raises `UsageError` if there are not as many numbers as names.
        """
        parts = [observation] if self.keys is None else [observation[key] for key in self.keys]
        try:
            rows = [np.asarray(part, dtype=np.float64).reshape(count, -1) for part in parts]
        except (TypeError, ValueError) as error:
            raise outside_space(str(error)) from error
        numbers = rows[0] if len(rows) == 1 else np.concatenate([np.empty((count, 0)), *rows], axis=1)
        if numbers.shape[1] != len(self.names):
            raise outside_space(f"{numbers.shape[1]} numbers in place of {len(self.names)}")
        return numbers


def outside_space(what: str, where: str = "") -> UsageError:
    """The error for an observation that is not of the space that the environment has said; `where` as "at step 3"."""
    return UsageError(f"the environment returned an observation outside its space{where and ' ' + where}: {what}")


def entries_of(space: Space[Any], names: Names | None) -> Entries:
    """The entries of observations from `space`. Raises `UsageError` if the names do not fit."""
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
    """The named thing in words, its space, and the names."""
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


LARGE = 1e4
"""Ends of a space beyond this say nothing of what an entry is about: some environments write the largest float32."""


class Beyond(NamedTuple):
    """An entry of an observation that lies beyond the ends of its space."""

    row: int
    """The first of the given observations in which it does."""
    name: str | None
    said: str


_ROUNDING = 1e-6
"""A scaled number may lie this far beyond -1 or 1, as environments compute in other types than their spaces'."""


class Observed:
    """Flattens observations of a space, and scales them.

    An entry with finite ends goes from -1 to 1. An entry without is divided by its scale, if it has one. A Discrete
    observation becomes one number for each value, 1 for the one that it has. Parts of a Dict that are no numbers, such
    as the mission of MiniGrid, are left out.
    """

    def __init__(self, space: Space[Any], entries: Entries, scale: Mapping[str, float]) -> None:
        """Args: `scale` named entry -> about its largest magnitude. Raises `UsageError`."""
        space = _in_numbers(space)
        flat = _flattened(space)
        if flat is None:
            raise UsageError(f"its observations cannot be written as a fixed number of numbers: {space}")
        self.size, self._type = flat.shape[0], flat.dtype
        self._space, self._plain = space, isinstance(space, Box) and len(space.shape) == 1
        low, high = flat.low.astype(np.float64), flat.high.astype(np.float64)
        known = (np.abs(low) <= LARGE) & (np.abs(high) <= LARGE) & (low < high)
        # Equal ends, as [0, 0], say nothing of the range of an entry: nothing lies beyond them.
        ends = np.stack([np.where(low < high, low, -np.inf), np.where(low < high, high, np.inf)])
        low, high = np.where(known, low, -1.0), np.where(known, high, 1.0)
        self._middle, self._reach = (low + high) / 2, (high - low) / 2
        named = _named(space, entries)
        self._names = {place: name for name, place in named.items()}
        for name, magnitude in scale.items():
            if name in entries.names and name not in named:
                raise UsageError(f"scale: '{name}' is of a Discrete observation, which has a 0 or 1 for each value")
            if name not in named:
                raise UsageError(f"scale: no entry '{name}'{did_you_mean(name, named)}")
            self._middle[named[name]], self._reach[named[name]] = 0.0, magnitude
            ends[:, named[name]] = -np.inf, np.inf
        self._least, self._most = self.scaled(ends) + np.array([[-_ROUNDING], [_ROUNDING]])

    def name(self, place: int) -> str:
        """The name of the number at a place of the flat observation: 'v', or number 3 of the observation."""
        return f"'{self._names[place]}'" if place in self._names else f"number {place} of the observation"

    def described(self, shown: Observation) -> Observation:
        """The record of a policy's view: these numbers, beside the time and the inputs that `shown` has."""
        if self.size > MOST:
            return replace(shown, size=self.size)
        names = tuple(self._names.get(place, "") for place in range(self.size))
        middle, reach = tuple(self._middle.tolist()), tuple(self._reach.tolist())
        return replace(shown, size=self.size, names=names, middle=middle, reach=reach)

    def flat(self, observation: Any) -> Array:
        """The numbers (d,) of one observation, as they are. Raises errors of many kinds if it is not of the space."""
        if self._plain:
            return cast(Array, observation)
        parts = [(self._space, observation)]
        if isinstance(self._space, Dict):
            parts = [(part, observation[key]) for key, part in self._space.spaces.items()]
        for part, value in parts:  # else the value before the first would count as the last
            if isinstance(part, Discrete | MultiDiscrete) and np.any(np.asarray(value) < part.start):
                raise ValueError(f"{value!r} is none of {part}")
        flat: Any = spaces.flatten(self._space, observation)
        return cast(Array, flat)

    def scaled(self, flat: Array) -> Array:
        """The policy's view: (N, d) -> (N, d)."""
        seen: Array = (flat - self._middle) / self._reach
        return seen

    def beyond(self, seen: Array) -> list[Beyond]:
        """The entries of scaled observations (N, d) that lie beyond the ends of the space, each at its first row.

        A number that is scaled by its own magnitude, in place of its ends, may be anywhere.
        """
        wrong = (seen < self._least) | (seen > self._most)
        return [
            self._beyond(int(wrong[:, place].argmax()), place, seen)
            for place in np.flatnonzero(wrong.any(axis=0)).tolist()
        ]

    def _beyond(self, row: int, place: int, seen: Array) -> Beyond:
        value, low, high = self._reach * [seen[row], self._least, self._most] + self._middle
        said = f"{self.name(place)} is {value[place]:.6g}, outside {low[place]:.4g} to {high[place]:.4g}"
        return Beyond(row, self._names.get(place), said)

    def own(self, seen: Array) -> NDArray[Any]:
        """The environment's own observation, from the policy's view: (N, d) -> (N, d), of the space's own type."""
        flat = seen * self._reach + self._middle
        return (flat if self._type.kind == "f" else np.rint(flat)).astype(self._type)


def _in_numbers(space: Space[Any]) -> Space[Any]:
    """The space; a Dict loses its parts that are no numbers."""
    if not isinstance(space, Dict):
        return space
    parts = {key: part for key, part in space.spaces.items() if _flattened(part) is not None}
    return Dict(parts) if 0 < len(parts) < len(space.spaces) else space


def _flattened(space: Space[Any]) -> Box | None:
    """The flat space; None if observations cannot be written as a fixed number of numbers."""
    try:
        flat: Any = spaces.flatten_space(space)
    except NotImplementedError:
        return None
    return flat if isinstance(flat, Box) else None


def _named(space: Space[Any], entries: Entries) -> dict[str, int]:
    """The place of each named entry among the numbers of a flat observation. Discrete ones have a number per value."""
    if entries.keys is None or not isinstance(space, Dict):
        return {name: place for place, name in enumerate(entries.names) if isinstance(space, Box | MultiBinary)}
    begin, places = 0, dict[str, Sequence[int | None]]()
    for key, part in space.spaces.items():
        size = prod(part.shape or ())
        places[key] = range(begin, begin + size) if isinstance(part, Box | MultiBinary) else [None] * size
        begin += spaces.flatdim(part)
    pairs = zip(entries.names, chain.from_iterable(places[key] for key in entries.keys), strict=True)
    return {name: place for name, place in pairs if place is not None}


_NAMES = "name all entries of the observation by names=('x', 'y')"
"""What to do where an entry has no name."""


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
            infos: the N infos.
            places: N places for messages, such as "at step 3".

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
            hint = "" if self.entries.names else f"; {_NAMES}"
            raise UsageError(f"signals: no '{name}'{place}: the observation has {known}, the info {there}{hint}")
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
        hint = f"{_NAMES}; " if "[" in text else ""  # before the error, whose last line points to a place
        raise UsageError(f"{place}: {hint}{error}") from error


def number(given: Any) -> float:
    """A number, also one in an array of one number. Raises `TypeError` or `ValueError` for anything else."""
    return float(given.item() if isinstance(given, np.ndarray) and given.size == 1 else given)


def numbers(given: Any, count: int) -> Array:
    """`count` signals as numbers, from the values that a task's class returned. Raises `UsageError`."""
    try:
        signals = np.array([number(value) for value in given])
    except (TypeError, ValueError) as error:
        raise UsageError(f"signals: expected {count} numbers, got {given!r}") from error
    if len(signals) != count:
        raise UsageError(f"signals: expected {count} numbers, got {len(signals)}")
    return signals
