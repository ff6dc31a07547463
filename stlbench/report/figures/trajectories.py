"""Trajectories, of one method or of several plans: in the plane that the task names, else signals against time."""

import math
import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array
from stlbench.report.figures import layout, plane
from stlbench.report.figures.regions import parts, region, signal_label, time_label
from stlbench.report.figures.style import TRACE, now, styled, term_style
from stlbench.simulation.referee import Recording
from stlbench.task.task import Task

READ = "0.92"  # the grey of the steps at which a part of the formula is read
_THIN: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.7}
TRACES_PER_PANEL = 16
PLANS_PER_FIGURE = 6
_PLANE = 4.6  # inches: wider than one column, since the formula stands under it
_PANEL = 1.7  # inches of a panel of a plan, at least


@styled
def trajectories(task: Task, recording: Recording, title: str, colour: str = TRACE) -> Figure:
    """Traces from some starts, spread over starts and seeds, with the regions where the formula's parts hold.

    Against time they have the method's colour; in a plane their colour is the time.
    """
    traces = recording.evenly(TRACES_PER_PANEL)
    if task.file.plane:
        inches = min(_PLANE, now().width)
        figure = Figure(figsize=(inches, inches - 0.3 + 0.16 * len(parts(task))), layout="constrained")
        keys = _in_plane(figure, [figure.subplots()], task, [traces], shrink=0.8)
    else:
        figure = layout.figure_of(1.0 + 1.4 * len(task.signals))
        rows = list(figure.subplots(len(task.signals), 1, sharex=True, squeeze=False)[:, 0])
        drawn = signals_in_time(rows, task, traces, color=colour, **_THIN)
        keys = _time_keys(task, drawn, colour, "steps at which the row's signal is read" if drawn else "")
    return layout.finish(figure, f"{title}: {len(traces)} of {len(recording.traces)} traces", keys, 1)


class Plan(NamedTuple):
    name: str  # what was maximised, and in which setting
    robustness: float  # mean over the report's starts
    satisfaction: float  # share of the starts
    traces: Array  # (N, T + 1, k)

    @property
    def title(self) -> str:
        return f"{self.name}\nrobustness {self.robustness:.3g}, satisfies from {100 * self.satisfaction:.0f} %"


@styled
def planned(task: Task, plans: Sequence[Plan]) -> Figure:
    """Draw at most `PLANS_PER_FIGURE` plans of one task: in its plane, or each signal against time."""
    columns = min(int(now().width / _PANEL), 3, len(plans))
    bands, signals = math.ceil(len(plans) / columns), len(task.signals)
    figure = layout.figure_of(2.6 * bands + 0.9 if task.file.plane else 0.8 + 1.2 * bands * signals)
    figure.set_figwidth(max(now().width * max(columns, 2) / 3, min(now().width, 2 * _PANEL)))
    if task.file.plane:
        tops = [figure.add_subplot(bands, columns, i + 1) for i in range(len(plans))]
        keys = _in_plane(figure, tops, task, [plan.traces for plan in plans], aspect=30)
    else:
        grid = figure.subplots(bands * signals, columns, sharex=True, squeeze=False).reshape(bands, signals, columns)
        panels = [grid[i // columns, :, i % columns] for i in range(len(plans))]
        for rows, plan in zip(panels, plans, strict=True):
            drawn = signals_in_time(list(rows), task, plan.traces, color=TRACE, **_THIN)
        _same_limits(grid)
        for axes in grid.ravel()[[not axes.has_data() for axes in grid.ravel()]]:
            axes.set_visible(False)
        tops, keys = [rows[0] for rows in panels], _time_keys(task, drawn, TRACE, "steps at which a part is read")
    for axes, plan in zip(tops, plans, strict=True):
        axes.set_title(plan.title, fontsize=now().small)
    return layout.finish(figure, f"{task.name}: what is asked for by the formula, and by rewards", keys, 1, now().tiny)


def _same_limits(grid: NDArray[Any]) -> None:
    """Each signal of axes (bands, signals, columns) has one range of values in all plans."""
    for i in range(grid.shape[1]):
        used = [axes for axes in grid[:, i].ravel() if axes.has_data()]
        ends = np.array([axes.get_ylim() for axes in used])
        for axes in used:
            axes.set_ylim(ends[:, 0].min(), ends[:, 1].max())


def _in_plane(figure: Figure, panels: Sequence[Axes], task: Task, traces: Sequence[Array], **bar: Any) -> list[Artist]:
    """Draw traces (N, T + 1, k) in each panel, all with one view and one colour bar; the entries of the legend."""
    every = np.concatenate(traces)
    for axes, own in zip(panels, traces, strict=True):
        view = plane.lay_out(axes, task, every)
        lines = plane.draw_traces(axes, task, view, own)
    figure.colorbar(lines, ax=panels, label=time_label(task), **bar)
    return [*part_keys(task, view.drawn), *plane.mark_keys(plane.leaving(view, every))]


def _time_keys(task: Task, drawn: Sequence[int], colour: str, shading: str) -> list[Artist]:
    """Entries of a legend. Without a text, `shading` has none."""
    trace = layout.key_of("one trace", color=colour, linewidth=0.8)
    return [*part_keys(task, drawn), *([layout.patch(READ, label=shading)] if shading else []), trace]


def part_keys(task: Task, drawn: Sequence[int], letters: int = 72) -> list[Artist]:
    """Entries of a legend for all parts of the formula; a part without a region says so, in a dotted box."""
    keys: list[Artist] = []
    for i, part in enumerate(parts(task)):
        most = letters if i in drawn else letters - 22
        text = textwrap.shorten(str(part), most, placeholder=" ...")
        keys.append(layout.term_patch(i, text) if i in drawn else layout.absent_patch(f"{text} (has no region here)"))
    return keys


def signals_in_time(rows: Sequence[Axes], task: Task, traces: Array, **line: Any) -> list[int]:
    """Draw traces (N, t + 1, k), one row for each signal; and when each part of the formula is read, and with which
    values of the signal it can hold then.

    Returns:
        Indices of the parts that have a region in some row.
    """
    drawn = set()
    for axes, values, (name, signal) in zip(rows, np.moveaxis(traces, -1, 0), task.file.signals.items(), strict=True):
        grid = np.linspace(signal.low, signal.high, 1001)
        for i, part in enumerate(parts(task)):
            shadow = region(task, part.psi, (grid,), (name,)) if name in stl.signals(part.psi) else None
            if shadow is None:
                continue
            drawn.add(i)
            axes.axvspan(part.start, part.end, color=READ, linewidth=0, zorder=0)
            colour, hatch = term_style(i)
            fill = to_rgba(colour, 2 * layout.REGION_ALPHA)
            look: dict[str, Any] = {"facecolor": fill, "edgecolor": colour, "hatch": hatch}
            edges = np.flatnonzero(np.diff(shadow[1].astype(np.int8), prepend=0, append=0))
            for first, end in edges.reshape(-1, 2):  # each run of values with which the part can hold
                size = part.end - part.start, grid[end - 1] - grid[first]
                axes.add_patch(Rectangle((part.start, grid[first]), *size, zorder=1, **look))
        axes.plot(values.T, zorder=4, **line)
        axes.set_xlim(0, task.file.steps)
        axes.set_ylabel(signal_label(task, name))
        axes.grid(alpha=0.25)
    rows[-1].set_xlabel(time_label(task))
    return sorted(drawn)
