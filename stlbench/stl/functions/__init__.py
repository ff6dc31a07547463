"""The functions of the formula language: one row each, which the parser, the compiler and the bounds all read.

A function without a value at an argument raises ArithmeticError or ValueError on floats, and is NaN on arrays. Floats
use the C library and arrays NumPy, so that exp, log, tan and the like may differ in the last bit; the others are equal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, TypeAlias

import numpy as np

from stlbench.stl.functions import derivatives as derivative
from stlbench.stl.functions import intervals as interval
from stlbench.stl.functions.derivatives import Derivatives, Ranges
from stlbench.stl.functions.intervals import Range

#: (ranges of the arguments, their derivatives, range of the value) -> derivatives of the value
ChainRule: TypeAlias = Callable[[Ranges, Sequence[Derivatives], Range], Derivatives]


@dataclass(frozen=True)
class Domain:
    """Where the one argument of a function must lie."""

    words: str  # after "must be" in a message
    may_leave: Callable[[float, float], bool]  # whether an argument somewhere in [low, high] may lie outside
    least: float | None = None  # the least argument that has a value, where there is one


@dataclass(frozen=True)
class Function:
    name: str
    arity: int | None  # None: one or more arguments
    floats: Callable[..., float]
    arrays: Callable[..., Any]
    interval: Callable[[Ranges], Range]  # contains the values of arguments in the ranges
    derivative: ChainRule
    domain: Domain | None = None  # None: it has a value everywhere

    def takes(self, count: int) -> bool:
        return count == self.arity if self.arity else count >= 1

    @property
    def arguments(self) -> str:
        return {1: "one argument", 2: "two arguments"}[self.arity] if self.arity else "one or more arguments"


def _first(of_one: Callable[[Range], Range]) -> Callable[[Ranges], Range]:
    return lambda ranges: of_one(ranges[0])


def _least(*values: float) -> float:
    """NaN if any is, as NumPy's."""
    return reduce(lambda a, b: a if a <= b else b if b < a else math.nan, values)


def _greatest(*values: float) -> float:
    return reduce(lambda a, b: a if a >= b else b if b > a else math.nan, values)


def _largest(*values: float) -> float:
    return _greatest(*map(abs, values))


def _largests(*values: Any) -> Any:
    return reduce(np.maximum, map(np.abs, values))


def _norm(*values: float) -> float:
    return math.sqrt(reduce(lambda total, value: total + value, [value * value for value in values]))


def _norms(*values: Any) -> Any:
    return np.sqrt(reduce(np.add, [value * value for value in values]))


def _log(values: Any) -> Any:
    return np.log(np.where(values > 0.0, values, math.nan))


def _atan2(y: float, x: float) -> float:
    """The sign of a zero does not count: (-pi, pi], and pi at y = 0, x < 0."""
    return math.atan2(y + 0.0, x + 0.0)


def _atan2s(y: Any, x: Any) -> Any:
    return np.arctan2(y + 0.0, x + 0.0)


def _may_contain_pole(low: float, high: float) -> bool:
    return bool(interval.may_contain_pole((np.array(low), np.array(high))))


_AT_LEAST_0 = Domain("at least 0", lambda low, high: low < 0, least=0.0)
_ABOVE_0 = Domain("above 0", lambda low, high: low <= 0)
_NO_POLE = Domain("no odd multiple of pi / 2", _may_contain_pole)

_ROWS = (
    Function("abs", 1, abs, np.abs, _first(interval.absolute), derivative.of_absolute),
    Function("sqrt", 1, math.sqrt, np.sqrt, _first(interval.root), derivative.of_root, _AT_LEAST_0),
    Function("exp", 1, math.exp, np.exp, _first(interval.exponential), derivative.of_exponential),
    Function("log", 1, math.log, _log, _first(interval.logarithm), derivative.of_logarithm, _ABOVE_0),
    Function("sin", 1, math.sin, np.sin, _first(interval.sine), derivative.of_sine),
    Function("cos", 1, math.cos, np.cos, _first(interval.cosine), derivative.of_cosine),
    Function("tan", 1, math.tan, np.tan, _first(interval.tangent), derivative.of_tangent, _NO_POLE),
    Function("tanh", 1, math.tanh, np.tanh, _first(interval.hyperbolic_tangent), derivative.of_hyperbolic_tangent),
    Function("atan2", 2, _atan2, _atan2s, lambda args: interval.direction(*args), derivative.of_direction),
    Function("min", None, _least, lambda *v: reduce(np.minimum, v), interval.least, derivative.of_least),
    Function("max", None, _greatest, lambda *v: reduce(np.maximum, v), interval.greatest, derivative.of_greatest),
    Function("norm", None, _norm, _norms, interval.norm, derivative.of_norm),
    Function("norminf", None, _largest, _largests, interval.largest, derivative.of_largest),
)
FUNCTIONS: dict[str, Function] = {row.name: row for row in _ROWS}
