"""Methods on tasks that a suite drew: over all of them, and over each group, such as a template or a tier."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from stlbench.report.tables.across import Entry, Field
from stlbench.report.tables.table import Column, Table, Value
from stlbench.statistics import sampled
from stlbench.statistics.across import Estimate, Runs
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


class Line(NamedTuple):
    """A row of either table: over the tasks of a part that the method fits, or that both methods fit."""

    field: Field
    part: Part
    method: str
    other: str  # empty in the table of groups
    tasks: int  # how many these are
    learned: Estimate  # shares of seeds in [0, 1], or their difference
    score: Estimate


_Columns = dict[Column, Callable[[Line], Value]]
_WHERE: _Columns = {
    Column("budget", right=False, shared=True): lambda line: line.field.budget,
    Column("track", right=False, shared=True): lambda line: line.field.track,
    Column("by", right=False): lambda line: line.part.kind,
    Column("group", right=False): lambda line: line.part.group,
    Column("method", right=False): lambda line: line.method,
}
_OTHER: _Columns = {Column("other", right=False): lambda line: line.other}
_INTERVALS = (
    "Tasks count as a sample of what the suite draws. Intervals: hierarchical bootstrap, which draws tasks and then "
    f"seeds; each is for itself at 95 %. Groups with fewer than {sampled.FEWEST} tasks have none."
)


def _numbers(fits: str, learned: str, score: str) -> _Columns:
    """The last columns, with the titles of a table."""
    return {
        Column(fits, right=False): lambda line: f"{line.tasks} of {len(line.part.places)}",
        Column(learned, unit="%", digits=0): lambda line: 100 * line.learned.value,
        Column("learned 95 % interval", unit="%", digits=0, kind=Interval): (
            lambda line: (ends := line.learned.interval) and Interval(100 * ends.low, 100 * ends.high)
        ),
        Column(score, digits=2): lambda line: line.score.value,
        Column("score 95 % interval", digits=2, kind=Interval): lambda line: line.score.interval,
    }


def group_lines(field: Field) -> Iterator[Line]:
    """One for each method on all tasks and on each group, of the methods that fit any of its tasks."""
    for part in parts(field):
        for entry in field.entries:
            if own := _fitting(part, entry):
                learned = sampled.share([entry.learned[place] for place in own])
                yield Line(field, part, entry.method, "", len(own), learned, sampled.mean(_of(entry.scores, own)))


def groups_table(fields: Iterable[Field]) -> Table:
    """One row for each line of the first field of each budget and track."""
    lines = (line for field in drawn(fields) for line in group_lines(field))
    notes = (
        "Learned: seeds whose policy satisfies from nearly all starts. Score: normalised robustness of the selected "
        "policies, 0 at random and 1 the best known. Both are means over the tasks that the method fits.",
        "Fits: coverage, on how many of the group's tasks the method has a result. A method with a low coverage "
        "may fit the easy tasks.",
        _INTERVALS,
    )
    return Table.of("Groups of drawn tasks", lines, _WHERE | _numbers("fits", "learned", "score"), notes)


def pairs_table(fields: Iterable[Field]) -> Table:
    """One row for each two methods on all tasks and on each group, over the tasks that both fit."""
    lines = (
        Line(
            *(field, part, one.method, other.method, len(both)),
            sampled.difference(_of(one.learned, both), _of(other.learned, both)),
            sampled.difference(_of(one.scores, both), _of(other.scores, both)),
        )
        for field in drawn(fields)
        for part in parts(field)
        for one, other in combinations(field.entries, 2)
        if (both := _fitting(part, one, other))
    )
    columns = _WHERE | _OTHER | _numbers("both fit", "learned more often", "higher score")
    note = "By how much the method has more than the other, mean over the tasks that both fit. "
    return Table.of("Differences on drawn tasks", lines, columns, (note + _INTERVALS,))


def _fitting(part: Part, *entries: Entry) -> list[int]:
    """The places of the part's tasks that all these methods fit."""
    return [place for place in part.places if all(entry.scores[place] for entry in entries)]


def _of(seeds: Sequence[Sequence[float]], places: Iterable[int]) -> Runs:
    return [np.array(seeds[place], dtype=float) for place in places]
