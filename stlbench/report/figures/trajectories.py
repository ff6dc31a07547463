"""Trajectories of one method: in the plane of two signals where the task file names them, else signals against time."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench.contract import Array
from stlbench.report.figures import layout, plane
from stlbench.report.figures.palette import TRACE
from stlbench.report.figures.parts import parts
from stlbench.report.figures.signals import READ, signals_in_time
from stlbench.report.figures.style import styled, width
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
