"""Robustness against time: each term's margin along the recorded traces, in the term's interval and in its funnel."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from stlbench.contract import Array
from stlbench.presentation import Band
from stlbench.report.figures.drawing import COLOURS
from stlbench.report.figures.regions import terms
from stlbench.rollout.traces import Recording
from stlbench.stl import Term
from stlbench.task.task import Task

__all__ = ["robustness_in_time"]

TRACE, FUNNEL = COLOURS[0], COLOURS[1]
_SINGLE = 7
"""Traces that are drawn one by one, from the worst to the best of the term's interval."""
_WIDE = 4.0
"""Where the margins go that many times further below 0 than above, the axis is logarithmic below."""


def robustness_in_time(task: Task, recording: Recording, bands: Sequence[Band], title: str) -> Figure | None:
    """One row a term: the margin of its psi at each step; None where the formula is not made of terms.

    Drawn are the median over starts and seeds, the range of the middle 90 %, some single traces, the steps at which the
    term is read, and the method's band where it has one. Terms are those that methods are told, so that a band and the
    margins have one unit.
    """
    rows = terms(task)
    if not rows:
        return None
    figure = Figure(figsize=(9.0, 1.3 + 2.5 * len(rows)), layout="constrained")
    by_term = {band.term: band for band in bands}
    for axes, term in zip(figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0], rows, strict=True):
        margins = task.specification.margin(term.psi)(recording.traces)
        axes.axvspan(term.start, term.end, color="0.88", linewidth=0, zorder=0)
        axes.axhline(0, color="0.25", linewidth=0.9, zorder=1)
        if term in by_term:
            _band(axes, by_term[term])
        _traces(axes, margins, term)
        low, high = task.specification.range(term.psi)
        _scale(axes, min(low, float(margins.min())), high)
        axes.set_title(textwrap.fill(str(term.formula), 105), fontsize=9, loc="left", family="monospace")
        axes.set_xlim(0, task.file.steps)
        axes.set_ylabel("robustness of psi\n[its unit]", fontsize=9)
    axes.set_xlabel(f"time [steps of {task.file.sampling_time:g} s]")
    count = f"{len(recording.traces)} traces" + (f", {recording.seeds} seeds" if recording.seeds > 1 else "")
    figure.suptitle(f"{title}: robustness against time ({count})", fontsize=11)
    _key(figure, bool(by_term))
    return figure


def _traces(axes: Axes, margins: Array, term: Term) -> None:
    """Margins (N, T + 1)."""
    t = np.arange(margins.shape[1])
    low, middle, high = np.percentile(margins, (5, 50, 95), axis=0)
    axes.fill_between(t, low, high, color=TRACE, alpha=0.25, linewidth=0, zorder=3)
    read = margins[:, term.start : term.end + 1]
    order = np.argsort(read.min(axis=1) if term.kind == "G" else read.max(axis=1))
    for i in np.unique(np.linspace(0, len(order) - 1, _SINGLE).round().astype(np.int64)):
        axes.plot(t, margins[order[i]], color="0.35", linewidth=0.5, alpha=0.7, zorder=4)
    axes.plot(t, middle, color=TRACE, linewidth=1.8, zorder=5)


def _band(axes: Axes, band: Band) -> None:
    t = np.arange(band.start, band.start + len(band.lower))
    axes.fill_between(t, band.lower, band.upper, color=FUNNEL, alpha=0.12, linewidth=0, zorder=1)
    for bound in (band.lower, band.upper):
        axes.plot(t, bound, "--", color=FUNNEL, linewidth=1.4, zorder=6)


def _scale(axes: Axes, low: float, high: float) -> None:
    """From low to high: linear, or logarithmic below -high where that is much longer below 0 than above."""
    if not (np.isfinite([low, high]).all() and 0 < _WIDE * high < -low):
        return
    axes.set_yscale("symlog", linthresh=high, linscale=0.8)
    decades = int(np.ceil(np.log10(-low / high)))
    ticks = [-high * 10.0**k for k in range(decades, -1, -1)] + [0.0, high]
    axes.set_yticks(ticks, [f"{tick:.3g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set_ylim(1.3 * low, 1.4 * high)


def _key(figure: Figure, banded: bool) -> None:
    marks = [
        Line2D([], [], color=TRACE, linewidth=1.8, label="median"),
        Patch(color=TRACE, alpha=0.25, linewidth=0, label="5 to 95 %"),
        Line2D([], [], color="0.35", linewidth=0.5, label="single traces"),
        Patch(color="0.88", linewidth=0, label="steps that the term reads"),
    ]
    if banded:
        marks.append(Line2D([], [], color=FUNNEL, linestyle="--", linewidth=1.4, label="the method's bounds"))
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9)
