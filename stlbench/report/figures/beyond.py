"""Axes that end before a value orders of magnitude away, which would press the others together: an arrow has it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import median
from typing import NamedTuple

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
    kept = [shown for group in groups if (shown := [value for value in group if math.isfinite(value)])]
    values = [value for group in kept for value in group]
    top = max([0.0, *values])
    furthest = top - min(values, default=0.0)
    share = _LEAST if top > 0 else _LEAST_AT_ZERO
    least = max(min((top - median(group) for group in kept), default=0.0), top, share * furthest)
    if furthest <= _FAR * least:
        return None
    return Window(min([-_ROOM * top, *(value for value in values if top - value <= _NEAR * least)]), top)


def number(value: float) -> str:
    """A value beyond the axis, in three digits or so."""
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"


def beside(axes: Axes, place: float, told: Sequence[tuple[str, str]]) -> None:
    """At the left end of a row: an arrow, and the numbers that lie there, each with its colour."""
    where, shift = axes.get_yaxis_transform(), 7.0
    axes.plot([0.0], [place], "<", color=told[0][1], markersize=4.5, transform=where, clip_on=False, zorder=6)
    for text, colour in told:
        words = axes.annotate(text, (0.0, place), (shift, 0), xycoords=where, textcoords="offset points")
        words.set(ha="left", va="center", color=colour, fontsize=tiny(), bbox=_PAPER, zorder=7)
        shift += 0.62 * tiny() * len(text) + 5


def below(axes: Axes, told: Sequence[tuple[str, str]]) -> None:
    """At the lower end of an axis: an arrow for each line that ends below it, and over it the number in its colour."""
    where = axes.transAxes
    for i, (text, colour) in enumerate(told):
        place = _FROM + (1 - _FROM) * (i + 1) / (len(told) + 1)
        axes.plot([place], [0.0], "v", color=colour, markersize=4.5, transform=where, clip_on=False, zorder=6)
        words = axes.annotate(text, (place, 0.0), (0, 5), xycoords=where, textcoords="offset points", rotation=90)
        words.set(ha="center", va="bottom", color=colour, fontsize=tiny(), bbox=_PAPER, zorder=7)


def beyond_key(marker: str, text: str) -> Line2D:
    """The entry of a legend for arrows."""
    return Line2D([], [], linestyle="", marker=marker, color="0.3", markersize=5, label=text)
