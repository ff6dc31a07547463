"""The methods of one task: robustness of each seed, learning curves, and both with trajectories in a plane; and
methods on drawn tasks: what they learned of each group, and how much their runs satisfy.
"""

import math
import textwrap
from collections.abc import Sequence
from itertools import groupby

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from stlbench.contract import Array
from stlbench.records.result import LEARNED
from stlbench.report.figures import layout, plane
from stlbench.report.figures.regions import Scale, parts, robustness_unit, time_label
from stlbench.report.figures.style import SINGLE, Colours, GroupStyle, lines_of, now, pages, styled, styles
from stlbench.report.figures.trajectories import part_keys
from stlbench.report.tables.across import Field
from stlbench.report.tables.rows import Group
from stlbench.report.tables.sampled import Line, common, group_lines
from stlbench.statistics.intervals import MeanCurve, mean_curve, median, median_interval, overlap
from stlbench.task.task import Task

METHODS_PER_OVERVIEW = 6
_ROW = 0.048  # inches of a row, whose label has two lines, for each point of its text
_LINE = 30  # characters of a line of an axis' label: as many as the axis is high
_PANEL = 2.2  # inches of a panel of an overview, at least
_LETTERS = 62  # of an entry of the overview's legend, which has two columns


@styled
def robustness_by_method(groups: Sequence[Group], scale: Scale, colours: Colours) -> Figure:
    """A point for each seed, the median with its interval under it; groups of one task."""
    figure = layout.figure_of(1.1 + _ROW * now().small * len(groups))
    keys = _robustness(figure.subplots(), groups, scale.unit, colours)
    return layout.finish(figure, f"{groups[0].setting.task}: robustness by method", keys, 4)


def _robustness(axes: Axes, groups: Sequence[Group], unit: str, colours: Colours) -> list[Artist]:
    """Draw one row for each group; the entries of the legend.

    If values lie orders of magnitude below the others, the axis ends before them, and their rows have the numbers.
    """
    looks = styles(groups, colours)
    values = [group.values("robustness_mean") for group in groups]
    shown = layout.window(values)
    for place, (seeds, style) in enumerate(zip(values, looks, strict=True)):
        _points(axes, place, seeds, shown, style.colour)
    axes.axvline(0, color=layout.LEVEL, linewidth=0.7, zorder=1)
    axes.set_yticks(range(len(groups)), [style.label.replace(": ", "\n") for style in looks])
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.grid(axis="x", alpha=0.3)
    axes.set_xlabel(f"mean robustness over the report starts [{unit}]")
    every = [0.0, *(value for seeds in values for value in seeds)]
    if shown is not None:
        axes.set_xlim(shown.limits)
    elif np.isfinite(every).all():
        axes.set_xlim(layout.Zoom(min(every), max(every)).limits)
    keys: list[Artist] = [
        layout.key_of("one seed", color="0.3", marker="o", linestyle="", alpha=0.6, markersize=4.5),
        layout.key_of("median seed, 95 % interval", color="0.3", marker="D", linewidth=2, markersize=5),
        layout.level_key("0: satisfied above"),
    ]
    return keys if shown is None else [*keys, layout.beyond_key("<", "beyond the axis")]


def _points(axes: Axes, place: int, values: Sequence[float], shown: layout.Zoom | None, colour: str) -> None:
    if not values:
        where = axes.get_yaxis_transform()
        axes.text(0.5, place, "no result", transform=where, ha="center", va="center", color="0.4", backgroundcolor="w")
        return
    far = [value for value in values if shown is not None and value < shown.low]
    near = [value for value in values if value not in far]
    if near:
        axes.plot(near, np.full(len(near), place - 0.14), "o", color=colour, alpha=0.6, markersize=4.5, mew=0)
    centre, ends = median(values), median_interval(values)
    below = shown is not None and centre < shown.low
    if ends is not None and not below:
        axes.plot(ends, (place + 0.16, place + 0.16), "-", color=colour, linewidth=2, solid_capstyle="butt")
    if not below:
        axes.plot([centre], [place + 0.16], "D", color=colour, markersize=5, markeredgecolor="white", mew=0.6)
    if far:
        spread = f"{layout.number(max(far))} to {layout.number(min(far))}"
        text = f"1 seed, {layout.number(far[0])}" if len(far) == 1 else f"{len(far)} seeds, {spread}"
        layout.arrow_at_left(axes, place - (0.34 if near else 0.14), [(text, colour)])  # above the seeds that are shown
    if below:
        interval = "" if ends is None else f" [{layout.number(ends.low)}, {layout.number(ends.high)}]"
        layout.arrow_at_left(axes, place + 0.2, [(f"median {layout.number(centre)}{interval}", colour)])


