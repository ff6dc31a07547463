"""Robustness by method; for a task that names a plane also with the trajectories of each method."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.contract import Array
from stlbench.report.figures import layout, plane
from stlbench.report.figures.axes import Window, arrow_at_left, beyond_key, number, window
from stlbench.report.figures.palette import Colours, styles
from stlbench.report.figures.regions import parts
from stlbench.report.figures.style import small, styled, tiny, width
from stlbench.report.figures.trajectories import part_keys
from stlbench.report.figures.units import robustness_unit, time_label
from stlbench.report.statistics.intervals import median, median_interval
from stlbench.report.tables.rows import Group, Numbers
from stlbench.task.task import Task

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
        arrow_at_left(axes, place - (0.34 if near else 0.14), [(_far(far), colour)])  # above the seeds that are shown
    if below:
        interval = "" if ends is None else f" [{number(ends.low)}, {number(ends.high)}]"
        arrow_at_left(axes, place + 0.2, [(f"median {number(centre)}{interval}", colour)])


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


METHODS_PER_OVERVIEW = 6
_PANEL = 2.2
"""Inches that a panel takes at least."""
_LETTERS = 62
"""Of an entry of the legend, which has two columns."""


@styled
def overview(task: Task, groups: Sequence[Group], traces: Sequence[Array | None], colours: Colours) -> Figure:
    """Draw groups of one task that names a plane.

    Args:
        task: names a plane.
        groups: at most `METHODS_PER_OVERVIEW`.
        traces: of each group, (N, T + 1, k), of one group at least; a group with None has no panel below.
        colours: of their methods.
    """
    names = [style.label.partition(":")[0] for style in styles(groups, colours)]
    panels = [
        (f"{name}\nsatisfies from {100 * np.mean(group.values(_satisfaction)):.0f} % of the starts", shown)
        for name, group, shown in zip(names, groups, traces, strict=True)
        if shown is not None
    ]
    columns = min(3, int(width() / _PANEL))
    rows = math.ceil(len(panels) / columns)
    heights = [0.45 + ROW * small() * len(groups), *[2.2] * rows]
    figure = Figure(figsize=(width(), sum(heights) + 0.7 + 0.11 * len(parts(task))), layout="constrained")
    grid = figure.add_gridspec(1 + rows, columns, height_ratios=heights)
    keys = draw_robustness(figure.add_subplot(grid[0, :]), groups, robustness_unit(task, task.formula), colours)
    below = [figure.add_subplot(grid[1 + i // columns, i % columns]) for i in range(len(panels))]
    keys += _draw_panels(below, task, panels)
    side = "right" if columns > 1 else "bottom"
    figure.colorbar(below[0].collections[-1], ax=below, label=time_label(task), aspect=30, location=side)
    layout.title(figure, f"{task.name}: {task.file.title}")
    layout.legend(figure, keys, 2, tiny())
    return figure


def _satisfaction(numbers: Numbers) -> float:
    return numbers.satisfaction


def _draw_panels(below: Sequence[Axes], task: Task, panels: Sequence[tuple[str, Array]]) -> list[Artist]:
    """One method's traces in each of the axes, all of one view; entries of the legend."""
    every = np.concatenate([traces for _, traces in panels])
    for axes, (name, traces) in zip(below, panels, strict=True):
        view = plane.lay_out(axes, task, every)
        plane.draw_traces(axes, task, view, traces)
        away = plane.leaving(view, traces).sum()
        axes.set_title(
            name + (f"\nleaving the picture: {away} of {len(traces)} traces" if away else ""), fontsize=tiny() + 1
        )
    return [*part_keys(task, view.drawn, _LETTERS), *plane.mark_keys(plane.leaving(view, every))]
