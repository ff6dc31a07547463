"""Robustness against time: each term's margin along the recorded traces, in its interval and in the method's bounds."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stlbench.contract import Array, Intractable, Unsuitable
from stlbench.contract.presentation import Band, Banded
from stlbench.registry.choices import Choice
from stlbench.report.figures import layout
from stlbench.report.figures.regions import rewarded_terms, robustness_unit, terms, time_label
from stlbench.report.figures.style import BOUNDS, SINGLE, TRACE, now, styled
from stlbench.rollout.questions import Ask, Question, answers
from stlbench.rollout.traces import Recording
from stlbench.stl import Term
from stlbench.task import build_method, load_task
from stlbench.task.task import Task

ONE_TRACE, READ = "0.45", "0.88"
_SINGLE_TRACES = 7  # traces that are drawn one by one, from the worst to the best of the term's interval
BAND_ELSEWHERE = "the method's bounds are of the rewarded form: `stlbench plot --rewarded`"


@styled
def robustness_in_time(
    task: Task,
    recording: Recording,
    bands: Sequence[Band],
    title: str,
    *,
    rewarded: bool = False,
    colour: str = TRACE,
) -> Figure | None:
    """One row for each term: the margin of its psi at each step; None if the formula is not made of terms.

    A row has the median over starts and seeds, the range of the middle 90 %, some single traces, the steps at which the
    term is read, and the method's band if it has one. `rewarded` draws the terms that methods see. If the `bands` are
    on other terms than these, the legend says so.
    """
    rows = rewarded_terms(task) if rewarded else terms(task)
    if not rows:
        return None
    figure = layout.figure_of(1.0 + (1.6 if now().width > 2 * SINGLE else 2.4) * len(rows))
    by_term = {band.term: band for band in bands} if rewarded or task.file.rewarded is None else {}
    for axes, term in zip(figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0], rows, strict=True):
        unit = "rewarded form, no unit" if rewarded else robustness_unit(task, term.psi)
        _row(axes, task, term, recording.traces, by_term.get(term), unit, colour)
    axes.set_xlabel(time_label(task))
    count = f"{len(recording.traces)} traces" + (f", {recording.seeds} seeds" if recording.seeds > 1 else "")
    form = " of the rewarded form" if rewarded else ""
    return layout.finish(
        figure, f"{title}: robustness{form} against time ({count})", _keys(bands, bool(by_term), colour), 3
    )


def _row(axes: Axes, task: Task, term: Term, traces: Array, band: Band | None, unit: str, colour: str) -> None:
    margins = task.specification.margin(term.psi)(traces)
    axes.axvspan(term.start, term.end, color=READ, linewidth=0, zorder=0)
    axes.axhline(0, color=layout.LEVEL, linewidth=0.7, zorder=1)
    if band is not None:
        t = np.arange(band.start, band.start + len(band.lower))
        axes.fill_between(t, band.lower, band.upper, color=BOUNDS, alpha=0.12, linewidth=0, zorder=1)
        for bound in (band.lower, band.upper):
            axes.plot(t, bound, "--", color=BOUNDS, linewidth=1.1, zorder=6)
    _traces(axes, margins, term, colour)
    label = f"robustness of psi\n[{unit}]"
    low, best = task.specification.range(term.psi)
    low, high = min(low, float(margins.min())), max(best, float(margins.max()))
    threshold = layout.linear_threshold(best, max(-low, high)) if best > 0 else None
    if threshold is not None:
        label += f"\n{layout.set_symlog(axes, threshold, low, high)}"
    axes.set_title(
        textwrap.fill(str(term.formula), int(14.6 * now().width)), fontsize=now().small, loc="left", family="monospace"
    )
    axes.set_xlim(0, task.file.steps)
    axes.set_ylabel(label, fontsize=now().small)


def _traces(axes: Axes, margins: Array, term: Term, colour: str) -> None:
    """Margins (N, T + 1)."""
    t = np.arange(margins.shape[1])
    low, middle, high = np.percentile(margins, (5, 50, 95), axis=0)
    axes.fill_between(t, low, high, color=colour, alpha=0.25, linewidth=0, zorder=3)
    read = margins[:, term.start : term.end + 1]
    order = np.argsort(read.min(axis=1) if term.kind == "G" else read.max(axis=1))
    for i in np.unique(np.linspace(0, len(order) - 1, _SINGLE_TRACES).round().astype(np.int64)):
        axes.plot(t, margins[order[i]], color=ONE_TRACE, linewidth=0.4, alpha=0.7, zorder=4)
    axes.plot(t, middle, color=colour, linewidth=1.3, zorder=5)


def _keys(bands: Sequence[Band], shown: bool, colour: str) -> list[Artist]:
    keys: list[Artist] = [
        layout.key_of("median", color=colour, linewidth=1.3),
        layout.patch(colour, "5 to 95 %", alpha=0.25),
        layout.key_of("single traces", color=ONE_TRACE, linewidth=0.5),
        layout.patch(READ, "steps that the term reads"),
        layout.level_key("0: psi holds above"),
    ]
    if shown:
        keys.append(layout.key_of("the method's bounds", color=BOUNDS, linestyle="--", linewidth=1.1))
    elif bands:
        keys.append(layout.absent_patch(BAND_ELSEWHERE))
    return keys


def bands_of(task: Choice, methods: Iterable[Choice], ask: Ask) -> Mapping[Choice, Sequence[Band]]:
    """The bounds of each method on a task; empty for a method that is not installed.

    A `PluginWarning` says why a method did not answer.
    """
    questions = dict[Choice, Question[tuple[Band, ...]]]()
    for method in methods:
        plugins, why = (("tasks", task.name), ("methods", method.name)), "cannot be asked for its bounds"
        questions[method] = Question(_bands, (task, method), plugins, f"task {task}: method {method} {why}")
    bounds = answers(list(questions.values()), ask)
    return {method: bounds.get(question, ()) for method, question in questions.items()}


def _bands(task: Choice, method: Choice) -> tuple[Band, ...]:
    """Empty for a method that has none, or that does not fit."""
    try:
        built = build_method(load_task(task), method)
    except (Unsuitable, Intractable):
        return ()
    bands = built.band() if isinstance(built, Banded) else ()
    plain = ([np.asarray(bound, dtype=np.float64) for bound in (band.lower, band.upper)] for band in bands)
    return tuple(Band(band.term, int(band.start), *bounds) for band, bounds in zip(bands, plain, strict=True))
