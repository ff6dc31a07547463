"""Methods over all tasks of a comparison: scores on one scale, aggregates, ranks, probability of improvement."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from stlbench.registry.choices import Choice
from stlbench.report.statistics import across
from stlbench.report.statistics.across import Estimate, Runs
from stlbench.report.statistics.intervals import Interval
from stlbench.report.tables.contests import Contest, contests, level
from stlbench.report.tables.rows import Group, Row
from stlbench.report.tables.table import Column, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

__all__ = [
    "FEWEST_TASKS",
    "Aggregate",
    "Entry",
    "Field",
    "aggregates",
    "aggregates_table",
    "fields",
    "improvement_table",
]

FEWEST_TASKS = 3
"""Aggregates are over so many tasks at least, and two methods."""


@dataclass(frozen=True)
class Entry:
    """One method on all tasks of a field."""

    method: str
    scores: tuple[tuple[float, ...], ...]
    """Of each task, of each seed: 0 is a policy that acts at random, 1 the best possible; 0 without a result."""
    unfinished: str
    """How the cells without a result ended: "40 intractable"; empty where there are none."""

    @property
    def runs(self) -> Runs:
        """The scores as arrays."""
        return [np.array(seeds) for seeds in self.scores]


@dataclass(frozen=True)
class Field:
    """Methods that are compared over the same tasks, each by the task's own agent, with one budget on one track."""

    budget: str
    track: str
    tasks: tuple[str, ...]
    of: int
    """How many tasks there are; fewer are compared where only those count that all methods finished."""
    entries: tuple[Entry, ...]

    @property
    def name(self) -> str:
        """ "all 12"; "the 4 of 12 that all finished"."""
        count = len(self.tasks)
        return f"all {self.of}" if count == self.of else f"the {count} of {self.of} that all finished"


@dataclass(frozen=True)
class Aggregate:
    """What is said of one method over the tasks of a field."""

    entry: Entry
    mean: Estimate
    middle: Estimate
    """Interquartile mean."""
    rank: Estimate


def fields(
    groups: Iterable[Group], standards: Mapping[str, Standard], best: Mapping[Choice, float]
) -> tuple[Field, ...]:
    """The fields of each budget and track: over all tasks, and over those of which each method finished a cell, where
    these are others.

    A task counts if it is no ablation, if it is known what actions at random and the best policy get, and if it was
    trained by its own agent. A method counts if it was tried on all these tasks. Fields have three tasks or more.
    """
    found = dict[tuple[str, str], list[Contest]]()
    for (task, agent, budget, track), contest in contests(groups).items():
        standard = standards.get(task.name)
        own = standard is not None and not task.parameters and str(agent) == standard.own_agent
        if own and len(contest) > 1 and _scale(task, standards, best):
            found.setdefault((budget, track), []).append(contest)
    return tuple(field for key, members in sorted(found.items()) for field in _fields(*key, members, standards, best))


def _scale(task: Choice, standards: Mapping[str, Standard], best: Mapping[Choice, float]) -> tuple[float, float] | None:
    """Robustness at random and at best."""
    at_random, top = standards[task.name].at_random, level(task, standards, best)
    return (at_random.mean, top) if at_random and top is not None and at_random.mean < top else None


def _fields(
    budget: str,
    track: str,
    members: Sequence[Contest],
    standards: Mapping[str, Standard],
    best: Mapping[Choice, float],
) -> Iterable[Field]:
    methods = sorted(set.intersection(*({group.setting.method for group in contest} for contest in members)))
    finished = [
        contest for contest in members if all(group.done for group in contest if group.setting.method in methods)
    ]
    for chosen in [members, *([finished] if len(finished) < len(members) else [])]:
        if len(chosen) >= FEWEST_TASKS and len(methods) > 1:
            tasks = tuple(str(contest[0].setting.task) for contest in chosen)
            entries = tuple(_entry(method, chosen, standards, best) for method in methods)
            yield Field(budget, track, tasks, len(members), entries)


