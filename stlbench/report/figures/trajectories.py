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
from stlbench.report.figures.regions import heading, terms
from stlbench.report.figures.signals import READ, signals_in_time
from stlbench.report.figures.style import DOUBLE, styled
from stlbench.report.figures.units import signal_label, time_label
from stlbench.rollout.traces import Recording
from stlbench.task.task import Task

__all__ = ["TRACES_PER_PANEL", "term_keys", "traces_in_time", "trajectories"]

TRACES_PER_PANEL = 16
_PLANE = 4.6
"""Inches: wider than one column, since the formula stands under it."""


@styled
def trajectories(task: Task, recording: Recording, title: str) -> Figure:
    """Traces from some starts, spread over starts and seeds, with the regions where the terms hold."""
    shown = recording.evenly(TRACES_PER_PANEL)
    figure, keys = _in_plane(task, shown) if task.file.plane else _in_time(task, shown)
    layout.title(figure, f"{title}: {len(shown)} of {len(recording.traces)} traces")
    figure.legend(handles=keys, loc="outside lower center", ncols=1)
    return figure


def _in_plane(task: Task, traces: Array) -> tuple[Figure, list[Artist]]:
    figure = Figure(figsize=(_PLANE, _PLANE - 0.3 + 0.16 * len(terms(task))), layout="constrained")
    axes: Axes = figure.subplots()
    view = plane.lay_out(axes, task, traces)
    lines = plane.draw_traces(axes, task, view, traces)
    figure.colorbar(lines, ax=axes, label=time_label(task), shrink=0.8)
    return figure, [*term_keys(task, view.drawn), *plane.mark_keys(plane.leaving(view, traces))]


def _in_time(task: Task, traces: Array) -> tuple[Figure, list[Artist]]:
    figure = Figure(figsize=(DOUBLE, 1.0 + 1.4 * len(task.signals)), layout="constrained")
    rows = list(figure.subplots(len(task.signals), 1, sharex=True, squeeze=False)[:, 0])
    drawn = traces_in_time(rows, task, traces)
    one_trace = Line2D([], [], color=TRACE, linewidth=0.8, label="one trace")
    shading = [layout.patch(READ, label="steps that the row's terms read")] if drawn else []
    return figure, [*term_keys(task, drawn), *shading, one_trace]


def traces_in_time(rows: Sequence[Axes], task: Task, traces: Array) -> list[int]:
    """Draw traces (N, T + 1, k) against time, one row per signal; the terms that have a region in one of the rows."""
    drawn = signals_in_time(rows, task)
    for i, axes in enumerate(rows):
        axes.plot(traces[..., i].T, color=TRACE, linewidth=0.6, alpha=0.7, zorder=4)
        axes.set_ylabel(signal_label(task, task.signals[i]))
    return drawn


def term_keys(task: Task, drawn: Sequence[int], letters: int = 72) -> list[Artist]:
    """Entries of a legend for all terms; those that have no region in the picture say so and have no colour."""
    keys: list[Artist] = []
    for i, term in enumerate(terms(task)):
        most = letters if i in drawn else letters - 22
        text = textwrap.shorten(f"{heading(term)} {term.psi}", most, placeholder=" ...")
        if i in drawn:
            keys.append(layout.term_patch(i, text))
        else:
            keys.append(Line2D([], [], linestyle="", label=f"{text} (has no region here)"))
    return keys
