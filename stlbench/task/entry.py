"""What the entries of a task file consist of: numbers within limits, formulas, and mappings that know their keys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo
from pydantic_core import CoreSchema, core_schema

from stlbench import stl

Count = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Entry(BaseModel):
    """A mapping of the file. It has the keys that are declared and no others."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Timing(NamedTuple):
    """How the intervals of a file's formulas are read; formulas are validated with it as the context."""

    dt: float | None = None
    """What `stl.parse` needs: seconds per step, None where intervals are in steps."""
    steps: int | None = None
    """Where operators without an interval end."""
    known: bool = True
    """False where `time`, `sampling_time` or `steps` is wrong: formulas are checked, their intervals mean nothing."""


@dataclass(frozen=True)
class Read:
    """An annotation: how an entry is read from the file; it is written as `str` has it.

    `PlainValidator` and `PlainSerializer` would do, but have Pydantic take the annotated type apart first, which for a
    formula costs more than to read a whole file.
    """

    value: Callable[[Any, ValidationInfo], Any]
    """From what the file has. Raises `ValueError`."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        """Pydantic asks here."""
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
