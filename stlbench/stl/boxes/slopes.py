"""Interval bounds of a margin's partial derivatives on many boxes at once, and the mean-value form made of them.

By the mean value theorem (for Lipschitz functions, with Clarke's generalised gradient), on a box X with middle c,
f(X) lies in f(c) + sum_i df/dx_i(X) (X_i - c_i). Its error falls with the square of the box, where plain interval
arithmetic falls linearly; it is what proves x - x = 0. Kinks (abs, min, max) give the hull of both sides' slopes.
"""

from __future__ import annotations

from functools import reduce
from typing import TypeAlias

import numpy as np

from stlbench.stl.boxes.intervals import (
    Proven,
    Range,
    cosine,
    difference,
    expression_range,
    formula_range,
    negative,
    power,
    product,
    quotient,
    sine,
    total,
)
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
)

#: derivative by each signal; a signal that is missing has derivative 0
Slopes: TypeAlias = dict[str, Range]


def mean_value_range(target: Formula | Expression, boxes: dict[str, Range], proven: Proven) -> Range:
    """Interval that contains the margin (or the value) of `target` on each box, NaN where no slope bounds it."""
    middles = {name: low / 2 + high / 2 for name, (low, high) in boxes.items()}
    at = {name: (middle, middle) for name, middle in middles.items()}
    if isinstance(target, Formula):
        centre, slopes = formula_range(target, at, proven), formula_slopes(target, boxes, proven)
    else:
        centre, slopes = expression_range(target, at, proven), expression_slopes(target, boxes, proven)
    steps = [product(slopes[name], difference(boxes[name], at[name])) for name in slopes]
    return reduce(total, steps, centre)


def formula_slopes(psi: Formula, boxes: dict[str, Range], proven: Proven) -> Slopes:
    """Bounds of the margin's derivatives."""
    match psi:
        case Predicate(op, left, right):
            small, large = (left, right) if op in ("<=", "<") else (right, left)
            falling = _negative(expression_slopes(small, boxes, proven))
            return _add(expression_slopes(large, boxes, proven), falling)
        case Not(arg):
            return _negative(formula_slopes(arg, boxes, proven))
        case And(args) | Or(args):
            ranges = [formula_range(arg, boxes, proven) for arg in args]
            return _picked(ranges, [formula_slopes(arg, boxes, proven) for arg in args], isinstance(psi, And))
        case Implies(left, right):
            return formula_slopes(Or((Not(left), right)), boxes, proven)
        case _:
            return {}


def expression_slopes(node: Expression, boxes: dict[str, Range], proven: Proven) -> Slopes:
    """Bounds of the value's derivatives."""
    match node:
        case Number():
            return {}
        case Signal(name):
            one = np.ones_like(boxes[name][0])
            return {name: (one, one)}
        case Negative(arg):
            return _negative(expression_slopes(arg, boxes, proven))
        case Binary(op, left, right):
            return _binary_slopes(op, left, right, boxes, proven)
        case Call(name, args):
            return _call_slopes(name, args, boxes, proven)


def _binary_slopes(op: str, left: Expression, right: Expression, boxes: dict[str, Range], proven: Proven) -> Slopes:
    first, second = expression_slopes(left, boxes, proven), expression_slopes(right, boxes, proven)
    f, g = expression_range(left, boxes, proven), expression_range(right, boxes, proven)
    match op:
        case "+":
            return _add(first, second)
        case "-":
            return _add(first, _negative(second))
        case "*":
            return _add(_scaled(first, g), _scaled(second, f))
        case "/":
            falling = _scaled(second, negative(quotient(f, power(g, 2))))
            return _add({name: quotient(slope, g) for name, slope in first.items()}, falling)
        case _:
            exponent = int(g[0])
            if exponent == 0:
                return {}
            return _scaled(first, product(power(f, exponent - 1), g))


def _call_slopes(name: str, args: tuple[Expression, ...], boxes: dict[str, Range], proven: Proven) -> Slopes:
    ranges = [expression_range(arg, boxes, proven) for arg in args]
    slopes = [expression_slopes(arg, boxes, proven) for arg in args]
    value = expression_range(Call(name, args), boxes, proven)
    match name:
        case "min" | "max":
            return _picked(ranges, slopes, name == "min")
        case "norminf":
            sizes = [expression_range(Call("abs", (arg,)), boxes, proven) for arg in args]
            sides = [_scaled(slope, _sign(range_)) for slope, range_ in zip(slopes, ranges, strict=True)]
            return _picked(sizes, sides, least=False)
        case "norm":
            parts = [_scaled(slope, _share(range_, value)) for slope, range_ in zip(slopes, ranges, strict=True)]
            return reduce(_add, parts)
        case "abs":
            return _scaled(slopes[0], _sign(ranges[0]))
        case "sqrt":
            half = np.full_like(value[0], 0.5)
            return _scaled(slopes[0], quotient((half, half), value))
        case "exp":
            return _scaled(slopes[0], value)
        case "sin":
            return _scaled(slopes[0], cosine([ranges[0]]))
        case _:
            return _scaled(slopes[0], negative(sine([ranges[0]])))


def _negative(slopes: Slopes) -> Slopes:
    return {name: negative(slope) for name, slope in slopes.items()}


def _scaled(slopes: Slopes, factor: Range) -> Slopes:
    return {name: product(slope, factor) for name, slope in slopes.items()}


def _add(left: Slopes, right: Slopes) -> Slopes:
    both = {name: total(left[name], right[name]) for name in left.keys() & right.keys()}
    return left | right | both


def _sign(range_: Range) -> Range:
    """Slope of |u|: -1, 1, or between them where u may be 0."""
    return np.where(range_[0] > 0, 1.0, -1.0), np.where(range_[1] < 0, -1.0, 1.0)


def _share(part: Range, whole: Range) -> Range:
    """part / norm, which lies in [-1, 1] whatever the intervals say."""
    low, high = quotient(part, whole)
    return np.fmin(np.fmax(low, -1.0), 1.0), np.fmax(np.fmin(high, 1.0), -1.0)


def _picked(ranges: list[Range], slopes: list[Slopes], least: bool) -> Slopes:
    """Slopes of a minimum (or maximum): the hull of those of the operands that can be the least (the greatest)."""
    keys = [range_ if least else negative(range_) for range_ in ranges]
    ceiling = reduce(np.minimum, [high for _, high in keys])
    zero = np.zeros_like(ceiling)
    result: Slopes = {}
    for name in {name: None for slope in slopes for name in slope}:
        low, high = np.full_like(ceiling, np.inf), np.full_like(ceiling, -np.inf)
        for (lower, _), slope in zip(keys, slopes, strict=True):
            mine, active = slope.get(name, (zero, zero)), ~(lower > ceiling)  # NaN counts as active
            low, high = (
                np.where(active, np.minimum(low, mine[0]), low),
                np.where(active, np.maximum(high, mine[1]), high),
            )
        result[name] = low, high
    return result
