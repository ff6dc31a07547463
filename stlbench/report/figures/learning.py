"""Learning curves: what checkpoints scored on the starts kept for selection, against environment steps."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter

from stlbench.report.figures import layout
from stlbench.report.figures.axes import arrows_below, beyond_key, number, window
from stlbench.report.figures.palette import Colours, GroupStyle, styles
from stlbench.report.figures.style import SINGLE, styled, width
from stlbench.report.statistics.intervals import MeanCurve, mean_curve
from stlbench.report.tables.rows import Group

_LINE = 30
"""Characters of a line of an axis' label: as many as the axis is high."""


@styled
def learning_curves(groups: Sequence[Group], unit: str, colours: Colours, most: float = math.inf) -> Figure:
    """Satisfaction and mean robustness: a line per group of one task, the mean over its seeds.

    Shaded: 95 % interval of that mean, where two seeds or more finished, cut at what is possible: 0 and 100 % of the
    starts, and `most` of the robustness. The legend says how many did, and names the groups without a line too. Where
    lines end orders of magnitude below the others, the axis of robustness ends before them, and arrows have the last
    means.
    """
    panels = int(width() / SINGLE)
    rows = math.ceil((len(groups) + 3) / panels)
    figure = Figure(figsize=(width(), 0.5 + 2.2 * (3 - panels) + 0.15 * rows), layout="constrained")
    left, right = figure.subplots(3 - panels, panels)
    looks = styles(groups, colours)
    curves = [[numbers.curve for numbers in group.done if numbers.curve] for group in groups]
    trained = [(own, style) for own, style in zip(curves, looks, strict=True) if own]
    means = [(mean_curve(own, lambda point: point[2], (-math.inf, most)), style) for own, style in trained]
    for own, style in trained:
        _draw(left, mean_curve(own, lambda point: 100 * point[1], (0, 100)), style)
    low, far = _limit(right, means)
    for line, style in means:
        _draw(right, line, style, low)
    arrows_below(right, far)
    left.set(ylabel="starts that satisfy [%]", ylim=(-4, 104))
    right.set_ylabel(textwrap.fill(f"mean robustness [{unit}]", _LINE))
    right.axhline(0, color=layout.LEVEL, linewidth=0.7, zorder=1)
    for axes in (left, right):
        axes.set_xlabel("environment steps")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.grid(alpha=0.3)
    setting = groups[0].setting
    name = str(setting.task) if setting.track == "shared" else f"{setting.task}, {setting.track}"
    layout.title(figure, f"{name}: learning curves on the selection starts (mean over seeds)")
    keys: list[Artist] = [
        Line2D([], [], color=style.colour, linestyle=style.line, linewidth=1.3, label=style.label)
        if group.done
        else Line2D([], [], color=style.colour, linestyle="", marker="x", markersize=5, label=style.label)
        for group, style in zip(groups, looks, strict=True)
    ]
    keys.append(layout.patch("0.3", "95 % interval of the mean, cut at what is possible", alpha=0.18))
    keys.append(layout.level_key("robustness 0: satisfied above"))
    keys += [beyond_key("v", "ends below the axis, with its last mean")] if far else []
    layout.legend(figure, keys, 2)
    return figure


def _draw(axes: Axes, line: MeanCurve, style: GroupStyle, low: float = -math.inf) -> None:
    """A line, and its interval where it lies above `low`, the end of the axis."""
    known = np.isfinite(line.low) & (line.mean >= low)
    if known.any():
        axes.fill_between(
            line.steps[known], line.low[known], line.high[known], color=style.colour, alpha=0.18, linewidth=0
        )
    marker = "o" if len(line.steps) == 1 else ""
    axes.plot(line.steps, line.mean, style.line, color=style.colour, linewidth=1.3, marker=marker, markersize=4)


def _limit(axes: Axes, lines: Sequence[tuple[MeanCurve, GroupStyle]]) -> tuple[float, list[tuple[str, str]]]:
    """Limit the axis of robustness: its lower end, and the last means of lines that end below it, with their colours.

    The axis has room for what seeds had, and cuts wider intervals, as two seeds have. The second half of each line
    chooses where it ends: all methods are bad at first.
    """
    ends = [end for line, _ in lines for end in (line.least, line.most) if math.isfinite(end)]
    if not ends:
        return -math.inf, []
    low, high = min(*ends, 0.0), max(*ends, 0.0)
    shown = window(line.mean[len(line.mean) // 2 :].tolist() for line, _ in lines)
    if shown is not None:
        low = shown.low
    margin = 0.05 * (high - low)
    axes.set_ylim(low - margin, high + margin) if margin else None
    low -= margin
    return low, [(number(line.mean[-1]), style.colour) for line, style in lines if line.mean[-1] < low]
