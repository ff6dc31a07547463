"""Methods over all tasks of a comparison: scores on one scale, aggregates, ranks, probability of improvement."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.records.result import LEARNED
from stlbench.registry.choices import Choice
from stlbench.report.tables.comparisons import Contest, contests
from stlbench.report.tables.rows import Group, Row, unfinished
from stlbench.report.tables.table import Column, Table, Value
from stlbench.report.tables.yardsticks import Known
from stlbench.statistics import across
from stlbench.statistics.across import Estimate, Runs
from stlbench.statistics.intervals import Interval

FEWEST_TASKS = 3
"""Tasks of an aggregate, at least. It has two methods at least."""


@dataclass(frozen=True)
class Entry:
    """One method on all tasks of a field."""

    method: str
    scores: tuple[tuple[float, ...], ...]
    """For each task, one score for each seed: 0 is a policy that acts at random, 1 the best known. A seed without a
    result has 0. Empty for a task that the method does not fit, so that no seed has a result."""
    unfinished: str  # how the cells without a result ended: "40 intractable"; empty if all have one
    classes: tuple[int, ...] = ()
    """For each task: methods of the same class are paid the same there, up to a constant. Empty: none are."""
    satisfaction: tuple[tuple[float, ...], ...] = ()
    """For the seeds behind the scores, the share of starts in [0, 1] that satisfy; 0 for a seed without a result."""

    @property
    def learned(self) -> tuple[tuple[bool, ...], ...]:
        """Whether the seeds learned the task."""
        return tuple(tuple(share >= LEARNED for share in seeds) for seeds in self.satisfaction)

    @property
    def runs(self) -> Runs:
        """The scores of the tasks that it fits, as arrays."""
        return [np.array(seeds) for seeds in self.scores if seeds]

    @property
    def fits(self) -> list[int]:
        """The places of the tasks that it fits."""
        return [place for place, seeds in enumerate(self.scores) if seeds]

    @property
    def coverage(self) -> str:
        """The number of tasks that it fits: "11 of 12"."""
        return f"{len(self.runs)} of {len(self.scores)}"


class Aggregate(NamedTuple):
    entry: Entry
    mean: Estimate
    middle: Estimate  # interquartile mean
    rank: Estimate


class Improvement(NamedTuple):
    """The probability that a run of the method is better than a run of the other."""

    method: str
    other: str
    both_fit: int  # tasks
    probability: Estimate


@dataclass(frozen=True)
class Field:
    """Methods that are compared over the same tasks, each by the task's own agent, with one budget on one track."""

    budget: str
    track: str
    tasks: tuple[str, ...]
    name: str  # which tasks these are: "all 12"; "9 of 12, not trivial"; "4 of 12, not trivial, all methods fit"
    entries: tuple[Entry, ...]
    groups: tuple[Mapping[str, str], ...] = ()
    """For each task its system, template and so on, if suites drew all of them; empty otherwise."""

    @cached_property
    def aggregates(self) -> tuple[Aggregate, ...]:
        """One for each entry; they take a second, and are computed once."""
        return tuple(
            Aggregate(entry, across.mean(entry.runs), across.middle(entry.runs), rank)
            for entry, rank in zip(self.entries, across.ranks(self._by_task), strict=True)
        )

    @cached_property
    def improvements(self) -> tuple[Improvement, ...]:
        """One for each two methods that fit a task in common."""
        rows = []
        for (i, one), (j, other) in combinations(enumerate(self.entries), 2):
            both = [(first, second) for methods in self._by_task if (first := methods[i]) and (second := methods[j])]
            if both:
                # runs of methods that are paid the same count as equal
                runs, other_runs = zip(*((a, b) if k != m else (0 * a, 0 * b) for (k, a), (m, b) in both), strict=True)
                rows.append(Improvement(one.method, other.method, len(both), across.improvement(runs, other_runs)))
        return tuple(rows)

    @property
    def medians(self) -> NDArray[np.float64]:
        """(tasks, methods): the median of each method's runs, where all fit all tasks.

        Methods that are paid the same share the median of all their runs.
        """
        rows = []
        for methods in self._by_task:
            fitting = [method for method in methods if method is not None]
            rows.append(
                [np.median(np.concatenate([runs for own, runs in fitting if own == kind])) for kind, _ in fitting]
            )
        return np.array(rows)

    @property
    def _by_task(self) -> list[list[tuple[int, NDArray[np.float64]] | None]]:
        """For each task and method its class and its runs; None if it does not fit."""
        classes = [entry.classes or (place,) * len(self.tasks) for place, entry in enumerate(self.entries)]
        return [
            [
                (kinds[task], np.array(entry.scores[task])) if entry.scores[task] else None
                for kinds, entry in zip(classes, self.entries, strict=True)
            ]
            for task in range(len(self.tasks))
        ]


def fields(groups: Iterable[Group], known: Known) -> tuple[Field, ...]:
    """The fields of each budget and track.

    One is over the tasks that are not trivial. If some are trivial, one is over all tasks. If not every method fits
    every task, one is over those that are not trivial and that every method fits. Fields have three tasks or more.

    A task counts if it is no ablation, was trained by its own agent, and has a scale: the robustness at random and the
    best known. A method counts if it was tried on all these tasks and fits one that is not trivial.
    """
    by_kind = dict[tuple[str, str], list[Contest]]()
    for (task, agent, budget, track), contest in contests(groups).items():
        reference = known.references.get(task.name)
        own = reference is not None and not task.parameters and str(agent) == reference.own_agent
        if own and len(contest) > 1 and _scale(task, known):
            by_kind.setdefault((budget, track), []).append(contest)
    return tuple(field for key, members in sorted(by_kind.items()) for field in _fields(*key, members, known))


