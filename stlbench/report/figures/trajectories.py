"""Trajectories, of one method or of plans side by side: in the plane that the task names, else signals against time."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench.report.figures import layout, plane
from stlbench.report.figures.palette import TRACE
from stlbench.report.figures.regions import READ, parts, signals_in_time
from stlbench.report.figures.style import small, styled, tiny, width
from stlbench.report.figures.units import signal_label, time_label
from stlbench.rollout.traces import Recording
from stlbench.task.task import Task

TRACES_PER_PANEL = 16
_PLANE = 4.6
"""Inches: wider than one column, since the formula stands under it."""


@styled
def trajectories(task: Task, recording: Recording, title: str, colour: str = TRACE) -> Figure:
    """Traces from some starts, spread over starts and seeds, with the regions where the formula's parts hold.

    Against time they have the method's colour; in a plane their colour is the time.
    """
    shown = recording.evenly(TRACES_PER_PANEL)
    figure, keys = _in_plane(task, shown) if task.file.plane else _in_time(task, shown, colour)
    layout.title(figure, f"{title}: {len(shown)} of {len(recording.traces)} traces")
    layout.legend(figure, keys, 1)
    return figure


def _in_plane(task: Task, traces: Array) -> tuple[Figure, list[Artist]]:
    inches = min(_PLANE, width())
    figure = Figure(figsize=(inches, inches - 0.3 + 0.16 * len(parts(task))), layout="constrained")
    axes: Axes = figure.subplots()
    view = plane.lay_out(axes, task, traces)
    lines = plane.draw_traces(axes, task, view, traces)
    figure.colorbar(lines, ax=axes, label=time_label(task), shrink=0.8)
    return figure, [*part_keys(task, view.drawn), *plane.mark_keys(plane.leaving(view, traces))]


def _in_time(task: Task, traces: Array, colour: str) -> tuple[Figure, list[Artist]]:
    figure = Figure(figsize=(width(), 1.0 + 1.4 * len(task.signals)), layout="constrained")
    rows = list(figure.subplots(len(task.signals), 1, sharex=True, squeeze=False)[:, 0])
    drawn = traces_in_time(rows, task, traces, colour)
    one_trace = Line2D([], [], color=colour, linewidth=0.8, label="one trace")
    shading = [layout.patch(READ, label="steps at which the row's signal is read")] if drawn else []
    return figure, [*part_keys(task, drawn), *shading, one_trace]


def traces_in_time(rows: Sequence[Axes], task: Task, traces: Array, colour: str = TRACE) -> list[int]:
    """Draw traces (N, T + 1, k) against time, one row per signal; the parts that have a region in one of the rows."""
    drawn = signals_in_time(rows, task)
    for i, axes in enumerate(rows):
        axes.plot(traces[..., i].T, color=colour, linewidth=0.6, alpha=0.7, zorder=4)
        axes.set_ylabel(signal_label(task, task.signals[i]))
    return drawn


def part_keys(task: Task, drawn: Sequence[int], letters: int = 72) -> list[Artist]:
    """Entries of a legend for all parts of the formula; those without a region say so, in a dotted box."""
    keys: list[Artist] = []
    for i, part in enumerate(parts(task)):
        most = letters if i in drawn else letters - 22
        text = textwrap.shorten(str(part), most, placeholder=" ...")
        if i in drawn:
            keys.append(layout.term_patch(i, text))
        else:
            keys.append(layout.absent_patch(f"{text} (has no region here)"))
    return keys


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
    figure = _plans_in_plane(task, plans, columns) if task.file.plane else _plans_in_time(task, plans, columns)
    layout.title(figure, f"{task.name}: what is asked for by the formula, and by rewards")
    return figure


def _plans_in_plane(task: Task, plans: Sequence[Plan], columns: int) -> Figure:
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


def _plans_in_time(task: Task, plans: Sequence[Plan], columns: int) -> Figure:
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