@styled
def learning_curves(groups: Sequence[Group], scale: Scale, colours: Colours) -> Figure:
    """Satisfaction and mean robustness of the checkpoints: a line for each group of one task, the mean over its seeds.

    The shade is the 95 % interval of that mean, of two seeds or more, cut at what is possible: 0 and 100 % of the
    starts, and the scale's largest robustness. The legend says how many seeds finished, also of groups without a line.
    A group has none if it has no checkpoint, or if its seeds have no common steps.
    If lines end orders of magnitude below the others, the axis ends before them, and arrows have their last means.
    """
    panels = int(now().width / SINGLE)
    figure = layout.figure_of(0.5 + 2.2 * (3 - panels) + 0.15 * math.ceil((len(groups) + 3) / panels))
    left, right = figure.subplots(3 - panels, panels)
    looks = styles(groups, colours)
    curves = [
        [[(at.steps, at.satisfaction, at.robustness_mean) for at in each.curve] for each in group.done if each.curve]
        for group in groups
    ]
    trained = [(own, style) for own, style in zip(curves, looks, strict=True) if own and overlap(own)]
    means = [(mean_curve(own, lambda point: point[2], (-math.inf, scale.most)), style) for own, style in trained]
    for own, style in trained:
        _draw(left, mean_curve(own, lambda point: 100 * point[1], (0, 100)), style)
    low, far = _limit(right, means)
    for line, style in means:
        _draw(right, line, style, low)
    layout.arrows_below(right, far)
    left.set(ylabel="starts that satisfy [%]", ylim=(-4, 104))
    right.set_ylabel(textwrap.fill(f"mean robustness [{scale.unit}]", _LINE))
    right.axhline(0, color=layout.LEVEL, linewidth=0.7, zorder=1)
    for axes in (left, right):
        axes.set_xlabel("environment steps")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.grid(alpha=0.3)
    setting = groups[0].setting
    name = ", ".join((str(setting.task), *setting.other_track))
    keys: list[Artist] = [
        layout.key_of(style.label, color=style.colour, linestyle=style.line, linewidth=1.3)
        if group.done
        else layout.key_of(style.label, color=style.colour, linestyle="", marker="x", markersize=5)
        for group, style in zip(groups, looks, strict=True)
    ]
    keys.append(layout.patch("0.3", "95 % interval of the mean, cut at what is possible", alpha=0.18))
    keys.append(layout.level_key("robustness 0: satisfied above"))
    keys += [layout.beyond_key("v", "ends below the axis, with its last mean")] if far else []
    return layout.finish(figure, f"{name}: learning curves on the selection starts (mean over seeds)", keys, 2)


def _draw(axes: Axes, line: MeanCurve, style: GroupStyle, low: float = -math.inf) -> None:
    """A line, and its interval as far as the line is above `low`, the end of the axis."""
    known = np.isfinite(line.low) & (line.mean >= low)
    if known.any():
        axes.fill_between(
            line.steps[known], line.low[known], line.high[known], color=style.colour, alpha=0.18, linewidth=0
        )
    marker = "o" if len(line.steps) == 1 else ""
    axes.plot(line.steps, line.mean, style.line, color=style.colour, linewidth=1.3, marker=marker, markersize=4)


