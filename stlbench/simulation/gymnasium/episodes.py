"""The episodes of N wrapped copies: their time, the method's memory, both in the observation, actions as numbers,
what was recorded of the signals, and the verdict.

It does for an environment that somebody else steps what `Simulator` and the referee do for a world.
"""

import warnings
from collections.abc import Iterator, Mapping
from numbers import Real
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Space
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array, Integers, Truth
from stlbench.errors import UsageError, did_you_mean
from stlbench.records.observation import Observation
from stlbench.simulation.faults import check_inputs, check_memory, check_rewards, pay
from stlbench.simulation.gymnasium.scoring import Scoring, place
from stlbench.simulation.verdicts import EarlyEnds, judge, without_end
from stlbench.simulation.worlds import scaled_times, time_and_inputs
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
        ends[0] = 1.0  # the time's; a method states no ends of its inputs
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
    if not isinstance(scale, Mapping):
        raise UsageError(f"scale: expected a mapping, named entry -> magnitude, got {scale!r}")
    for name, value in scale.items():
        if name not in entries.names:
            raise UsageError(f"scale: no entry '{name}' among the names{did_you_mean(name, entries.names)}")
        if not isinstance(value, Real) or not 0 < value < np.inf:
            raise UsageError(f"scale: '{name}' has a magnitude above 0, got {value!r}")


def _scaled_space(space: Space[Any], observed: Observed | None) -> Space[Any]:
    """The space of the scaled numbers; the space itself if nothing is scaled."""
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
    """For numbers (N, ...) some of which are not finite."""
    where = tuple(np.argwhere(~np.isfinite(part))[0].tolist())
    which = _which(where[0], t, copy)
    raise UsageError(f"the environment returned an observation with {part[where]} {which}; numbers are finite")


def _which(row: int, t: Integers, copy: int | None) -> str:
    return place(int(t[row]), row if len(t) > 1 else copy)


_CUT = (
    "an episode began anew after {} of {} steps, so that its formula was not judged; a TimeLimit belongs inside of "
    "stlbench.wrap, or give its limit as `steps`"
)


class Episodes:
    """N copies of an environment, each at its own step; `rows` are numbers of copies. Raises `PluginFault`."""

    def __init__(self, scoring: Scoring, count: int) -> None:
        self._scoring = scoring
        self.steps, signals = scoring.specification.steps, len(scoring.specification.signals)
        self.t: Integers = np.zeros(count, dtype=np.int64)
        self._memory = np.zeros((count, scoring.method.memory_size))
        self._samples = np.full((count, self.steps + 1, signals), np.nan)
        self._times = scaled_times(self.steps)
        self._going, self._warned = np.zeros(count, dtype=np.bool_), False

    def start(self, rows: Integers, signals: Array) -> None:
        """Begin new episodes at the samples (r, k). Warns once of an episode that somebody cut before its end."""
        method = self._scoring.method
        if not self._warned and (cut := self.t[rows] * self._going[rows]).any():
            self._warned = True
            warnings.warn(_CUT.format(cut.max(), self.steps), stacklevel=3)
        self._going[rows] = True
        self.t[rows] = 0
        self._samples[rows, 0] = signals
        self._memory[rows] = check_memory(method, method.initial_memory(signals, self.t[rows]), self.t[rows])

    def step(self, going: Truth, signals: Array, action: Array, ended: Truth) -> tuple[Array, Truth, Truth]:
        """One step of the copies that are `going` (N,), to the samples (N, k); some have `ended` (N,).

        Returns the rewards (N,), 0 where a copy is not going, and which episodes are over and which are complete, (N,).
        """
        scoring, rewards, rows = self._scoring, np.zeros(len(going)), np.flatnonzero(going)
        t, scale = self.t[rows], scoring.method.scale if scoring.scaled else 1.0
        samples = np.stack([self._samples[rows, t], signals[rows]])
        paid, self._memory[rows] = pay(scoring.method, samples, action[rows], t, self._memory[rows])
        rewards[rows] = paid[0] / scale
        self._samples[rows, t + 1] = signals[rows]
        self.t[rows] = t + 1
        complete = going & (self.t == self.steps)
        over = ended | complete
        self._going &= ~over
        for row in np.flatnonzero(over).tolist():
            rewards[row] += self._left(row, action[[row]]) / scale
        return rewards, over, complete

    def _left(self, row: int, action: Array) -> float:
        """The pay of the steps after an early end, in the method's unit."""
        t, scoring = int(self.t[row]), self._scoring
        ends = EarlyEnds(scoring.method, scoring.terminated)
        paid = ends.sum_left(self._samples[row, t], action, t, self._memory[[row]], scoring.discount)
        check_rewards(scoring.method, np.array([[paid]]), 1, self.t[[row]])
        return paid

    def entries(self, signals: Array, own: Array, over: Truth) -> dict[str, Any]:
        """The entries of the info, of all copies; `own` (N,) are the environment's rewards.

        `robustness` and `satisfied` have shape (N,), under `interval` (N, 2): bounds of the robustness, and whether
        every and whether some continuation satisfies the formula. Before the end of an episode nothing is known: they
        are -inf and False, under `interval` (-inf, inf) and (False, True).
        """
        rows, scoring = np.flatnonzero(over), self._scoring
        interval, specification = scoring.terminated == "interval", scoring.specification
        shape = (len(over), 2) if interval else (len(over),)
        robustness, satisfied = np.full(shape, -np.inf), np.zeros(shape, dtype=np.bool_)
        if interval:
            robustness[:, 1], satisfied[:, 1] = np.inf, True
        if len(rows):
            t = self.t[rows]
            if scoring.terminated == "hold":
                traces = self._samples[rows[:, None], np.minimum(np.arange(self.steps + 1), t[:, None])]
            else:
                traces = without_end(self._samples[rows], t)
            try:
                verdicts = judge(specification.formula, traces, specification, scoring.terminated)
            except stl.UndefinedError as error:
                raise UsageError(f"formula: {error}") from error
            robustness[rows] = verdicts.robustness if interval else verdicts.robustness[:, 0]
            satisfied[rows] = verdicts.satisfied if interval else verdicts.satisfied[:, 0]
        verdict = {"robustness": robustness, "satisfied": satisfied}
        return {"signals": signals[:, None], "t": self.t, "env_reward": own, **verdict}

    def observe(self) -> Array:
        """The columns of an observation after the numbers of the environment, (N, 1 + inputs)."""
        method = self._scoring.method
        parts = time_and_inputs(method, self._times, self.t, self._memory)
        for inputs in parts[1:]:
            check_inputs(method, inputs, self.t)
        return np.concatenate(parts, axis=1)
