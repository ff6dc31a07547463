"""The plane of two signals: the regions of the parts of a task's formula, and traces coloured by time."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D

from stlbench.contract import Array, Truth
from stlbench.report.figures import layout
from stlbench.report.figures.regions import parts, region, signal_label
from stlbench.report.figures.style import TIME, term_style
from stlbench.simulation.verdicts import last_steps
from stlbench.stl import signals
from stlbench.task.task import Task

_POINTS = 150  # points of a trace, each with a colour of its own
_GRID = 201
_PAD = 0.06
_START, _END, _LEAVES = tuple[dict[str, Any], ...](
    {"linestyle": "", "marker": marker, "color": colour, "markeredgecolor": edge, "markeredgewidth": 0.7, "ms": size}
    for marker, colour, edge, size in (
        ("o", "white", "black", 4),
        ("s", "black", "black", 3),
        ("X", "black", "white", 6),
    )
)


class View(NamedTuple):
    columns: tuple[int, int]  # of the signals across and up
    low: Array  # (2,): the lower left corner
    high: Array  # (2,): the upper right corner
    drawn: tuple[int, ...]  # indices of the parts that have a region in the plane


def lay_out(axes: Axes, task: Task, traces: Array, *, whole: bool = False) -> View:
    """Lay out the plane of a task that names one, with the regions of its formula's parts.

    It shows the regions and the traces (N, T + 1, k), as far as these stay in the ranges of the signals, or the `whole`
    of these ranges.
    """
    assert task.file.plane is not None
    names = task.file.plane
    across, up = (task.file.signals[name] for name in names)
    columns = (task.signals.index(names[0]), task.signals.index(names[1]))
    ranges = View(columns, np.array([across.low, up.low]), np.array([across.high, up.high]), ())
    grid = _grid(ranges)
    places = traces[..., list(columns)].reshape(-1, 2)
    known = places[np.isfinite(places).all(axis=1)]  # samples after an early end are NaN
    visible, drawn = [known[~_outside(ranges, known)]], list[int]()
    for i, part in enumerate(parts(task)):
        if (found := region(task, part.psi, grid, names)) is not None:
            margin, inside = found
            _fill(axes, grid, margin, inside, i)
            at = zip(grid, inside.nonzero(), strict=True)
            visible.append(np.column_stack([values[index] for values, index in at]))
            drawn.append(i)
    view = (ranges if whole else _around(np.concatenate(visible), ranges))._replace(drawn=tuple(drawn))
    axes.set(xlabel=signal_label(task, names[0]), ylabel=signal_label(task, names[1]))
    axes.set(xlim=(view.low[0], view.high[0]), ylim=(view.low[1], view.high[1]))
    if across.unit == up.unit:
        axes.set_aspect("equal")
    return view


def _grid(view: View) -> list[Array]:
    return [np.linspace(low, high, _GRID) for low, high in zip(view.low, view.high, strict=True)]


class Moving:
    """The region of a part that reads more signals than a plane shows, as these are at a sample of a trace."""

    def __init__(self, axes: Axes, task: Task, view: View, i: int) -> None:
        assert task.file.plane is not None
        self.task, self.names, self.grid, self.psi = task, task.file.plane, _grid(view), parts(task)[i].psi
        self.colour = to_rgba(term_style(i)[0], layout.REGION_ALPHA)
        extent = (view.low[0], view.high[0], view.low[1], view.high[1])
        self.image = axes.imshow(np.zeros((1, 1, 4)), extent=extent, origin="lower", aspect=axes.get_aspect(), zorder=1)

    def show(self, sample: Array) -> None:
        """Show the region at a sample (k,)."""
        found = region(self.task, self.psi, self.grid, self.names, sample)
        assert found is not None  # `moving` chose parts that have one
        self.image.set_data(found[1].T[..., None] * np.array(self.colour))


def moving(axes: Axes, task: Task, view: View) -> dict[int, Moving]:
    """Those of the parts without a region in the view that read one of its signals, by their indices."""
    names = set(task.file.plane or ())
    rest = (i for i, part in enumerate(parts(task)) if i not in view.drawn and names & set(signals(part.psi)))
    return {i: Moving(axes, task, view, i) for i in rest}


def _fill(axes: Axes, grid: Sequence[Array], margin: Array, inside: Truth, i: int) -> None:
    """Draw the region of part i, from the margin and the truth (p_1, p_2) over the grid."""
    colour, hatch = term_style(i)
    levels, fill = (0.5, 1.5), to_rgba(colour, layout.REGION_ALPHA)
    filled = axes.contourf(*grid, inside.T.astype(float), levels=levels, colors=[fill], hatches=[hatch], zorder=1)
    filled.set(edgecolor=colour, linewidth=0)  # the edge is the colour of the hatch
    axes.contour(*grid, margin.T, levels=(0.0,), colors=[colour], linewidths=1.0, zorder=2)


def _around(places: Array, whole: View) -> View:
    """The part of the plane that has all places (p, 2), with a margin."""
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
    axes.add_line(Line2D(*places[:, 0].T, zorder=5, **_START))
    axes.add_line(Line2D(*places[np.arange(len(traces)), last_steps(traces)].T, zorder=6, **_END))
    away = leaving(view, traces)
    if away.any():
        exits = np.array([trace[np.argmax(_outside(view, trace))] for trace in places[away]])
        axes.add_line(Line2D(*np.clip(exits, view.low, view.high).T, zorder=7, clip_on=False, **_LEAVES))
    return lines


def leaving(view: View, traces: Array) -> Truth:
    """(N,): which of the traces (N, T + 1, k) leave the picture."""
    return np.asarray(_outside(view, traces[..., list(view.columns)]).any(axis=1))


def _outside(view: View, places: Array) -> Truth:
    """(..., 2) -> (...)."""
    return np.asarray(((places < view.low) | (places > view.high)).any(axis=-1))


def mark_keys(away: Truth) -> list[Artist]:
    """Entries of a legend for the marks of `draw_traces`; `away` (N,) says which traces leave the picture."""
    keys: list[Artist] = [layout.key_of("start", **_START), layout.key_of("end", **_END)]
    if away.any():
        keys.append(layout.key_of(f"leaves the picture here: {away.sum()} of {len(away)} traces", **_LEAVES))
    return keys
