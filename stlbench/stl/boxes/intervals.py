"""Interval arithmetic on many boxes at once, rounded outwards so that every result contains the real-number range.

An interval is a pair of arrays (m,), one entry a box. +, -, *, / and sqrt are correctly rounded by IEEE 754, so one
float outwards is enough; sin, cos and exp are within 4 units in the last place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.language.syntax import (
    And,
    Binary,
    Call,
    Expression,
    Formula,
    Implies,
    Negative,
    Not,
    Number,
    Or,
    Predicate,
    Signal,
    TrueFormula,
)

Ends: TypeAlias = NDArray[np.float64]
Range: TypeAlias = tuple[Ends, Ends]
#: proven ranges of subexpressions whose own interval may be too wide (arguments of sqrt and divisors)
Proven: TypeAlias = dict[Expression, tuple[float, float]]


def formula_range(psi: Formula, boxes: dict[str, Range], proven: Proven) -> Range:
    """Interval that contains the margin of `psi` on each box; `boxes` maps each signal to its ends (m,)."""
    match psi:
        case TrueFormula():
            return np.array(math.inf), np.array(math.inf)
        case Predicate(op, left, right):
            small, large = (left, right) if op in ("<=", "<") else (right, left)
            return total(expression_range(large, boxes, proven), negative(expression_range(small, boxes, proven)))
        case Not(arg):
            return negative(formula_range(arg, boxes, proven))
        case And(args):
            return _each(np.minimum, [formula_range(arg, boxes, proven) for arg in args])
        case Or(args):
            return _each(np.maximum, [formula_range(arg, boxes, proven) for arg in args])
        case Implies(left, right):
            ranges = [negative(formula_range(left, boxes, proven)), formula_range(right, boxes, proven)]
            return _each(np.maximum, ranges)
        case _:
            raise ValueError(f"expected a formula without temporal operators, got {psi}")


def expression_range(node: Expression, boxes: dict[str, Range], proven: Proven) -> Range:
    """Interval that contains the value of `node` on each box."""
    lower, upper = _natural(node, boxes, proven)
    if node in proven:
        least, most = proven[node]
        return np.clip(lower, least, most), np.clip(upper, least, most)
    return lower, upper


def negative(range_: Range) -> Range:
    """Interval of the negated value."""
    return -range_[1], -range_[0]


def _natural(node: Expression, boxes: dict[str, Range], proven: Proven) -> Range:
    match node:
        case Number(value):
            return np.array(value), np.array(value)
        case Signal(name):
            return boxes[name]
        case Negative(arg):
            return negative(expression_range(arg, boxes, proven))
        case Binary("**", left, Number(value)):
            return power(expression_range(left, boxes, proven), int(value))
        case Binary("*", left, right) if left == right:
            return power(expression_range(left, boxes, proven), 2)
        case Binary(op, left, right):
            return _BINARY[op](expression_range(left, boxes, proven), expression_range(right, boxes, proven))
        case Call(name, args):
            return _CALLS[name]([expression_range(arg, boxes, proven) for arg in args])


def _outwards(lower: Ends, upper: Ends, steps: int = 1) -> Range:
    for _ in range(steps):
        lower, upper = np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)
    return lower, upper


def _each(pick: np.ufunc, ranges: list[Range]) -> Range:
    """Range of a function that rises in every argument and does not round."""
    lowers, uppers = zip(*ranges, strict=True)
    return reduce(pick, lowers), reduce(pick, uppers)


def total(left: Range, right: Range) -> Range:
    """left + right."""
    return _outwards(left[0] + right[0], left[1] + right[1])


def difference(left: Range, right: Range) -> Range:
    """left - right, as of independent values."""
    return total(left, negative(right))


def product(left: Range, right: Range) -> Range:
    """left * right, as of independent values."""
    corners = [x * y for x in left for y in right]
    return _outwards(reduce(np.minimum, corners), reduce(np.maximum, corners))


def quotient(left: Range, right: Range) -> Range:
    """left / right; means something only where `right` excludes 0 (NaN or infinite ends at 0)."""
    corners = [x / y for x in left for y in right]
    return _outwards(reduce(np.minimum, corners), reduce(np.maximum, corners))


def power(base: Range, exponent: int) -> Range:
    """base ** exponent, by repeated multiplication of non-negative ends, so that each rounding is covered."""
    lower, upper = base
    if exponent == 0:
        return np.ones_like(lower), np.ones_like(upper)
    if exponent % 2:
        rising = [
            np.sign(end) * _raised(np.abs(end), exponent, np.sign(end) * way)
            for end, way in zip(base, (-1, 1), strict=True)
        ]
        return rising[0], rising[1]
    small, large = _absolute([base])
    return _raised(small, exponent, np.float64(-1)), _raised(large, exponent, np.float64(1))


def _raised(base: Ends, exponent: int, way: Ends | np.float64) -> Ends:
    """base ** exponent for base >= 0, rounded up where `way` > 0 and down (not below 0) elsewhere."""
    towards = np.where(np.asarray(way) > 0, np.inf, 0.0)
    result = base
    for _ in range(exponent - 1):
        result = np.nextafter(result * base, towards)
    return result


def _absolute(args: list[Range]) -> Range:
    lower, upper = args[0]
    least = np.where((lower <= 0) & (upper >= 0), 0.0, np.minimum(np.abs(lower), np.abs(upper)))
    return least, np.maximum(np.abs(lower), np.abs(upper))


def _root(args: list[Range]) -> Range:
    lower, upper = (np.sqrt(np.maximum(end, 0.0)) for end in args[0])
    widened = _outwards(lower, upper)
    return np.maximum(widened[0], 0.0), widened[1]


def _exponential(args: list[Range]) -> Range:
    lower, upper = _outwards(np.exp(args[0][0]), np.exp(args[0][1]), steps=4)
    return np.maximum(lower, 0.0), upper


def _norm(args: list[Range]) -> Range:
    squares = [power(arg, 2) for arg in args]
    return _root([reduce(total, squares)])


def _largest(args: list[Range]) -> Range:
    return _each(np.maximum, [_absolute([arg]) for arg in args])


def cosine(args: list[Range]) -> Range:
    """cos of the one argument, in radians."""
    return _wave(args[0], np.cos, peak=0.0)


def sine(args: list[Range]) -> Range:
    """sin of the one argument, in radians."""
    return _wave(args[0], np.sin, peak=math.pi / 2)


def _wave(angle: Range, wave: np.ufunc, peak: float) -> Range:
    """Ends, and +-1 where a peak or a trough may lie between them (within rounding of the angle)."""
    at_ends = wave(angle[0]), wave(angle[1])
    lower, upper = _outwards(np.minimum(*at_ends), np.maximum(*at_ends), steps=4)
    lower = np.where(_contains(angle, peak + math.pi), -1.0, np.maximum(lower, -1.0))
    return lower, np.where(_contains(angle, peak), 1.0, np.minimum(upper, 1.0))


def _contains(angle: Range, offset: float) -> NDArray[np.bool_]:
    """Whether offset + 2 pi n lies in the interval for some whole n; says yes in doubt."""
    slack = 1e-9 * (1.0 + np.maximum(np.abs(angle[0]), np.abs(angle[1])))
    turns = np.ceil((angle[0] - slack - offset) / (2 * math.pi))
    inside: NDArray[np.bool_] = offset + 2 * math.pi * turns <= angle[1] + slack
    return inside


_BINARY: dict[str, Callable[[Range, Range], Range]] = {
    "+": total,
    "-": difference,
    "*": product,
    "/": quotient,
}
_CALLS: dict[str, Callable[[list[Range]], Range]] = {
    "abs": _absolute,
    "min": lambda args: _each(np.minimum, args),
    "max": lambda args: _each(np.maximum, args),
    "sqrt": _root,
    "sin": sine,
    "cos": cosine,
    "exp": _exponential,
    "norm": _norm,
    "norminf": _largest,
}
