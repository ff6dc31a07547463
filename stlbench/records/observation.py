"""The meaning of the numbers of an observation. The record travels with a policy, which is never shown another one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import isclose
from typing import Annotated, Any

from pydantic import AfterValidator, TypeAdapter, ValidationError

from stlbench import __version__
from stlbench.errors import UsageError, counted, one_line
from stlbench.records.identity import Finite, Whole, first_problem

KEY = "stlbench_observation"
"""Under which a file of a policy, or a space of Gymnasium, has the record."""
MOST = 1000
"""Numbers of an environment that a record describes one by one. It has only the size of pictures, which have more."""
_NAMED = 12
"""Numbers that a message names."""


@dataclass(frozen=True)
class Observation:
    """The numbers that a policy is shown: those of the task, the time, and the inputs of a method, in this order."""

    size: Whole
    """Numbers of the task."""
    names: tuple[str, ...] = ()
    """An environment has one for each number, perhaps empty; a system the quantities from which the task computes its
    numbers. Empty if nothing has a name."""
    middle: tuple[Finite, ...] = ()
    """For each number of an environment: a policy sees (number - middle) / reach. Empty for a system, whose class
    scales by itself."""
    reach: tuple[Finite, ...] = ()
    steps: Whole | None = None
    """The time runs from -1 to 1 in so many steps. None where the time is not shown."""
    inputs: Whole = 0
    """Inputs of the method."""
    method: str = ""
    """The method whose inputs they are; empty where that is not known, or there are none."""
    task: str = ""
    """The place of the recording: a task, or the id of an environment under `stlbench.wrap`."""
    version: str = ""
    """The version of stlbench that recorded it."""

    @classmethod
    def beside(cls, steps: int, inputs: int, method: str, task: str) -> Observation:
        """The time and the inputs that this version of stlbench adds to the numbers of a task."""
        return cls(0, steps=steps, inputs=inputs, method=method if inputs else "", task=task, version=__version__)

    @classmethod
    def joined(cls, parts: Sequence[Observation]) -> Observation:
        """The record of several parts, one after the other. The first has the time and the inputs."""
        described = all(part.middle for part in parts)
        return replace(
            parts[0],
            size=sum(part.size for part in parts),
            names=tuple(chain.from_iterable(part.names for part in parts)) if described else (),
            middle=tuple(chain.from_iterable(part.middle for part in parts)) if described else (),
            reach=tuple(chain.from_iterable(part.reach for part in parts)) if described else (),
        )

    @property
    def total(self) -> int:
        """D, the length of an observation."""
        return self.size + (self.steps is not None) + self.inputs

    def within(self, place: int) -> bool:
        """Whether a number is known to be from -1 to 1: the time, and what is scaled by its ends or its magnitude."""
        if place >= self.size:
            return place == self.size and self.steps is not None
        return bool(self.middle) and self._scales[place] != (0.0, 1.0)

    @property
    def facts(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        plain: dict[str, Any] = TypeAdapter(Observation).dump_python(self, mode="json")
        return plain

    def save_in(self, space: object) -> None:
        """Have a space of Gymnasium carry the record. Stable-Baselines3 writes what a space has into its files."""
        setattr(space, KEY, self.facts)

    @property
    def unscaled(self) -> Observation:
        """The observation of the environment itself: its numbers unscaled, without time and inputs."""
        middle, reach = (0.0,) * self.size, (1.0,) * self.size
        return replace(self, middle=middle, reach=reach, steps=None, inputs=0, method="")

    @classmethod
    def of_facts(cls, source: str, facts: object) -> Observation:
        """The record that a file has, which anybody may have written.

        Raises:
            UsageError: it is no record. The message begins with `source`.
        """
        try:
            adapter = TypeAdapter[Observation](Described)
            return adapter.validate_json(facts) if isinstance(facts, str | bytes) else adapter.validate_python(facts)
        except ValidationError as error:
            raise UsageError(one_line(f"{source}: its {KEY} is no record: {first_problem(error)}")) from error

    def check(self, source: str, shown: Observation) -> None:
        """Refuse what a policy with this record would be shown, unless it is what the record says.

        Raises:
            UsageError: in one line, the first difference. The message begins with `source`.
        """
        if wrong := next(self._differences(shown), None):
            where = f" on {self.task}" if self.task else ""
            raise UsageError(one_line(f"{source}: it was trained{where} to observe {wrong}"))

    def _differences(self, shown: Observation) -> Iterator[str]:
        """Each as the end of "it was trained to observe"."""
        yield from _of_names(self, shown)
        if self.size != shown.size:
            yield f"{self.size} numbers beside the time; here are {shown.size}"
        if bool(self.middle) != bool(shown.middle):
            yield f"{self.numbers}; here are {shown.numbers}"
        for place, (own, other) in enumerate(zip(self._scales, shown._scales, strict=False)):
            if not all(isclose(a, b, rel_tol=1e-6, abs_tol=1e-9) for a, b in zip(own, other, strict=True)):
                yield f"{self._number(place)}; here is {shown._number(place)}"
        if self.steps != shown.steps:
            yield f"{_time(self.steps)}; here is {_time(shown.steps)}"
        if self.inputs and self.method and shown.method != self.method:
            yield f"inputs of method {self.method}; say --method '{self.method}'"
        if self.inputs != shown.inputs:
            yield f"{self.inputs} inputs of a method; here are {shown.inputs}"

    @property
    def _scales(self) -> tuple[tuple[float, float], ...]:
        return tuple(zip(self.middle, self.reach, strict=True))

    def _number(self, place: int) -> str:
        """How a number is made: omega / 8."""
        name = (self.names[place] if place < len(self.names) else "") or f"number {place}"
        middle, reach = self._scales[place]
        shifted = f"{name} {'-' if middle > 0 else '+'} {abs(middle):g}" if middle else name
        if reach == 1:
            return shifted
        return f"({shifted}) / {reach:g}" if middle else f"{shifted} / {reach:g}"

    @property
    def numbers(self) -> str:
        """Those of the task, in words: "x, y, omega / 8"."""
        if not self.middle:
            of = f" of {', '.join(self.names)}" if self.names else ""
            return f"{counted(self.size, 'feature')}{of}"
        more = f" and {self.size - _NAMED} more numbers" if self.size > _NAMED else ""
        return ", ".join(self._number(place) for place in range(min(self.size, _NAMED))) + more

    def __str__(self) -> str:
        parts = [self.numbers]
        if self.steps is not None:
            parts.append(_time(self.steps))
        if self.inputs:
            parts.append(f"{counted(self.inputs, 'input')} of {self.method or 'a method'}")
        return one_line("; ".join(parts))


def _described(record: Observation) -> Observation:
    if len(record.middle) != len(record.reach) or (record.middle and len(record.middle) != record.size):
        raise ValueError("middle and reach have one number for each of size")
    return record


Described = Annotated[Observation, AfterValidator(_described)]
"""A record that is read."""


def _of_names(own: Observation, shown: Observation) -> Iterator[str]:
    """If both name what they show, the names agree."""
    if not any(own.names) or not any(shown.names):
        return
    if bool(own.middle) and len(own.names) == len(shown.names):
        pairs = zip(own.names, shown.names, strict=True)
        wrong = [(a, b) for a, b in pairs if a and b and a != b]
        missing = [a for a, _ in wrong if a not in shown.names]
    else:
        wrong = [] if own.names == shown.names else [(own.names[0], "")]
        missing = [name for name in own.names if name and name not in shown.names]
    if missing:
        yield f"{', '.join(missing)}, which {_place(shown)} does not show"
    elif wrong:
        yield f"the same in another order than {_place(shown)} shows it"


def _place(shown: Observation) -> str:
    return f"task {shown.task}" if shown.task else "the environment"


def _time(steps: int | None) -> str:
    return "no time" if steps is None else f"the time from -1 to 1 in {steps} steps"
