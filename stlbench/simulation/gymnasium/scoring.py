"""The checked options of `stlbench.wrap`: formula, method, what an early end means, and how the signals are read
from what an environment returns.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeAlias, cast

import numpy as np
from gymnasium.spaces import Space
from gymnasium.vector.utils import iterate

from stlbench import stl
from stlbench.contract import Array, Integers, Intractable, RewardMethod, Specification, Unsuitable
from stlbench.errors import UsageError, did_you_mean
from stlbench.registry import plugins
from stlbench.registry.choices import choice_of
from stlbench.task.build import aim_of, fitting_methods, in_turn
from stlbench.task.file import EarlyEnd
from stlbench.task.gym_spaces import Expressions, number

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


MethodOf: TypeAlias = str | Callable[[Specification], RewardMethod]
"""A method by name, or a class, or anything else that makes one for a specification."""
Ranges: TypeAlias = Mapping[str, tuple[float, float]]  # signal -> the least and the greatest value that it takes, about


@dataclass(frozen=True)
class Scoring:
    """How the episodes of an environment are paid and judged."""

    reader: Reader
    made_by: MethodOf
    specification: Specification  # the method knows nothing else; it has the formula, in steps
    scaled: bool
    terminated: EarlyEnd
    discount: float  # in 0..1; it weighs the rewards that an early end leaves out

    @cached_property
    def method(self) -> RewardMethod:
        return _make_method(self.made_by, self.specification)

    def __reduce__(self) -> tuple[Any, ...]:
        """Without the method, whose compiled code cannot be pickled: it is made again."""
        return Scoring, tuple(getattr(self, each.name) for each in fields(self))

    @property
    def inputs(self) -> int:
        """Numbers of the method's that the policy is shown."""
        return self.method.input_size if self.method.memory_size else 0


def specify(
    formula: str | stl.Formula, names: tuple[str, ...], ranges: Ranges, steps: int, dt: float | None
) -> Specification:
    """The specification. Raises `UsageError`: no formula, an unknown signal, a missing range, a long horizon."""
    low, high = _ends(names, ranges)
    try:
        parsed = stl.parse(formula if isinstance(formula, str) else "true", dt)  # which checks dt
        resolved = stl.resolve_end(parsed if isinstance(formula, str) else formula, steps)
    except (TypeError, ValueError) as error:
        raise UsageError(f"formula: {error}") from error
    for word in sorted(resolved.words.intersection(names)):
        raise UsageError(f"formula: {stl.AmbiguousError(word, 'environment')}")
    for name in stl.signals(resolved):
        if name not in names:
            raise UsageError(f"formula: no signal '{name}'{did_you_mean(name, names)}")
    if (horizon := stl.horizon(resolved)) > steps:
        raise UsageError(f"formula: its horizon of {horizon} steps exceeds the {steps} steps of an episode")
    return Specification(resolved, names, low, high, steps, 1.0 if dt is None else float(dt))


def _make_method(method: MethodOf, specification: Specification) -> RewardMethod:
    try:
        if isinstance(method, str):
            return cast(RewardMethod, plugins.build("methods", choice_of(method), specification))
        other = isinstance(method, type) and not issubclass(method, RewardMethod)
        made = method(specification) if callable(method) and not other else None
    except (Intractable, Unsuitable) as error:
        name = method if isinstance(method, str) else getattr(method, "__name__", method)
        raise UsageError(f"method {name} does not fit: {error}") from error
    if not isinstance(made, RewardMethod):
        raise UsageError(f"method: expected a name or a class of reward methods, got {method!r}")
    return made


def first_that_fits(specification: Specification) -> str:
    """The method that `method="auto"` means. Raises `UsageError` if none fits."""
    names = in_turn(fitting_methods(specification), aim_of(specification.formula))
    if not names:
        raise UsageError(f"method auto: no installed method fits the formula {specification.formula}")
    return names[0]


def _ends(names: Sequence[str], ranges: Ranges) -> tuple[tuple[float, ...], tuple[float, ...]]:
    for name in names:
        if name not in ranges:
            raise UsageError(f"ranges: none for the signal '{name}'; give its least and greatest value, (low, high)")
    for name in ranges:
        if name not in names:
            raise UsageError(f"ranges: no signal '{name}'{did_you_mean(name, names)}")
    pairs = [_pair(name, ranges[name]) for name in names]
    return tuple(low for low, _ in pairs), tuple(high for _, high in pairs)


def _pair(name: str, ends: object) -> tuple[float, float]:
    with suppress(TypeError, ValueError):
        low, high = map(float, ends)  # type: ignore[call-overload]
        if -math.inf < low < high < math.inf:
            return low, high
    raise UsageError(f"ranges: '{name}' has (low, high), finite and low < high, got {ends!r}")
