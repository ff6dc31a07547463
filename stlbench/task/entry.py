"""The values of a task file: numbers within limits, formulas, regions of states, and mappings that know their keys."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from stlbench import stl
from stlbench.contract import Array, Truth

Count = Annotated[int, Field(ge=1)]
MOST_STARTS = 100_000
"""Starts of a set, as the seeds of a set are a range of so many whole numbers (`starts.SeedStarts`)."""
Starts = Annotated[int, Field(ge=1, le=MOST_STARTS)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Entry(BaseModel):
    """A mapping of the file. It has the keys that are declared and no others."""

    model_config = ConfigDict(extra="forbid", frozen=True, ser_json_inf_nan="constants")


Parts = Mapping[str, Any]
"""Entry -> its value, nested like the file. A wrong value is not there."""


class Timing(NamedTuple):
    """How the intervals of a file's formulas are read; formulas are validated with it as the context."""

    dt: float | None = None
    """The time that `stl.parse` needs: seconds per step, None where intervals are in steps."""
    steps: int | None = None
    """The step at which operators without an interval end."""
    known: bool = True
    """False where `time`, `sampling_time` or `steps` is wrong: formulas are checked, their intervals mean nothing."""


@dataclass(frozen=True)
class Read:
    """An annotation: how an entry is read from the file; it is written as `str` has it.

    `PlainValidator` and `PlainSerializer` would do, but Pydantic then takes the annotated type apart first. For a
    formula that costs more than reading a whole file.
    """

    value: Callable[[Any, ValidationInfo], Any]
    """Makes a value from the entry of the file. Raises `ValueError`."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(str)
        return core_schema.with_info_plain_validator_function(self.value, serialization=written)


def _read_formula(value: Any, info: ValidationInfo) -> stl.Formula:
    timing: Timing = info.context or Timing()
    formula = stl.parse(_text(value), dt=timing.dt)
    return formula if timing.steps is None else stl.resolve_end(formula, timing.steps)


def read_point_formula(value: Any, info: ValidationInfo) -> stl.Formula:
    """A formula without temporal operators. Raises `ValueError`."""
    formula = stl.parse(_text(value))
    if stl.is_temporal(formula):
        raise ValueError(f"expected a formula without temporal operators, got {formula}")
    return formula


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"expected a formula, got {value!r}")
    return value


Formula = Annotated[stl.Formula, Read(_read_formula)]
"""A formula, read once: its intervals are in steps, and every operator has one."""

PointFormula = Annotated[stl.Formula, Read(read_point_formula)]
"""A formula without temporal operators."""


def read_both(value: Any) -> Any:
    """A number, which fixes a state, as an interval. Raises `ValueError`."""
    if isinstance(value, int | float):
        return value, value
    if not isinstance(value, list | tuple):
        raise ValueError(f"expected a number or [low, high], got {value!r}")
    return value


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError(f"low must not exceed high, got {list(ends)}")
    if math.isinf(ends[1] - ends[0]):
        raise ValueError(f"low and high are farther apart than any number, got {list(ends)}")
    return ends


def _written(ends: tuple[float, float]) -> tuple[float, float] | float:
    return ends if ends[0] < ends[1] else ends[0]


Extent = Annotated[
    tuple[Finite, Finite],
    BeforeValidator(read_both),
    AfterValidator(_ordered),
    PlainSerializer(_written, return_type=Any),
]


class Region(Entry):
    """A set of initial states: a box over the state's names, numbers where a state is fixed, a condition."""

    box: dict[str, Extent]
    where: PointFormula | None = None
    """Over the state's names; initial states fulfil it."""

    @property
    def low(self) -> Array:
        return np.array([low for low, _ in self.box.values()])

    @property
    def high(self) -> Array:
        return np.array([high for _, high in self.box.values()])

    def keep(self, states: Array) -> Array:
        """The states, of (N, n), that fulfil `where`."""
        return states if self.where is None else states[_predicate(self.where, tuple(self.box))(states)]


@cache
def _predicate(formula: stl.Formula, names: tuple[str, ...]) -> Callable[[Array], Truth]:
    return stl.holds(formula, names)
