"""Robustness against time: each term's margin along the recorded traces, why a trace has its robustness, and the
best, the median and the worst start of a group.
"""

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from stlbench import stl
from stlbench.contract import Array, Intractable, Unsuitable
from stlbench.contract.presentation import Band, Banded
from stlbench.records.identity import Setting
from stlbench.records.result import MAIN, Result
from stlbench.registry.choices import Choice
from stlbench.report.figures import layout, plane
from stlbench.report.figures.regions import parts, rewarded_terms, robustness_unit, terms, time_label
from stlbench.report.figures.style import BOUNDS, MARK, SINGLE, TRACE, now, styled
from stlbench.report.figures.trajectories import signals_in_time, trajectories
from stlbench.report.tables.table import Column, Table, Value
from stlbench.simulation.faults import Ask, Question, answers
from stlbench.simulation.referee import Recording, gather, load
from stlbench.simulation.verdicts import Loss, first_loss, last_step, reason
from stlbench.stl import Term
from stlbench.task import build_method
from stlbench.task.task import Task, load_task

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
    term is read, and the method's band if it has one. An early end leaves a trace out from then on. `rewarded` draws
    the terms that methods see. If the `bands` are on other terms than these, the legend says so.
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
    low, high = min(low, float(np.nanmin(margins))), max(best, float(np.nanmax(margins)))
    threshold = layout.linear_threshold(best, max(-low, high)) if best > 0 else None
    if threshold is not None:
        label += f"\n{layout.set_symlog(axes, threshold, low, high)}"
    axes.set_title(
        textwrap.fill(str(term.formula), int(14.6 * now().width)), fontsize=now().small, loc="left", family="monospace"
    )
    axes.set_xlim(0, task.file.steps)
    axes.set_ylabel(label, fontsize=now().small)


def _traces(axes: Axes, margins: Array, term: Term, colour: str) -> None:
    """Margins (N, T + 1), NaN after an early end, which counts as the worst."""
    t, missing = np.arange(margins.shape[1]), np.isnan(margins)
    known = ~missing.all(axis=0)
    low, middle, high = np.nanpercentile(margins[:, known], (5, 50, 95), axis=0)
    axes.fill_between(t[known], low, high, color=colour, alpha=0.25, linewidth=0, zorder=3)
    read = np.where(missing, -np.inf, margins)[:, term.start : term.end + 1]
    order = np.argsort(read.min(axis=1) if term.kind == "G" else read.max(axis=1))
    for i in np.unique(np.linspace(0, len(order) - 1, _SINGLE_TRACES).round().astype(np.int64)):
        axes.plot(t, margins[order[i]], color=ONE_TRACE, linewidth=0.4, alpha=0.7, zorder=4)
    axes.plot(t[known], middle, color=colour, linewidth=1.3, zorder=5)


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


_PAPER = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1}  # behind a text, over the lines
_LETTERS = 90  # of a line in the legend
_PLANE = 2.6  # inches of the plane if it is below the rows, as in one column
_CLOSE = 8  # the row of the margin shows at most so many times the margin that decides


class Place(NamedTuple):
    step: int
    text: str  # the margin and the step, in words
    explanation: str  # for the legend
    witness: stl.Witness | None

    @property
    def predicate(self) -> stl.Predicate | None:
        """The predicate whose margin it is; None for `True`, and for an early end."""
        predicate = None if self.witness is None else self.witness.predicate
        return predicate if isinstance(predicate, stl.Predicate) else None


@styled
def counterexample(task: Task, trace: Array, witness: stl.Witness | None, title: str) -> Figure:
    """Draw a trace (t + 1, k) with the predicate and the step that its robustness comes from.

    One row for each signal, with the regions of the terms; below, the margin of the predicate at every step. If the
    task names a plane, it is on the right, or below in one column. Without a witness, an early end decides.
    """
    here, wide = place_of(task, trace, witness), task.file.plane is not None
    rows = len(task.signals) + (here.predicate is not None)
    side_by_side = wide and now().width > 2 * SINGLE
    figure = layout.figure_of(max(3.2, 1.2 + 1.1 * rows) + (_PLANE if wide and not side_by_side else 0.0))
    if side_by_side or not wide:
        grid = figure.add_gridspec(rows, 2 if wide else 1)
    else:
        grid = figure.add_gridspec(rows + 1, 1, height_ratios=[*[1.1] * rows, _PLANE])
    in_time = [figure.add_subplot(grid[row, 0]) for row in range(rows)]
    for axes in in_time[1:]:
        axes.sharex(in_time[0])
    drawn = set(_signals(in_time[: len(task.signals)], task, trace, here))
    if rows > len(task.signals):
        _margin(in_time[-1], task, trace, here)
    in_time[-1].set_xlabel(time_label(task))
    in_time[-1].tick_params(labelbottom=True)
    if wide:
        axes = figure.add_subplot(grid[:, 1] if side_by_side else grid[rows, 0])
        view = plane.lay_out(axes, task, trace[None])
        plane.draw_traces(axes, task, view, trace[None])
        axes.plot(*trace[here.step, list(view.columns)], "o", color=MARK, markersize=6, zorder=8, clip_on=False)
        drawn |= set(view.drawn)
    mark = layout.key_of(textwrap.fill(here.explanation, _LETTERS), linestyle="", marker="o", color=MARK, markersize=5)
    return layout.finish(figure, title, [mark, *(layout.term_patch(i, str(parts(task)[i])) for i in sorted(drawn))], 1)


