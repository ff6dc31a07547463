"""Interval arithmetic on many boxes at once, rounded outwards so that every result contains the real-number range.

A range is a pair of arrays (m,), one element per box. Operands are independent, angles are in radians. +, -, *, / and
sqrt are correctly rounded by IEEE 754, so one float outwards is enough; the other functions are NumPy's, which are
within 4 units in the last place.
"""

import math
from collections.abc import Sequence
from functools import reduce
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Range: TypeAlias = tuple[Floats, Floats]
Mask: TypeAlias = NDArray[np.bool_]

#: how far NumPy's transcendental functions may be off, in floats
ROUNDING = 4


def outwards(lower: Floats, upper: Floats, steps: int = 1) -> Range:
    """Both ends moved away from each other by `steps` floats."""
    for _ in range(steps):
        lower, upper = np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)
    return lower, upper


def negative(range_: Range) -> Range:
    return -range_[1], -range_[0]


def total(left: Range, right: Range) -> Range:
    return outwards(left[0] + right[0], left[1] + right[1])


def difference(left: Range, right: Range) -> Range:
    return total(left, negative(right))


def product(left: Range, right: Range) -> Range:
    return outwards(*_hull([x * y for x in left for y in right]))


def quotient(left: Range, right: Range) -> Range:
    """u / v; valid only where v excludes 0 (NaN or infinite ends at 0)."""
    return outwards(*_hull([x / y for x in left for y in right]))


def _hull(corners: Sequence[Floats]) -> Range:
    return reduce(np.minimum, corners), reduce(np.maximum, corners)


def power(base: Range, exponent: float) -> Range:
    lower, upper = base
    if exponent == 0:
        return np.ones_like(lower), np.ones_like(upper)
    if exponent % 2:
        return _odd_power(lower, exponent, -1.0), _odd_power(upper, exponent, 1.0)
    small, large = absolute(base)
    return _power(small, exponent, np.float64(-1)), _power(large, exponent, np.float64(1))


def _odd_power(end: Floats, exponent: float, way: float) -> Floats:
    """end ** exponent for an odd exponent, rounded up for way 1 and down for way -1."""
    sign: Floats = np.sign(end)
    return sign * _power(np.abs(end), exponent, sign * way)


def _power(base: Floats, exponent: float, way: Floats | np.float64) -> Floats:
    """base ** exponent for base >= 0, rounded up where `way` > 0 and down (not below 0) elsewhere.

    By squaring, with each product rounded: as many steps as the exponent has binary digits, a thousand at most.
    """
    towards = np.where(np.asarray(way) > 0, np.inf, 0.0)
    result, square, left = None, base, int(exponent)
    while left:
        if left % 2:
            result = square if result is None else np.nextafter(result * square, towards)
        left //= 2
        if left:
            square = np.nextafter(square * square, towards)
    assert result is not None
    return result


def least(ranges: Sequence[Range]) -> Range:
    lowers, uppers = zip(*ranges, strict=True)
    return reduce(np.minimum, lowers), reduce(np.minimum, uppers)


def greatest(ranges: Sequence[Range]) -> Range:
    lowers, uppers = zip(*ranges, strict=True)
    return reduce(np.maximum, lowers), reduce(np.maximum, uppers)


def absolute(range_: Range) -> Range:
    lower, upper = range_
    closest = np.where((lower <= 0) & (upper >= 0), 0.0, np.minimum(np.abs(lower), np.abs(upper)))
    return closest, np.maximum(np.abs(lower), np.abs(upper))


def root(range_: Range) -> Range:
    """sqrt(u), of what of u is at least 0."""
    lower, upper = (np.sqrt(np.maximum(end, 0.0)) for end in range_)
    widened = outwards(lower, upper)
    return np.maximum(widened[0], 0.0), widened[1]


def norm(ranges: Sequence[Range]) -> Range:
    return root(reduce(total, [power(range_, 2) for range_ in ranges]))


def largest(ranges: Sequence[Range]) -> Range:
    return greatest([absolute(range_) for range_ in ranges])


def exponential(range_: Range) -> Range:
    lower, upper = outwards(np.exp(range_[0]), np.exp(range_[1]), ROUNDING)
    return np.maximum(lower, 0.0), upper


def logarithm(range_: Range) -> Range:
    """log(u), of what of u is at least 0; -inf at 0."""
    lower, upper = (np.log(np.maximum(end, 0.0)) for end in range_)
    return outwards(lower, upper, ROUNDING)


def hyperbolic_tangent(range_: Range) -> Range:
    lower, upper = outwards(np.tanh(range_[0]), np.tanh(range_[1]), ROUNDING)
    return np.maximum(lower, -1.0), np.minimum(upper, 1.0)


def sine(angle: Range) -> Range:
    return _wave(angle, np.sin, peak=math.pi / 2)


def cosine(angle: Range) -> Range:
    return _wave(angle, np.cos, peak=0.0)


def _wave(angle: Range, wave: np.ufunc, peak: float) -> Range:
    """Ends, and +-1 where a peak or a trough may lie between them (within rounding of the angle)."""
    at_ends = wave(angle[0]), wave(angle[1])
    lower, upper = outwards(np.minimum(*at_ends), np.maximum(*at_ends), ROUNDING)
    lower = np.where(_may_contain(angle, peak + math.pi, 2 * math.pi), -1.0, np.maximum(lower, -1.0))
    return lower, np.where(_may_contain(angle, peak, 2 * math.pi), 1.0, np.minimum(upper, 1.0))


def tangent(angle: Range) -> Range:
    """All numbers where a pole may lie in u, else it rises."""
    lower, upper = outwards(np.tan(angle[0]), np.tan(angle[1]), ROUNDING)
    pole = may_contain_pole(angle)
    return np.where(pole, -np.inf, lower), np.where(pole, np.inf, upper)


def may_contain_pole(angle: Range) -> Mask:
    """Whether pi/2 + n pi may lie in the interval for some whole n; true in doubt."""
    return _may_contain(angle, math.pi / 2, math.pi)


def _may_contain(angle: Range, offset: float, period: float) -> Mask:
    """Whether offset + n * period lies in the interval for some whole n; true in doubt."""
    slack = 1e-9 * (1.0 + np.maximum(np.abs(angle[0]), np.abs(angle[1])))
    turns = np.ceil((angle[0] - slack - offset) / period)
    inside: Mask = offset + period * turns <= angle[1] + slack
    return inside


def direction(y: Range, x: Range) -> Range:
    """atan2(v, u) in [-pi, pi]: extreme at corners, and of any value where the box meets the branch cut."""
    lower, upper = outwards(*_hull([np.arctan2(v + 0.0, u + 0.0) for v in y for u in x]), ROUNDING)
    cut = meets_branch_cut(y, x)
    pi = np.nextafter(math.pi, 4.0)
    return np.where(cut, -pi, np.maximum(lower, -pi)), np.where(cut, pi, np.minimum(upper, pi))


def meets_branch_cut(y: Range, x: Range) -> Mask:
    """Whether atan2 jumps within the box: from pi at y = 0, x < 0 to -pi just below it."""
    cut: Mask = (y[0] < 0) & (y[1] >= 0) & (x[0] < 0)
    return cut