def _entry(
    method: Choice, members: Sequence[Contest], standards: Mapping[str, Standard], best: Mapping[Choice, float]
) -> Entry:
    groups = [group for contest in members for group in contest if group.setting.method == method]
    scores = []
    for group in groups:
        low, high = _scale(group.setting.task, standards, best) or (0.0, 1.0)
        scores.append(tuple(_score(row, low, high) for row in group.rows))
    ended = Counter(row.status for group in groups for row in group.rows if row.status != "done")
    return Entry(str(method), tuple(scores), ", ".join(f"{count} {status}" for status, count in ended.items()))


def _score(row: Row, low: float, high: float) -> float:
    """0 without a result, or where the robustness is no finite number."""
    value = row.numbers.robustness_mean if row.numbers else math.nan
    return (value - low) / (high - low) if math.isfinite(value) else 0.0


@lru_cache(maxsize=64)
def aggregates(field: Field) -> tuple[Aggregate, ...]:
    """Of each method of a field. Cached: it takes a second, and screen, files and figures ask for it."""
    runs = [entry.runs for entry in field.entries]
    return tuple(
        Aggregate(entry, across.mean(scores), across.middle(scores), rank)
        for entry, scores, rank in zip(field.entries, runs, across.ranks(runs), strict=True)
    )


@lru_cache(maxsize=64)
def _improvements(field: Field) -> tuple[tuple[str, str, Estimate], ...]:
    return tuple(
        (one.method, other.method, across.improvement(one.runs, other.runs))
        for one, other in combinations(field.entries, 2)
    )


_FIELD = (
    Column("budget", right=False, shared=True),
    Column("track", right=False, shared=True),
    Column("tasks", right=False, shared=True),
)


def aggregates_table(found: Iterable[Field]) -> Table:
    """One row per field and method."""
    columns = (
        *_FIELD,
        Column("method", right=False),
        Column("runs", drop=3),
        Column("mean", digits=3, drop=1),
        Column("mean 95 % interval", digits=3, kind=Interval, drop=2),
        Column("IQM", digits=3),
        Column("IQM 95 % interval", digits=3, kind=Interval),
        Column("rank", digits=2),
        Column("rank 95 % interval", digits=2, kind=Interval),
        Column("without a result", right=False),
    )
    rows = tuple(_row(field, each) for field in found for each in aggregates(field))
    return Table("Across tasks", columns, rows, _NOTES)


def _row(field: Field, found: Aggregate) -> tuple[Value, ...]:
    runs = sum(map(len, found.entry.scores))
    estimates = [part for estimate in (found.mean, found.middle, found.rank) for part in estimate]
    return (*_field(field), found.entry.method, runs, *estimates, found.entry.unfinished or None)


_NOTES = (
    "Robustness of the selected policies, normalised: 0 is what actions at random get on a task, 1 the best possible, "
    "or what the controller by hand gets where that is not known. Cells without a result count as 0.",
    "Over all runs of all tasks: mean and interquartile mean. Rank: place among the methods by the IQM of a task's "
    "seeds, 1 is the best, mean over tasks. Intervals: bootstrap over the seeds of each task.",
)


def improvement_table(found: Iterable[Field]) -> Table:
    """One row per field and pair of methods."""
    columns = (
        *_FIELD,
        Column("method", right=False),
        Column("other", right=False),
        Column("probability", digits=2),
        Column("95 % interval", digits=2, kind=Interval),
    )
    rows = tuple(
        (*_field(field), one, other, *estimate) for field in found for one, other, estimate in _improvements(field)
    )
    note = (
        "That a run of the method does better than a run of the other on the same task, mean over the tasks; 0.5 says "
        "neither does."
    )
    return Table("Probability of improvement", columns, rows, (note,))


def _field(field: Field) -> tuple[str, str, str]:
    return field.budget, field.track, field.name
