"""Figures of a report: robustness by method, and learning curves, one of each a task, as PNG and SVG."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.report.figures.drawing import Style, file_name, pages, save, styles
from stlbench.report.figures.learning import learning_curves
from stlbench.report.statistics import interval, iqm
from stlbench.report.tables.rows import Group

__all__ = ["draw", "robustness_by_method"]


def draw(groups: Sequence[Group], folder: Path) -> list[Path]:
    """Draw both figures of each task that has a finished cell; the files' paths.

    Where a task has more groups than can be told apart, further figures have names that end in _2, _3, ...
    """
    paths = []
    for task, members in groupby(groups, key=lambda group: group.setting.task):
        shown = list(members)
        if any(group.done for group in shown):
            for end, page in pages(shown):
                paths += save(robustness_by_method(page), folder, file_name("robustness", str(task)) + end)
                paths += save(learning_curves(page), folder, file_name("learning", str(task)) + end)
    return paths


def robustness_by_method(groups: Sequence[Group]) -> Figure:
    """A point a seed, the interquartile mean with its interval under it; groups of one task."""
    figure = Figure(figsize=(8.0, 1.7 + 0.6 * len(groups)), layout="constrained")
    axes: Axes = figure.subplots()
    looks = styles(groups)
    for place, (group, style) in enumerate(zip(groups, looks, strict=True)):
        _points(axes, place, group.values(lambda numbers: numbers.robustness_mean), style)
    axes.axvline(0, color="0.5", linewidth=0.8, zorder=0)
    axes.set_yticks(range(len(groups)), [style.label.replace(": ", "\n") for style in looks])
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.set_xlabel("mean robustness over the report starts [unit of the predicates]")
    axes.set_title(f"{groups[0].setting.task}: robustness by method", loc="left")
    axes.grid(axis="x", alpha=0.3)
    _key_of_points(figure)
    return figure


def _points(axes: Axes, place: int, values: Sequence[float], style: Style) -> None:
    if not values:
        where = axes.get_yaxis_transform()
        axes.text(0.5, place, "no result", transform=where, ha="center", va="center", color="0.4", backgroundcolor="w")
        return
    axes.plot(values, np.full(len(values), place - 0.12), "o", color=style.colour, alpha=0.6, markersize=6, mew=0)
    centre, ends = float(iqm(values)), interval(values, iqm)
    if ends is not None:
        axes.plot(ends, (place + 0.15, place + 0.15), "-", color=style.colour, linewidth=2.5, solid_capstyle="butt")
    axes.plot([centre], [place + 0.15], "D", color=style.colour, markersize=7, markeredgecolor="white")


def _key_of_points(figure: Figure) -> None:
    marks = [
        Line2D([], [], color="0.3", marker="o", linestyle="", alpha=0.6, label="one seed"),
        Line2D([], [], color="0.3", marker="D", linewidth=2.5, label="IQM and 95 % bootstrap interval over seeds"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, frameon=False)
