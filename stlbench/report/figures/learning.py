"""Learning curves: what checkpoints scored on the starts kept for selection, against environment steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter

from stlbench.contract import Array
from stlbench.report.figures.drawing import Style, styles
from stlbench.report.statistics import interval
from stlbench.report.tables.rows import CurveRow, Group

__all__ = ["aligned", "learning_curves"]


def learning_curves(groups: Sequence[Group]) -> Figure:
    """Satisfaction and mean robustness: a line a group of one task, the mean over its seeds.

    Shaded: 95 % bootstrap interval of that mean, where two seeds or more finished. The legend says how many did, and
    names the groups without a line too.
    """
    rows = math.ceil(len(groups) / 2)
    figure = Figure(figsize=(10.0, 4.2 + 0.22 * rows), layout="constrained")
    left, right = figure.subplots(1, 2)
    found = styles(groups)
    for group, style in zip(groups, found, strict=True):
        curves = [numbers.curve for numbers in group.done if numbers.curve]
        if curves:
            _line(left, curves, style, lambda point: 100 * point[1])
            _line(right, curves, style, lambda point: point[2])
    left.set(ylabel="starts that satisfy [%]", ylim=(-4, 104))
    right.set_ylabel("mean robustness [unit of the predicates]")
    right.axhline(0, color="0.5", linewidth=0.8, zorder=0)
    for axes in (left, right):
        axes.set_xlabel("environment steps")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.grid(alpha=0.3)
    figure.suptitle(
        f"{groups[0].setting.task}: learning curves on the selection starts (mean over seeds, 95 % interval)"
    )
    marks = [
        Line2D([], [], color=style.colour, linestyle=style.line if group.done else "", linewidth=1.8, label=style.label)
        for group, style in zip(groups, found, strict=True)
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=min(2, len(marks)), frameon=False)
    return figure


def _line(axes: Axes, curves: Sequence[Sequence[CurveRow]], style: Style, value: Callable[[CurveRow], float]) -> None:
    steps, values = aligned(curves, value)
    ends = [interval(column, np.mean) for column in values.T]
    shown = [i for i, pair in enumerate(ends) if pair is not None]
    if shown:
        low, high = np.array([ends[i] for i in shown]).T
        axes.fill_between(steps[shown], low, high, color=style.colour, alpha=0.18, linewidth=0)
    marker = "o" if len(steps) == 1 else ""
    axes.plot(steps, values.mean(axis=0), style.line, color=style.colour, linewidth=1.8, marker=marker)


def aligned(curves: Sequence[Sequence[CurveRow]], value: Callable[[CurveRow], float]) -> tuple[Array, Array]:
    """Curves on common steps: (p,) and (seeds, p), where seeds took checkpoints at other steps linearly interpolated.

    The common steps end where the shortest curve does and begin where the latest one does.
    """
    begin, end = max(curve[0][0] for curve in curves), min(curve[-1][0] for curve in curves)
    steps = np.array(sorted({point[0] for curve in curves for point in curve if begin <= point[0] <= end}), dtype=float)
    values = [np.interp(steps, [point[0] for point in curve], [value(point) for point in curve]) for curve in curves]
    return steps, np.array(values)
