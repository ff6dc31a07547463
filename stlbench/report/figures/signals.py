"""Signals against time: one row per signal, with the interval of each term and the values with which it can hold."""

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
from stlbench.report.figures.regions import region, terms
from stlbench.report.figures.units import time_label
from stlbench.stl import Term
from stlbench.task.task import Task

__all__ = ["READ", "Read", "readings", "signals_in_time"]

READ = "0.92"
"""The grey of the steps that a term reads."""


class Read(NamedTuple):
    """That a term reads a signal."""

    row: int
    """Which signal."""
    place: int
    """Which term."""
    term: Term
    ranges: list[tuple[float, float]]
    """Values of the signal with which the term can hold."""


def readings(task: Task) -> Iterator[Read]:
    """Which signals the terms read, as far as that can be drawn."""
    for row, (name, signal) in enumerate(task.file.signals.items()):
        grid = np.linspace(signal.low, signal.high, 1001)
        for i, term in enumerate(terms(task)):
            found = region(task, term.psi, (grid,), (name,)) if name in stl.signals(term.psi) else None
            if found is not None:
                yield Read(row, i, term, [(float(grid[first]), float(grid[last])) for first, last in _runs(found[1])])


def signals_in_time(rows: Sequence[Axes], task: Task) -> list[int]:
    """Lay out one row per signal: where each term is read, and for which values of the signal it can hold then.

    Returns:
        Indices of the terms that have a region in some row.
    """
    drawn = set()
    for row, i, term, ranges in readings(task):
        drawn.add(i)
        rows[row].axvspan(term.start, term.end, color=READ, linewidth=0, zorder=0)
        colour, hatch = term_style(i)
        for low, high in ranges:
            corner, size = (term.start, low), (term.end - term.start, high - low)
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