def _limit(axes: Axes, lines: Sequence[tuple[MeanCurve, GroupStyle]]) -> tuple[float, list[tuple[str, str]]]:
    """Limit the axis of robustness: its lower end, and the last means of lines that end below it, with their colours.

    The axis has room for all seeds, and cuts wider intervals. The second half of each line chooses where it ends: all
    methods are bad at first.
    """
    ends = [end for line, _ in lines for end in (line.least, line.most) if math.isfinite(end)]
    if not ends:
        return -math.inf, []
    low, high = min(*ends, 0.0), max(*ends, 0.0)
    shown = layout.window(line.mean[len(line.mean) // 2 :].tolist() for line, _ in lines)
    if shown is not None:
        low = shown.low
    margin = 0.05 * (high - low)
    if margin:
        axes.set_ylim(low - margin, high + margin)
    low -= margin
    return low, [(layout.number(line.mean[-1]), style.colour) for line, style in lines if line.mean[-1] < low]


@styled
def overview(task: Task, groups: Sequence[Group], traces: Sequence[Array | None], colours: Colours) -> Figure:
    """Draw the robustness of at most `METHODS_PER_OVERVIEW` groups of one task that names a plane, and their traces.

    Each group has traces (N, T + 1, k), or None and no panel; one has traces at least.
    """
    panels = [
        (style.label.partition(":")[0], group, shown)
        for style, group, shown in zip(styles(groups, colours), groups, traces, strict=True)
        if shown is not None
    ]
    columns = min(3, int(now().width / _PANEL))
    rows = math.ceil(len(panels) / columns)
    heights = [0.45 + _ROW * now().small * len(groups), *[2.2] * rows]
    figure = layout.figure_of(sum(heights) + 0.7 + 0.11 * len(parts(task)))
    grid = figure.add_gridspec(1 + rows, columns, height_ratios=heights)
    keys = _robustness(figure.add_subplot(grid[0, :]), groups, robustness_unit(task, task.formula), colours)
    below = [figure.add_subplot(grid[1 + i // columns, i % columns]) for i in range(len(panels))]
    every = np.concatenate([shown for *_, shown in panels])
    for axes, (name, group, shown) in zip(below, panels, strict=True):
        view = plane.lay_out(axes, task, every)
        lines = plane.draw_traces(axes, task, view, shown)
        away = plane.leaving(view, shown).sum()
        text = f"{name}\nsatisfies from {100 * np.mean(group.values('satisfaction')):.0f} % of the starts"
        text += f"\nleaving the picture: {away} of {len(shown)} traces" if away else ""
        axes.set_title(text, fontsize=now().tiny + 1)
    keys += [*part_keys(task, view.drawn, _LETTERS), *plane.mark_keys(plane.leaving(view, every))]
    side = "right" if columns > 1 else "bottom"
    figure.colorbar(lines, ax=below, label=time_label(task), aspect=30, location=side)
    return layout.finish(figure, f"{task.name}: {task.file.title}", keys, 2, now().tiny)


_ROW_OF_GROUPS, _AROUND = 0.27, 1.3
"""Inches: of a row, and around all rows."""


@styled
def groups(field: Field) -> Figure:
    """Draw one row for each group, kinds of groups apart, and one column for each method.

    An entry has the share of seeds that learned, which is its colour, and below it the mean score, both over the tasks
    common to the methods. If a method does not fit these, they are over all that it fits, in brackets and without a
    colour. An empty entry means that it fits none.
    """
    kinds = [list(lines) for _, lines in groupby(group_lines(field), key=lambda line: line.part.kind)]
    heights = [len({line.part.group for line in lines}) for lines in kinds]
    figure = layout.figure_of(_AROUND + _ROW_OF_GROUPS * sum(heights))
    methods = [entry.method for entry in field.entries]
    panels = figure.subplots(len(kinds), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axes, lines in zip(panels, kinds, strict=True):
        _panel(axes, lines, methods)
    panels[0].set_xticks(range(len(methods)), methods, rotation=30, ha="left")
    panels[0].tick_params(labeltop=True)
    panels[-1].tick_params(labelbottom=False)
    title = f"What was learned of drawn tasks (budget {field.budget}, track {field.track})"
    keys = [
        layout.patch(
            "#08519c", "upper number, and the colour: the share of seeds that learned of the common tasks [%]"
        ),
        layout.key_of("lower number: the mean score, 0 at random and 1 the best known", linestyle=""),
        layout.key_of("in brackets: of other tasks, since the method does not fit the common ones", linestyle=""),
        layout.key_of("empty: the method fits no task of the group", linestyle=""),
    ]
    return layout.finish(figure, title, keys, 1)


def _panel(axes: Axes, lines: list[Line], methods: list[str]) -> None:
    names = list(dict.fromkeys(line.part.group for line in lines))
    shares, texts = np.full((len(names), len(methods)), np.nan), dict[tuple[int, int], str]()
    for line in lines:
        place = names.index(line.part.group), methods.index(line.method)
        reached = line.common or line.fitted
        numbers = f"{100 * reached.learned.value:.0f}", f"{reached.score.value:.2f}"
        texts[place] = "\n".join(numbers if line.common else map("({})".format, numbers))
        if line.common:
            shares[place] = reached.learned.value
    layout.shares_map(axes, shares, texts, names, now().small)


_PANEL_OF_GROUPS = 2.6
"""Inches: of a panel of satisfaction."""


@styled
def satisfied(field: Field, colours: Colours) -> Figure:
    """Draw for each method the share of runs whose policy satisfies from so many starts or more, from half to all.

    Runs are of the tasks common to the methods, every task with the same weight; a method that does not fit these has
    no line. There are as many panels as there are colours for.
    """
    shared = sorted(common((entry.fits for entry in field.entries), len(field.tasks)))
    entries = [entry for entry in field.entries if shared and {*shared} <= {*entry.fits}]
    parts = [part for _, part in pages(entries)] or [[]]
    figure = layout.figure_of(_AROUND + _PANEL_OF_GROUPS * len(parts))
    panels = figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
    starts = np.arange(50, 101)
    for axes, part in zip(panels, parts, strict=True):
        own = [colours[entry.method] for entry in part]
        for entry, colour, line in zip(part, own, lines_of(own), strict=True):
            seeds = [100 * np.array(entry.satisfaction[place]) + _ROUNDED for place in shared]
            runs = np.mean([(each[:, None] >= starts).mean(axis=0) for each in seeds], axis=0)
            axes.plot(starts, 100 * runs, line, color=colour, linewidth=1.3, label=entry.method)
        axes.axvline(100 * LEARNED, color=layout.LEVEL, linewidth=0.7, zorder=1)
        axes.set(ylabel="runs [%]", ylim=(-3, 103), xlim=(50, 100))
        axes.grid(alpha=0.3)
        if part:
            axes.legend(loc="best", fontsize=now().tiny, ncols=2)
    panels[-1].set_xlabel("satisfies from so many starts or more [%]")
    title = (
        f"Satisfaction on {len(shared)} common of {len(field.tasks)} tasks (budget {field.budget}, track {field.track})"
    )
    return layout.finish(figure, title, [layout.level_key("from here on a run has learned the task")], 1)


_ROUNDED = 1e-9
"""A share of .7 counts as 70 %, whatever rounding made of it."""
