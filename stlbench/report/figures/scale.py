"""Axes whose values span orders of magnitude: linear around 0, logarithmic beyond a threshold that the data choose."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Literal

from matplotlib.axes import Axes

_LINEAR_ENOUGH = 10.0
"""Where the largest value is at most that many times a group's, a linear axis shows the group well."""
_TOGETHER = 5.0
"""Groups that reach up to so many times as far as the one nearest to 0 are in the linear part with it."""
_DECADES = 4
"""At most so many are logarithmic, so that one value by chance near 0 does not squeeze all others."""
_LINEAR_PART = 1.0
"""From 0 to the threshold takes as much room as that many decades beyond."""
_MARGIN = 0.04
_ALONE = 0.25
"""Of the threshold: values that reach so far have a number, though they stay within the linear part."""
_APART = 2.5
"""How many times the threshold the next tick is at least, so that their numbers do not touch."""


def linear_threshold(groups: Iterable[Iterable[float]], largest: float) -> float | None:
    """Up to which magnitude an axis has to be linear, so that values of each group can be told apart.

    Args:
        groups: values, such as one method's; the group nearest to 0 shall lie in the linear part.
        largest: the largest magnitude on the axis.

    Returns:
        How far the group nearest to 0 reaches, and those that reach up to five times as far; rounded up to 1, 2 or 5
        times a power of ten, and at least a 10,000th of `largest`. None where a linear axis will do.
    """
    extents = [max((abs(value) for value in group if math.isfinite(value)), default=0.0) for group in groups]
    extents = [max(extent, largest / 10**_DECADES) for extent in extents if extent > 0]
    if not extents or not math.isfinite(largest) or largest <= _LINEAR_ENOUGH * min(extents):
        return None
    return _round_up(max(extent for extent in extents if extent <= _TOGETHER * min(extents)))


def _round_up(value: float) -> float:
    """The next of 1, 2, 5, 10, 20, 50, ..., also of their fractions; a value 1 % above one of them is taken for it."""
    exponent = math.floor(math.log10(value))
    candidates = [_decimal(digit, exponent) for digit in (1, 2, 5, 10)]
    return next((candidate for candidate in candidates if 1.01 * candidate >= value), candidates[-1])


def _round_down(value: float) -> float:
    """The last of 1, 2, 5, 10, 20, 50, ... that is no more."""
    exponent = math.floor(math.log10(value))
    return max(each for digit in (1, 2, 5) if (each := _decimal(digit, exponent)) <= value)


def _decimal(digit: int, exponent: int) -> float:
    """The float nearest to digit x 10^exponent, which a product in floats may miss."""
    return float(f"{digit}e{exponent}")


def set_symlog(axes: Axes, which: Literal["x", "y"], threshold: float, low: float, high: float) -> str:
    """Make one axis linear up to `threshold` and logarithmic beyond, over at least [low, high].

    Returns:
        What the axis' label should add, to say so.
    """
    low = min(low, -threshold) if low < 0 else 0.0
    high = max(high, threshold) if high > 0 else 0.0
    getattr(axes, f"set_{which}scale")("symlog", linthresh=threshold, linscale=_LINEAR_PART)
    axis = axes.xaxis if which == "x" else axes.yaxis
    major, minor = symlog_ticks(threshold, low, high)
    axis.set_ticks(major, [f"{tick:g}" for tick in major])
    axis.set_ticks(minor, minor=True)
    axis.set_tick_params(which="minor", labelbottom=False, labelleft=False)
    transform = axis.get_transform()
    ends = transform.transform([low, high])
    pad = _MARGIN * (ends[1] - ends[0])
    getattr(axes, f"set_{which}lim")(*transform.inverted().transform([ends[0] - pad, ends[1] + pad]))
    return f"logarithmic beyond ±{threshold:g}"


def symlog_ticks(threshold: float, low: float, high: float) -> tuple[list[float], list[float]]:
    """Ticks with numbers, and those between them, of an axis from `low` <= 0 to `high` >= 0.

    0 and the threshold have numbers; an end that is nearer has the last round number before it. Beyond the threshold
    each power of ten has one; over one decade and a half or less 1, 2 and 5 times
    each.
    """
    major, minor = {0.0}, set[float]()
    for sign, end in ((-1, -low), (1, high)):
        if end < threshold:
            if end > _ALONE * threshold:
                major.add(sign * _round_down(end))
            continue
        digits: Sequence[int] = (1,) if end > 10**1.5 * threshold else (1, 2, 5)
        nearest = _APART * threshold if len(digits) == 1 else threshold
        major.add(sign * threshold)
        for exponent in range(math.floor(math.log10(threshold)), math.floor(math.log10(end)) + 1):
            for digit in range(1, 10):
                value = _decimal(digit, exponent)
                if threshold < value <= end:
                    (major if digit in digits and value >= nearest else minor).add(sign * value)
    return sorted(major), sorted(minor)
