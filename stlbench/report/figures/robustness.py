"""Robustness by method: what each seed's policy scored on the report's starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.report.figures import layout
from stlbench.report.figures.beyond import Window, beside, beyond_key, number, window
from stlbench.report.figures.palette import Colours, styles
from stlbench.report.figures.style import small, styled, width
from stlbench.report.statistics.intervals import median, median_interval
from stlbench.report.tables.rows import Group

ROW = 0.048
"""Inches of a row, whose label has two lines, for each point of its text."""


@styled
def robustness_by_method(groups: Sequence[Group], unit: str, colours: Colours) -> Figure:
    """A point per seed, the median with its interval under it; groups of one task."""
    figure = Figure(figsize=(width(), 1.1 + ROW * small() * len(groups)), layout="constrained")
    keys = draw_robustness(figure.subplots(), groups, unit, colours)
    layout.title(figure, f"{groups[0].setting.task}: robustness by method")
    layout.legend(figure, keys, 4)
    return figure


def draw_robustness(axes: Axes, groups: Sequence[Group], unit: str, colours: Colours) -> list[Artist]:
    """One row per group; entries of the legend.

    Where values lie orders of magnitude below the others, the axis ends before them, and their rows have the numbers.
    """
    looks = styles(groups, colours)
    values = [group.values(lambda numbers: numbers.robustness_mean) for group in groups]
    shown = window(values)
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
        margin = 0.05 * float(np.ptp(every)) or 1.0
        axes.set_xlim(min(every) - margin, max(every) + margin)
    return _keys(shown)


def _points(axes: Axes, place: int, values: Sequence[float], shown: Window | None, colour: str) -> None:
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
        beside(axes, place - (0.34 if near else 0.14), [(_far(far), colour)])  # above the seeds that are shown
    if below:
        said = "" if ends is None else f" [{number(ends.low)}, {number(ends.high)}]"
        beside(axes, place + 0.2, [(f"median {number(centre)}{said}", colour)])


def _far(values: Sequence[float]) -> str:
    """ "10 seeds, -29 to -35"."""
    if len(values) == 1:
        return f"1 seed, {number(values[0])}"
    return f"{len(values)} seeds, {number(max(values))} to {number(min(values))}"


def _keys(shown: Window | None) -> list[Artist]:
    keys: list[Artist] = [
        Line2D([], [], color="0.3", marker="o", linestyle="", alpha=0.6, markersize=4.5, label="one seed"),
        Line2D([], [], color="0.3", marker="D", linewidth=2, markersize=5, label="median seed, 95 % interval"),
        layout.level_key("0: satisfied above"),
    ]
    return keys if shown is None else [*keys, beyond_key("<", "beyond the axis")]
