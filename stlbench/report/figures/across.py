"""Figures over all tasks: aggregates with their intervals, performance profiles, alignment, mean ranks (Demsar 2006,
JMLR 7), and on how many seeds each method learned each task.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stlbench.contract import Array
from stlbench.report.figures import layout
from stlbench.report.figures.style import BOUNDS, INK, SINGLE, TRACE, Colours, lines_of, now, pages, styled
from stlbench.report.tables.across import Field
from stlbench.report.tables.rows import Group
from stlbench.report.tables.yardsticks import Aligned
from stlbench.statistics.across import Estimate, profile, ranking

_COARSE = (0.0, 0.5, 0.9, 0.99, 0.999)
_FINE = (0.0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999)
"""Scores with a number on the axis: of a wide axis, and of one that shows less than a decade and a half of them."""
_NARROW = 1.5
_BEST = 0.999  # scores from here on are drawn here
SCALE = ("0 acts at random, 1 is the best known", "logarithmic towards 1")
"""Lines: what scores are, and how their axis is spread."""
_MARKERS = ("D", "s", "^")  # of fields


def place(score: float) -> float:
    """The place of a score on the axis, -log10(1 - score): 0 at random, 1 at 0.9, 2 at 0.99, up to 3."""
    return -math.log10(1 - min(score, _BEST))


@styled
def across_tasks(fields: Sequence[Field], colours: Colours) -> Figure:
    """Draw the fields of one budget and track; the first has no trivial tasks.

    Left the interquartile mean of each method with its interval, for each field; right the performance profile of the
    first field, with its band, in as many panels as there are colours for.
    """
    first = fields[0]
    parts = [part for _, part in pages(range(len(first.entries)))]
    heights = 1.1 + 0.25 * len(first.entries), 0.3 + 2.3 * len(parts)
    side_by_side = now().width > 2 * SINGLE
    figure = layout.figure_of(0.5 + (max(heights) if side_by_side else sum(heights)))
    if side_by_side:
        left, right = figure.subfigures(1, 2, squeeze=False)[0]
    else:
        left, right = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    _aggregates(left.subplots(), fields, colours)
    panels = right.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
    for axes, part in zip(panels, parts, strict=True):
        _profiles(axes, first, part, colours)
    _scores(panels[-1], "score", _lowest(first), _BEST)
    keys = [
        layout.key_of(f"IQM over {field.name}, 95 % interval", color="0.3", marker=marker, markersize=5, linewidth=2)
        for field, marker in zip(fields, _MARKERS, strict=False)
    ]
    title = f"Robustness across tasks ({first.name}; budget {first.budget}, track {first.track})"
    return layout.finish(figure, title, keys, 2)


def _aggregates(axes: Axes, fields: Sequence[Field], colours: Colours) -> None:
    ends = list[float]()
    for i, field in enumerate(fields):
        for row, aggregate in enumerate(field.aggregates):
            value, interval = aggregate.middle
            colour = colours[aggregate.entry.method]
            height = row + 0.26 * i - 0.13 * (len(fields) - 1)
            if interval is not None:
                ends_of = [*map(place, interval)]
                axes.plot(ends_of, [height] * 2, "-", color=colour, linewidth=2, solid_capstyle="butt")
            (mark,) = axes.plot([place(value)], [height], _MARKERS[i], color=colour, markersize=5)
            mark.set(markeredgecolor="white", markeredgewidth=0.6)
            ends += [value, *(interval or ())]
    methods = [each.method + ("" if all(each.scores) else f"\n(fits {each.coverage})") for each in fields[0].entries]
    axes.set_yticks(range(len(methods)), methods)
    axes.set_ylim(len(methods) - 0.5, -0.5)
    _scores(axes, "interquartile mean of the scores", min(ends), max(ends))


def profiles(field: Field) -> tuple[Array, tuple[tuple[Estimate, ...], ...]]:
    """Performance profiles: places on the axis of scores (p,), and for each method the share of runs above each."""
    places = np.linspace(min(place(_lowest(field)), 0.0), place(_BEST), 121)
    return places, tuple(tuple(profile(entry.runs, 1 - 10**-places)) for entry in field.entries)


def _lowest(field: Field) -> float:
    return min(score for entry in field.entries for seeds in entry.scores for score in seeds)


def _profiles(axes: Axes, field: Field, rows: Sequence[int], colours: Colours) -> None:
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
    axes.legend(loc="lower left", fontsize=now().tiny)


def ticks(lowest: float, highest: float = _BEST) -> list[tuple[float, str]]:
    """Places on the axis of scores that have a number; the first and the last enclose these scores."""
    digits = (3, 1) if lowest > -30 else (1,)
    negative = [float(-digit * 10**power) for power in range(6, -1, -1) for digit in digits]
    narrow = lowest >= 0 and place(highest) - place(lowest) < _NARROW
    every = [*negative, *(_FINE if narrow else _COARSE)]
    below, above = [tick for tick in every if tick <= lowest], [tick for tick in every if tick >= min(highest, _BEST)]
    first, last = max(below, default=every[0]), min(above)
    return [(place(tick), f"{tick:g}") for tick in every if first <= tick <= last]


def _scores(axes: Axes, label: str, lowest: float, highest: float) -> None:
    places, texts = zip(*ticks(lowest, highest), strict=True)
    axes.set_xticks(places, texts)
    axes.set_xlim(places[0] - 0.05, places[-1] + 0.05)
    axes.set_xlabel("\n".join([label, *SCALE]), fontsize=now().small)
    axes.grid(alpha=0.3)


_KEYS, _NARROW_KEYS = 0.6, 1.8  # inches of the title and the legend, which take more lines in one column
_ROW, _AROUND = 0.115, 0.6  # inches: of a row, and of the room above and below the rows
_POLICIES: tuple[dict[str, Any], ...] = (
    {"marker": "x", "color": "0.6", "markersize": 3.5},
    {"marker": "o", "color": TRACE, "markersize": 3.5},
    {"marker": "D", "color": BOUNDS, "markersize": 4.5, "markerfacecolor": "none", "markeredgewidth": 1.1},
)
"""Marks of final and selected learned policies, and of the best policy by the reward, in no method's colour."""


