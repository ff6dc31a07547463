"""Trajectories: in the plane of two signals where the task file names them, else the signals against time."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from stlbench import stl
from stlbench.contract import Array, Truth
from stlbench.report.figures.drawing import COLOURS, of_term
from stlbench.report.figures.regions import heading, region, terms
from stlbench.rollout.traces import Recording
from stlbench.task.task import Task

__all__ = ["in_plane", "label", "signals_in_time", "trajectories"]

_SHOWN = 16
"""Traces a figure."""
_POINTS = 150
"""Points that a trace in the plane is drawn with: each has a colour of its own."""
_GRID = 161
_TIME = "viridis"


def trajectories(task: Task, recording: Recording, title: str) -> Figure:
    """Traces from some starts, spread over starts and seeds, with the regions where the terms hold."""
    shown = recording.evenly(_SHOWN)
    figure = _in_plane(task, shown) if task.file.plane else _in_time(task, shown)
    figure.suptitle(f"{title}: {len(shown)} of {len(recording.traces)} traces", fontsize=11)
    _key(figure, task)
    return figure


def _in_plane(task: Task, traces: Array) -> Figure:
    figure = Figure(figsize=(7.4, 6.6 + 0.25 * len(terms(task))), layout="constrained")
    axes: Axes = figure.subplots()
    x, y = in_plane(axes, task)
    chosen = np.linspace(0, traces.shape[1] - 1, min(_POINTS, traces.shape[1])).round().astype(np.int64)
    points = traces[:, chosen][..., [x, y]]
    segments = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 2)
    lines = LineCollection(list(segments), cmap=_TIME, linewidths=1.1, zorder=4)
    lines.set_array(np.tile(chosen[:-1].astype(float), len(traces)))
    lines.set_clim(0, task.file.steps)
    axes.add_collection(lines)
    axes.plot(*traces[:, 0, [x, y]].T, "o", color="white", markeredgecolor="black", markersize=5, zorder=5)
    axes.plot(*traces[:, -1, [x, y]].T, "s", color="black", markersize=4, zorder=6)
    figure.colorbar(lines, ax=axes, label=f"time [steps of {task.file.sampling_time:g} s]", shrink=0.8)
    return figure


def in_plane(axes: Axes, task: Task) -> tuple[int, int]:
    """Lay out the plane of a task that names one, with the regions of its terms; the columns of its two signals."""
    assert task.file.plane is not None
    names = task.file.plane
    ranges = [task.file.signals[name] for name in names]
    grid = [np.linspace(entry.low, entry.high, _GRID) for entry in ranges]
    for i, term in enumerate(terms(task)):
        found = region(task, term.psi, grid, names)
        if found is not None:
            margin, inside = found[0].T, found[1].T.astype(float)
            axes.contourf(*grid, inside, levels=(0.5, 1.5), colors=[of_term(i)], alpha=0.13, zorder=1)
            axes.contour(*grid, margin, levels=(0.0,), colors=[of_term(i)], linewidths=1.3, zorder=2)
    axes.set_xlim(ranges[0].low, ranges[0].high)
    axes.set_ylim(ranges[1].low, ranges[1].high)
    axes.set_xlabel(label(task, names[0]))
    axes.set_ylabel(label(task, names[1]))
    if ranges[0].unit == ranges[1].unit:
        axes.set_aspect("equal")
    return task.signals.index(names[0]), task.signals.index(names[1])


def _in_time(task: Task, traces: Array) -> Figure:
    figure = Figure(figsize=(9.0, 1.4 + 2.2 * len(task.signals)), layout="constrained")
    rows = list(figure.subplots(len(task.signals), 1, sharex=True, squeeze=False)[:, 0])
    signals_in_time(rows, task)
    for i, axes in enumerate(rows):
        axes.plot(traces[..., i].T, color=COLOURS[0], linewidth=0.8, alpha=0.7, zorder=4)
        axes.set_ylabel(label(task, task.signals[i]))
    return figure


def signals_in_time(rows: Sequence[Axes], task: Task) -> None:
    """Lay out one row a signal: where each term is read, and for which values of the signal it can hold then."""
    for axes, (name, entry) in zip(rows, task.file.signals.items(), strict=True):
        grid = np.linspace(entry.low, entry.high, 1001)
        for i, term in enumerate(terms(task)):
            if name not in stl.signals(term.psi):
                continue
            axes.axvspan(term.start, term.end, color="0.92", linewidth=0, zorder=0)
            found = region(task, term.psi, (grid,), (name,))
            for low, high in _runs(found[1]) if found is not None else ():
                corner, size = (term.start, grid[low]), (term.end - term.start, grid[high] - grid[low])
                axes.add_patch(Rectangle(corner, *size, color=of_term(i), alpha=0.3, linewidth=1, zorder=1))
        axes.set_xlim(0, task.file.steps)
        axes.grid(alpha=0.25)
    rows[-1].set_xlabel(f"time [steps of {task.file.sampling_time:g} s]")


def _runs(truth: Truth) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], truth, [False]]).astype(np.int8)))
    return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]


def label(task: Task, name: str) -> str:
    """The signal with its unit: x [m]."""
    unit = task.file.signals[name].unit
    return f"{name} [{unit}]" if unit else name


def _key(figure: Figure, task: Task) -> None:
    marks: list[Patch | Line2D] = [
        Patch(facecolor=of_term(i), alpha=0.35, label=textwrap.shorten(f"{heading(term)} {term.psi}", 100))
        for i, term in enumerate(terms(task))
    ]
    if task.file.plane:
        marks.append(
            Line2D(
                [], [], color="white", marker="o", markeredgecolor="black", linestyle="", markersize=5, label="start"
            )
        )
        marks.append(Line2D([], [], color="black", marker="s", linestyle="", markersize=4, label="end"))
    if marks:
        figure.legend(handles=marks, loc="outside lower center", ncols=1, frameon=False, fontsize=8)
