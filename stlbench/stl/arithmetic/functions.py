"""The functions and operators of the formula language: a row each, for the parser, the compiler and the bounds.

A function without a value at an argument raises ArithmeticError or ValueError on floats, and is NaN on arrays. Floats
use the C library and arrays NumPy, so that exp, log, tan and the like may differ in the last bit; the others are equal.
"""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from stlbench.stl.arithmetic import derivatives as derivative
from stlbench.stl.arithmetic import intervals as interval
from stlbench.stl.arithmetic.derivatives import ChainRule, Ranges
from stlbench.stl.arithmetic.intervals import Range


@dataclass(frozen=True)
class Domain:
    """Where the last argument of a function must lie."""

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


def _each(interval: Callable[..., Range]) -> Callable[[Ranges], Range]:
    return lambda ranges: interval(*ranges)


def _lower(a: float, b: float) -> float:
    """NaN if either is, as NumPy's."""
    return a if a <= b else b if b < a else math.nan


def _higher(a: float, b: float) -> float:
    return a if a >= b else b if b > a else math.nan


def _of_all(pick: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda *values: reduce(pick, values)


def _of_sizes(pick: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda *values: reduce(pick, map(abs, values))


def _norm(root: Callable[[Any], Any]) -> Callable[..., Any]:
    return lambda *values: root(reduce(operator.add, [value * value for value in values]))


def _log(values: Any) -> Any:
    return np.log(np.where(values > 0.0, values, math.nan))


def _polar(atan2: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    """The sign of a zero does not count: (-pi, pi], and pi at y = 0, x < 0."""
    return lambda y, x: atan2(y + 0.0, x + 0.0)


def _may_contain_pole(low: float, high: float) -> bool:
    return bool(interval.may_contain_pole((np.array(low), np.array(high))))


def _quotient(left: Any, right: Any) -> Any:
    return left / np.where(right == 0.0, math.nan, right)


def _power(ranges: Ranges) -> Range:
    """For a constant exponent."""
    base, (exponent, _) = ranges
    return interval.power(base, float(exponent))


_AT_LEAST_0 = Domain("at least 0", lambda low, high: low < 0, least=0.0)
_ABOVE_0 = Domain("above 0", lambda low, high: low <= 0)
_NO_POLE = Domain("no odd multiple of pi / 2", _may_contain_pole)
_NOT_0 = Domain("other than 0", lambda low, high: low <= 0 <= high)

_FUNCTIONS = (
    Function("abs", 1, abs, np.abs, _each(interval.absolute), derivative.of_absolute),
    Function("sqrt", 1, math.sqrt, np.sqrt, _each(interval.root), derivative.of_root, _AT_LEAST_0),
    Function("exp", 1, math.exp, np.exp, _each(interval.exponential), derivative.of_exponential),
    Function("log", 1, math.log, _log, _each(interval.logarithm), derivative.of_logarithm, _ABOVE_0),
    Function("sin", 1, math.sin, np.sin, _each(interval.sine), derivative.of_sine),
    Function("cos", 1, math.cos, np.cos, _each(interval.cosine), derivative.of_cosine),
    Function("tan", 1, math.tan, np.tan, _each(interval.tangent), derivative.of_tangent, _NO_POLE),
    Function("tanh", 1, math.tanh, np.tanh, _each(interval.hyperbolic_tangent), derivative.of_hyperbolic_tangent),
    Function("atan2", 2, _polar(math.atan2), _polar(np.arctan2), _each(interval.direction), derivative.of_direction),
    Function("min", None, _of_all(_lower), _of_all(np.minimum), interval.least, derivative.of_least),
    Function("max", None, _of_all(_higher), _of_all(np.maximum), interval.greatest, derivative.of_greatest),
    Function("norm", None, _norm(math.sqrt), _norm(np.sqrt), interval.norm, derivative.of_norm),
    Function("norminf", None, _of_sizes(_higher), _of_sizes(np.maximum), interval.largest, derivative.of_largest),
)
FUNCTIONS: dict[str, Function] = {row.name: row for row in _FUNCTIONS}

_OPERATORS = (
    Function("+", 2, operator.add, operator.add, _each(interval.total), derivative.of_sum),
    Function("-", 2, operator.sub, operator.sub, _each(interval.difference), derivative.of_difference),
    Function("*", 2, operator.mul, operator.mul, _each(interval.product), derivative.of_product),
    Function("/", 2, operator.truediv, _quotient, _each(interval.quotient), derivative.of_quotient, _NOT_0),
    Function("**", 2, operator.pow, operator.pow, _power, derivative.of_power),
)
#: the functions, and the operators between two operands
OPERATIONS: dict[str, Function] = FUNCTIONS | {row.name: row for row in _OPERATORS}
