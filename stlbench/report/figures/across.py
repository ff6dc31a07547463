"""Methods over all tasks: aggregates with their intervals, and the share of runs above every score."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.contract import Array
from stlbench.report.figures import layout
from stlbench.report.figures.palette import COLOURS, LINES, Line
from stlbench.report.statistics.across import Estimate, profile
from stlbench.report.tables.across import Field, aggregates

__all__ = ["SCALE", "across_tasks", "place", "profiles", "ticks"]

_TICKS = (-9, -3, -1, 0, 0.5, 0.9, 0.99, 0.999)
_BEST = 0.999
"""Scores from here on are drawn here."""
SCALE = "0 acts at random, 1 is the best possible"
"""What scores are."""
_MARKERS = ("D", "s")


def place(score: float) -> float:
    """Where a score stands on the axis: -log10 of what it lacks of the best; 0 at random, 1 at 0.9, 2 at 0.99, to 3."""
    return -math.log10(1 - min(score, _BEST))


def across_tasks(fields: Sequence[Field]) -> Figure:
    """Draw the fields of one budget and track: all tasks, and where there are others those that all methods finished.

    Left the interquartile mean of each method with its interval, for each field; right the performance profile over all
    tasks, with its band.
    """
    every = fields[0]
    figure = Figure(figsize=(11.0, 3.0 + 0.34 * len(every.entries)), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.1))
    _aggregates(left, fields)
    _profiles(right, every)
    layout.title(figure, f"Robustness across {len(every.tasks)} tasks (budget {every.budget}, track {every.track})")
    figure.legend(handles=_keys(fields), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _aggregates(axes: Axes, fields: Sequence[Field]) -> None:
    ends = list[float]()
    for number, field in enumerate(fields):
        for row, found in enumerate(aggregates(field)):
            value, interval = found.middle
            height, colour = row + 0.2 * number - 0.1 * (len(fields) - 1), _colour(row)
            if interval is not None:
                axes.plot(
                    [*map(place, interval)], [height] * 2, "-", color=colour, linewidth=2.5, solid_capstyle="butt"
                )
            axes.plot([place(value)], [height], _MARKERS[number], color=colour, markersize=7, markeredgecolor="white")
            ends += [value, *(interval or ())]
    methods = [entry.method for entry in fields[0].entries]
    axes.set_yticks(range(len(methods)), methods)
    axes.set_ylim(len(methods) - 0.5, -0.5)
    _scores(axes, "interquartile mean of the scores", min(ends))


@lru_cache(maxsize=64)
def profiles(field: Field) -> tuple[Array, tuple[tuple[Estimate, ...], ...]]:
    """Performance profiles: places on the axis of scores (p,), and for each method the share of runs above each."""
    places = np.linspace(min(place(_lowest(field)), 0.0), place(_BEST), 121)
    return places, tuple(tuple(profile(entry.runs, 1 - 10**-places)) for entry in field.entries)


def _lowest(field: Field) -> float:
    return min(score for entry in field.entries for seeds in entry.scores for score in seeds)


def _profiles(axes: Axes, field: Field) -> None:
    places, lines = profiles(field)
    for row, shares in enumerate(lines):
        axes.plot(places, [100 * value for value, _ in shares], _line(row), color=_colour(row), linewidth=1.8)
        if all(interval is not None for _, interval in shares):
            low, high = zip(*(interval for _, interval in shares if interval), strict=True)
            axes.fill_between(places, 100 * np.array(low), 100 * np.array(high), color=_colour(row), alpha=0.15, lw=0)
    axes.set(ylabel="runs with a higher score [%]", ylim=(-3, 103))
    _scores(axes, "score", _lowest(field))


def ticks(lowest: float) -> list[tuple[float, str]]:
    """Places on the axis of scores that have a number, from that of the lowest score on."""
    return [(place(tick), f"{tick:g}") for tick in _TICKS if place(tick) >= min(place(lowest), 0.0) - 0.1]


def _scores(axes: Axes, label: str, lowest: float) -> None:
    """Ticks and limits of an axis of scores."""
    places, texts = zip(*ticks(lowest), strict=True)
    axes.set_xticks(places, texts)
    axes.set_xlim(min(place(lowest), 0.0) - 0.1, place(_BEST) + 0.1)
    axes.set_xlabel(f"{label}\n({SCALE})")
    axes.grid(alpha=0.3)


def _colour(row: int) -> str:
    return COLOURS[row % len(COLOURS)]


def _line(row: int) -> Line:
    return LINES[row // len(COLOURS) % len(LINES)]


def _keys(fields: Iterable[Field]) -> list[Artist]:
    """Entries of the legend: the methods, then what is left of each field."""
    listed = list(fields)
    methods: list[Artist] = [
        Line2D(
            [], [], color=_colour(row), linestyle=LINES[row // len(COLOURS) % len(LINES)], linewidth=1.8, label=label
        )
        for row, label in enumerate(_labels(listed[0]))
    ]
    shapes: list[Artist] = [
        Line2D([], [], color="0.3", marker=marker, linewidth=2.5, label=f"IQM over {field.name}, 95 % interval")
        for field, marker in zip(listed, _MARKERS, strict=False)
    ]
    return [*methods, *shapes]


def _labels(field: Field) -> list[str]:
    """Methods, with how the cells ended that count as 0."""
    return [f"{entry.method} ({entry.unfinished})" if entry.unfinished else entry.method for entry in field.entries]
