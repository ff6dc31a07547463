"""Methods over all tasks: aggregates with their intervals, and the share of runs above every score."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.contract import Array
from stlbench.report.figures import layout
from stlbench.report.figures.palette import GROUPS_PER_FIGURE, Colours, lines_of
from stlbench.report.figures.style import SINGLE, small, styled, tiny, width
from stlbench.report.statistics.across import Estimate, profile
from stlbench.report.tables.across import Entry, Field, aggregates

_COARSE = (0.0, 0.5, 0.9, 0.99, 0.999)
_FINE = (0.0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999)
"""Scores with a number on the axis: of a wide axis, and of one that shows less than a decade and a half of them."""
_NARROW = 1.5
_BEST = 0.999
"""Scores from here on are drawn here."""
SCALE = ("0 acts at random, 1 is the best known", "logarithmic towards 1")
"""Lines: what scores are, and how their axis is spread."""
_MARKERS = ("D", "s", "^")
"""Of fields."""


def place(score: float) -> float:
    """Where a score stands on the axis: -log10 of what it lacks of the best; 0 at random, 1 at 0.9, 2 at 0.99, to 3."""
    return -math.log10(1 - min(score, _BEST))


@styled
def across_tasks(fields: Sequence[Field], colours: Colours) -> Figure:
    """Draw the fields of one budget and track, the first of which is without trivial tasks.

    Left the interquartile mean of each method with its interval, for each field; right the performance profile of the
    first field, with its band, in as many panels as colours tell methods apart.
    """
    first = fields[0]
    parts = list(_parts(len(first.entries)))
    heights = 1.1 + 0.25 * len(first.entries), 0.3 + 2.3 * len(parts)
    beside = width() > 2 * SINGLE
    figure = Figure(figsize=(width(), 0.5 + (max(heights) if beside else sum(heights))), layout="constrained")
    if beside:
        left, right = figure.subfigures(1, 2, squeeze=False)[0]
    else:
        left, right = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    _aggregates(left.subplots(), fields, colours)
    panels = right.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
    for axes, part in zip(panels, parts, strict=True):
        _profiles(axes, first, part, colours)
    _scores(panels[-1], "score", _lowest(first), _BEST)
    layout.title(figure, f"Robustness across tasks ({first.name}; budget {first.budget}, track {first.track})")
    layout.legend(figure, _keys(fields), 2)
    return figure


def _parts(count: int) -> Iterator[range]:
    """The rows of each panel of profiles."""
    panels = math.ceil(count / GROUPS_PER_FIGURE)
    ends = [round(i * count / panels) for i in range(panels + 1)]
    return (range(start, end) for start, end in pairwise(ends))


def _aggregates(axes: Axes, fields: Sequence[Field], colours: Colours) -> None:
    ends = list[float]()
    for number, field in enumerate(fields):
        for row, found in enumerate(aggregates(field)):
            value, interval = found.middle
            colour = colours[found.entry.method]
            height = row + 0.26 * number - 0.13 * (len(fields) - 1)
            if interval is not None:
                ends_of = [*map(place, interval)]
                axes.plot(ends_of, [height] * 2, "-", color=colour, linewidth=2, solid_capstyle="butt")
            (mark,) = axes.plot([place(value)], [height], _MARKERS[number], color=colour, markersize=5)
            mark.set(markeredgecolor="white", markeredgewidth=0.6)
            ends += [value, *(interval or ())]
    methods = [_label(entry) for entry in fields[0].entries]
    axes.set_yticks(range(len(methods)), methods)
    axes.set_ylim(len(methods) - 0.5, -0.5)
    _scores(axes, "interquartile mean of the scores", min(ends), max(ends))


@lru_cache(maxsize=64)
def profiles(field: Field) -> tuple[Array, tuple[tuple[Estimate, ...], ...]]:
    """Performance profiles: places on the axis of scores (p,), and for each method the share of runs above each."""
    places = np.linspace(min(place(_lowest(field)), 0.0), place(_BEST), 121)
    return places, tuple(tuple(profile(entry.runs, 1 - 10**-places)) for entry in field.entries)


def _lowest(field: Field) -> float:
    return min(score for entry in field.entries for seeds in entry.scores for score in seeds)


def _profiles(axes: Axes, field: Field, rows: range, colours: Colours) -> None:
    places, lines = profiles(field)
    own = [colours[field.entries[row].method] for row in rows]
    for row, colour, line in zip(rows, own, lines_of(own), strict=True):
        shares = lines[row]
        method = field.entries[row].method
        axes.plot(places, [100 * value for value, _ in shares], line, color=colour, linewidth=1.3, label=method)
        if all(interval is not None for _, interval in shares):
            low, high = zip(*(interval for _, interval in shares if interval), strict=True)
            axes.fill_between(places, 100 * np.array(low), 100 * np.array(high), color=colour, alpha=0.15, lw=0)
    axes.set(ylabel="runs with a higher score [%]", ylim=(-3, 103))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", fontsize=tiny())


def ticks(lowest: float, highest: float = _BEST) -> list[tuple[float, str]]:
    """Places on the axis of scores that have a number; the first and the last lie around these scores."""
    digits = (3, 1) if lowest > -30 else (1,)
    negative = [float(-digit * 10**power) for power in range(6, -1, -1) for digit in digits]
    narrow = lowest >= 0 and place(highest) - place(lowest) < _NARROW
    every = [*negative, *(_FINE if narrow else _COARSE)]
    below, above = [tick for tick in every if tick <= lowest], [tick for tick in every if tick >= min(highest, _BEST)]
    first, last = max(below, default=every[0]), min(above)
    return [(place(tick), f"{tick:g}") for tick in every if first <= tick <= last]


def _scores(axes: Axes, label: str, lowest: float, highest: float) -> None:
    """Ticks and limits of an axis of scores."""
    places, texts = zip(*ticks(lowest, highest), strict=True)
    axes.set_xticks(places, texts)
    axes.set_xlim(places[0] - 0.05, places[-1] + 0.05)
    axes.set_xlabel("\n".join([label, *SCALE]), fontsize=small())
    axes.grid(alpha=0.3)


def _keys(fields: Iterable[Field]) -> list[Line2D]:
    """Entries of the legend: what is left of each field."""
    looks = zip((field.name for field in fields), _MARKERS, strict=False)
    return [
        Line2D([], [], color="0.3", marker=marker, markersize=5, linewidth=2, label=f"IQM over {name}, 95 % interval")
        for name, marker in looks
    ]


def _label(entry: Entry) -> str:
    """The method, with how many of the tasks it fits where that is not all."""
    return entry.method if all(entry.scores) else f"{entry.method}\n(fits {entry.coverage})"