def _scale(task: Choice, known: Known) -> tuple[float, float] | None:
    """Robustness at random and at best."""
    at_random, top = known.references[task.name].at_random, known.level(task)
    return (at_random.mean, top) if at_random and top is not None and at_random.mean < top else None


def _fields(budget: str, track: str, members: Sequence[Contest], known: Known) -> Iterator[Field]:
    hard = [contest for contest in members if not known.references[contest[0].setting.task.name].trivial] or members
    tried = set.intersection(*({group.setting.method for group in contest} for contest in members))
    methods = sorted({group.setting.method for contest in hard for group in contest if group.done} & tried)
    common = [contest for contest in hard if all(group.done for group in contest if group.setting.method in methods)]
    chosen = {len(hard): hard} | {len(members): members} | {len(common): common}
    for count, contests_of in chosen.items():
        if count >= FEWEST_TASKS and len(methods) > 1:
            tasks = tuple(str(contest[0].setting.task) for contest in contests_of)
            parts = ["not trivial"] * (count <= len(hard) < len(members)) + ["all methods fit"] * (count < len(hard))
            name = ", ".join([f"{count} of {len(members)}", *parts]) if parts else f"all {count}"
            entries = tuple(_entry(method, contests_of, known) for method in methods)
            of_tasks = tuple(known.references[contest[0].setting.task.name].groups for contest in contests_of)
            yield Field(budget, track, tasks, name, entries, of_tasks if all(of_tasks) else ())


def _entry(method: Choice, members: Sequence[Contest], known: Known) -> Entry:
    scores, satisfaction = list[tuple[float, ...]](), list[tuple[float, ...]]()
    classes, every = list[int](), list[Row]()
    for contest in members:
        group = next(group for group in contest if group.setting.method == method)
        low, high = _scale(group.setting.task, known) or (0.0, 1.0)
        rows = group.rows if group.done else ()
        values = [row.measurement.score.mean if row.measurement else math.nan for row in rows]
        scores.append(tuple((value - low) / (high - low) if math.isfinite(value) else 0.0 for value in values))
        satisfaction.append(tuple(row.measurement.score.satisfaction if row.measurement else 0.0 for row in rows))
        same = [other is group or known.likeness(group.setting, other.setting) == "=" for other in contest]
        classes.append(same.index(True))  # the place of the first method that is paid the same
        every += group.rows
    return Entry(str(method), tuple(scores), unfinished(every), tuple(classes), tuple(satisfaction))


_FIELD: dict[Column, Callable[[tuple[Field, Any]], Value]] = {
    Column("budget", right=False, shared=True): lambda row: row[0].budget,
    Column("track", right=False, shared=True): lambda row: row[0].track,
    Column("tasks", right=False, shared=True): lambda row: row[0].name,
}


def aggregates_table(several: Iterable[Field]) -> Table:
    """One row for each field and method."""
    columns: dict[Column, Callable[[tuple[Field, Aggregate]], Value]] = {
        **_FIELD,
        Column("method", right=False): lambda row: row[1].entry.method,
        Column("fits", right=False): lambda row: row[1].entry.coverage,
        Column("runs", drop=3): lambda row: sum(map(len, row[1].entry.scores)),
        Column("mean", digits=3, drop=1): lambda row: row[1].mean.value,
        Column("mean 95 % interval", digits=3, kind=Interval, drop=2): lambda row: row[1].mean.interval,
        Column("IQM", digits=3): lambda row: row[1].middle.value,
        Column("IQM 95 % interval", digits=3, kind=Interval): lambda row: row[1].middle.interval,
        Column("rank", digits=2): lambda row: row[1].rank.value,
        Column("rank 95 % interval", digits=2, kind=Interval): lambda row: row[1].rank.interval,
        Column("without a result", right=False): lambda row: row[1].entry.unfinished or None,
    }
    notes = (
        "Robustness of the selected policies, normalised: 0 is what actions at random get on a task, 1 the best known, "
        "or what the controller by hand gets where that is not known. Not trivial: no constant action solves the task.",
        "Fits: on how many of the tasks the method has a result. All other numbers are of these tasks alone, so they "
        "are nothing without it: a method may fit the easy tasks, or meet few rivals. On a task that it fits, a seed "
        "without a result counts as 0.",
        "Over all runs of all tasks: mean and interquartile mean. Rank: place among the methods that fit a task by the "
        "median of the seeds, 1 is the best, mean over tasks; methods that pay the same there share a place. "
        "Intervals: bootstrap over the seeds of each task.",
    )
    rows = ((field, aggregate) for field in several for aggregate in field.aggregates)
    return Table.of("Across tasks", rows, columns, notes)


def improvement_table(several: Iterable[Field]) -> Table:
    """One row for each field and pair of methods."""
    columns: dict[Column, Callable[[tuple[Field, Improvement]], Value]] = {
        **_FIELD,
        Column("method", right=False): lambda row: row[1].method,
        Column("other", right=False): lambda row: row[1].other,
        Column("both fit", right=False): lambda row: f"{row[1].both_fit} of {len(row[0].tasks)}",
        Column("probability", digits=2): lambda row: row[1].probability.value,
        Column("95 % interval", digits=2, kind=Interval): lambda row: row[1].probability.interval,
    }
    note = (
        "That a run of the method does better than a run of the other on the same task, mean over the tasks that both "
        "fit; 0.5 says neither does, as on a task where both pay the same."
    )
    rows = ((field, improvement) for field in several for improvement in field.improvements)
    return Table.of("Probability of improvement", rows, columns, (note,))
