"""Bounds of partial derivatives on many boxes at once: the chain rule of each function and operator.

Kinks (abs, min, max) give the hull of the derivatives on both sides, which is Clarke's generalised gradient. Where a
function jumps or its derivative is not bounded, the bounds are infinite or NaN.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import TypeAlias

import numpy as np

from stlbench.stl.arithmetic import intervals

#: derivative by each signal; a signal that is missing has derivative 0
Derivatives: TypeAlias = dict[str, intervals.Range]
Ranges: TypeAlias = Sequence[intervals.Range]
#: (ranges of the arguments, their derivatives, range of the value) -> derivatives of the value
ChainRule: TypeAlias = Callable[[Ranges, Sequence[Derivatives], intervals.Range], Derivatives]


def negated(inner: Derivatives) -> Derivatives:
    return {name: intervals.negative(range_) for name, range_ in inner.items()}


def scaled(inner: Derivatives, factor: intervals.Range) -> Derivatives:
    return {name: intervals.product(range_, factor) for name, range_ in inner.items()}


def added(left: Derivatives, right: Derivatives) -> Derivatives:
    both = {name: intervals.total(left[name], right[name]) for name in left.keys() & right.keys()}
    return left | right | both


# --- chain rules


def of_least(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    """min: the hull of the derivatives of those arguments that can be the least."""
    ceiling = reduce(np.minimum, [high for _, high in args])
    active = [~(low > ceiling) for low, _ in args]  # NaN counts as active
    count = np.sum(active, axis=0)
    result: Derivatives = {}
    for name in {name: None for derivatives in inner for name in derivatives}:
        own = [(derivatives[name], can) for derivatives, can in zip(inner, active, strict=True) if name in derivatives]
        low, high = np.full_like(ceiling, np.inf), np.full_like(ceiling, -np.inf)
        for (lower, upper), can in own:
            low = np.where(can, np.minimum(low, lower), low)
            high = np.where(can, np.maximum(high, upper), high)
        others = count > np.sum([can for _, can in own], axis=0)  # an argument without the signal can be the least
        result[name] = np.where(others, np.minimum(low, 0.0), low), np.where(others, np.maximum(high, 0.0), high)
    return result


def of_greatest(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    """max: the hull of the derivatives of those arguments that can be the greatest."""
    return of_least([intervals.negative(arg) for arg in args], inner, intervals.negative(value))


def of_largest(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    """norminf: as of max(|u|, ...)."""
    sizes = [intervals.absolute(arg) for arg in args]
    return of_greatest(sizes, [scaled(own, _sign(arg)) for own, arg in zip(inner, args, strict=True)], value)


def of_sum(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    return added(*inner)


def of_difference(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    return added(inner[0], negated(inner[1]))


def of_quotient(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    falling = intervals.negative(intervals.quotient(args[0], intervals.power(args[1], 2)))
    return added(_divided(inner[0], args[1]), scaled(inner[1], falling))


def of_power(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    """For a constant exponent."""
    exponent = float(args[1][0])
    return scaled(inner[0], intervals.product(intervals.power(args[0], exponent - 1), args[1])) if exponent > 0 else {}


def of_logarithm(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
    return _divided(inner[0], args[0])


def _divided(inner: Derivatives, by: intervals.Range) -> Derivatives:
    return {name: intervals.quotient(range_, by) for name, range_ in inner.items()}


def _chained(slopes: Callable[[Ranges, intervals.Range], Sequence[intervals.Range]]) -> ChainRule:
    """The chain rule of a function, from its derivative by each argument."""

    def rule(args: Ranges, inner: Sequence[Derivatives], value: intervals.Range) -> Derivatives:
        return reduce(added, [scaled(own, slope) for own, slope in zip(inner, slopes(args, value), strict=True)])

    return rule


def _tangent_slope(value: intervals.Range) -> intervals.Range:
    """1 + tan ** 2; of any value where a pole may lie in the angle."""
    low, high = intervals.total(_same(1.0, value), intervals.power(value, 2))
    return np.where(np.isfinite(value[0]), low, -np.inf), high


def _hyperbolic_slope(value: intervals.Range) -> intervals.Range:
    """1 - tanh ** 2, which lies in [0, 1]."""
    low, high = intervals.difference(_same(1.0, value), intervals.power(value, 2))
    return np.maximum(low, 0.0), np.minimum(high, 1.0)


def _direction_slopes(y: intervals.Range, x: intervals.Range) -> list[intervals.Range]:
    """atan2: (x dy - y dx) / (x ** 2 + y ** 2); of any value where it jumps, at the branch cut and at the origin."""
    square = intervals.total(intervals.power(x, 2), intervals.power(y, 2))
    jump = intervals.meets_branch_cut(y, x) | (square[0] <= 0)
    slopes = intervals.quotient(x, square), intervals.quotient(intervals.negative(y), square)
    return [(np.where(jump, -np.inf, low), np.where(jump, np.inf, high)) for low, high in slopes]


def _same(number: float, like: intervals.Range) -> intervals.Range:
    """The number on every box."""
    numbers = np.full_like(like[0], number)
    return numbers, numbers


def _sign(range_: intervals.Range) -> intervals.Range:
    """Derivative of |u|: -1, 1, or between them where u may be 0."""
    return np.where(range_[0] > 0, 1.0, -1.0), np.where(range_[1] < 0, -1.0, 1.0)


def _share(part: intervals.Range, whole: intervals.Range) -> intervals.Range:
    """part / norm, which lies in [-1, 1] whatever the intervals say."""
    low, high = intervals.quotient(part, whole)
    return np.fmin(np.fmax(low, -1.0), 1.0), np.fmax(np.fmin(high, 1.0), -1.0)


of_product = _chained(lambda args, value: [args[1], args[0]])
of_absolute = _chained(lambda args, value: [_sign(args[0])])
of_root = _chained(lambda args, value: [intervals.quotient(_same(0.5, value), value)])
of_exponential = _chained(lambda args, value: [value])
of_sine = _chained(lambda args, value: [intervals.cosine(args[0])])
of_cosine = _chained(lambda args, value: [intervals.negative(intervals.sine(args[0]))])
of_tangent = _chained(lambda args, value: [_tangent_slope(value)])
of_hyperbolic_tangent = _chained(lambda args, value: [_hyperbolic_slope(value)])
of_direction = _chained(lambda args, value: _direction_slopes(*args))
of_norm = _chained(lambda args, value: [_share(arg, value) for arg in args])
