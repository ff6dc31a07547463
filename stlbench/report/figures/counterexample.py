"""One trace and why it has its robustness: signals against time, the margin that decides, and the plane."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from stlbench import stl
from stlbench.contract import Array
from stlbench.report.figures import layout, plane
from stlbench.report.figures.palette import MARK, TRACE
from stlbench.report.figures.regions import parts, signals_in_time
from stlbench.report.figures.style import SINGLE, small, styled, width
from stlbench.report.figures.units import robustness_unit, signal_label, time_label
from stlbench.rollout.reasons import first_loss
from stlbench.task.task import Task

_PAPER = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}
"""Behind a text that would else be crossed by lines."""
_LETTERS = 90
"""Of a line in the legend."""
_PLANE = 2.6
"""Inches of the plane where it stands below the rows, as in one column."""
_CLOSE = 8
"""The row of the margin shows at most so many times the margin that decides; what is beyond leaves the picture."""


class Place(NamedTuple):
    """Where the robustness comes from."""

    step: int
    text: str
    """The margin and the step, in words."""
    explanation: str
    """For the legend."""
    witness: stl.Witness | None

    @property
    def predicate(self) -> stl.Predicate | None:
        """Whose margin it is; none where it is that of `True`, or of an early end."""
        predicate = None if self.witness is None else self.witness.predicate
        return predicate if isinstance(predicate, stl.Predicate) else None


@styled
def counterexample(task: Task, trace: Array, witness: stl.Witness | None, title: str) -> Figure:
    """Draw a trace with the predicate and the step that its robustness comes from.

    One row per signal, with the regions of the terms; below, the margin of the predicate at every step. Where the task
    names a plane, it is drawn beside them, or below in one column.

    Args:
        task: what was tried.
        trace: (t + 1, k), as far as it was recorded: T + 1 samples, or fewer after an early end.
        witness: of the robustness; None where the early end decides it.
        title: of the figure.
    """
    here, wide = place_of(task, trace, witness), task.file.plane is not None
    rows = len(task.signals) + (here.predicate is not None)
    side_by_side = wide and width() > 2 * SINGLE
    tall = max(3.2, 1.2 + 1.1 * rows) + (_PLANE if wide and not side_by_side else 0.0)
    figure = Figure(figsize=(width(), tall), layout="constrained")
    if side_by_side or not wide:
        grid = figure.add_gridspec(rows, 2 if wide else 1)
    else:
        grid = figure.add_gridspec(rows + 1, 1, height_ratios=[*[1.1] * rows, _PLANE])
    in_time = [figure.add_subplot(grid[0, 0])]
    in_time += [figure.add_subplot(grid[row, 0], sharex=in_time[0]) for row in range(1, rows)]
    drawn = set(_signals(in_time[: len(task.signals)], task, trace, here))
    if rows > len(task.signals):
        _margin(in_time[-1], task, trace, here)
    in_time[-1].set_xlabel(time_label(task))
    in_time[-1].tick_params(labelbottom=True)
    if wide:
        drawn |= set(_plane(figure.add_subplot(grid[:, 1] if side_by_side else grid[rows, 0]), task, trace, here))
    layout.title(figure, title)
    keys = _keys(task, sorted(drawn), here)
    layout.legend(figure, keys, 1)
    return figure


def place_of(task: Task, trace: Array, witness: stl.Witness | None) -> Place:
    """Where the robustness of a trace (t + 1, k) comes from, with its witness; None where an early end decides it.

    Then it is where the trace lost a conjunct, if it had lost any, or its end.
    """
    loss = first_loss(task, trace) if witness is None else None
    step = witness.step if witness else loss.step if loss else len(trace) - 1
    at = f"at step {step} ({step * task.file.sampling_time:.3g} s)"
    if witness is None:
        return Place(step, at, f"{loss.conjunct}: lost {at}" if loss else f"ended early, {at}", None)
    predicate = f"{'not ' if witness.sign < 0 else ''}{witness.predicate}"
    text = f"{witness.margin:.3g} {at}"
    return Place(step, text, f"{predicate}: margin {text}, in {witness.conjunct}", witness)


def _signals(rows: Sequence[Axes], task: Task, trace: Array, here: Place) -> list[int]:
    """The rows of the signals; which parts of the formula have a region there."""
    drawn, predicate = signals_in_time(rows, task), here.predicate
    read = task.signals if predicate is None else stl.signals(predicate)
    for axes, name, values in zip(rows, task.signals, trace.T, strict=True):
        axes.plot(values, "-", color=TRACE, linewidth=1.0, zorder=4)
        axes.axvline(here.step, color=MARK, linewidth=0.9, linestyle="--", zorder=3)
        if name in read:
            axes.plot(here.step, values[here.step], "o", color=MARK, markersize=5, zorder=6)
        axes.set_ylabel(signal_label(task, name))
        axes.set_xlabel("")
        axes.tick_params(labelbottom=False)
    return drawn


def _margin(axes: Axes, task: Task, trace: Array, here: Place) -> None:
    """The row of the predicate's margin, with the one that decides."""
    assert here.witness is not None
    predicate, step, margin = here.witness.predicate, here.step, here.witness.margin
    margins = margins_of(task, predicate, trace)
    axes.axhline(0, color=layout.LEVEL, linewidth=0.9)
    axes.plot(margins, "-", color=TRACE, linewidth=1.0)
    axes.vlines(step, min(0.0, margin), max(0.0, margin), color=MARK, linewidth=1.8, zorder=5)
    axes.plot(step, margin, "o", color=MARK, markersize=5, zorder=6)
    early = step < task.file.steps / 2
    text = axes.annotate(here.text, (step, margin), (6 if early else -6, 6), textcoords="offset points")
    text.set(ha="left" if early else "right", color=MARK, fontsize=small(), bbox=_PAPER, zorder=7)
    axes.margins(y=0.25)
    if 0 < _CLOSE * abs(margin) < np.abs(margins).max():
        axes.set_ylim(-_CLOSE * abs(margin), _CLOSE * abs(margin))
    axes.grid(alpha=0.25)
    axes.set_title(f"margin of {predicate}", fontsize=small(), loc="left", family="monospace")
    axes.set_ylabel(f"margin\n[{robustness_unit(task, predicate)}]")


def margins_of(task: Task, predicate: stl.Predicate | stl.TrueFormula, trace: Array) -> Array:
    """The margin of a predicate at every step of a trace (t + 1, k): (t + 1,)."""
    with np.errstate(all="ignore"):
        return np.broadcast_to(stl.margin(predicate, task.signals)(trace), len(trace))


def _plane(axes: Axes, task: Task, trace: Array, here: Place) -> tuple[int, ...]:
    """The plane; which parts of the formula have a region there."""
    view = plane.lay_out(axes, task, trace[None])
    plane.draw_traces(axes, task, view, trace[None])
    axes.plot(*trace[here.step, list(view.columns)], "o", color=MARK, markersize=6, zorder=8, clip_on=False)
    return view.drawn


def _keys(task: Task, drawn: Sequence[int], here: Place) -> list[Artist]:
    text, named = textwrap.fill(here.explanation, _LETTERS), parts(task)
    mark = Line2D([], [], linestyle="", marker="o", color=MARK, markersize=5, label=text)
    return [mark, *(layout.term_patch(i, str(named[i])) for i in drawn)]
