"""Observations with the time and the method's memory in them, and actions as numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Space
from numpy.typing import NDArray

from stlbench.contract import Array, Integers
from stlbench.errors import UsageError, did_you_mean
from stlbench.records.observation import Observation
from stlbench.rollout.gymnasium.readers import place
from stlbench.task.gym_spaces import Entries, Observed, outside_space

KEY = "stl"  # under which a Dict observation has the time and the memory
OBSERVATION = "observation"  # the key of an observation that is neither a vector nor a Dict


class Observing:
    """Scales observations as tasks of stlbench do (`Observed`), and adds the time and the method's inputs.

    A vector gets them at its end. A Dict gets them under `KEY`, and its vectors are scaled. Any other observation
    becomes a Dict, with itself, unscaled, under `OBSERVATION`. The space carries the record of this if all parts are
    vectors.
    """

    def __init__(self, space: Space[Any], entries: Entries, scale: Mapping[str, float], record: Observation) -> None:
        """For one environment: `entries` have names, `scale` has magnitudes, `record` is of time and inputs.

        Raises `UsageError` for a scale that is none or of no entry, or a key `KEY` in the observation.
        """
        _check_scale(space, entries, scale)
        self._whole, self._vector = isinstance(space, Dict), _is_vector(space)
        parts = dict(space.spaces) if isinstance(space, Dict) else {OBSERVATION: space}
        if KEY in parts:
            raise UsageError(f"the observation has a key '{KEY}', which is where time and memory go")
        self._observed = {
            key: Observed(part, named, {name: value for name, value in scale.items() if name in named.names})
            for key, part in parts.items()
            if _is_vector(part)
            for named in [entries.of(space, key)]
        }
        self._warned = False
        self._shapes = {key: parts[key].shape for key in self._observed}
        shown = {key: _scaled_space(part, self._observed.get(key)) for key, part in parts.items()}
        ends = np.full(record.total, np.inf)
        ends[0] = 1.0
        own = Box(-ends.astype(np.float32), ends.astype(np.float32))
        self._dtypes = {key: shown[key].dtype for key in self._observed}
        self.space: Space[Any] = Dict([*shown.items(), (KEY, own)])  # in this order, as tasks have them
        if self._vector:
            vector, dtype = cast(Box, shown[OBSERVATION]), self._dtypes[OBSERVATION]
            low, high = np.concatenate([vector.low, own.low]), np.concatenate([vector.high, own.high])
            self.space = Box(low.astype(dtype), high.astype(dtype), dtype=cast(Any, dtype))
        if len(self._observed) == len(parts):
            described = [observed.described(record) for observed in self._observed.values()]
            Observation.joined(described).save_in(self.space)

    def join(self, observation: Any, own: Array, t: Integers, copy: int | None = None) -> Any:
        """One observation and `own` (size,), or N batched ones and (N, size), at steps t, (1,) or (N,).

        `copy` is its number in a vector environment. Raises `UsageError` for a vector of another length, or numbers
        that are not finite. Warns, once, of numbers outside of their space.
        """
        for part in _floats(observation):
            if not np.isfinite(part).all():
                _tell(part if own.ndim == 2 else part[None], t, copy)
        if self._vector:
            seen = self._scaled(OBSERVATION, observation, t, copy)
            return np.concatenate([seen, own], axis=-1, dtype=cast(Any, self._dtypes[OBSERVATION]))
        inner = observation if self._whole else {OBSERVATION: observation}
        scaled = {key: self._scaled(key, inner[key], t, copy).astype(self._dtypes[key]) for key in self._observed}
        return {**inner, **scaled, KEY: own.astype(np.float32)}

    def _scaled(self, key: str, vector: Any, t: Integers, copy: int | None) -> Array:
        if (given := np.shape(vector)[-1:]) != self._shapes[key]:
            raise outside_space(f"{given} numbers in place of {self._shapes[key]}")
        seen = self._observed[key].scaled(vector)
        if not self._warned and (found := self._observed[key].beyond(np.atleast_2d(seen))):
            self._warned, which = True, _which(found[0].row, t, copy)
            remedy = "a `scale` for it takes the place of these ends, and `ranges` should reach what signals take"
            gymnasium.logger.warn(f"{outside_space(found[0].said, which)}; {remedy}")
        return seen


def _is_vector(space: Space[Any]) -> bool:
    return isinstance(space, Box) and len(space.shape) == 1


def _check_scale(space: Space[Any], entries: Entries, scale: Mapping[str, float]) -> None:
    for name, value in scale.items():
        if name not in entries.names:
            raise UsageError(f"scale: no entry '{name}' among the names{did_you_mean(name, entries.names)}")
        if not isinstance(value, Real) or not 0 < value < np.inf:
            raise UsageError(f"scale: '{name}' has a magnitude above 0, got {value!r}")


def _scaled_space(space: Space[Any], observed: Observed | None) -> Space[Any]:
    """Where the scaled numbers are; of what is not scaled, the space itself."""
    if observed is None or not isinstance(space, Box):
        return space
    dtype: Any = space.dtype if np.issubdtype(space.dtype, np.floating) else np.float32
    low, high = (observed.scaled(ends.astype(np.float64)).astype(dtype) for ends in (space.low, space.high))
    return Box(low, high, dtype=dtype)


def _floats(observation: Any) -> Iterator[NDArray[Any]]:
    if isinstance(observation, dict | tuple):
        for part in observation.values() if isinstance(observation, dict) else observation:
            yield from _floats(part)
    elif isinstance(observation, np.ndarray | np.floating) and observation.dtype.kind == "f":
        yield np.asarray(observation)


def _tell(part: NDArray[Any], t: Integers, copy: int | None) -> None:
    """Of numbers (N, ...) of which some are not finite."""
    where = tuple(np.argwhere(~np.isfinite(part))[0].tolist())
    which = _which(where[0], t, copy)
    raise UsageError(f"the environment returned an observation with {part[where]} {which}; numbers are finite")


def _which(row: int, t: Integers, copy: int | None) -> str:
    return place(int(t[row]), row if len(t) > 1 else copy)
