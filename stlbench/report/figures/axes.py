"""Axes whose values span orders of magnitude: symmetric logarithms, and ends with an arrow for what lies beyond."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Literal, NamedTuple

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from stlbench.report.figures.style import tiny

_NEAR, _FAR = 5.0, 10.0
"""What lies so many times as far as the nearest group is shown with it; beyond the second number more is cut."""
_LEAST, _LEAST_AT_ZERO = 1e-3, 2e-2
"""Of the furthest value's distance, that of the nearest group is at least: one by chance at 0 cuts off no others.

The second number counts where no value is positive, as where 0 is the best known.
"""
_ROOM = 0.25
"""Below 0, of what is above it."""
_FROM = 0.5
"""Of a lower end's length: arrows stand further right, where the curves that rise have risen."""
_MARGIN = 0.05
_PAPER = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5}
"""Behind a number, over what else is there."""


class Window(NamedTuple):
    """The part of an axis that is shown."""

    low: float
    high: float

    @property
    def limits(self) -> tuple[float, float]:
        """With a margin."""
        margin = _MARGIN * (self.high - self.low) or 1.0
        return self.low - margin, self.high + margin


def window(groups: Iterable[Iterable[float]]) -> Window | None:
    """Where to end an axis so that values of the best groups can be told apart; None where it can show all.

    A value lies as far as it is below the best of all, or below 0 where none is positive; a group as far as its median.
    Shown are 0, and what lies at most five times as far as the nearest group does, or as the best value is above 0.
    The axis ends there if a value lies more than ten times as far.
    """
    finite = [shown for group in groups if (shown := [value for value in group if math.isfinite(value)])]
    values = [value for group in finite for value in group]
    top = max([0.0, *values])
    furthest = top - min(values, default=0.0)
    share = _LEAST if top > 0 else _LEAST_AT_ZERO
    least = max(min((top - median(group) for group in finite), default=0.0), top, share * furthest)
    if furthest <= _FAR * least:
        return None
    return Window(min([-_ROOM * top, *(value for value in values if top - value <= _NEAR * least)]), top)


def number(value: float) -> str:
    """A value beyond the axis, in three digits or so."""
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"


def arrow_at_left(axes: Axes, place: float, texts: Sequence[tuple[str, str]]) -> None:
    """At the left end of a row: an arrow, and the numbers that lie there, each with its colour."""
    where, shift = axes.get_yaxis_transform(), 7.0
    axes.plot([0.0], [place], "<", color=texts[0][1], markersize=4.5, transform=where, clip_on=False, zorder=6)
    for text, colour in texts:
        words = axes.annotate(text, (0.0, place), (shift, 0), xycoords=where, textcoords="offset points")
        words.set(ha="left", va="center", color=colour, fontsize=tiny(), bbox=_PAPER, zorder=7)
        shift += 0.62 * tiny() * len(text) + 5


def arrows_below(axes: Axes, texts: Sequence[tuple[str, str]]) -> None:
    """At the lower end of an axis: an arrow for each line that ends below it, and over it the number in its colour."""
    where = axes.transAxes
    for i, (text, colour) in enumerate(texts):
        place = _FROM + (1 - _FROM) * (i + 1) / (len(texts) + 1)
        axes.plot([place], [0.0], "v", color=colour, markersize=4.5, transform=where, clip_on=False, zorder=6)
        words = axes.annotate(text, (place, 0.0), (0, 5), xycoords=where, textcoords="offset points", rotation=90)
        words.set(ha="center", va="bottom", color=colour, fontsize=tiny(), bbox=_PAPER, zorder=7)


def beyond_key(marker: str, text: str) -> Line2D:
    """The entry of a legend for arrows."""
    return Line2D([], [], linestyle="", marker=marker, color="0.3", markersize=5, label=text)


_LINEAR_ENOUGH = 10.0
"""Where the largest value is at most that many times a group's, a linear axis shows the group well."""
_TOGETHER = 5.0
"""Groups that reach up to so many times as far as the one nearest to 0 are in the linear part with it."""
_DECADES = 4
"""At most so many are logarithmic, so that one value by chance near 0 does not squeeze all others."""
_LINEAR_PART = 1.0
"""From 0 to the threshold takes as much room as that many decades beyond."""
_PAD = 0.04
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
    pad = _PAD * (ends[1] - ends[0])
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
