"""What the policies of one group did: the best, the median and the worst start, and why the worst is as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stlbench.contract import Array
from stlbench.records.result import MAIN, Result
from stlbench.report.figures.counterexample import Place, place_of
from stlbench.rollout.reasons import Loss, first_loss, last_step, reason
from stlbench.rollout.traces import load
from stlbench.task.task import Task


@dataclass(frozen=True)
class Pick:
    """One trace of the report."""

    what: str
    """best, median or worst."""
    cell: str
    start: int
    """Which of the report's starts."""
    robustness: float
    trace: Array
    """(t + 1, k), as far as it was recorded."""


@dataclass(frozen=True)
class Story:
    """Of the selected policies of all seeds of a group."""

    picks: tuple[Pick, ...]
    """The worst is the last; fewer than three where there are not so many starts."""
    starts: int
    """Among how many starts, of all seeds."""
    place: Place
    """Where the robustness of the worst comes from."""
    loss: Loss | None
    """What the worst lost first; None where it satisfies."""

    @property
    def worst(self) -> Pick:
        """The start with the least robustness."""
        return self.picks[-1]


def tell_story(task: Task, results: Sequence[Result], folder: Path) -> Story | None:
    """Read the traces that it takes; None where no result has values of single starts.

    Raises `UsageError` where there is no file of the traces, or one of another version of the task.
    """
    ranked = sorted(
        (value, i, start)
        for i, result in enumerate(results)
        if result.measurement is not None
        for start, value in enumerate(result.measurement.selected[MAIN].robustness)
    )
    if not ranked:
        return None
    places = {"best": len(ranked) - 1, "median": len(ranked) // 2, "worst": 0}
    kept = {place: what for what, place in places.items()}  # of a single start it is the worst
    loaded = dict[int, Array]()
    picks = list[Pick]()
    for place, what in kept.items():
        value, i, start = ranked[place]
        if i not in loaded:
            loaded[i] = load(task, results[i], folder).traces
        trace = loaded[i][start]
        picks.append(Pick(what, results[i].id.name, start, value, trace[: last_step(trace) + 1]))
    worst = loaded[ranked[0][1]][ranked[0][2]]
    loss = first_loss(task, worst) if ranked[0][0] <= 0 else None
    return Story(tuple(picks), len(ranked), place_of(task, picks[-1].trace, reason(task, worst)), loss)
