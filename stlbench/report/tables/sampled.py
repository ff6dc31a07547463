"""Methods on tasks that a suite drew: over all of them, and over each group, such as a template or a tier."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from stlbench.report.tables.across import Entry, Field
from stlbench.report.tables.table import Column, Table, Value
from stlbench.statistics import sampled
from stlbench.statistics.across import Estimate
from stlbench.statistics.intervals import Interval

ALL = "all"


class Part(NamedTuple):
    """Tasks of one group, or all tasks."""

    kind: str  # of groups, such as template
    group: str
    places: tuple[int, ...]
    """Of its tasks in the field."""


def parts(field: Field) -> Iterator[Part]:
    """All tasks first; then each group of each kind, kinds and groups in the order of their first tasks."""
    everywhere = tuple(range(len(field.tasks)))
    yield Part(ALL, ALL, everywhere)
    for kind in field.groups[0]:
        for group in sorted({groups[kind] for groups in field.groups}):
            yield Part(kind, group, tuple(place for place in everywhere if field.groups[place][kind] == group))


def drawn(fields: Iterable[Field]) -> list[Field]:
    """Of each budget and track the first field, if suites drew all its tasks."""
    first = dict[tuple[str, str], Field]()
    for field in fields:
        first.setdefault((field.budget, field.track), field)
    return [field for field in first.values() if field.groups]


_WHERE = (
    Column("budget", right=False, shared=True),
    Column("track", right=False, shared=True),
    Column("by", right=False),
    Column("group", right=False),
)
_INTERVALS = (
    "Tasks count as a sample of what the suite draws. Intervals: hierarchical bootstrap, which draws tasks and then "
    f"seeds; each is for itself at 95 %. Groups with fewer than {sampled.FEWEST} tasks have none."
)


def groups_table(fields: Iterable[Field]) -> Table:
    """One row for each method on all tasks and on each group, of the methods that fit any of its tasks."""
    columns = (
        *_WHERE,
        Column("method", right=False),
        Column("fits", right=False),
        Column("learned", unit="%", digits=0),
        Column("learned 95 % interval", unit="%", digits=0, kind=Interval),
        Column("score", digits=2),
        Column("score 95 % interval", digits=2, kind=Interval),
    )
    rows = tuple(
        (*_where(field, part), entry.method, *_method(entry, part))
        for field in drawn(fields)
        for part in parts(field)
        for entry in field.entries
        if any(entry.scores[place] for place in part.places)
    )
    notes = (
        "Learned: seeds whose policy satisfies from nearly all starts. Score: normalised robustness of the selected "
        "policies, 0 at random and 1 the best known. Both are means over the tasks that the method fits.",
        "Fits: coverage, on how many of the group's tasks the method has a result. A method with a low coverage "
        "may fit the easy tasks.",
        _INTERVALS,
    )
    return Table("Groups of drawn tasks", columns, rows, notes)


def _method(entry: Entry, part: Part) -> tuple[Value, ...]:
    fitting = [place for place in part.places if entry.scores[place]]
    learned = _percent(sampled.share([entry.learned[place] for place in fitting]))
    score = sampled.mean([np.array(entry.scores[place]) for place in fitting])
    return f"{len(fitting)} of {len(part.places)}", *learned, *score


def pairs_table(fields: Iterable[Field]) -> Table:
    """One row for each two methods on all tasks and on each group, over the tasks that both fit."""
    columns = (
        *_WHERE,
        Column("method", right=False),
        Column("other", right=False),
        Column("both fit", right=False),
        Column("learned more often", unit="%", digits=0),
        Column("learned 95 % interval", unit="%", digits=0, kind=Interval),
        Column("higher score", digits=2),
        Column("score 95 % interval", digits=2, kind=Interval),
    )
    rows = tuple(
        (*_where(field, part), one.method, other.method, *values)
        for field in drawn(fields)
        for part in parts(field)
        for one, other in combinations(field.entries, 2)
        if (values := _pair(one, other, part))
    )
    note = "By how much the method has more than the other, mean over the tasks that both fit. "
    return Table("Differences on drawn tasks", columns, rows, (note + _INTERVALS,))


def _pair(one: Entry, other: Entry, part: Part) -> tuple[Value, ...]:
    """Empty where no task fits both."""
    both = [place for place in part.places if one.scores[place] and other.scores[place]]
    if not both:
        return ()

    def more(name: str) -> Estimate:
        first, second = (
            [np.array(getattr(entry, name)[place], dtype=float) for place in both] for entry in (one, other)
        )
        return sampled.difference(first, second)

    return f"{len(both)} of {len(part.places)}", *_percent(more("learned")), *more("scores")


def _percent(estimate: Estimate) -> tuple[float, Interval | None]:
    value, ends = estimate
    return 100 * value, ends and Interval(100 * ends.low, 100 * ends.high)


def _where(field: Field, part: Part) -> tuple[str, ...]:
    return field.budget, field.track, part.kind, part.group