@styled
def alignment(rows: Sequence[Aligned], units: Mapping[str, str]) -> Figure:
    """One panel per task, in it one row for each method and setting.

    Args:
        rows: each has a `reward_optimal`; the rows of a task follow each other.
        units: of the robustness, by task.
    """
    panels = [(task, list(members)) for task, members in groupby(rows, key=lambda row: row.task)]
    columns = min(int(now().width / SINGLE), len(panels))
    lines = [panels[at : at + columns] for at in range(0, len(panels), columns)]
    heights = [_AROUND + _ROW * max(len(members) for _, members in line) for line in lines]
    figure = layout.figure_of(sum(heights) + (_KEYS if now().width > 2 * SINGLE else _NARROW_KEYS))
    cut = False
    grid = figure.add_gridspec(len(lines), columns, height_ratios=heights)
    for i, (task, members) in enumerate(panels):
        cut = _panel(figure.add_subplot(grid[i // columns, i % columns]), task, members, units[task]) or cut
    title = "Alignment: the best known, the best by the reward, the learned (means over the report starts)"
    return layout.finish(figure, title, _alignment_keys(cut), 3)


def _panel(axes: Axes, task: str, rows: Sequence[Aligned], unit: str) -> bool:
    """The rows of a task; whether some of their values lie below the axis."""
    for i, method in enumerate(dict.fromkeys(row.method for row in rows)):
        places = [place for place, row in enumerate(rows) if row.method == method]
        if i % 2:
            axes.axhspan(places[0] - 0.5, places[-1] + 0.5, color="0.95", zorder=0)
    shown = layout.window([*_values(row)] for row in rows)
    for place, row in enumerate(rows):
        _marks(axes, place, row, shown)
    axes.axvline(0, color=layout.LEVEL, linewidth=0.7, zorder=1)
    axes.set_yticks(range(len(rows)), [f"{row.method}, {row.setting}" for row in rows], fontsize=now().tiny)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(axis="x", alpha=0.3)
    axes.set_title(task)
    axes.set_xlabel(f"mean robustness [{unit}]", fontsize=now().tiny)
    axes.tick_params(axis="x", labelsize=now().tiny)
    if shown is not None:
        axes.set_xlim(shown.limits)
    return shown is not None


def _values(row: Aligned) -> Iterator[float]:
    values = (row.best_known, row.reward_optimal, row.selected, row.final)
    return (value for value in values if value is not None and math.isfinite(value))


def _marks(axes: Axes, place: int, row: Aligned, shown: layout.Zoom | None) -> None:
    ends = [value for value in (row.best_known, row.reward_optimal, row.selected) if value is not None]
    axes.plot((min(ends), max(ends)), (place, place), "-", color="0.8", linewidth=0.8, zorder=2)
    if row.best_known is not None:
        upright = (place - 0.5, place + 0.5)
        axes.plot((row.best_known,) * 2, upright, "-", color=INK, linewidth=2, solid_capstyle="butt", zorder=3)
    far = list[tuple[str, str]]()
    for value, mark in zip((row.final, row.selected, row.reward_optimal), _POLICIES, strict=True):
        if value is not None and shown is not None and value < shown.low:
            far.append((layout.number(value), mark["color"]))
        elif value is not None:
            axes.plot([value], [place], linestyle="", zorder=4, clip_on=False, **mark)
    if far:
        layout.arrow_at_left(axes, place, far)


def _alignment_keys(cut: bool) -> list[Artist]:
    texts = ("learned: final policies", "learned: selected policies, mean over seeds", "best by the reward")
    marks = [layout.key_of(text, linestyle="", **mark) for text, mark in zip(texts, _POLICIES, strict=True)]
    best = layout.key_of("the best known", color=INK, linewidth=2)
    keys = [best, *reversed(marks), layout.level_key("0: satisfied above")]
    return [*keys, layout.beyond_key("<", "below the axis: numbers in the colour of the mark")] if cut else [*keys]


_AROUND_RANKS, _ROW_OF_RANKS = 1.0, 0.2
"""Inches: around the rows, and of a row."""


@styled
def ranks(field: Field, colours: Colours) -> Figure:
    """Draw the mean rank of each method, the best on top, and a bar for each set of methods that may be alike.

    All methods fit all tasks of the field.
    """
    found = ranking(field.medians)
    order = sorted(range(len(field.entries)), key=lambda method: found.ranks[method])
    sets = found.alike
    figure = layout.figure_of(_AROUND_RANKS + _ROW_OF_RANKS * (len(order) + len(sets) + 1))
    axes = figure.subplots()
    for row, method in enumerate(order):
        name, rank = field.entries[method].method, found.ranks[method]
        axes.plot([1, rank], [row, row], "-", color="0.85", linewidth=0.8, zorder=1)
        axes.plot([rank], [row], "o", color=colours[name], markersize=5, zorder=3)
        axes.annotate(f"{rank:.2f}", (rank, row), (5, 0), textcoords="offset points", va="center", fontsize=now().tiny)
    for row, members in enumerate(sets, len(order)):
        ends = [found.ranks[members[0]], found.ranks[members[-1]]]
        axes.plot(ends, [row, row], "-", color=INK, linewidth=2.5, solid_capstyle="butt")
    row = len(order) + len(sets)
    axes.errorbar(1 + found.difference / 2, row, xerr=found.difference / 2, color="0.4", capsize=3, linewidth=1)
    names = [field.entries[method].method for method in order]
    axes.set_yticks(range(row + 1), [*names, *["may be alike"] * len(sets), "critical difference"])
    axes.set_ylim(row + 0.6, -0.6)
    axes.set_xlim(0.9, max(len(order), 1 + found.difference) + 0.3)
    axes.set_xticks(range(1, len(order) + 1))
    axes.set_xlabel("mean rank, 1 is the best")
    axes.grid(axis="x", alpha=0.3)
    title = f"Ranks over drawn tasks ({field.name}; budget {field.budget}, track {field.track})"
    test = f"critical difference by Nemenyi, 5 % for all pairs (Friedman's test: p = {found.chance:.2g})"
    keys = [
        layout.key_of("may be alike: no pair is farther apart than the critical difference", color=INK, linewidth=2.5),
        layout.key_of(test, color="0.4", linewidth=1),
    ]
    return layout.finish(figure, title, keys, 2)


_ROW_OF_OVERVIEW, _AROUND_OVERVIEW = 0.15, 1.25
"""Inches: of a row, and around all rows."""
_UNKNOWN = "·"


@styled
def overview(rows: Sequence[tuple[str, Sequence[Group]]], methods: Sequence[str]) -> Figure:
    """Draw one row for each task, or for each setting of one, and one column for each method.

    An entry has the number of seeds that learned, and their share as its colour.

    Args:
        rows: name of the task or setting -> its groups, one a method.
        methods: the columns.
    """
    figure = layout.figure_of(_AROUND_OVERVIEW + _ROW_OF_OVERVIEW * len(rows))
    axes = figure.subplots()
    shares, texts = np.full((len(rows), len(methods)), np.nan), dict[tuple[int, int], str]()
    for row, (_, groups) in enumerate(rows):
        for group in groups:
            place = row, methods.index(str(group.setting.method))
            texts[place] = f"{sum(group.learned)}" if group.done else _UNKNOWN
            if group.done:
                shares[place] = sum(group.learned) / group.tried
    layout.shares_map(axes, shares, texts, [name for name, _ in rows], now().tiny)
    axes.set_xticks(range(len(methods)), methods, rotation=45, ha="left", rotation_mode="anchor", fontsize=now().tiny)
    axes.tick_params(labeltop=True, labelbottom=False)
    seeds = {group.tried for _, groups in rows for group in groups if group.done}
    each = f"{min(seeds)}" if len(seeds) == 1 else f"{min(seeds)} to {max(seeds)}" if seeds else "no"
    keys: list[Artist] = [layout.patch("#08519c", f"seeds that learned the task, of {each}; the colour is their share")]
    if any(not group.done for _, groups in rows for group in groups):
        keys.append(layout.key_of(f"{_UNKNOWN} no seed finished", linestyle=""))
    return layout.finish(figure, "What each method learned", keys, 1)
