"""What the policies of one group did: the best, the median and the worst start, and why the worst is as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from matplotlib.figure import Figure

from stlbench.contract import Array
from stlbench.contract.presentation import Band
from stlbench.records.identity import Setting
from stlbench.records.result import MAIN, Result
from stlbench.report.figures.counterexample import Place, counterexample, place_of
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.trajectories import trajectories
from stlbench.report.tables.table import Column, Table
from stlbench.rollout.reasons import Loss, first_loss, last_step, reason
from stlbench.rollout.traces import Recording, gather, load
from stlbench.task.task import Task


@dataclass(frozen=True)
class Story:
    """Of the selected policies of all seeds of a group."""

    recording: Recording
    """All traces."""
    picks: tuple[int, ...]
    """Which of them are the best, the median and the worst start, in this order; of a single start, that one."""
    cell: str
    """Of the worst start."""
    start: int
    """Which of the report's starts is the worst."""
    robustness: float
    """From there."""
    place: Place
    """Where this robustness comes from."""
    loss: Loss | None
    """What the worst start lost first; None where it satisfies."""

    @property
    def worst(self) -> Array:
        """The trace of the worst start, as far as it was recorded: (t + 1, k)."""
        trace: Array = self.recording.traces[self.picks[-1]]
        return trace[: last_step(trace) + 1]


def tell_story(task: Task, results: Sequence[Result], folder: Path) -> Story | None:
    """Read the traces of finished cells; None where no result has values of single starts.

    Raises `UsageError` where there is no file of the traces, or one of another version of the task.
    """
    starts = [
        (value, result.id.name, start)
        for result in results
        if result.measurement is not None
        for start, value in enumerate(result.measurement.selected[MAIN].robustness)
    ]
    if not starts:
        return None
    recording = gather([load(task, result, folder) for result in results])
    ranked = sorted(range(len(starts)), key=lambda row: starts[row][0])
    picks = tuple(dict.fromkeys((ranked[-1], ranked[len(ranked) // 2], ranked[0])))
    value, cell, start = starts[ranked[0]]
    trace = recording.traces[ranked[0]]
    loss = first_loss(task, trace) if value <= 0 else None
    place = place_of(task, trace[: last_step(trace) + 1], reason(task, trace))
    return Story(recording, picks, cell, start, value, place, loss)


def figures_of(task: Task, story: Story, bands: Sequence[Band], name: str, colour: str) -> list[tuple[str, Figure]]:
    """The figures of a story, each with what it shows."""
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
    """Which part of the formula failed, when, by how much."""
    columns = (
        Column("method", right=False),
        *(Column(title, right=False, shared=True) for title in ("agent", "budget", "track")),
        Column("worst start", right=False),
        Column("robustness", digits=3),
        Column("lost first", right=False),
        Column("lost at step"),
        Column("decided by", right=False),
        Column("at step"),
        Column("margin", digits=3),
    )
    rows = tuple(
        (
            *(str(setting.method), str(setting.agent), setting.budget, setting.track),
            *(f"{story.cell}, start {story.start}", story.robustness),
            *((None, None) if story.loss is None else (str(story.loss.conjunct), story.loss.step)),
            "an early end" if (why := story.place.witness) is None else str(why.predicate),
            *(story.place.step, None if why is None else why.margin),
        )
        for setting, story in stories.items()
    )
    notes = (
        "Of the selected policies of all seeds, the report's start with the least robustness.",
        "Lost first: the part of the formula that nothing could satisfy any more from that step on. Decided by: the "
        "predicate whose margin at that step is the robustness.",
    )
    return Table("Worst start of each method, and why", columns, rows, notes)
