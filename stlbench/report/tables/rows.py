"""A few numbers of each cell, and groups of cells that differ in nothing but the seed."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal, TypeVar

from stlbench.errors import UsageError
from stlbench.records.identity import OUTSIDE, CellId, Setting
from stlbench.records.result import NOT_RUN, SCHEMA, Measurement, Result, Status
from stlbench.registry import plugins
from stlbench.report.tables.table import Column, FirstFailed, Seeds, Value
from stlbench.statistics.intervals import mean, median

_T = TypeVar("_T")
_Part = TypeVar("_Part")


@dataclass(frozen=True)
class Row:
    """One cell, without the values of single starts, so that thousands of cells fit into memory."""

    id: CellId
    status: Status | Literal["not run", "not scored"]
    reason: str
    provenance: Mapping[str, str]  # how the result came about (`provenance.collect`)
    measurement: Measurement | None


@dataclass(frozen=True)
class Group:
    """The cells that differ in nothing but the seed, in the order of their seeds."""

    setting: Setting
    rows: tuple[Row, ...]

    @property
    def outside(self) -> bool:
        """Whether stlbench did not train these policies."""
        return self.setting.track == OUTSIDE

    @cached_property
    def done(self) -> tuple[Measurement, ...]:
        """The measurements of the finished cells; every aggregate is over these."""
        return tuple(row.measurement for row in self.rows if row.measurement is not None)

    def values(self, name: str) -> tuple[Any, ...]:
        """One column of `SCHEMA`, of each finished cell."""
        return tuple(map(SCHEMA[name].of, self.done))

    @property
    def learned(self) -> tuple[bool, ...]:
        """Whether the selected policy of each finished cell learned the task."""
        return tuple(measured.score.learned for measured in self.done)

    @property
    def final_learned(self) -> tuple[bool, ...]:
        return tuple(measured.final_score.learned for measured in self.done)

    def mean(self, name: str) -> float | None:
        return mean(self.values(name))

    def median(self, name: str) -> float | None:
        values = self.values(name)
        return median(values) if values else None

    @property
    def tried(self) -> int:
        """How many seeds ran, with a result or without."""
        return sum(row.status != NOT_RUN for row in self.rows)

    @property
    def extension(self) -> str:
        """Why the task is outside the form of the method's source, as far as any cell says."""
        return next(filter(None, self.values("extension")), "")

    @property
    def seeds(self) -> Seeds:
        return Seeds(len(self.done), len(self.rows), unfinished(self.rows) or None)

    @property
    def remarks(self) -> str:
        """Status and reason of the cells that ended without a measurement, each once."""
        ended = Counter((row.status, row.reason) for row in self.rows if row.status not in ("done", NOT_RUN))
        return "; ".join(f"{status}: {reason}" if reason else status for status, reason in ended)

    @cached_property
    def first_failed(self) -> FirstFailed | None:
        """The conjunct that failed first most often, over the starts of all seeds; None if none failed."""
        counts = sum((Counter(measured.score.first_failed) for measured in self.done), Counter[str]())
        if not counts:
            return None
        formula = min(counts, key=lambda text: (-counts[text], text))
        return FirstFailed(formula, counts[formula], counts.total())


def unfinished(rows: Iterable[Row]) -> str:
    """How the cells without a result ended: "40 intractable, 1 timeout"; empty if all have one."""
    ended = Counter(row.status for row in rows if row.status != "done")
    return ", ".join(f"{count} {status}" for status, count in ended.items())


def missing_row(cell: CellId) -> Row:
    return Row(cell, NOT_RUN, "", {}, None)


def row(result: Result) -> Row:
    return Row(
        id=result.id,
        status=result.status,
        reason=result.reason,
        provenance=_shared(tuple(result.provenance.items())),
        measurement=result.measurement and result.measurement.summarised(),
    )


@lru_cache(maxsize=64)
def _shared(items: tuple[tuple[str, str], ...]) -> Mapping[str, str]:
    """The items as a mapping, one object for all cells of a run."""
    return dict(items)


def group(rows: Iterable[Row]) -> tuple[Group, ...]:
    gathered: dict[Setting, list[Row]] = {}
    for row in rows:
        gathered.setdefault(row.id.setting, []).append(row)
    return tuple(
        Group(setting, tuple(sorted(gathered[setting], key=lambda row: row.id.seed))) for setting in sorted(gathered)
    )


def trained(groups: Iterable[Group]) -> tuple[Group, ...]:
    return tuple(group for group in groups if not group.outside)


Maximised = Literal["reward", "formula"]


def maximised(groups: Iterable[Group]) -> dict[str, Maximised]:
    """Agent that plans -> what it maximises, by its cells, or else by the installed agent."""
    known, groups = dict[str, Maximised | None](), trained(groups)
    for group in groups:
        plans = next(filter(None, group.values("maximised")), None)
        if group.done:
            known[group.setting.agent.name] = plans
    for name in {group.setting.agent.name for group in groups} - known.keys():
        with suppress(UsageError):
            known[name] = getattr(plugins.find("agents", name).load(), "plans", None)
    return {name: plans for name, plans in known.items() if plans is not None}


def split(groups: Sequence[Group]) -> tuple[tuple[Group, ...], tuple[Group, ...]]:
    """The groups of agents that learn, and of agents that plan; policies from outside are in neither."""
    planners, own = maximised(groups), trained(groups)
    learned = tuple(group for group in own if group.setting.agent.name not in planners)
    return learned, tuple(group for group in own if group.setting.agent.name in planners)


CONTESTANT: Mapping[Column, Callable[[Group], Value]] = {
    Column("task", right=False, shared=True): lambda group: str(group.setting.task),
    Column("method", right=False): lambda group: str(group.setting.method),
    Column("agent", right=False, shared=True): lambda group: str(group.setting.agent),
    Column("budget", right=False, shared=True): lambda group: "unknown" if group.outside else group.setting.budget,
    Column("track", right=False, shared=True): lambda group: group.setting.track,
}
"""The columns that say which group a row is of."""
SETTING = {**CONTESTANT, Column("seeds", right=False, kind=Seeds): lambda group: group.seeds}
"""These, and how many of its seeds have a result."""


def columns_of(
    part: Callable[[_T], _Part | None], columns: Mapping[Column, Callable[[_Part], Value]]
) -> dict[Column, Callable[[_T], Value]]:
    """The columns of a part, for items that have it; None for an item that does not."""

    def of_item(value: Callable[[_Part], Value]) -> Callable[[_T], Value]:
        return lambda item: None if (found := part(item)) is None else value(found)

    return {column: of_item(value) for column, value in columns.items()}


def shared_columns(group_of: Callable[[_T], Group]) -> dict[Column, Callable[[_T], Value]]:
    """Task, agent, budget and track, for items of which each belongs to a group."""
    return columns_of(group_of, {column: value for column, value in SETTING.items() if column.shared})
