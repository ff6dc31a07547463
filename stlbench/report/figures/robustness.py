"""Robustness by method: what each seed's policy scored on the report's starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.report.figures import layout
from stlbench.report.figures.palette import GroupStyle, styles
from stlbench.report.figures.scale import linear_threshold, set_symlog
from stlbench.report.statistics.intervals import interval, iqm
from stlbench.report.tables.rows import Group

__all__ = ["draw_robustness", "robustness_by_method", "robustness_keys"]


def robustness_by_method(groups: Sequence[Group], unit: str) -> Figure:
    """A point per seed, the interquartile mean with its interval under it; groups of one task."""
    figure = Figure(figsize=(8.0, 1.8 + 0.6 * len(groups)), layout="constrained")
    draw_robustness(figure.subplots(), groups, unit)
    layout.title(figure, f"{groups[0].setting.task}: robustness by method")
    figure.legend(handles=robustness_keys(), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def draw_robustness(axes: Axes, groups: Sequence[Group], unit: str) -> None:
    """One row per group. Where values span orders of magnitude, the axis is logarithmic away from 0."""
    looks = styles(groups)
    values = [group.values(lambda numbers: numbers.robustness_mean) for group in groups]
    for place, (seeds, style) in enumerate(zip(values, looks, strict=True)):
        _points(axes, place, seeds, style)
    axes.axvline(0, color=layout.LEVEL, linewidth=0.9, zorder=1)
    axes.set_yticks(range(len(groups)), [style.label.replace(": ", "\n") for style in looks])
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.grid(axis="x", alpha=0.3)
    label = f"mean robustness over the report starts [{unit}]"
    every = [value for seeds in values for value in seeds]
    threshold = linear_threshold(values, max(map(abs, every), default=0.0))
    if threshold is not None:
        label += f"\n{set_symlog(axes, 'x', threshold, min(every), max(every))}"
    elif every and np.isfinite(every).all():
        _limit(axes, values, [0.0, *every])
    axes.set_xlabel(label)


def _limit(axes: Axes, values: Sequence[Sequence[float]], shown: Sequence[float]) -> None:
    """Room for what is shown and for intervals, but for none of two seeds that would squeeze everything else."""
    low, high = min(shown), max(shown)
    ends = [end for seeds in values for end in interval(seeds) or ()]
    left, right = max(min([low, *ends]), 2 * low - high), min(max([high, *ends]), 2 * high - low)
    margin = 0.05 * (right - left) or 1.0
    axes.set_xlim(left - margin, right + margin)


def _points(axes: Axes, place: int, values: Sequence[float], style: GroupStyle) -> None:
    if not values:
        where = axes.get_yaxis_transform()
        axes.text(0.5, place, "no result", transform=where, ha="center", va="center", color="0.4", backgroundcolor="w")
        return
    axes.plot(values, np.full(len(values), place - 0.12), "o", color=style.colour, alpha=0.6, markersize=6, mew=0)
    centre, ends = iqm(values), interval(values)
    if ends is not None:
        axes.plot(ends, (place + 0.15, place + 0.15), "-", color=style.colour, linewidth=2.5, solid_capstyle="butt")
    axes.plot([centre], [place + 0.15], "D", color=style.colour, markersize=7, markeredgecolor="white")


def robustness_keys() -> list[Artist]:
    """Entries of the legend for what `draw_robustness` draws."""
    return [
        Line2D([], [], color="0.3", marker="o", linestyle="", alpha=0.6, label="one seed"),
        Line2D([], [], color="0.3", marker="D", linewidth=2.5, label="IQM over seeds and its 95 % interval"),
        layout.level_key("0: satisfied above"),
    ]
