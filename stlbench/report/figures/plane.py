"""The plane of two signals: the regions of the parts of a task's formula, and traces coloured by time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D

from stlbench.contract import Array, Truth
from stlbench.report.figures.layout import REGION_ALPHA
from stlbench.report.figures.palette import TIME, term_style
from stlbench.report.figures.regions import parts, region
from stlbench.report.figures.units import signal_label
from stlbench.task.task import Task

_POINTS = 150
"""Points that a trace is drawn with: each has a colour of its own."""
_GRID = 201
_PAD = 0.06


class _Mark(NamedTuple):
    marker: Literal["o", "s", "X"]
    colour: str
    edge: str
    size: float

    def artist(self, places: Array, label: str = "") -> Line2D:
        """A mark at each of the places (N, 2)."""
        return Line2D(
            *places.T,
            linestyle="",
            marker=self.marker,
            color=self.colour,
            markeredgecolor=self.edge,
            markeredgewidth=0.7,
            markersize=self.size,
            label=label,
        )


_START, _END, _LEAVES = (
    _Mark("o", "white", "black", 4),
    _Mark("s", "black", "black", 3),
    _Mark("X", "black", "white", 6),
)
_NOWHERE = np.zeros((0, 2))


class View(NamedTuple):
    """Which part of the signals' space a plane shows."""

    columns: tuple[int, int]
    """Of the signals across and up."""
    low: Array
    """(2,): the lower left corner."""
    high: Array
    """(2,): the upper right corner."""
    drawn: tuple[int, ...]
    """Indices of the parts that have a region in the plane."""


def lay_out(axes: Axes, task: Task, traces: Array, *, whole: bool = False) -> View:
    """Lay out the plane of a task that names one, with the regions of its formula's parts.

    It shows the regions and the traces (N, T + 1, k), as far as these stay in the ranges of the signals; where the
    `whole` is wanted, all of these ranges.
    """
    assert task.file.plane is not None
    names = task.file.plane
    across, up = (task.file.signals[name] for name in names)
    columns = (task.signals.index(names[0]), task.signals.index(names[1]))
    ranges = View(columns, np.array([across.low, up.low]), np.array([across.high, up.high]), ())
    grid = [np.linspace(low, high, _GRID) for low, high in zip(ranges.low, ranges.high, strict=True)]
    places = traces[..., list(columns)].reshape(-1, 2)
    visible, drawn = [places[~_outside(ranges, places)]], list[int]()
    for i, part in enumerate(parts(task)):
        margin_and_truth = region(task, part.psi, grid, names)
        if margin_and_truth is not None:
            margin, inside = margin_and_truth
            _fill(axes, grid, margin, inside, i)
            visible.append(
                np.column_stack([values[index] for values, index in zip(grid, inside.nonzero(), strict=True)])
            )
            drawn.append(i)
    view = (ranges if whole else _around(np.concatenate(visible), ranges))._replace(drawn=tuple(drawn))
    axes.set(xlabel=signal_label(task, names[0]), ylabel=signal_label(task, names[1]))
    axes.set(xlim=(view.low[0], view.high[0]), ylim=(view.low[1], view.high[1]))
    if across.unit == up.unit:
        axes.set_aspect("equal")
    return view


def _fill(axes: Axes, grid: Sequence[Array], margin: Array, inside: Truth, i: int) -> None:
    """Draw the region of part i, where the margin (p_1, p_2) over the grid is known, and where psi holds."""
    colour, hatch = term_style(i)
    levels, fill = (0.5, 1.5), to_rgba(colour, REGION_ALPHA)
    filled = axes.contourf(*grid, inside.T.astype(float), levels=levels, colors=[fill], hatches=[hatch], zorder=1)
    filled.set_edgecolor(colour)  # of the hatch
    filled.set_linewidth(0)
    axes.contour(*grid, margin.T, levels=(0.0,), colors=[colour], linewidths=1.0, zorder=2)


def _around(places: Array, whole: View) -> View:
    """The part of the plane that has all places (p, 2), and a little more."""
    if not len(places):
        return whole
    low, high = places.min(axis=0), places.max(axis=0)
    pad = np.maximum(_PAD * (high - low), 0.01 * (whole.high - whole.low))
    return whole._replace(low=np.maximum(low - pad, whole.low), high=np.minimum(high + pad, whole.high))


def draw_traces(axes: Axes, task: Task, view: View, traces: Array) -> LineCollection:
    """Draw traces (N, T + 1, k) with marks where they start, end and leave the picture; the lines, for a colour bar."""
    places = traces[..., list(view.columns)]
    chosen = np.linspace(0, places.shape[1] - 1, min(_POINTS, places.shape[1])).round().astype(np.int64)
    points = places[:, chosen]
    segments = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 2)
    lines = LineCollection(list(segments), cmap=TIME, linewidths=0.9, zorder=4)
    lines.set_array(np.tile(chosen[:-1].astype(float), len(traces)))
    lines.set_clim(0, task.file.steps)
    axes.add_collection(lines)
    marks = [_START.artist(places[:, 0]), _END.artist(places[:, -1])]
    away = leaving(view, traces)
    if away.any():
        exits = np.array([trace[np.argmax(_outside(view, trace))] for trace in places[away]])
        marks.append(_LEAVES.artist(np.clip(exits, view.low, view.high)))
        marks[-1].set_clip_on(False)
    for zorder, mark in enumerate(marks, start=5):
        mark.set_zorder(zorder)
        axes.add_line(mark)
    return lines


def leaving(view: View, traces: Array) -> Truth:
    """(N,): which of the traces (N, T + 1, k) leave the picture, so that a part of them is not seen."""
    return np.asarray(_outside(view, traces[..., list(view.columns)]).any(axis=1))


def _outside(view: View, places: Array) -> Truth:
    """(..., 2) -> (...)."""
    return np.asarray(((places < view.low) | (places > view.high)).any(axis=-1))


def mark_keys(away: Truth) -> list[Artist]:
    """Entries of a legend for the marks of `draw_traces`; `away` (N,) says which traces leave the picture."""
    keys: list[Artist] = [_START.artist(_NOWHERE, "start"), _END.artist(_NOWHERE, "end")]
    if away.any():
        keys.append(_LEAVES.artist(_NOWHERE, f"leaves the picture here: {away.sum()} of {len(away)} traces"))
    return keys
