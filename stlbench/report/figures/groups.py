"""Methods on drawn tasks: what they learned of each group, such as a template, and how much their runs satisfy."""

from __future__ import annotations

from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stlbench.records.result import LEARNED
from stlbench.report.figures import layout
from stlbench.report.figures.style import Colours, lines_of, now, pages, styled
from stlbench.report.tables.across import Field
from stlbench.report.tables.sampled import Line, common, group_lines

_ROW, _AROUND = 0.27, 1.3
"""Inches: of a row, and around all rows."""
_PALE, _DARK = "0.99", "0.1"
_MAP = "Blues"


@styled
def groups(field: Field) -> Figure:
    """Draw one row for each group, kinds of groups apart, and one column for each method.

    An entry has the share of seeds that learned, which is its colour, and below it the mean score, both over the tasks
    common to the methods. If a method does not fit these, they are over all that it fits, in brackets and without a
    colour. An empty entry means that it fits none.
    """
    kinds = [list(lines) for _, lines in groupby(group_lines(field), key=lambda line: line.part.kind)]
    heights = [len({line.part.group for line in lines}) for lines in kinds]
    figure = layout.figure_of(_AROUND + _ROW * sum(heights))
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
    shares = np.full((len(names), len(methods)), np.nan)
    for line in lines:
        row, place = names.index(line.part.group), methods.index(line.method)
        reached = line.common or line.fitted
        share = reached.learned.value
        text = f"{100 * share:.0f}\n{reached.score.value:.2f}"
        if line.common is None:
            text = "\n".join(f"({number})" for number in text.splitlines())
        else:
            shares[row, place] = share
        colour = _PALE if line.common and share > 0.6 else _DARK
        axes.text(place, row, text, ha="center", va="center", color=colour, fontsize=now().tiny, linespacing=1.0)
    axes.imshow(shares, cmap=_MAP, vmin=0, vmax=1.1, aspect="auto")
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)


_PANEL = 2.6
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
    figure = layout.figure_of(_AROUND + _PANEL * len(parts))
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
