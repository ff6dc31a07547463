"""What each reward asks for: the trajectories of planned policies side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench.report.figures import layout, plane
from stlbench.report.figures.palette import TRACE
from stlbench.report.figures.signals import READ
from stlbench.report.figures.style import small, styled, tiny, width
from stlbench.report.figures.trajectories import part_keys, traces_in_time
from stlbench.report.figures.units import time_label
from stlbench.task.task import Task

PLANS_PER_FIGURE = 6
_PANEL = 1.7
"""Inches that a panel takes at least."""


class Plan(NamedTuple):
    """What one plan led to."""

    name: str
    """What was maximised, and in which setting."""
    robustness: float
    """Mean over the report's starts."""
    satisfaction: float
    """Share of the starts."""
    traces: Array
    """(N, T + 1, k)."""

    @property
    def title(self) -> str:
        """The name, and what the referee says."""
        return f"{self.name}\nrobustness {self.robustness:.3g}, satisfies from {100 * self.satisfaction:.0f} %"


@styled
def planned(task: Task, plans: Sequence[Plan]) -> Figure:
    """Draw at most `PLANS_PER_FIGURE` plans of one task: in its plane, or each signal against time."""
    columns = min(int(width() / _PANEL), 3, len(plans))
    figure = _in_plane(task, plans, columns) if task.file.plane else _in_time(task, plans, columns)
    layout.title(figure, f"{task.name}: what is asked for by the formula, and by rewards")
    return figure


def _in_plane(task: Task, plans: Sequence[Plan], columns: int) -> Figure:
    rows = math.ceil(len(plans) / columns)
    figure = Figure(
        figsize=(max(width() * max(columns, 2) / 3, min(width(), 2 * _PANEL)), 2.6 * rows + 0.9), layout="constrained"
    )
    panels = [figure.add_subplot(rows, columns, i + 1) for i in range(len(plans))]
    every = np.concatenate([plan.traces for plan in plans])
    for axes, plan in zip(panels, plans, strict=True):
        view = plane.lay_out(axes, task, every)
        lines = plane.draw_traces(axes, task, view, plan.traces)
        axes.set_title(plan.title, fontsize=small())
    keys = [*part_keys(task, view.drawn), *plane.mark_keys(plane.leaving(view, every))]
    figure.colorbar(lines, ax=panels, label=time_label(task), aspect=30)
    layout.legend(figure, keys, 1, tiny())
    return figure


def _in_time(task: Task, plans: Sequence[Plan], columns: int) -> Figure:
    bands, signals = math.ceil(len(plans) / columns), len(task.signals)
    figure = Figure(
        figsize=(max(width() * max(columns, 2) / 3, min(width(), 2 * _PANEL)), 0.8 + 1.2 * bands * signals),
        layout="constrained",
    )
    grid = figure.subplots(bands * signals, columns, sharex=True, squeeze=False)
    drawn = list[int]()
    for i, plan in enumerate(plans):
        band, column = divmod(i, columns)
        rows = list(grid[band * signals : (band + 1) * signals, column])
        drawn = traces_in_time(rows, task, plan.traces)
        rows[0].set_title(plan.title, fontsize=small())
    _same_limits(grid[: bands * signals].reshape(bands, signals, columns))
    for axes in grid.ravel()[[not axes.has_data() for axes in grid.ravel()]]:
        axes.set_visible(False)
    one_trace = Line2D([], [], color=TRACE, linewidth=0.8, label="one trace")
    keys: list[Artist] = [*part_keys(task, drawn), layout.patch(READ, label="steps at which a part is read"), one_trace]
    layout.legend(figure, keys, 1, tiny())
    return figure


def _same_limits(grid: NDArray[Any]) -> None:
    """Each signal of axes (bands, signals, columns) has one range of values in all plans."""
    for i in range(grid.shape[1]):
        used = [axes for axes in grid[:, i].ravel() if axes.has_data()]
        ends = np.array([axes.get_ylim() for axes in used])
        for axes in used:
            axes.set_ylim(ends[:, 0].min(), ends[:, 1].max())
