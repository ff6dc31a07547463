"""Methods on each group of drawn tasks, such as a template or a system: what they learned, and their scores."""

from __future__ import annotations

from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stlbench.report.figures import layout
from stlbench.report.figures.style import now, styled
from stlbench.report.tables.across import Field
from stlbench.report.tables.sampled import Line, group_lines

_ROW, _AROUND = 0.27, 1.3
"""Inches: of a row, and around all rows."""
_PALE, _DARK = "0.99", "0.1"
_MAP = "Blues"


@styled
def groups(field: Field) -> Figure:
    """Draw one row for each group, kinds of groups apart, and one column for each method.

    An entry has the share of seeds that learned, which is its colour, and below it the mean score, both over the tasks
    common to the methods. Of a method that does not fit these they are over all that it fits, in brackets and without a
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
