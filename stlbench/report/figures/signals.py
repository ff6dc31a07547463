"""Signals against time, one row per signal: when parts of the formula are read, and with which values they can hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from stlbench import stl
from stlbench.contract import Truth
from stlbench.report.figures.layout import REGION_ALPHA
from stlbench.report.figures.palette import term_style
from stlbench.report.figures.parts import Part, parts
from stlbench.report.figures.regions import region
from stlbench.report.figures.units import time_label
from stlbench.task.task import Task

READ = "0.92"
"""The grey of the steps at which a part of the formula is read."""


class Read(NamedTuple):
    """That a part of the formula reads a signal."""

    row: int
    """Which signal."""
    place: int
    """Which part."""
    part: Part
    ranges: list[tuple[float, float]]
    """Values of the signal with which the part can hold."""


def readings(task: Task) -> Iterator[Read]:
    """Which signals the parts read, as far as that can be drawn."""
    for row, (name, signal) in enumerate(task.file.signals.items()):
        grid = np.linspace(signal.low, signal.high, 1001)
        for i, part in enumerate(parts(task)):
            found = region(task, part.psi, (grid,), (name,)) if name in stl.signals(part.psi) else None
            if found is not None:
                yield Read(row, i, part, [(float(grid[first]), float(grid[last])) for first, last in _runs(found[1])])


def signals_in_time(rows: Sequence[Axes], task: Task) -> list[int]:
    """Lay out one row per signal: when each part of the formula is read, and with which values it can hold then.

    Returns:
        Indices of the parts that have a region in some row.
    """
    drawn = set()
    for row, i, part, ranges in readings(task):
        drawn.add(i)
        rows[row].axvspan(part.start, part.end, color=READ, linewidth=0, zorder=0)
        colour, hatch = term_style(i)
        for low, high in ranges:
            corner, size = (part.start, low), (part.end - part.start, high - low)
            fill = to_rgba(colour, 2 * REGION_ALPHA)
            rows[row].add_patch(Rectangle(corner, *size, facecolor=fill, edgecolor=colour, hatch=hatch, zorder=1))
    for axes in rows:
        axes.set_xlim(0, task.file.steps)
        axes.grid(alpha=0.25)
    rows[-1].set_xlabel(time_label(task))
    return sorted(drawn)


def _runs(truth: Truth) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], truth, [False]]).astype(np.int8)))
    return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]
