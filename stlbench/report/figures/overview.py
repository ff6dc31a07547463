"""A task at a glance: robustness by method above, trajectories of each method in the plane below."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stlbench.contract import Array
from stlbench.report.figures import layout, plane
from stlbench.report.figures.palette import Colours, styles
from stlbench.report.figures.parts import parts
from stlbench.report.figures.robustness import ROW, draw_robustness
from stlbench.report.figures.style import small, styled, tiny, width
from stlbench.report.figures.trajectories import part_keys
from stlbench.report.figures.units import robustness_unit, time_label
from stlbench.report.tables.rows import Group, Numbers
from stlbench.task.task import Task

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
