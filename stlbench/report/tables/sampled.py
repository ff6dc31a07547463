"""Methods on tasks that a suite drew: over all of them, and over each group, such as a template or a tier."""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import combinations
from typing import NamedTuple, TypeVar

import numpy as np

from stlbench.report.tables.across import Entry, Field
from stlbench.report.tables.rows import columns_of
from stlbench.report.tables.table import Column, Table, Value
from stlbench.statistics import across
from stlbench.statistics.across import Estimate, Runs
from stlbench.statistics.intervals import Interval

ALL = "all"
_T = TypeVar("_T")


class TaskSet(NamedTuple):
    """Tasks of one group, or all tasks."""

    kind: str  # of groups, such as template
    group: str
    places: tuple[int, ...]
    """The number of its tasks in the field."""


def parts(field: Field) -> Iterator[TaskSet]:
    """All tasks first; then each group of each kind, kinds and groups in the order of their first tasks."""
    everywhere = tuple(range(len(field.tasks)))
    yield TaskSet(ALL, ALL, everywhere)
    for kind in field.groups[0]:
        for group in sorted({groups[kind] for groups in field.groups}):
            yield TaskSet(kind, group, tuple(place for place in everywhere if field.groups[place][kind] == group))


def drawn(fields: Iterable[Field]) -> list[Field]:
    """The first field of each budget and track, if suites drew all its tasks."""
    first = dict[tuple[str, str], Field]()
    for field in fields:
        first.setdefault((field.budget, field.track), field)
    return [field for field in first.values() if field.groups]


class Reached(NamedTuple):
    """A method's score on some tasks of a part, or its lead over another method."""

    tasks: int
    learned: Estimate  # shares of seeds in [0, 1], or their difference
    score: Estimate


class Line(NamedTuple):
    """A row of either table."""

    field: Field
    part: TaskSet
    method: str
    other: str  # empty in the table of groups
    common: Reached | None  # on the tasks of `common`; None where the method does not fit them all, or there are none
    fitted: Reached  # on the tasks that the method fits, or that both methods fit


def common(fits: Iterable[Collection[_T]], tasks: int) -> set[_T]:
    """The tasks on which methods are compared: those common to all methods that fit at least half of so many tasks.

    Shares over different tasks say nothing of methods. A method that fits few tasks would leave few in common.
    """
    many = [set(own) for own in fits if len(own) >= tasks / 2]
    return set[_T].intersection(*many) if many else set()


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
    "Tasks count as a sample of what the suite draws. Intervals at 95 %, each for itself: of shares for a number of "
    "trials (as Clopper and Pearson 1934), of their differences Student's with a task more that each method wins, of "
    "scores a hierarchical bootstrap, which draws tasks and then seeds. This is too narrow where few tasks have "
    f"another score than most. Groups with fewer than {across.FEWEST} tasks have none."
)
_Of = Callable[[Line], Reached | None]


def _numbers(of: _Of, tasks: str, learned: str, score: str, where: str = "", drop: int = 0) -> _Columns:
    """Columns of what was reached, with the titles of a table, and of what has to be said of the tasks."""

    first: _Columns = {
        Column(tasks, right=False): lambda line: f"{getattr(of(line), 'tasks', 0)} of {len(line.part.places)}"
    }
    later = drop and drop + 1
    numbers: dict[Column, Callable[[Reached], Value]] = {
        Column(f"{learned}{where}", unit="%", digits=0, drop=drop): lambda found: 100 * found.learned.value,
        Column(f"learned{where} 95 % interval", unit="%", digits=0, kind=Interval, drop=later): (
            lambda found: found.learned.interval and found.learned.interval.percent
        ),
        Column(f"{score}{where}", digits=2, drop=drop): lambda found: found.score.value,
        Column(f"score{where} 95 % interval", digits=2, kind=Interval, drop=later): lambda found: found.score.interval,
    }
    return first | columns_of(of, numbers)


def group_lines(field: Field) -> Iterator[Line]:
    """One for each method on all tasks and on each group, of the methods that fit any of its tasks."""
    for part in parts(field):
        fits = [_fitting(part, entry) for entry in field.entries]
        shared = common(fits, len(part.places))
        for entry, own in zip(field.entries, fits, strict=True):
            if own:
                compared = _reached(entry, sorted(shared)) if shared and shared <= {*own} else None
                yield Line(field, part, entry.method, "", compared, _reached(entry, own))


def _reached(entry: Entry, places: Sequence[int]) -> Reached:
    learned = across.sample_share([entry.learned[place] for place in places])
    return Reached(len(places), learned, across.sample_mean(_of(entry.scores, places)))


def groups_table(fields: Iterable[Field]) -> Table:
    """One row for each line of the first field of each budget and track."""
    lines = (line for field in drawn(fields) for line in group_lines(field))
    notes = (
        "Learned: seeds whose policy satisfies from nearly all starts. Score: normalised robustness of the selected "
        "policies, 0 at random and 1 the best known. Both are means over tasks.",
        "Common: methods are compared on the tasks that all methods fit which fit at least half of the group's. A "
        "method that does not fit all of these has 0 there, and no numbers.",
        "Fits: coverage, on how many of the group's tasks the method has a result. What follows is over these: it says "
        "how good the method is there, and does not compare it, since a method may fit the easy tasks.",
        _INTERVALS,
    )
    columns = {
        **_WHERE,
        **_numbers(lambda line: line.common, "common", "learned", "score"),
        **_numbers(lambda line: line.fitted, "fits", "learned", "score", " of all it fits", drop=1),
    }
    return Table.of("Groups of drawn tasks", lines, columns, notes)


def pairs_table(fields: Iterable[Field]) -> Table:
    """One row for each two methods on all tasks and on each group, over the tasks that both fit."""
    lines = (
        Line(field, part, one.method, other.method, None, _more(one, other, both))
        for field in drawn(fields)
        for part in parts(field)
        for one, other in combinations(field.entries, 2)
        if (both := _fitting(part, one, other))
    )
    columns = _WHERE | _OTHER | _numbers(lambda line: line.fitted, "both fit", "learned more often", "higher score")
    note = "How much more the method has than the other, mean over the tasks that both fit. "
    return Table.of("Differences on drawn tasks", lines, columns, (note + _INTERVALS,))


def _more(one: Entry, other: Entry, places: Sequence[int]) -> Reached:
    """The lead of the one over the other."""
    learned = ([entry.learned[place] for place in places] for entry in (one, other))
    scores = (_of(entry.scores, places) for entry in (one, other))
    return Reached(len(places), across.sample_share_difference(*learned), across.sample_difference(*scores))


def _fitting(part: TaskSet, *entries: Entry) -> list[int]:
    """The places of the part's tasks that all these methods fit."""
    return [place for place in part.places if all(entry.scores[place] for entry in entries)]


def _of(seeds: Sequence[Sequence[float]], places: Iterable[int]) -> Runs:
    return [np.array(seeds[place], dtype=float) for place in places]
