"""Learning curves: what checkpoints scored on the starts kept for selection, against environment steps."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter

from stlbench.report.figures import layout
from stlbench.report.figures.palette import GroupStyle, styles
from stlbench.report.figures.scale import linear_threshold, set_symlog
from stlbench.report.statistics.curves import MeanCurve, mean_curve
from stlbench.report.tables.rows import Group

__all__ = ["learning_curves"]


def learning_curves(groups: Sequence[Group], unit: str) -> Figure:
    """Satisfaction and mean robustness: a line per group of one task, the mean over its seeds.

    Shaded: 95 % t interval of that mean, where two seeds or more finished. The legend says how many did, and
    names the groups without a line too. Where robustness spans orders of magnitude, its axis is logarithmic away from
    0.
    """
    rows = math.ceil((len(groups) + 1) / 2)
    figure = Figure(figsize=(10.0, 4.2 + 0.22 * rows), layout="constrained")
    left, right = figure.subplots(1, 2)
    looks = styles(groups)
    means = list[MeanCurve]()
    for group, style in zip(groups, looks, strict=True):
        curves = [numbers.curve for numbers in group.done if numbers.curve]
        if curves:
            _draw(left, mean_curve(curves, lambda point: 100 * point[1]), style)
            means.append(mean_curve(curves, lambda point: point[2]))
            _draw(right, means[-1], style)
    left.set(ylabel="starts that satisfy [%]", ylim=(-4, 104))
    right.set_ylabel(f"mean robustness [{unit}]{_scale(right, means)}")
    right.axhline(0, color=layout.LEVEL, linewidth=0.9, zorder=1)
    for axes in (left, right):
        axes.set_xlabel("environment steps")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.grid(alpha=0.3)
    task = groups[0].setting.task
    layout.title(figure, f"{task}: learning curves on the selection starts (mean over seeds, 95 % interval)")
    keys = [
        Line2D([], [], color=style.colour, linestyle=style.line if group.done else "", linewidth=1.8, label=style.label)
        for group, style in zip(groups, looks, strict=True)
    ]
    keys.append(layout.level_key("robustness 0: satisfied above"))
    figure.legend(handles=keys, loc="outside lower center", ncols=min(2, len(keys)), frameon=False)
    return figure


def _draw(axes: Axes, line: MeanCurve, style: GroupStyle) -> None:
    known = np.isfinite(line.low)
    if known.any():
        axes.fill_between(
            line.steps[known], line.low[known], line.high[known], color=style.colour, alpha=0.18, linewidth=0
        )
    marker = "o" if len(line.steps) == 1 else ""
    axes.plot(line.steps, line.mean, style.line, color=style.colour, linewidth=1.8, marker=marker)


def _scale(axes: Axes, lines: Sequence[MeanCurve]) -> str:
    """Make the axis of robustness logarithmic where that helps; what its label should add.

    The axis has room for what seeds had, and cuts wider intervals, as two seeds have. The second half of each line
    chooses the linear part: all methods are bad at first.
    """
    ends = [end for line in lines for end in (line.least, line.most) if math.isfinite(end)]
    if not ends:
        return ""
    low, high = min(*ends, 0.0), max(*ends, 0.0)
    threshold = linear_threshold((line.mean[len(line.mean) // 2 :] for line in lines), max(-low, high))
    if threshold is not None:
        return f"\n{set_symlog(axes, 'y', threshold, low, high)}"
    margin = 0.05 * (high - low)
    axes.set_ylim(low - margin, high + margin) if margin else None
    return ""