def place_of(task: Task, trace: Array, witness: stl.Witness | None) -> Place:
    """The origin of the robustness of a trace (t + 1, k), from its witness; None if an early end decides it.

    An early end has the step at which the trace lost a conjunct, or else its last step.
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
    """Draw the rows of the signals; the parts of the formula that have a region there."""
    drawn = signals_in_time(rows, task, trace[None], color=TRACE, linewidth=1.0)
    read = task.signals if here.predicate is None else stl.signals(here.predicate)
    for axes, name, values in zip(rows, task.signals, trace.T, strict=True):
        axes.axvline(here.step, color=MARK, linewidth=0.9, linestyle="--", zorder=3)
        if name in read:
            axes.plot(here.step, values[here.step], "o", color=MARK, markersize=5, zorder=6)
        axes.set_xlabel("")
        axes.tick_params(labelbottom=False)
    return drawn


def _margin(axes: Axes, task: Task, trace: Array, here: Place) -> None:
    assert here.witness is not None
    predicate, step, margin = here.witness.predicate, here.step, here.witness.margin
    with np.errstate(all="ignore"):
        margins = np.broadcast_to(stl.margin(predicate, task.signals)(trace), len(trace))
    axes.axhline(0, color=layout.LEVEL, linewidth=0.9)
    axes.plot(margins, "-", color=TRACE, linewidth=1.0)
    axes.vlines(step, min(0.0, margin), max(0.0, margin), color=MARK, linewidth=1.8, zorder=5)
    axes.plot(step, margin, "o", color=MARK, markersize=5, zorder=6)
    early = step < task.file.steps / 2
    text = axes.annotate(here.text, (step, margin), (6 if early else -6, 6), textcoords="offset points")
    text.set(ha="left" if early else "right", color=MARK, fontsize=now().small, bbox=_PAPER, zorder=7)
    axes.margins(y=0.25)
    if 0 < _CLOSE * abs(margin) < np.abs(margins).max():
        axes.set_ylim(-_CLOSE * abs(margin), _CLOSE * abs(margin))
    axes.grid(alpha=0.25)
    axes.set_title(f"margin of {predicate}", fontsize=now().small, loc="left", family="monospace")
    axes.set_ylabel(f"margin\n[{robustness_unit(task, predicate)}]")


@dataclass(frozen=True)
class Story:
    recording: Recording  # all traces
    picks: tuple[int, ...]
    """The places of the best, the median and the worst start in the traces; a single start has one place."""
    cell: str  # the cell of the worst start
    start: int  # the number of the worst start among the report's starts
    robustness: float  # of the worst start
    place: Place  # the origin of this robustness
    loss: Loss | None  # what the worst start lost first; None if it satisfies

    @property
    def worst(self) -> Array:
        """The trace of the worst start, as far as it was recorded: (t + 1, k)."""
        trace: Array = self.recording.traces[self.picks[-1]]
        return trace[: last_step(trace) + 1]


def tell_story(task: Task, results: Sequence[Result], folder: Path) -> Story | None:
    """Read the traces of finished cells that have values of single starts; None if no result has any.

    Raises `UsageError` if the file of the traces is missing, or of another version of the task.
    """
    told = [(each, own) for each in results if each.measurement and (own := each.measurement.selected[MAIN].robustness)]
    starts = [(value, each.id.name, start) for each, own in told for start, value in enumerate(own)]
    if not starts:
        return None
    recording = gather([load(task, each, folder) for each, _ in told])
    ranked = sorted(range(len(starts)), key=lambda row: starts[row][0])
    picks = tuple(dict.fromkeys((ranked[-1], ranked[len(ranked) // 2], ranked[0])))
    value, cell, start = starts[ranked[0]]
    trace = recording.traces[ranked[0]]
    loss = first_loss(task, trace) if value <= 0 else None
    place = place_of(task, trace[: last_step(trace) + 1], reason(task, trace))
    return Story(recording, picks, cell, start, value, place, loss)


def figures_of(task: Task, story: Story, bands: Sequence[Band], name: str, colour: str) -> list[tuple[str, Figure]]:
    picked = replace(story.recording, traces=story.recording.traces[list(story.picks)])
    in_time = robustness_in_time(task, story.recording, bands, name, colour=colour)
    why = counterexample(
        task, story.worst, story.place.witness, f"{name}: worst start, robustness {story.robustness:.4g}"
    )
    return [
        (f"{name}: the best, the median and the worst start", trajectories(task, picked, name, colour)),
        *([(f"{name}: margin of each term against time; a term holds above 0", in_time)] if in_time else []),
        (f"{name}: why the worst start has robustness {story.robustness:.4g}: {story.place.explanation}", why),
    ]


def worst_table(stories: Mapping[Setting, Story]) -> Table:
    columns: dict[Column, Callable[[tuple[Setting, Story]], Value]] = {
        Column("method", right=False): lambda row: str(row[0].method),
        Column("agent", right=False, shared=True): lambda row: str(row[0].agent),
        Column("budget", right=False, shared=True): lambda row: row[0].budget,
        Column("track", right=False, shared=True): lambda row: row[0].track,
        Column("worst start", right=False): lambda row: f"{row[1].cell}, start {row[1].start}",
        Column("robustness", digits=3): lambda row: row[1].robustness,
        Column("lost first", right=False): lambda row: (loss := row[1].loss) and str(loss.conjunct),
        Column("lost at step"): lambda row: (loss := row[1].loss) and loss.step,
        Column("decided by", right=False): (
            lambda row: "an early end" if (why := row[1].place.witness) is None else str(why.predicate)
        ),
        Column("at step"): lambda row: row[1].place.step,
        Column("margin", digits=3): lambda row: why.margin if (why := row[1].place.witness) else None,
    }
    notes = (
        "The report's start with the least robustness, over the selected policies of all seeds.",
        "Lost first: the part of the formula that nothing could satisfy any more from that step on. Decided by: the "
        "predicate whose margin at that step is the robustness.",
    )
    return Table.of("Worst start of each method, and why", stories.items(), columns, notes)
